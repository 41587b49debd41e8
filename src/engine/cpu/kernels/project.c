/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians to splats, LANES at a time. */
#include "kernels.h"

#include "filter.h"

#include <math.h>
#include <string.h>

#include "math/projection.h"
#include "math/sh.h"
#include "math/tiles.h"

/* The reference's tile rectangle, as tile_rect_make. */
struct rects {
    ireal x0, y0, x1, y1;
};

SIMD struct rects tile_rects(const struct cpu_project_args *a, real x, real y, real sigma)
{
    const real reach = r_min(3 * sigma, r_set(1e6f)), whole = r_from_int(r_to_int(reach));
    const real radius = whole + r_keep(r_lt(whole, reach), r_set(1));
    const real gx = r_set((float) a->grid_x), gy = r_set((float) a->grid_y), zero = r_set(0);
    const float scale = 1.0f / SG_TILE;
#define EDGE(v, limit) r_to_int(r_min(r_max((v) *scale, zero), limit))
    return (struct rects){EDGE(x - radius, gx), EDGE(y - radius, gy),
                          EDGE(x + radius + (SG_TILE - 1), gx),
                          EDGE(y + radius + (SG_TILE - 1), gy)};
#undef EDGE
}

/* The lowest n bits, 1 to 31, of which the highest must not overflow. */
SIMD ireal lowest_bits(ireal n)
{
    const ireal one = i_set(1);
    return (((one << (n - one)) - one) << one) + one;
}

/* Bits of the tiles that the ellipses touch, where the rectangle is small. */
SIMD ireal tile_bits(const struct cpu_project_args *a, const struct rects *r,
                     const struct ellipse *e, real x, real y, mask small)
{
    const ireal width = r->x1 - r->x0, height = r->y1 - r->y0, one = i_set(1);
    if (a->reference_tiles)
        return lowest_bits(i_sel(small, width * height, one));
    const real lo = r_from_int(r->x0), hi = r_from_int(r->x1);
    ireal bits = i_set(0);
    for (int row = 0;; row++) {
        const mask inside = r_and(small, r_lt(r_set((float) row), r_from_int(height)));
        if (!m_any(inside))
            return bits;
        const real top = r_from_int(r->y0 + row) * (float) SG_TILE - y;
        const struct row_span span = ellipse_row_span(*e, top, top + (float) (SG_TILE - 1));
        const struct cell_range cells = row_span_cells(span, x, SG_TILE, lo, hi);
        const ireal c0 = r_to_int(cells.first) - r->x0, c1 = r_to_int(cells.end) - r->x0;
        const mask some = r_and(r_and(inside, span.hit), r_lt(r_from_int(c0), r_from_int(c1)));
        bits |= i_sel(some, lowest_bits(i_sel(some, c1 - c0, one)) << (c0 + row * width), i_set(0));
    }
}

SIMD void store_extents(const struct cpu_project_args *a, size_t base, const struct rects *r,
                        ireal bits, mask visible, mask drawn, mask small)
{
    int32_t x0[LANES], y0[LANES], x1[LANES], y1[LANES], tiles[LANES];
    memcpy(x0, &r->x0, sizeof(x0));
    memcpy(y0, &r->y0, sizeof(y0));
    memcpy(x1, &r->x1, sizeof(x1));
    memcpy(y1, &r->y1, sizeof(y1));
    memcpy(tiles, &bits, sizeof(tiles));
    const uint32_t v = m_bits(visible), d = m_bits(drawn), s = m_bits(small);
    for (int lane = 0; lane < LANES && base + (size_t) lane < a->count; lane++) {
        const bool is_small = s >> lane & 1, any = (d >> lane & 1) && (!is_small || tiles[lane]);
        a->extents[base + (size_t) lane] =
            any ? (struct cpu_extent){(uint16_t) x0[lane], (uint16_t) y0[lane], (uint16_t) x1[lane],
                                      (uint16_t) y1[lane], is_small ? (uint32_t) tiles[lane] : 0}
                : (struct cpu_extent){.x0 = v >> lane & 1, .x1 = v >> lane & 1};
    }
}

