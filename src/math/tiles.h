/* SPDX-License-Identifier: Apache-2.0 */
/* Which tiles (or smaller cells) a splat can touch. Include a real_*.h or simd.h first.
 *
 * A pair is drawn only where opacity exp(-q/2) >= 1/255, an ellipse q <= k. In coordinates relative
 * to its centre, q = (x - slope y)^2 / var + y^2 / c,   slope = b/c,  var = det/c, from the 2D
 * covariance (a, b; b, c). Counting, emitting and drawing share this code. */
#ifndef SG_MATH_TILES_H
#define SG_MATH_TILES_H

#include "constants.h"

struct ellipse {
    real slope;  /* of the line of conditional means, dx/dy */
    real reach;  /* k var: square of the half width at the centre's height */
    real taper;  /* var / c: what it loses per square of y */
    real ymax;   /* half height */
    real yright; /* y of the rightmost point; the leftmost is at -yright */
};

/* q at the border: 2 ln(255 opacity), widened (at most doubled) where the evaluated conic is
 * inexact because a c / det is large, and by more than the error of r_root. */
SG_FN real ellipse_border(real opacity, real a, real c, real det)
{
    const real widen = r_min(NUM(1e-6) * (a * c / det), r_set(1));
    return NUM(2) * r_log(NUM(255) * opacity) * (NUM(1) + widen) + NUM(0.02);
}

/* k: q at the border. */
SG_FN STRUCT(ellipse) ellipse_make(real k, real slope, real var, real c)
{
    STRUCT(ellipse) e;
    e.slope = slope, e.reach = k * var, e.taper = var / c, e.ymax = r_sqrt(k * c);
    e.yright = slope * c * r_sqrt(k / (slope * slope * c + var));
    return e;
}

/* Horizontal extent of an ellipse between two rows, relative to its centre. hit: it reaches them.
 */
struct row_span {
    mask hit;
    real x0, x1;
};

/* Rows y0 <= y1, relative to the centre. */
SG_FN STRUCT(row_span) ellipse_row_span(STRUCT(ellipse) e, real y0, real y1)
{
    const real ya = r_min(r_max(e.yright, y0), y1), yb = r_min(r_max(-e.yright, y0), y1);
    const real zero = r_set(0);
    PRECISE const real left_a = e.reach - ya * ya * e.taper;
    PRECISE const real left_b = e.reach - yb * yb * e.taper;
    PRECISE const real x0 = e.slope * yb - r_root(r_max(left_b, zero));
    PRECISE const real x1 = e.slope * ya + r_root(r_max(left_a, zero));
    STRUCT(row_span) o;
    o.x0 = x0, o.x1 = x1;
    o.hit = r_and(r_le(y0, e.ymax), r_le(-e.ymax, y1));
    return o;
}

/* The cells from `low` to `high` that a span meets with a pixel's centre, as whole numbers but for
 * a conversion to integers. Pixel centres of cell c are side c .. side c + side - 1. x: of the
 * ellipse's centre. Clamped, any float converts. */
struct cell_range {
    real first, end;
};

SG_FN STRUCT(cell_range)
    row_span_cells(STRUCT(row_span) span, real x, scalar side, real low, real high)
{
    const scalar scale = NUM(1) / side;
    PRECISE const real left = (x + span.x0 + NUM(1)) * scale;
    PRECISE const real right = (x + span.x1 + side) * scale;
    STRUCT(cell_range) o;
    o.first = r_max(r_min(left, high), low);
    o.end = r_max(r_min(right, high), low);
    return o;
}

/* The conic as a sum of squares (math/pair.h) from its A and the variance c: across and down; the
 * shear is across x slope. */
SG_FN real conic_across(real A)
{
    return r_sqrt(A * NUM(0.5f * SG_LOG2E));
}

SG_FN real conic_down(real c)
{
    return r_sqrt(NUM(0.5f * SG_LOG2E) / c);
}

#endif
