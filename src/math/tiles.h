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
static inline real ellipse_border(real opacity, real a, real c, real det)
{
    const real widen = r_min((scalar) 1e-6 * (a * c / det), r_set(1));
    return (scalar) 2 * r_log((scalar) 255 * opacity) * ((scalar) 1 + widen) + (scalar) 0.02;
}

/* k: q at the border. */
static inline struct ellipse ellipse_make(real k, real slope, real var, real c)
{
    return (struct ellipse){slope, k * var, var / c, r_sqrt(k * c),
                            slope * c * r_sqrt(k / (slope * slope * c + var))};
}

/* Horizontal extent of the ellipse between rows y0 <= y1 (relative to its centre). False: it does
 * not reach them. */
static inline mask ellipse_row_span(const struct ellipse *e, real y0, real y1, real *x0, real *x1)
{
    const real ya = r_min(r_max(e->yright, y0), y1), yb = r_min(r_max(-e->yright, y0), y1);
    const real zero = r_set(0);
    *x1 = e->slope * ya + r_root(r_max(e->reach - ya * ya * e->taper, zero));
    *x0 = e->slope * yb - r_root(r_max(e->reach - yb * yb * e->taper, zero));
    return r_and(r_le(y0, e->ymax), r_le(-e->ymax, y1));
}

#endif
