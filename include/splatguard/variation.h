/* SPDX-License-Identifier: Apache-2.0 */
/* Forms of total variation: an attack raises it, a loss of the defense lowers it. */
#ifndef SPLATGUARD_VARIATION_H
#define SPLATGUARD_VARIATION_H

/* What the inner steps of the attack raise. Only the sign of its gradient is used. */
enum sg_attack_tv {
    SG_ATTACK_TV_VERTICAL2, /* twice the sum of |x[row] - x[row + 1]|, as in the published program
                             */
    SG_ATTACK_TV_ANISO,     /* sum of |vertical| + |horizontal| differences */
    SG_ATTACK_TV_ISO        /* sum of sqrt(vertical^2 + horizontal^2 + 1e-12) */
};

/* What a difference d between neighbouring values adds to the loss. */
enum sg_tv_penalty {
    SG_TV_PENALTY_L2,   /* d^2 */
    SG_TV_PENALTY_L1,   /* |d| */
    SG_TV_PENALTY_HUBER /* d^2 up to SG_TV_EDGE, linear beyond: like L2 for oscillation, L1 for
                         * edges
                         */
};
#define SG_TV_EDGE (16.0f / 255)

#endif
