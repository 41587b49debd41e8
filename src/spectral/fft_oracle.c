/* SPDX-License-Identifier: Apache-2.0 */
/* One transform after the other, by Cooley and Tukey in the plainest form. */
#include <math.h>
#include <string.h>

#include "fft.h"

static int least_factor(int n)
{
    for (int p = 2; p <= n / p; p++)
        if (n % p == 0)
            return p;
    return n;
}

static void add_product(double *to, const double *a, uint64_t k, int n)
{
    const double angle = 6.283185307179586476925 * (double) (k % (uint64_t) n) / (double) n;
    const double re = cos(angle), im = -sin(angle);
    to[0] += a[0] * re - a[1] * im;
    to[1] += a[0] * im + a[1] * re;
}

/* The points of `in` are `step` complex numbers apart. */
static void transform(int n, const double *in, size_t step, double *out, double *room)
{
    const int radix = least_factor(n), rest = n / radix;
    for (int j = 0; j < radix && rest > 1; j++)
        transform(rest, in + 2 * step * (size_t) j, step * (size_t) radix,
                  out + 2 * (size_t) j * (size_t) rest, room);
    for (int k = 0; k < n; k++) {
        room[2 * k] = room[2 * k + 1] = 0;
        for (int j = 0; j < radix; j++)
            add_product(room + 2 * k,
                        rest > 1 ? out + 2 * (j * rest + k % rest) : in + 2 * step * (size_t) j,
                        (uint64_t) j * (uint64_t) k, n);
    }
    memcpy(out, room, 2 * (size_t) n * sizeof(double));
}

void sg_fft_exact(int n, const double *in, double *out, double *room)
{
    transform(n, in, 1, out, room);
}

/* Backward: with real and imaginary parts exchanged, before and after. */
static void columns(const struct sg_fft *fft, const float *in, float *out, bool backward,
                    float *scratch)
{
    const int n = fft->n;
    double *from = (double *) (void *) scratch, *to = from + 2 * n, *room = to + 2 * n;
    for (int lane = 0; lane < SG_FFT_LANES; lane++) {
        for (int k = 0; k < n; k++)
            for (int part = 0; part < 2; part++)
                from[2 * k + (part ^ backward)] =
                    (double) in[(size_t) k * SG_FFT_POINT + (size_t) (part * SG_FFT_LANES + lane)];
        sg_fft_exact(n, from, to, room);
        for (int k = 0; k < n; k++)
            for (int part = 0; part < 2; part++)
                out[(size_t) k * SG_FFT_POINT + (size_t) (part * SG_FFT_LANES + lane)] =
                    (float) to[2 * k + (part ^ backward)];
    }
}

static float *coefficient(const struct sg_fft_rows *r, int row, int column)
{
    return r->panels + (size_t) (column / SG_FFT_LANES) * r->panel + (size_t) row * SG_FFT_POINT +
           (size_t) (column % SG_FFT_LANES);
}

static void rows(const struct sg_fft *fft, const struct sg_fft_rows *r, const float *const *row,
                 float *scratch)
{
    const int n = fft->n, end = (int) SG_FFT_PANELS(r->columns) * SG_FFT_LANES;
    double *from = (double *) (void *) scratch, *to = from + 2 * n, *room = to + 2 * n;
    for (int i = 0; i < r->count; i++) {
        for (int k = 0; k < n; k++)
            from[2 * k] = (double) row[i][k < r->width ? k : r->width - 1], from[2 * k + 1] = 0;
        sg_fft_exact(n, from, to, room);
        for (int k = 0; k < end; k++) {
            float *f = coefficient(r, i, k);
            f[0] = k < n ? (float) to[2 * k] : 0;
            f[SG_FFT_LANES] = k < n ? (float) to[2 * k + 1] : 0;
        }
    }
}

static void rows_back(const struct sg_fft *fft, const struct sg_fft_rows *r, float *const *row,
                      float scale, float *scratch)
{
    const int n = fft->n;
    double *from = (double *) (void *) scratch, *to = from + 2 * n, *room = to + 2 * n;
    for (int i = 0; i < r->count; i++) {
        if (!row[i])
            continue;
        memset(from, 0, 2 * (size_t) n * sizeof(double));
        for (int k = 0; k < r->columns;
             k++) { /* a number, and its conjugate; exchanged, as above */
            const float *f = coefficient(r, i, k);
            const int twin = (n - k) % n;
            from[2 * k + 1] = from[2 * twin + 1] = (double) f[0];
            from[2 * k] = k ? (double) f[SG_FFT_LANES] : 0;
            from[2 * twin] = -from[2 * k];
        }
        sg_fft_exact(n, from, to, room);
        for (int k = r->width; k < n; k++)
            to[2 * r->width - 1] += to[2 * k + 1];
        for (int k = 0; k < r->width; k++)
            row[i][k] += scale * (float) to[2 * k + 1];
    }
}

const struct sg_fft_kernels sg_fft_oracle = {
    .columns = columns, .rows = rows, .rows_back = rows_back};
