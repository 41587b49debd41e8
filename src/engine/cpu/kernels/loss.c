/* SPDX-License-Identifier: Apache-2.0 */
/* L1 and SSIM with their gradient. A piece of work is a range of one channel's rows. It goes down
 * the image with two bands of rows that fit the second-level cache: the target as floats, and
 * behind it the partial derivatives of SSIM, from which the gradient follows. The window is applied
 * to ROWS rows together, in chunks of columns that fit the first-level cache: down the columns
 * first, then along each row. Sums are kept by row, and a row's values must not depend on where in
 * a piece it lies: copies of code that the compiler makes may be rounded differently, hence r_fma
 * and functions that are not inlined. */
#include "kernels.h"

#include "math/photometric.h"

#define ROWS 4                            /* rows together */
#define REACH (ROWS + 2 * SG_SSIM_RADIUS) /* rows that they read */
#define CHUNK 416                         /* the most columns at a time */
#define PAD SG_LANES /* columns on both sides of a chunk, of which the window reads the nearest */

/* Rows first to end - 1 of an image. */
struct band {
    const float *rows;
    float *own;       /* the same; NULL: they are only read */
    ptrdiff_t stride; /* in floats */
    int width, first, end;
};

SIMD const float *band_row(const struct band *b, int y)
{
    return b->rows + (y - b->first) * b->stride;
}

SIMD float *band_own_row(const struct band *b, int y)
{
    return b->own + (y - b->first) * b->stride;
}

