/* SPDX-License-Identifier: Apache-2.0 */
/* L1 and SSIM with their gradient, one channel after the other, so that what one pass leaves is still in the cache for the
 * next. A piece of work is CPU_LOSS_ROWS rows, in chunks of columns that fit the first-level cache: the window down the columns
 * first, for the piece's rows together, then along each row. Sums are kept by row: they do not depend on how rows are dealt out. */
#include "kernels.h"

#include "math/photometric.h"

#define ROWS CPU_LOSS_ROWS
#define REACH (ROWS + 2 * SG_SSIM_RADIUS) /* rows that a piece reads */
#define CHUNK 416                         /* the most columns at a time */
#define PAD SG_LANES                      /* columns on both sides of a chunk, of which the window reads the nearest */

/* The target as floats; where masked out, the render itself. */
void KERNEL(loss_target)(const struct cpu_loss_args *a, int channel, int y)
{
    const size_t plane = (size_t) a->width * (size_t) a->height, first = (size_t) y * (size_t) a->width;
    const size_t end = y + ROWS < a->height ? first + ROWS * (size_t) a->width : plane;
    const float *x = a->rgb + (size_t) channel * plane;
    const float *planes = a->params->planes ? a->params->planes + (size_t) channel * plane : NULL;
    const uint8_t *used = a->params->mask, *t = a->params->target + channel;
    float *out = a->target + (size_t) channel * plane;
    for (size_t i = first; i < end; i++)
        out[i] = used && !used[i] ? x[i] : planes ? planes[i] : (float) t[3 * i] * (1.0f / 255.0f);
}

/* Columns at a time: of `width`, equal parts. */
SIMD int chunk_columns(int width)
{
    const int chunks = (width + CHUNK - 1) / CHUNK;
    return ((width + chunks - 1) / chunks + LANES - 1) / LANES * LANES;
}

/* Lanes of a row from column i on, zeros past its end. */
SIMD real row_load(const float *row, int i, int width)
{
    return i + LANES <= width ? r_load(row + i) : r_load_part(row + i, width - i);
}

/* A column of vectors: LANES pixels of each row that a piece reads, `stride` floats apart. */
struct column {
    const float *first;
    ptrdiff_t stride;
};

/* Columns at the image's edges are copied, with zeros outside. */
static __attribute__((noinline)) struct column edge_column(const float *plane, int i, int top, int width, int height,
                                                           float copy[REACH * LANES])
{
    for (int j = 0; j < REACH; j++) {
        const bool inside = top + j >= 0 && top + j < height && i >= 0 && i < width;
        r_store(copy + j * LANES, inside ? row_load(plane + (ptrdiff_t) (top + j) * width, i, width) : r_set(0));
    }
    return (struct column){copy, LANES};
}

SIMD struct column find_column(const float *plane, int i, int y, int width, int height, float copy[REACH * LANES])
{
    const int top = y - SG_SSIM_RADIUS;
    if (top >= 0 && top + REACH <= height && i >= 0 && i + LANES <= width)
        return (struct column){plane + (ptrdiff_t) top * width + i, width};
    return edge_column(plane, i, top, width, height, copy);
}

SIMD void row_store(float *row, int i, int width, real v)
{
    if (i + LANES <= width)
        r_store(row + i, v);
    else
        r_store_part(row + i, width - i, v);
}

/* The window down a column for each of the piece's rows. It is symmetric: one multiplication for two taps. */
SIMD void down(const real v[REACH], float out[ROWS][CHUNK + 2 * PAD], int column)
{
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; r++) {
        const real *at = v + r + SG_SSIM_RADIUS;
        real s = at[0] * sg_ssim_window[SG_SSIM_RADIUS];
#pragma GCC unroll 8
        for (int k = 1; k <= SG_SSIM_RADIUS; k++)
            s += (at[-k] + at[k]) * sg_ssim_window[SG_SSIM_RADIUS - k];
        r_store(out[r] + column, s);
    }
}

/* The window along a row. */
SIMD real along(const float *row)
{
    real near[2 * SG_SSIM_RADIUS + 1];
    r_load_around(row, near);
    real s = near[SG_SSIM_RADIUS] * sg_ssim_window[SG_SSIM_RADIUS];
#pragma GCC unroll 8
    for (int k = 1; k <= SG_SSIM_RADIUS; k++)
        s += (near[SG_SSIM_RADIUS - k] + near[SG_SSIM_RADIUS + k]) * sg_ssim_window[SG_SSIM_RADIUS - k];
    return s;
}

