/* SPDX-License-Identifier: Apache-2.0 */
/* The arithmetic of src/math is written once, over `real` and `mask`. This file makes them double
 * and bool, for finite differences. */
#ifndef SG_MATH_REAL_H
#define SG_MATH_REAL_H

#include <math.h>
#include <stdbool.h>

#include "dialect.h"

typedef double real;
typedef double scalar; /* one lane of real */
typedef bool mask;

static inline real r_sel(mask m, real a, real b)
{
    return m ? a : b;
}
static inline real r_sqrt(real a)
{
    return sqrt(a);
}
static inline real r_root(real a)
{
    return sqrt(a);
} /* vectors may round it within 1e-4 */
static inline real r_exp(real a)
{
    return exp(a);
}
static inline real r_log(real a)
{
    return log(a);
}
static inline real r_log1p(real a)
{
    return log1p(a);
}
static inline real r_abs(real a)
{
    return fabs(a);
}
static inline real r_set(scalar a)
{
    return a;
}
static inline real r_reciprocal(real a)
{
    return 1 / a;
}
#define r_lt(a, b) ((a) < (b))
#define r_le(a, b) ((a) <= (b))
#define r_and(a, b) ((a) && (b))
static inline real r_max(real a, real b)
{
    return a > b ? a : b;
}
static inline real r_min(real a, real b)
{
    return a < b ? a : b;
}
static inline real r_min_keep(mask m, real a, real b)
{
    return m ? r_min(a, b) : 0;
}

#endif
