/* SPDX-License-Identifier: Apache-2.0 */
/* One Gaussian from what the networks of Scaffold-GS say (Lu et al. 2024, section 3.2), and back.
 * Its parameters are those of a stored Gaussian (enum sg_param at SH degree 0), so that everything
 * behind draws it like any other. Include a real_*.h or simd.h first. */
#ifndef SG_MATH_NEURAL_H
#define SG_MATH_NEURAL_H

#include "constants.h"

#define SG_NEURAL_PLANES 14
#define SG_NEURAL_LEAST 1e-30   /* of exp(2 y) - 1, whose logarithm is taken */
#define SG_NEURAL_MOST 8.0      /* of y: tanh is 1 in float behind it */
#define SG_NEURAL_BOUND 8.886e6 /* of exp(2 y) - 1 there, less what rounding takes */

/* What it is made of. */
struct neural {
    real y;                 /* of its opacity, tanh(y); it exists where y is above 0 */
    real cov[7];            /* scales, a sigmoid's argument; quaternion */
    real colour[3];         /* a sigmoid's argument */
    real offset[3];         /* in units of reach */
    real anchor[3];         /* position */
    real reach[3], size[3]; /* the anchor's scales, natural log */
};

/* Shares from what the network of the feature bank says: the softmax. */
SG_FN void neural_shares(INOUT_ARRAY(real, z, 3))
{
    const real most = r_max(r_max(z[0], z[1]), z[2]);
    real sum = r_set(0);
    for (int j = 0; j < 3; j++)
        sum = sum + (z[j] = r_exp(z[j] - most));
    for (int j = 0; j < 3; j++)
        z[j] = z[j] / sum;
}

/* ln of a sigmoid, and the sigmoid. */
SG_FN real neural_log_sigmoid(real x)
{
    const real least = r_min(x, r_set(0)); /* - |x| = 2 least - x */
    return least - r_log(NUM(1) + r_exp(NUM(2) * least - x));
}

SG_FN real neural_sigmoid(real x)
{
    const real least = r_min(x, r_set(0)), e = r_exp(NUM(2) * least - x);
    /* 1 / (1 + e) where x >= 0, else e / (1 + e) */
    return r_sel(r_lt(x, r_set(0)), e, r_set(1)) / (NUM(1) + e);
}

/* exp(2 y) - 1: the logit of tanh(y) is the logarithm of half of it. */
SG_FN real neural_odds(real y)
{
    return r_max(r_exp(NUM(2) * r_min(y, r_set(NUM(SG_NEURAL_MOST)))) - NUM(1),
                 r_set(NUM(SG_NEURAL_LEAST)));
}

/* Whether a Gaussian can exist: an offset of SG_OFFSET_HIDDEN hides it, whatever the networks
 * say. */
SG_FN mask neural_shown(real offset)
{
    return r_lt(offset, r_set(NUM(SG_OFFSET_HIDDEN * 0.1f)));
}

SG_FN void neural_forward(IN(neural, n), OUT_ARRAY(real, planes, SG_NEURAL_PLANES))
{
    for (int k = 0; k < 3; k++) {
        planes[k] = REF(n).anchor[k] + REF(n).offset[k] * r_exp(REF(n).reach[k]);
        planes[4 + k] = REF(n).size[k] + neural_log_sigmoid(REF(n).cov[k]);
        planes[11 + k] = (neural_sigmoid(REF(n).colour[k]) - NUM(0.5)) / NUM(SG_SH_C0);
    }
    planes[3] = r_log(neural_odds(REF(n).y) * NUM(0.5));
    for (int k = 0; k < 4; k++)
        planes[7 + k] = REF(n).cov[3 + k];
}

/* What neural_backward needs of what the networks say: the odds of y and whether it is at its
 * bound, and the sigmoids. With SG_NEURAL_DRAWN they come from the planes, but for rounding, so
 * that the last layer need not be computed again. */
#ifdef SG_NEURAL_DRAWN
#define NEURAL_ODDS(n, planes) (NUM(2) * r_exp((planes)[3]))
#define NEURAL_BOUNDED(n, odds) r_lt(r_set(NUM(SG_NEURAL_BOUND)), odds)
#define NEURAL_COLOUR(n, planes, k) ((planes)[11 + (k)] * NUM(SG_SH_C0) + NUM(0.5))
#define NEURAL_SCALE(n, planes, k) r_exp((planes)[4 + (k)] - REF(n).size[k])
#else
#define NEURAL_ODDS(n, planes) neural_odds(REF(n).y)
#define NEURAL_BOUNDED(n, odds) r_lt(r_set(NUM(SG_NEURAL_MOST)), REF(n).y)
#define NEURAL_COLOUR(n, planes, k) neural_sigmoid(REF(n).colour[k])
#define NEURAL_SCALE(n, planes, k) neural_sigmoid(REF(n).cov[k])
#endif

/* planes: those of neural_forward. gradient: dL/d planes, 0 for what does not exist. volume: dL/d
 * (product of the scales). d: dL/d of the same fields; that of `anchor` is not computed, for
 * anchors do not move. */
SG_FN void neural_backward(IN(neural, n), IN_ARRAY(real, planes, SG_NEURAL_PLANES),
                           IN_ARRAY(real, gradient, SG_NEURAL_PLANES), real volume, OUT(neural, d))
{
    const real product = volume * r_exp(planes[4] + planes[5] + planes[6]);
    const real odds = NEURAL_ODDS(n, planes);
    const mask bounded = NEURAL_BOUNDED(n, odds);
    REF(d).y = r_sel(bounded, r_set(0), NUM(2) * (odds + NUM(1)) * (gradient[3] / odds));
    for (int k = 0; k < 3; k++) {
        const real scale = gradient[4 + k] + product, unit = r_exp(REF(n).reach[k]),
                   c = NEURAL_COLOUR(n, planes, k);
        REF(d).size[k] = scale;
        REF(d).cov[k] = scale * (NUM(1) - NEURAL_SCALE(n, planes, k));
        REF(d).offset[k] = gradient[k] * unit;
        REF(d).reach[k] = gradient[k] * unit * REF(n).offset[k];
        REF(d).colour[k] = gradient[11 + k] * c * (NUM(1) - c) / NUM(SG_SH_C0);
    }
    for (int k = 0; k < 4; k++)
        REF(d).cov[3 + k] = gradient[7 + k];
}

#endif
