/* SPDX-License-Identifier: Apache-2.0 */
/* The total variation: the penalty on renders, the forms that an attack raises, and the attack's
 * step. Include a real_*.h or simd.h first. */
#ifndef SG_MATH_TOTAL_VARIATION_H
#define SG_MATH_TOTAL_VARIATION_H

#include "constants.h"

/* enum sg_tv_penalty */
#define SG_TV_NORM_L2 0
#define SG_TV_NORM_L1 1
#define SG_TV_NORM_HUBER 2

SG_FN real tv_sign(real v)
{
    return r_sel(r_lt(r_set(NUM(0)), v), r_set(NUM(1)), r_set(NUM(0))) -
           r_sel(r_lt(v, r_set(NUM(0))), r_set(NUM(1)), r_set(NUM(0)));
}

/* d clamped to the edge. Without branches, so that compilers can vectorise loops of it. */
SG_FN real tv_cut(real d, scalar edge)
{
    return NUM(0.5) * (r_abs(d + edge) - r_abs(d - edge));
}

/* The penalty on a difference of neighbours, and its derivative. */
SG_FN real tv_norm(real d, int norm, scalar edge)
{
    return norm == SG_TV_NORM_L2   ? d * d
           : norm == SG_TV_NORM_L1 ? r_abs(d)
                                   : tv_cut(d, edge) * (NUM(2) * d - tv_cut(d, edge));
}

SG_FN real tv_slope(real d, int norm, scalar edge)
{
    return norm == SG_TV_NORM_L2   ? NUM(2) * d
           : norm == SG_TV_NORM_L1 ? tv_sign(d)
                                   : NUM(2) * tv_cut(d, edge);
}

/* The gradient of a pixel, from the differences to the row above, from it to the row below, and the
 * same of columns; down, across: their weights. */
SG_FN real tv_gradient(real above, real below, real before, real after, int norm, scalar edge,
                       scalar down, scalar across)
{
    return down * (tv_slope(above, norm, edge) - tv_slope(below, norm, edge)) +
           across * (tv_slope(before, norm, edge) - tv_slope(after, norm, edge));
}

/* The term of SG_ATTACK_TV_ISO of a pixel with these differences to the next row and column. */
SG_FN real tv_iso_term(real v, real h)
{
    return r_sqrt(v * v + h * h + NUM(SG_TV_ISO_FLOOR));
}

/* Half of that of SG_ATTACK_TV_VERTICAL2; across: that of SG_ATTACK_TV_ANISO. */
SG_FN real tv_sign_term(real v, real h, bool across)
{
    return across ? r_abs(v) + r_abs(h) : r_abs(v);
}

/* A pixel and those around it; beyond the border, the nearest of the image. */
struct tv_pixels {
    real above, above_right, left, here, right, below_left, below;
};

SG_FN real tv_weight(real v, real h)
{
    return NUM(1) / tv_iso_term(v, h);
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
