/* SPDX-License-Identifier: Apache-2.0 */
/* Which tiles (or smaller cells) a splat can touch. Include a real_*.h or simd.h first.
 *
 * A pair is drawn only where opacity exp(-q/2) >= 1/255, an ellipse q <= k. In coordinates relative to its centre,
 *     q = (x - slope y)^2 / var + y^2 / c,   slope = b/c,  var = det/c,
 * from the 2D covariance (a, b; b, c). Counting, emitting and drawing share this code. */
#ifndef SG_MATH_TILES_H
#define SG_MATH_TILES_H

#include "constants.h"

struct ellipse {
    real k;     /* q at the border, with a margin for rounding */
    real slope; /* of the line of conditional means, dx/dy */
    real var;   /* conditional variance of x */
    real ic;    /* 1/c */
};

/* Derived values that every row shares. */
struct ellipse_rows {
    real ymax; /* half height */
    real yr;   /* y of the rightmost point; the leftmost is at -yr */
};

/* 2 ln(255 opacity), widened (at most doubled) where the evaluated conic is inexact because a c / det is large. */
static inline real ellipse_border(real opacity, real a, real c, real det)
{
    const real widen = r_min((scalar) 1e-6 * (a * c / det), r_set(1));
    return (scalar) 2 * r_log((scalar) 255 * opacity) * ((scalar) 1 + widen) + (scalar) 0.02;
}

static inline struct ellipse_rows ellipse_rows(const struct ellipse *e)
{
    const real c = (scalar) 1 / e->ic;
    const real reach = e->slope * e->slope * c + e->var; /* variance of x */
    return (struct ellipse_rows){r_sqrt(e->k * c), e->slope * c * r_sqrt(e->k / reach)};
}

/* Horizontal extent of the ellipse between rows y0 <= y1 (relative to its centre). False: it does not reach them. */
static inline mask ellipse_row_span(const struct ellipse *e, const struct ellipse_rows *r, real y0, real y1, real *x0,
                                    real *x1)
{
    const real ya = r_min(r_max(r->yr, y0), y1), yb = r_min(r_max(-r->yr, y0), y1);
    const real zero = r_set(0);
    *x1 = e->slope * ya + r_sqrt(r_max(e->k - ya * ya * e->ic, zero) * e->var);
    *x0 = e->slope * yb - r_sqrt(r_max(e->k - yb * yb * e->ic, zero) * e->var);
    return r_and(r_le(y0, r->ymax), r_le(-r->ymax, y1));
}

#endif
