/* SPDX-License-Identifier: Apache-2.0 */
/* One Adam step (Kingma and Ba 2015). Include a real_*.h or simd.h first. */
#ifndef SG_MATH_ADAM_H
#define SG_MATH_ADAM_H

#include "constants.h"

/* rate = lr / (1 - beta1^t), root = 1 / sqrt(1 - beta2^t). Returns the new parameter. */
static inline real adam_step(real p, real g, real *m, real *v, scalar rate, scalar root)
{
    const scalar b1 = (scalar) SG_ADAM_BETA1, b2 = (scalar) SG_ADAM_BETA2;
    *m = b1 * *m + ((scalar) 1 - b1) * g;
    *v = b2 * *v + ((scalar) 1 - b2) * g * g;
    /* The bound keeps the fast reciprocal of an infinite moment from being NaN. */
    return p -
           rate * *m *
               r_reciprocal(r_min(r_sqrt(*v) * root, r_set((scalar) 1e30)) + (scalar) SG_ADAM_EPS);
}

#endif
