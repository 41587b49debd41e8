/* SPDX-License-Identifier: Apache-2.0 */
/* Total variation, as an attack makes it large and as a loss keeps it small. */
#ifndef SPLATGUARD_VARIATION_H
#define SPLATGUARD_VARIATION_H

/* What the inner loop of the attack makes large. Only the sign of its gradient is used. */
enum sg_tv_form {
    SG_TV_VERTICAL2, /* twice the sum of |x[row] - x[row + 1]|: what the published code computes */
    SG_TV_ANISO,     /* sum of |vertical| + |horizontal| differences */
    SG_TV_ISO /* sum of sqrt(vertical^2 + horizontal^2 + 1e-12) of the differences to the next row
                 and column */
};

/* What a difference d between neighbouring values counts in the loss. */
enum sg_tv_norm {
    SG_TV_NORM_L2,   /* d^2 */
    SG_TV_NORM_L1,   /* |d| */
    SG_TV_NORM_HUBER /* d^2 up to SG_TV_EDGE, from there on linear: fine oscillation as with L2,
                        edges as with L1 */
};
#define SG_TV_EDGE (16.0f / 255)

#endif