/* Forgets the rows above `first`. */
static void band_slide(struct band *b, int first)
{
    if (first <= b->first)
        return;
    memmove(b->own, band_row(b, first),
            (size_t) (b->end - first) * (size_t) b->stride * sizeof(float));
    b->first = first;
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

SIMD void row_store(float *row, int i, int width, real v)
{
    if (i + LANES <= width)
        r_store(row + i, v);
    else
        r_store_part(row + i, width - i, v);
}

/* A column of vectors: LANES pixels of each of REACH rows, `stride` floats apart. */
struct column {
    const float *first;
    ptrdiff_t stride;
};

/* Columns at the edges are copied, with zeros outside. */
static __attribute__((noinline)) struct column edge_column(const struct band *b, int i, int top,
                                                           float copy[REACH * LANES])
{
    for (int j = 0; j < REACH; j++) {
        const bool inside = top + j >= b->first && top + j < b->end && i >= 0 && i < b->width;
        r_store(copy + j * LANES, inside ? row_load(band_row(b, top + j), i, b->width) : r_set(0));
    }
    return (struct column){copy, LANES};
}

/* What the window reads for ROWS rows from y on, in the columns from i on. */
SIMD struct column find_column(const struct band *b, int i, int y, float copy[REACH * LANES])
{
    const int top = y - SG_SSIM_RADIUS;
    if (top >= b->first && top + REACH <= b->end && i >= 0 && i + LANES <= b->width)
        return (struct column){band_row(b, top) + i, b->stride};
    return edge_column(b, i, top, copy);
}

/* The window down a column for each of ROWS rows. It is symmetric: one multiplication for two
 * taps. */
SIMD void down(const real v[REACH], float out[ROWS][CHUNK + 2 * PAD], int column)
{
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; r++) {
        const real *at = v + r + SG_SSIM_RADIUS;
        real s = at[0] * sg_ssim_window[SG_SSIM_RADIUS];
#pragma GCC unroll 8
        for (int k = 1; k <= SG_SSIM_RADIUS; k++)
            s = r_fma(at[-k] + at[k], r_set(sg_ssim_window[SG_SSIM_RADIUS - k]), s);
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
        s += (near[SG_SSIM_RADIUS - k] + near[SG_SSIM_RADIUS + k]) *
             sg_ssim_window[SG_SSIM_RADIUS - k];
    return s;
}

struct row_sums {
    real l1, l2, ssim;
};

/* Along `width` pixels of a row: SSIM and its partial derivatives from the moments of x, t, xx +
 * tt, xt. */
static __attribute__((noinline)) void derive_row(const float *x, const float *t,
                                                 const float *const moments[4],
                                                 float *const derivatives[3], int width,
                                                 struct row_sums *sums)
{
    struct row_sums s = *sums;
    for (int i = 0; i < width; i += LANES) {
        const struct ssim at = ssim_point(along(moments[0] + i), along(moments[1] + i),
                                          along(moments[2] + i), along(moments[3] + i));
        s.ssim += r_keep(r_lt(r_lane() + (float) i, r_set((float) width)), at.s);
        row_store(derivatives[0], i, width, at.d_m);
        row_store(derivatives[1], i, width, at.d_xx);
        row_store(derivatives[2], i, width, at.d_xy);
        const real d = row_load(x, i, width) - row_load(t, i, width);
        s.l1 += r_max(d, -d);
        s.l2 += d * d;
    }
    *sums = s;
}

/* Along `width` pixels of a row: dL/dimage from the derivatives under the window. */
static __attribute__((noinline)) void gradient_row(const float *x, const float *t,
                                                   const float *const derivatives[3],
                                                   const uint8_t *used, bool tolerant, float l1,
                                                   float dssim, int width, float *out)
{
    for (int i = 0; i < width; i += LANES) {
        const real vx = row_load(x, i, width), vt = row_load(t, i, width);
        real g = photometric_gradient(vx, vt, along(derivatives[0] + i), along(derivatives[1] + i),
                                      along(derivatives[2] + i), l1, dssim, tolerant);
        if (used) {
            real keep = r_set(0);
            for (int k = 0; k < LANES && i + k < width; k++)
                keep[k] = used[i + k] ? 1.0f : 0.0f;
            g *= keep;
        }
        row_store(out, i, width, g);
    }
}

/* Partial derivatives of SSIM at rows y to y + count - 1, count <= ROWS; and the sums of the rows
 * that the piece owns. */
SIMD void forward(const struct band *image, const struct band *target, const struct band maps[3],
                  int y, int count, double *sums, int first, int end)
{
    const int w = image->width, chunk = chunk_columns(w);
    struct row_sums row[ROWS] = {0};
    _Alignas(64) float moments[4][ROWS][CHUNK + 2 * PAD]; /* of x, t, xx + tt, xt */
    for (int c = 0; c < w; c += chunk) {
        const int width = w - c < chunk ? w - c : chunk;
        for (int i = -PAD; i < width + PAD; i += LANES) {
            float copies[2][REACH * LANES];
            const struct column x = find_column(image, c + i, y, copies[0]);
            const struct column t = find_column(target, c + i, y, copies[1]);
            real v[REACH];
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++)
                v[j] = r_load(x.first + j * x.stride);
            down(v, moments[0], i + PAD);
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++)
                v[j] = r_load(t.first + j * t.stride);
            down(v, moments[1], i + PAD);
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++) {
                const real vx = r_load(x.first + j * x.stride);
                v[j] = r_fma(v[j], v[j], vx * vx);
            }
            down(v, moments[2], i + PAD);
#pragma GCC unroll 16
            for (int j = 0; j < REACH; j++)
                v[j] =
                    r_fma(r_load(x.first + j * x.stride), r_load(t.first + j * t.stride), r_set(0));
            down(v, moments[3], i + PAD);
        }
        for (int r = 0; r < count; r++) {
            const float *const m[4] = {moments[0][r] + PAD, moments[1][r] + PAD,
                                       moments[2][r] + PAD, moments[3][r] + PAD};
            float *const d[3] = {band_own_row(&maps[0], y + r) + c,
                                 band_own_row(&maps[1], y + r) + c,
                                 band_own_row(&maps[2], y + r) + c};
            derive_row(band_row(image, y + r) + c, band_row(target, y + r) + c, m, d, width,
                       &row[r]);
        }
    }
    for (int r = 0; r < count; r++)
        if (y + r >= first && y + r < end) {
            double *to = sums + 3 * (y + r);
            to[0] = (double) r_sum(row[r].l1), to[1] = (double) r_sum(row[r].l2),
            to[2] = (double) r_sum(row[r].ssim);
        }
}

