/* SPDX-License-Identifier: Apache-2.0 */
/* A step up the total variation for one pixel. Include a real_*.h or simd.h first. */
#ifndef SG_MATH_ASCEND_H
#define SG_MATH_ASCEND_H

#include "constants.h"

/* A pixel and those around it; beyond the border, the nearest of the image. */
struct tv_pixels {
    real above, above_right, left, here, right, below_left, below;
};

SG_FN real tv_sign(real v)
{
    return r_sel(r_lt(r_set(NUM(0)), v), r_set(NUM(1)), r_set(NUM(0))) -
           r_sel(r_lt(v, r_set(NUM(0))), r_set(NUM(1)), r_set(NUM(0)));
}

/* 1 / the root of the term of a pixel with these differences to the next row and column. */
SG_FN real tv_weight(real v, real h)
{
    return NUM(1) / r_sqrt(v * v + h * h + NUM(SG_TV_ISO_FLOOR));
}

/* dTV/dhere of SG_ATTACK_TV_ISO. */
SG_FN real tv_iso_gradient(STRUCT(tv_pixels) p)
{
    return (p.here - p.above) * tv_weight(p.here - p.above, p.above_right - p.above) +
           (p.here - p.left) * tv_weight(p.below_left - p.left, p.here - p.left) -
           ((p.below - p.here) + (p.right - p.here)) *
               tv_weight(p.below - p.here, p.right - p.here);
}

/* Half of that of SG_ATTACK_TV_VERTICAL2; across: that of SG_ATTACK_TV_ANISO. */
SG_FN real tv_sign_gradient(STRUCT(tv_pixels) p, bool across)
{
    const real vertical = tv_sign(p.here - p.above) + tv_sign(p.here - p.below);
    return across ? vertical + tv_sign(p.here - p.left) + tv_sign(p.here - p.right) : vertical;
}

/* The step by a gradient's sign, within epsilon of the photo and within [0, 1]. */
SG_FN real tv_step(real here, real gradient, scalar size, real photo, real epsilon)
{
    const real bound =
        r_min(r_max(here + size * tv_sign(gradient), photo - epsilon), photo + epsilon);
    return r_min(r_max(bound, r_set(NUM(0))), r_set(NUM(1)));
}

#endif
