/* SPDX-License-Identifier: Apache-2.0 */
/* The tiles that the reference lets a splat touch. */
#ifndef SG_MATH_TILE_RECT_H
#define SG_MATH_TILE_RECT_H

#include <stdbool.h>

/* Screen radius in whole pixels and the reference's tile rectangle [x0, x1) x [y0, y1) of it.
 * Integer-exact on every engine. False: the rectangle is empty. */
struct sg_tile_rect {
    int x0, y0, x1, y1;
};
static inline bool sg_tile_rect(float x, float y, float sigma, int grid_x, int grid_y, int *radius,
                                struct sg_tile_rect *r)
{
    float rad = 3.0f * sigma;
    rad = rad < 1e6f ? rad : 1e6f;
    *radius = (int) rad + ((float) (int) rad < rad);
    /* Clamped before the conversion: an int cannot hold every float. Truncation toward zero as in
     * the reference. */
    const float px = x < -1e8f  ? -1e8f
                     : x > 1e8f ? 1e8f
                                : x,
                py = y < -1e8f  ? -1e8f
                     : y > 1e8f ? 1e8f
                                : y;
    const float fr = (float) *radius;
#define SG_CLAMP_TILE(v, n) ((v) < 0 ? 0 : (v) > (n) ? (n) : (v))
    r->x0 = SG_CLAMP_TILE((int) ((px - fr) / 16.0f), grid_x);
    r->x1 = SG_CLAMP_TILE((int) ((px + fr + 15.0f) / 16.0f), grid_x);
    r->y0 = SG_CLAMP_TILE((int) ((py - fr) / 16.0f), grid_y);
    r->y1 = SG_CLAMP_TILE((int) ((py + fr + 15.0f) / 16.0f), grid_y);
#undef SG_CLAMP_TILE
    return r->x0 < r->x1 && r->y0 < r->y1;
}

#endif
