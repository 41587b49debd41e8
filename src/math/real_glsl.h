/* SPDX-License-Identifier: Apache-2.0 */
/* GLSL's side of math/dialect.h, with `real` as one float. After it no `layout(scalar)` can be
 * written, for `scalar` is a macro. */
#ifndef SG_MATH_REAL_H
#define SG_MATH_REAL_H

#define SG_GLSL

#define real float
#define scalar float
#define mask bool

#define SG_FN
#define STRUCT(name) name
#define IN(name, x) in name x
#define OUT(name, x) out name x
#define REF(x) x
#define IN_ARRAY(type, name, n) in type name[n]
#define OUT_ARRAY(type, name, n) out type name[n]
#define INOUT_ARRAY(type, name, n) inout type name[n]
#define SG_TABLE const
#define NUM(x) float(x)
#define TO_INT(x) int(x)
#define TO_FLOAT(x) float(x)
#define WORD uint
#define PRECISE precise

#define r_sel(m, a, b) ((m) ? (a) : (b))
#define r_sqrt(a) sqrt(a)
#define r_root(a) sqrt(a)
#define r_exp(a) exp(a)
#define r_log(a) log(a)
#define r_log1p(a) log(1.0 + (a)) /* within 1e-6, which is much of a small result */
#define r_abs(a) abs(a)
#define r_set(a) float(a)
#define r_reciprocal(a) (1.0 / (a))
#define r_lt(a, b) ((a) < (b))
#define r_le(a, b) ((a) <= (b))
#define r_and(a, b) ((a) && (b))
#define r_min_keep(m, a, b) ((m) ? min(a, b) : 0.0) /* where m, neither is NaN */

/* GLSL does not promise which operand max and min return where one is NaN. */
float r_max(float a, float b)
{
    return a > b ? a : b;
}
float r_min(float a, float b)
{
    return a < b ? a : b;
}

#endif