/* dL/dimage at rows y to y + count - 1, count <= ROWS. */
SIMD void backward(const struct cpu_loss_args *a, const struct band *image,
                   const struct band *target, const struct band maps[3], int y, int count,
                   float *gradient)
{
    const int w = a->width, chunk = chunk_columns(w);
    const float unit = 1 / (3 * (float) w * (float) a->height), lambda = a->params->lambda_dssim;
    const float l1 = (1 - lambda) * unit, dssim = -lambda * unit;
    _Alignas(64) float windowed[3][ROWS][CHUNK + 2 * PAD];
    for (int c = 0; c < w; c += chunk) {
        const int width = w - c < chunk ? w - c : chunk;
        for (int i = -PAD; i < width + PAD; i += LANES)
            for (int m = 0; m < 3; m++) {
                float copy[REACH * LANES];
                const struct column col = find_column(&maps[m], c + i, y, copy);
                real v[REACH];
#pragma GCC unroll 16
                for (int j = 0; j < REACH; j++)
                    v[j] = r_load(col.first + j * col.stride);
                down(v, windowed[m], i + PAD);
            }
        for (int r = 0; r < count; r++) {
            const size_t at = (size_t) (y + r) * (size_t) w + (size_t) c;
            const float *const d[3] = {windowed[0][r] + PAD, windowed[1][r] + PAD,
                                       windowed[2][r] + PAD};
            gradient_row(band_row(image, y + r) + c, band_row(target, y + r) + c, d,
                         a->target->mask ? a->target->mask + at : NULL, a->params->tolerance > 0,
                         l1, dssim, width, gradient + at);
        }
    }
}

/* The target's next row as floats: the render itself where masked out, else the nearest value
 * within the tolerance. */
SIMD void next_target(const struct cpu_loss_args *a, int channel, struct band *target)
{
    const int y = target->end++;
    const size_t row = (size_t) y * (size_t) a->width,
                 plane = (size_t) a->width * (size_t) a->height;
    const float *x = a->rgb + (size_t) channel * plane + row;
    const float *values =
        a->target->planes ? a->target->planes + (size_t) channel * plane + row : NULL;
    const uint8_t *used = a->target->mask ? a->target->mask + row : NULL;
    const uint8_t *bytes = values ? NULL : a->target->rgb + 3 * row + channel;
    float *out = band_own_row(target, y);
    for (int i = 0; i < a->width; i++)
        out[i] = used && !used[i] ? x[i]
                 : values         ? values[i]
                                  : (float) bytes[3 * i] * (1.0f / 255.0f);
    const real tolerance = r_set(a->params->tolerance);
    for (int i = 0; a->params->tolerance > 0 && i < a->width; i += LANES) {
        const real photo = row_load(out, i, a->width);
        row_store(out, i, a->width, photometric_target(row_load(x, i, a->width), photo, tolerance));
    }
}

SIMD int least(int a, int b)
{
    return a < b ? a : b;
}

SIMD int most(int a, int b)
{
    return a > b ? a : b;
}

/* Derivatives are computed 5 rows ahead of the rows of a step, and the target 10 rows ahead. */
void KERNEL(loss)(const struct cpu_loss_args *a, int channel, int first, int end, float *scratch)
{
    const int w = a->width, h = a->height;
    const ptrdiff_t stride = CPU_LOSS_STRIDE(w);
    const size_t plane = (size_t) channel * (size_t) w * (size_t) h;
    const struct band image = {a->rgb + plane, NULL, w, w, 0, h};
    const int top = most(first - SG_SSIM_RADIUS, 0), above = most(top - SG_SSIM_RADIUS, 0);
    struct band target = {scratch, scratch, stride, w, above, above}, maps[3];
    scratch += (CPU_LOSS_STEP + 4 * SG_SSIM_RADIUS) * stride;
    for (int m = 0; m < 3; m++, scratch += (CPU_LOSS_STEP + 2 * SG_SSIM_RADIUS) * stride)
        maps[m] = (struct band){scratch, scratch, stride, w, top, top};
    for (int y = first; y < end; y += CPU_LOSS_STEP) {
        const int stop = least(y + CPU_LOSS_STEP, end), ready = least(stop + SG_SSIM_RADIUS, h);
        band_slide(&target, y - 2 * SG_SSIM_RADIUS);
        while (target.end < least(ready + SG_SSIM_RADIUS, h))
            next_target(a, channel, &target);
        for (int m = 0; m < 3; m++)
            band_slide(&maps[m], y - SG_SSIM_RADIUS);
        for (int row = maps[0].end; row < ready; row += ROWS)
            forward(&image, &target, maps, row, least(ROWS, ready - row),
                    a->sums + 3 * (ptrdiff_t) channel * h, first, end);
        for (int m = 0; m < 3; m++)
            maps[m].end = ready;
        for (int row = y; row < stop; row += ROWS)
            backward(a, &image, &target, maps, row, least(ROWS, stop - row), a->gradient + plane);
    }
}
