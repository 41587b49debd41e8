/* SPDX-License-Identifier: Apache-2.0 */
/* The tiles that the reference lets a splat touch. Include a real_*.h first. */
#ifndef SG_MATH_TILE_RECT_H
#define SG_MATH_TILE_RECT_H

#include "constants.h"

/* Screen radius in whole pixels and the reference's tile rectangle [x0, x1) x [y0, y1) of it;
 * x0 = x1 or y0 = y1: it is empty. Integer-exact on every engine. */
struct tile_rect {
    int radius, x0, y0, x1, y1;
};

SG_FN int clamp_tile(int tile, int tiles)
{
    return tile < 0 ? 0 : tile > tiles ? tiles : tile;
}

SG_FN STRUCT(tile_rect) tile_rect_make(float x, float y, float sigma, int grid_x, int grid_y)
{
    STRUCT(tile_rect) r;
    float rad = 3.0f * sigma;
    rad = rad < 1e6f ? rad : 1e6f;
    r.radius = TO_INT(rad) + (TO_FLOAT(TO_INT(rad)) < rad ? 1 : 0);
    /* Clamped before the conversion: an int cannot hold every float, nor NaN. Truncation toward
     * zero as in the reference. */
    const float px = x > -1e8f ? x < 1e8f ? x : 1e8f : -1e8f,
                py = y > -1e8f ? y < 1e8f ? y : 1e8f : -1e8f;
    const float fr = TO_FLOAT(r.radius), side = TO_FLOAT(SG_TILE);
    r.x0 = clamp_tile(TO_INT((px - fr) / side), grid_x);
    r.x1 = clamp_tile(TO_INT((px + fr + (side - 1.0f)) / side), grid_x);
    r.y0 = clamp_tile(TO_INT((py - fr) / side), grid_y);
    r.y1 = clamp_tile(TO_INT((py + fr + (side - 1.0f)) / side), grid_y);
    return r;
}

#endif