void FILTERED(project)(const struct cpu_project_args *a, size_t first, size_t end)
{
    const struct pinhole v = VIEW(a);
    const int coefficients = (a->degree + 1) * (a->degree + 1);
    for (size_t block = first; block < end; block++)
        for (int half = 0; half < SG_LANES; half += LANES) {
            const float *p = a->params + block * (size_t) a->planes * SG_LANES + half;
            const size_t base = block * SG_LANES + (size_t) half;
            if (base >= a->count)
                break;
            real planes[SG_P_SH];
            for (int i = 0; i < SG_P_SH; i++)
                planes[i] = r_load(p + i * SG_LANES);
            struct splat s;
            struct projection pr;
            project(&v, planes + SG_P_XYZ, planes + SG_P_SCALE, planes + SG_P_ROT, &s, &pr);
            const struct rects rect = tile_rects(a, s.x, s.y, s.sigma);
            /* NaN fails every comparison; r_exp would hide it. */
            mask good = r_and(s.visible, r_le(planes[SG_P_OPACITY], planes[SG_P_OPACITY]));
            good = r_and(good, r_and(r_lt(r_from_int(rect.x0), r_from_int(rect.x1)),
                                     r_lt(r_from_int(rect.y0), r_from_int(rect.y1))));
            /* Neighbours in memory are neighbours in space: mostly all are seen, or none. */
            if (!m_any(good)) {
                const size_t left = a->count - base, n = left < LANES ? left : LANES;
                memset(a->extents + base, 0, n * sizeof(*a->extents));
                continue;
            }
            const real opacity = opacity_drawn(planes[SG_P_OPACITY], GAIN(s));

            real dir[3], basis[16], rgb[3];
            sh_direction(planes, v.centre, dir);
            sh_basis(a->degree, dir[0], dir[1], dir[2], basis);
            for (int ch = 0; ch < 3; ch++)
                rgb[ch] = r_set(0.5f);
            for (int k = 0; k < coefficients; k++)
                for (int ch = 0; ch < 3; ch++)
                    rgb[ch] += basis[k] * r_load(p + (SG_P_SH + 3 * k + ch) * SG_LANES);
            for (int ch = 0; ch < 3; ch++) {
                good = r_and(good, colour_sound(rgb[ch]));
                rgb[ch] = colour_drawn(rgb[ch]);
            }
            const real area = r_from_int((rect.x1 - rect.x0) * (rect.y1 - rect.y0));
            const mask drawn = r_and(good, r_le(r_set(SG_ALPHA_MIN), opacity));
            const mask small = r_and(drawn, r_le(area, r_set(CPU_MASK_TILES)));
            const real safe = r_sel(drawn, opacity, r_set(1)), var = 1 / s.A;
            const struct ellipse e =
                ellipse_make(ellipse_border(safe, s.a, s.c, s.det), s.b / s.c, var, s.c);
            store_extents(a, base, &rect, tile_bits(a, &rect, &e, s.x, s.y, small), good, drawn,
                          small);

            const real across = conic_across(s.A);
            const real fields[16] = {
                s.x,      s.y,    e.slope,          e.reach,         e.taper, e.ymax, e.yright,
                r_set(0), across, across * e.slope, conic_down(s.c), safe,    rgb[0], rgb[1],
                rgb[2],   s.z};
            float out[16][LANES];
            for (int i = 0; i < 16; i++)
                r_store(out[i], fields[i]);
            for (int lane = 0; lane < LANES && base + (size_t) lane < a->count; lane++) {
                float *to = (float *) &a->splats[base + (size_t) lane];
                for (int i = 0; i < 16; i++)
                    to[i] = out[i][lane];
                a->splats[base + (size_t) lane].peak = log2f(out[11][lane]);
            }
        }
}
