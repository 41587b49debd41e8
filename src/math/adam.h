/* SPDX-License-Identifier: Apache-2.0 */
/* One Adam step (Kingma and Ba 2015). Include a real_*.h or simd.h first. */
#ifndef SG_MATH_ADAM_H
#define SG_MATH_ADAM_H

#include "constants.h"

/* A parameter and its moments. */
struct adam_state {
    real p, m, v;
};

/* rate = lr / (1 - beta1^t), root = 1 / sqrt(1 - beta2^t). */
SG_FN STRUCT(adam_state) adam_step(STRUCT(adam_state) s, real g, scalar rate, scalar root)
{
    const scalar b1 = NUM(SG_ADAM_BETA1), b2 = NUM(SG_ADAM_BETA2);
    s.m = b1 * s.m + (NUM(1) - b1) * g;
    s.v = b2 * s.v + (NUM(1) - b2) * g * g;
    /* The bound keeps the fast reciprocal of an infinite moment from being NaN. */
    s.p = s.p -
          rate * s.m * r_reciprocal(r_min(r_sqrt(s.v) * root, r_set(NUM(1e30))) + NUM(SG_ADAM_EPS));
    return s;
}

#endif
