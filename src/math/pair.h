/* SPDX-License-Identifier: Apache-2.0 */
/* A splat at a pixel, and its gradients: Kerbl et al. 2023. Include a real_*.h or simd.h first.
 *
 * With the conic as a sum of squares (math/tiles.h), log2 of opacity x Gaussian is
 * peak - (down dy)^2 - (across dx - shear dy)^2, where (dx, dy) is the pixel's offset from the
 * splat's centre. The forward and the backward pass must round it alike. */
#ifndef SG_MATH_PAIR_H
#define SG_MATH_PAIR_H

#include "constants.h"

/* The offset along the ellipse's first axis, in units in which q = along^2 + (down dy)^2. */
SG_FN real pair_along(real dx, real dy, scalar across, scalar shear)
{
    PRECISE const real sheared = shear * dy;
    PRECISE const real along = across * dx - sheared;
    return along;
}

/* What the offset down leaves of the peak. */
SG_FN real pair_below(real dy, scalar down, scalar peak)
{
    PRECISE const real scaled = down * dy;
    PRECISE const real below = peak - scaled * scaled;
    return below;
}

/* log2 of the pair's opacity before its bound. */
SG_FN real pair_power(real along, real below)
{
    PRECISE const real power = below - along * along;
    return power;
}

/* Whether the pair is drawn. */
SG_FN mask pair_drawn(real power)
{
    return r_le(r_set(NUM(SG_LOG2_ALPHA_MIN)), power);
}

/* The alpha that is drawn, 0 where a pair is not. raw: 2^power. */
SG_FN real pair_alpha(mask drawn, real raw)
{
    return r_min_keep(drawn, raw, r_set(NUM(SG_ALPHA_MAX)));
}

/* The chain is the product of all (1 - alpha) so far. It never rises, so "the pixel has not
 * stopped" is chain_open. */
SG_FN real chain_next(real chain, real alpha)
{
    PRECISE const real next = chain - chain * alpha;
    return next;
}

SG_FN mask chain_open(real chain)
{
    return r_le(r_set(NUM(SG_T_MIN)), chain);
}

/* A colour's share of dL/dimage = (gr, gg, gb). */
SG_FN real pair_light(scalar r, scalar g, scalar b, real gr, real gg, real gb)
{
    return r * gr + g * gg + b * gb;
}

/* w = opacity G dL/dalpha. chain: before this pair; light: pair_light; behind: the share of all
 * that the pixel shows behind the pair. */
SG_FN real pair_gradient(real raw, real alpha, real chain, real light, real behind)
{
    const real dalpha = chain * light - behind * r_reciprocal(NUM(1) - alpha);
    return raw * dalpha;
}

/* dL/dx and dL/dy of one pixel, divided by 2 ln 2. */
SG_FN real pair_slope_x(real w, real along, scalar across)
{
    return w * (across * along);
}

SG_FN real pair_slope_y(real w, real along, real dy, scalar shear, scalar down)
{
    return w * (down * down * dy - shear * along);
}

/* All gradients of position and conic are moments of w. From moments about a point, in the order
 * w, w y, w y^2, w x, w x y, w x^2, to moments about the splat's centre, in the order w, w x, w y,
 * w x^2, w x y, w y^2. dx, dy: the point's offset from the centre. */
SG_FN void moments_move(IN_ARRAY(scalar, sums, 6), scalar dx, scalar dy, OUT_ARRAY(scalar, to, 6))
{
    to[0] = sums[0];
    to[1] = sums[3] + dx * sums[0];
    to[2] = sums[1] + dy * sums[0];
    to[3] = sums[5] + dx * (sums[3] + to[1]);
    to[4] = sums[4] + dx * sums[1] + dy * to[1];
    to[5] = sums[2] + dy * (sums[1] + to[2]);
}

#endif
