/* SPDX-License-Identifier: Apache-2.0 */
/* A projected Gaussian in memory, and its tiles. With the conic as a sum of squares
 * (math/tiles.h), log2 of opacity x Gaussian is peak - (across dx - shear dy)^2 - (down dy)^2. */
#include "math/tiles.h"

#define SPLAT VK_SPLAT
#define S_X 0
#define S_Y 1
#define S_SLOPE 2
#define S_REACH 3
#define S_TAPER 4
#define S_YMAX 5
#define S_YRIGHT 6
#define S_ACROSS 8
#define S_SHEAR 9
#define S_DOWN 10
#define S_PEAK 11
#define S_R 12
#define S_G 13
#define S_B 14
#define S_Z 15

/* Tiles [x0, x1) x [y0, y1), two words. x1 = x0: draws nothing; x1 = 0: is not visible. */
struct rect {
    uint x0, y0, x1, y1;
};
rect rect_load(Uints rects, uint i)
{
    const uint low = rects.v[2 * i], high = rects.v[2 * i + 1];
    return rect(low & 0xffff, low >> 16, high & 0xffff, high >> 16);
}

ellipse ellipse_load(Floats splats, uint i)
{
    const uint at = i * SPLAT;
    return ellipse(splats.v[at + S_SLOPE], splats.v[at + S_REACH], splats.v[at + S_TAPER],
                   splats.v[at + S_YMAX], splats.v[at + S_YRIGHT]);
}

/* First and end tile of row ty that a splat touches, within its rectangle. Counting and emitting
 * share it; `precise`, here and in the functions that it calls, which it does not reach from here,
 * keeps a compiler from rounding it differently in one of them. */
uvec2 row_tiles(ellipse e, float x, float y, rect r, uint ty, bool reference_tiles)
{
    if (reference_tiles)
        return uvec2(r.x0, r.x1);
    precise const float top = float(ty * SG_TILE) - y;
    precise const row_span span = ellipse_row_span(e, top, top + float(SG_TILE - 1));
    if (!span.hit)
        return uvec2(r.x0, r.x0);
    const cell_range cells = row_span_cells(span, x, SG_TILE, float(r.x0), float(r.x1));
    const uint c0 = uint(cells.first), c1 = uint(cells.end);
    return uvec2(c0, max(c0, c1));
}

/* Runs `statement` for each tile of splat i in the band, with `tile` its index. */
#define EACH_TILE(i, band_first, band_end, statement)                                              \
    do {                                                                                           \
        const rect r_ = rect_load(a.rects, i);                                                     \
        if (r_.x0 < r_.x1) {                                                                       \
            const ellipse e_ = ellipse_load(a.splats, i);                                          \
            const float x_ = a.splats.v[(i) *SPLAT + S_X], y_ = a.splats.v[(i) *SPLAT + S_Y];      \
            const uint low_ = max(r_.y0, (band_first) / a.grid_x);                                 \
            const uint high_ = min(r_.y1, ((band_end) -1) / a.grid_x + 1);                         \
            for (uint ty_ = low_; ty_ < high_; ty_++) {                                            \
                const uvec2 row_ = row_tiles(e_, x_, y_, r_, ty_, a.reference_tiles != 0);         \
                for (uint tx_ = row_.x; tx_ < row_.y; tx_++) {                                     \
                    const uint tile = ty_ * a.grid_x + tx_;                                        \
                    if (tile >= (band_first) && tile < (band_end)) {                               \
                        statement;                                                                 \
                    }                                                                              \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
    } while (false)
