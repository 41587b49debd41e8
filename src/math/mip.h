/* SPDX-License-Identifier: Apache-2.0 */
/* The 3D filter of Mip-Splatting (Yu et al. 2024, section 5.1) for one Gaussian: what it is drawn
 * as, wider by the filter and with an opacity that makes up for that; the gradient of that; and
 * from how near a camera sees it. Include a real_*.h first. */
#ifndef SG_MATH_MIP_H
#define SG_MATH_MIP_H

#include "constants.h"

/* ---- what is drawn ---- */

/* ln of the standard deviation of the sum, from both logarithms: no square overflows. */
SG_FN real mip_widened(real log_scale, real log_filter)
{
    const real apart = log_scale - log_filter;
    return r_max(log_scale, log_filter) + NUM(0.5) * r_log1p(r_exp(NUM(-2) * r_max(apart, -apart)));
}

SG_FN real mip_log_sigmoid(real x)
{
    return x < NUM(0) ? x - r_log1p(r_exp(x)) : -r_log1p(r_exp(-x));
}

/* Opacity of the drawn Gaussian. log_kept: sum of ln(scale / drawn scale). Stays below 1, so that
 * it has a logit. */
SG_FN real mip_opacity(real logit, real log_kept)
{
    return r_min(r_exp(mip_log_sigmoid(logit) + log_kept), NUM(0.99999994));
}

/* From what is stored to what is drawn. Returns the logit of the opacity. */
SG_FN real mip_draw(IN_ARRAY(real, scales, 3), real logit, real log_filter,
                    OUT_ARRAY(real, drawn, 3))
{
    real log_kept = NUM(0);
    for (int k = 0; k < 3; k++) {
        drawn[k] = mip_widened(scales[k], log_filter);
        log_kept += scales[k] - drawn[k];
    }
    return mip_log_sigmoid(logit) + log_kept - r_log1p(-mip_opacity(logit, log_kept));
}

/* Gradients of what is drawn to those of what is stored. Returns that of the logit. */
SG_FN real mip_draw_backward(IN_ARRAY(real, scales, 3), real logit, real log_filter,
                             INOUT_ARRAY(real, of_scales, 3), real of_logit)
{
    real kept[3], log_kept = NUM(0); /* kept: s^2 / (s^2 + f^2) */
    for (int k = 0; k < 3; k++) {
        const real apart = scales[k] - mip_widened(scales[k], log_filter);
        kept[k] = r_exp(NUM(2) * apart);
        log_kept += apart;
    }
    /* of the logarithm of the drawn opacity */
    const real gradient = of_logit / (NUM(1) - mip_opacity(logit, log_kept));
    for (int k = 0; k < 3; k++)
        of_scales[k] = of_scales[k] * kept[k] + gradient * (NUM(1) - kept[k]);
    return gradient * (NUM(1) - r_exp(mip_log_sigmoid(logit)));
}

/* The logit that is stored so that the opacity is drawn as `limit`, where it is drawn as more: both
 * opacities change by one factor. */
SG_FN real mip_limited(real logit, real drawn_logit, real limit)
{
    const real drawn = NUM(1) / (NUM(1) + r_exp(-drawn_logit));
    const real less = limit * (NUM(1) / (NUM(1) + r_exp(-logit))) / drawn;
    return drawn > limit ? r_log(less / (NUM(1) - less)) : logit;
}

/* ---- how wide the filter is ---- */

#define MIP_UNSEEN 3e38f /* the depth of what no camera sees */

/* Depth of a position in a camera that sees it; else 0. In the order of operations of the released
 * code. c: R by rows, t, fx, fy, cx, cy, width, height. margin: of the image's sides, beyond
 * which a camera sees nothing. */
SG_FN real mip_depth(IN_ARRAY(real, c, SG_MIP_CAMERA), IN_ARRAY(real, p, 3), real margin)
{
    const real z = c[6] * p[0] + c[7] * p[1] + c[8] * p[2] + c[11];
    const real inverse = NUM(1) / r_max(z, NUM(0.001));
    const real u = c[12] * (c[0] * p[0] + c[1] * p[1] + c[2] * p[2] + c[9]) * inverse + c[14];
    const real v = c[13] * (c[3] * p[0] + c[4] * p[1] + c[5] * p[2] + c[10]) * inverse + c[15];
    return z > NUM(SG_Z_MIN) && u >= -margin * c[16] && u <= (NUM(1) + margin) * c[16] &&
                   v >= -margin * c[17] && v <= (NUM(1) + margin) * c[17]
               ? z
               : NUM(0);
}

/* The filter's standard deviation at a depth; focal: the largest focal length. pixels: the standard
 * deviation there. */
SG_FN float mip_filter(float depth, float focal, float pixels)
{
    return depth / focal * pixels;
}

#endif