void KERNEL(loss_forward)(const struct cpu_loss_args *a, int channel, int y)
{
    const int w = a->width, chunk = chunk_columns(w), count = a->height - y < ROWS ? a->height - y : ROWS;
    const size_t plane = (size_t) w * (size_t) a->height;
    const float *x = a->rgb + (size_t) channel * plane, *t = a->target + (size_t) channel * plane;
    real l1[ROWS], l2[ROWS], ssim[ROWS];
    for (int r = 0; r < ROWS; r++)
        l1[r] = l2[r] = ssim[r] = r_set(0);
    _Alignas(64) float moments[4][ROWS][CHUNK + 2 * PAD]; /* of x, t, xx + tt, xt */
    for (int c = 0; c < w; c += chunk) {
        const int end = w - c < chunk ? w - c : chunk;
        for (int i = -PAD; i < end + PAD; i += LANES) {
            float copies[2][REACH * LANES];
            const struct column xs = find_column(x, c + i, y, w, a->height, copies[0]);
            const struct column ts = find_column(t, c + i, y, w, a->height, copies[1]);
            real v[REACH];
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++)
                v[j] = r_load(xs.first + j * xs.stride);
            down(v, moments[0], i + PAD);
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++)
                v[j] = r_load(ts.first + j * ts.stride);
            down(v, moments[1], i + PAD);
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++) {
                const real vx = r_load(xs.first + j * xs.stride);
                v[j] = v[j] * v[j] + vx * vx;
            }
            down(v, moments[2], i + PAD);
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++)
                v[j] = r_load(xs.first + j * xs.stride) * r_load(ts.first + j * ts.stride);
            down(v, moments[3], i + PAD);
        }
        for (int r = 0; r < count; r++) {
            const size_t at = (size_t) (y + r) * (size_t) w;
            float *maps = a->maps + at;
            for (int i = 0; i < end; i += LANES) {
                real d_m, d_xx, d_xy;
                const real s = ssim_point(along(moments[0][r] + i + PAD), along(moments[1][r] + i + PAD),
                                          along(moments[2][r] + i + PAD), along(moments[3][r] + i + PAD), &d_m, &d_xx, &d_xy);
                ssim[r] += r_keep(r_lt(r_lane() + (float) i, r_set((float) end)), s);
                row_store(maps, c + i, w, d_m);
                row_store(maps + plane, c + i, w, d_xx);
                row_store(maps + 2 * plane, c + i, w, d_xy);
                const real d = row_load(x + at, c + i, w) - row_load(t + at, c + i, w);
                l1[r] += r_max(d, -d);
                l2[r] += d * d;
            }
        }
    }
    double *sums = a->sums + 3 * ((size_t) channel * (size_t) a->height + (size_t) y);
    for (int r = 0; r < count; r++, sums += 3)
        sums[0] = (double) r_sum(l1[r]), sums[1] = (double) r_sum(l2[r]), sums[2] = (double) r_sum(ssim[r]);
}

void KERNEL(loss_backward)(const struct cpu_loss_args *a, int channel, int y)
{
    const int w = a->width, chunk = chunk_columns(w), count = a->height - y < ROWS ? a->height - y : ROWS;
    const size_t plane = (size_t) w * (size_t) a->height;
    const float unit = 1 / (3 * (float) plane), lambda = a->params->lambda_dssim;
    const float l1 = (1 - lambda) * unit, dssim = -lambda * unit;
    _Alignas(64) float maps[3][ROWS][CHUNK + 2 * PAD];
    for (int c = 0; c < w; c += chunk) {
        const int end = w - c < chunk ? w - c : chunk;
        for (int i = -PAD; i < end + PAD; i += LANES)
            for (int m = 0; m < 3; m++) {
                float copy[REACH * LANES];
                const struct column col =
                    find_column(a->maps + (size_t) m * plane, c + i, y, w, a->height, copy);
                real v[REACH];
#pragma GCC unroll 16
                for (int j = 0; j < REACH; j++)
                    v[j] = r_load(col.first + j * col.stride);
                down(v, maps[m], i + PAD);
            }
        for (int r = 0; r < count; r++) {
            const size_t at = (size_t) (y + r) * (size_t) w;
            const float *x = a->rgb + (size_t) channel * plane + at, *t = a->target + (size_t) channel * plane + at;
            float *out = a->gradient + (size_t) channel * plane + at;
            const uint8_t *used = a->params->mask ? a->params->mask + at : NULL;
            for (int i = 0; i < end; i += LANES) {
                const real vx = row_load(x, c + i, w), vt = row_load(t, c + i, w);
                const real ds = along(maps[0][r] + i + PAD) + 2 * vx * along(maps[1][r] + i + PAD) +
                                vt * along(maps[2][r] + i + PAD);
                const real sign = r_keep(r_lt(vt, vx), r_set(1)) - r_keep(r_lt(vx, vt), r_set(1));
                real g = l1 * sign + dssim * ds;
                if (used) { /* no pull where the target is the render itself */
                    real keep = r_set(0);
                    for (int k = 0; k < LANES && i + k < end; k++)
                        keep[k] = used[c + i + k] ? 1.0f : 0.0f;
                    g *= keep;
                }
                row_store(out, c + i, w, g);
            }
        }
    }
}
