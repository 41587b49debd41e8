/* SPDX-License-Identifier: Apache-2.0 */
/* The files of src/math that include no header of the C library are C11 and GLSL at once, so that
 * every engine computes by the same lines. They are written in what both languages share:
 *
 *   SG_FN                       before a function
 *   STRUCT(name)                the type of a struct; small ones are passed and returned by value
 *   IN(name, x), OUT(name, x)   a large struct as a parameter: a pointer in C
 *   REF(x)                      what such a parameter holds
 *   IN_ARRAY(type, name, n),    an array as a parameter: a pointer in C; `in`, `out` or `inout` in
 *   OUT_ARRAY(type, name, n),   GLSL
 *   INOUT_ARRAY(type, name, n)
 *   SG_TABLE                    before a constant array
 *   NUM(x)                      a number in the precision of the arithmetic
 *   TO_INT(x), TO_FLOAT(x)      conversions
 *   WORD                        the unsigned type of 32 bits
 *   PRECISE                     before a variable that is rounded as it is written in every use
 *
 * There are no pointers, casts or static variables, and no names that GLSL reserves. This is the C
 * side; math/real_glsl.h is the other. */
#ifndef SG_MATH_DIALECT_H
#define SG_MATH_DIALECT_H

#define SG_FN static inline
#define STRUCT(name) struct name
#define IN(name, x) const struct name *x
#define OUT(name, x) struct name *x
#define REF(x) (*(x))
#define IN_ARRAY(type, name, n) const type *name
#define OUT_ARRAY(type, name, n) type *name
#define INOUT_ARRAY(type, name, n) type *name
#define SG_TABLE static const
#define NUM(x) ((scalar) (x))
#define TO_INT(x) ((int) (x))
#define TO_FLOAT(x) ((float) (x))
#define WORD uint32_t
#define PRECISE

#endif
