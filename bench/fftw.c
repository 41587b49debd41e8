/* SPDX-License-Identifier: Apache-2.0 */
/* What the library did before it had transforms of its own, for comparison. It is built where FFTW
 * is installed, and is part of the benchmark only. Rows are transformed 16 at a time from a small
 * buffer, columns 16 at a time in place and only those that reach into the band. */
#include "fftw.h"

#include <complex.h>
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "spectral/fft.h"
#include "spectral/frequency.h"

#define OUTSIDE 255
#define ROWS 16
#define COLUMNS 16
#define APART 4
#define BINS 36

struct fftw_anisotropy {
    sg_ctx *ctx;
    int width, height, w, h;
    int columns;
    size_t row, stride;
    fftwf_plan rows[2], rows_back[2], cols[2], cols_back[2]; /* of a whole piece; of the last one */
    uint8_t *direction;
    float *buffers, *beyond;
    float complex *f;
    double *energy;
    float factor[256];
    const float *image;
    float *gradient;
};

static size_t row_pieces(const struct fftw_anisotropy *a)
{
    return ((size_t) a->h + ROWS - 1) / ROWS;
}

static size_t column_pieces(const struct fftw_anisotropy *a)
{
    return ((size_t) a->columns + COLUMNS - 1) / COLUMNS;
}

static void make_plans(struct fftw_anisotropy *a, int last)
{
    const int rows = last ? a->h % ROWS : ROWS, columns = last ? a->columns % COLUMNS : COLUMNS;
    const int row = (int) a->row, stride = (int) a->stride;
    const unsigned flags = FFTW_ESTIMATE; /* as the library did: the same plans in each run */
    if (rows) {
        a->rows[last] = fftwf_plan_many_dft_r2c(1, &a->w, rows, a->buffers, NULL, 1, row, a->f,
                                                NULL, 1, stride, flags);
        a->rows_back[last] = fftwf_plan_many_dft_c2r(1, &a->w, rows, a->f, NULL, 1, stride,
                                                     a->buffers, NULL, 1, row, flags);
    }
    if (columns) {
        a->cols[last] = fftwf_plan_many_dft(1, &a->h, columns, a->f, NULL, stride, 1, a->f, NULL,
                                            stride, 1, FFTW_FORWARD, flags);
        a->cols_back[last] = fftwf_plan_many_dft(1, &a->h, columns, a->f, NULL, stride, 1, a->f,
                                                 NULL, stride, 1, FFTW_BACKWARD, flags);
    }
}

static void *aligned(size_t bytes)
{
    void *p = NULL;
    if (posix_memalign(&p, 64, bytes + 64))
        abort();
    return memset(p, 0, bytes + 64);
}

struct fftw_anisotropy *fftw_anisotropy_create(sg_ctx *ctx, int width, int height, bool exact)
{
    struct fftw_anisotropy *a = aligned(sizeof(*a));
    const struct sg_spectrum_params band = {SG_SPECTRUM_DEFAULTS};
    *a = (struct fftw_anisotropy){.ctx = ctx, .width = width, .height = height};
    a->w = sg_anisotropy_width(width, exact), a->h = sg_anisotropy_height(height, exact);
    a->row = ((size_t) a->w + 15) / 16 * 16, a->stride = (SG_FFT_COLUMNS(a->w) + 7) / 8 * 8;
    for (int v = 0; v < (int) SG_FFT_COLUMNS(a->w); v++)
        for (int u = 0; u < a->h && a->columns <= v; u++)
            if (sg_spectrum_bin(u, v, a->w, a->h, &band, OUTSIDE) != OUTSIDE)
                a->columns = v + 1;
    a->direction = aligned((size_t) a->h * (size_t) a->columns);
    for (int u = 0; u < a->h; u++)
        for (int v = 0; v < a->columns; v++)
            a->direction[u * a->columns + v] =
                (uint8_t) sg_spectrum_bin(u, v, a->w, a->h, &band, OUTSIDE);
    a->buffers = aligned((size_t) sg_ctx_threads(ctx) * ROWS * a->row * sizeof(float));
    a->f = aligned(3 * (size_t) a->h * a->stride * sizeof(float complex));
    a->beyond = aligned(3 * (size_t) (a->h - height) * (size_t) width * sizeof(float));
    a->energy = aligned(3 * column_pieces(a) * BINS * sizeof(double));
    make_plans(a, 0);
    make_plans(a, 1);
    return a;
}

void fftw_anisotropy_destroy(struct fftw_anisotropy *a)
{
    for (int i = 0; i < 2; i++) {
        fftwf_destroy_plan(a->rows[i]);
        fftwf_destroy_plan(a->rows_back[i]);
        fftwf_destroy_plan(a->cols[i]);
        fftwf_destroy_plan(a->cols_back[i]);
    }
    free(a->direction), free(a->buffers), free(a->f), free(a->beyond), free(a->energy), free(a);
}

static float complex *spectrum_of(const struct fftw_anisotropy *a, size_t plane)
{
    return a->f + plane * (size_t) a->h * a->stride;
}

static void transform_rows(void *arg, size_t piece, int thread)
{
    struct fftw_anisotropy *a = arg;
    const size_t plane = piece / row_pieces(a);
    const int first = (int) (piece % row_pieces(a)) * ROWS,
              end = first + ROWS < a->h ? first + ROWS : a->h;
    float *buffer = a->buffers + (size_t) thread * ROWS * a->row;
    for (int y = first; y < end; y++) {
        float *to = buffer + (size_t) (y - first) * a->row;
        const size_t own =
            plane * (size_t) a->height + (size_t) (y < a->height ? y : a->height - 1);
        memcpy(to, a->image + own * (size_t) a->width, (size_t) a->width * sizeof(float));
        for (int x = a->width; x < a->w; x++)
            to[x] = to[a->width - 1];
    }
    fftwf_execute_dft_r2c(a->rows[end - first < ROWS], buffer,
                          spectrum_of(a, plane) + (size_t) first * a->stride);
}

struct column_piece {
    float complex *f; /* its first column */
    int first, count;
};

static struct column_piece column_piece(const struct fftw_anisotropy *a, size_t piece)
{
    const int first = (int) (piece % column_pieces(a)) * COLUMNS;
    return (struct column_piece){spectrum_of(a, piece / column_pieces(a)) + first, first,
                                 first + COLUMNS < a->columns ? COLUMNS : a->columns - first};
}

static void transform_columns(void *arg, size_t piece, int thread)
{
    struct fftw_anisotropy *a = arg;
    const struct column_piece c = column_piece(a, piece);
    double energy[APART][256] = {0}, whole[256] = {0};
    (void) thread;
    fftwf_execute_dft(a->cols[c.count < COLUMNS], c.f, c.f);
    for (int u = 0; u < a->h; u++) {
        const float *f = (const float *) (c.f + (size_t) u * a->stride);
        const uint8_t *bin = a->direction + u * a->columns + c.first;
        float e[COLUMNS] = {0};
        for (int v = 0; v < c.count; v++)
            e[v] = f[2 * v] * f[2 * v] + f[2 * v + 1] * f[2 * v + 1];
        (c.first ? energy[0] : whole)[bin[0]] += (double) e[0];
        for (int v = 1; v < c.count; v++)
            energy[v % APART][bin[v]] += (double) e[v];
    }
    double *sums = a->energy + piece * BINS;
    memset(sums, 0, BINS * sizeof(double));
    for (int b = 0; b < BINS; b++) {
        const double sum = (energy[0][b] + energy[1][b]) + (energy[2][b] + energy[3][b]);
        sums[b] += whole[b] + sum;
        sums[(b + BINS / 2) % BINS] += sum;
    }
}

static double loss_of_bins(struct fftw_anisotropy *a)
{
    double energy[BINS] = {0}, total = 0, entropy = 0;
    for (size_t piece = 0; piece < 3 * column_pieces(a); piece++)
        for (int b = 0; b < BINS; b++)
            energy[b] += a->energy[piece * BINS + (size_t) b];
    for (int b = 0; b < BINS; b++)
        total += energy[b];
    for (int b = 0; b < BINS; b++)
        entropy -= energy[b] > 0 ? energy[b] / total * log(energy[b] / total) : 0;
    for (int b = 0; b < BINS; b++)
        a->factor[b] =
            (float) (2 * (log(fmax(energy[b] / total, 1e-12)) + entropy) / (total * log(BINS)));
    return 1 - entropy / log(BINS);
}

static void pull_columns(void *arg, size_t piece, int thread)
{
    struct fftw_anisotropy *a = arg;
    const struct column_piece c = column_piece(a, piece);
    (void) thread;
    for (int u = 0; u < a->h; u++) {
        float complex *f = c.f + (size_t) u * a->stride;
        const uint8_t *bin = a->direction + u * a->columns + c.first;
        for (int v = 0; v < c.count; v++)
            f[v] *= a->factor[bin[v]];
    }
    fftwf_execute_dft(a->cols_back[c.count < COLUMNS], c.f, c.f);
}

static void pull_rows(void *arg, size_t piece, int thread)
{
    struct fftw_anisotropy *a = arg;
    const size_t plane = piece / row_pieces(a), width = (size_t) a->width;
    const int first = (int) (piece % row_pieces(a)) * ROWS,
              end = first + ROWS < a->h ? first + ROWS : a->h;
    float *buffer = a->buffers + (size_t) thread * ROWS * a->row;
    float complex *f = spectrum_of(a, plane) + (size_t) first * a->stride;
    for (int y = first; y < end; y++)
        memset(f + (size_t) (y - first) * a->stride + a->columns, 0,
               (SG_FFT_COLUMNS(a->w) - (size_t) a->columns) * sizeof(*f));
    fftwf_execute_dft_c2r(a->rows_back[end - first < ROWS], f, buffer);
    for (int y = first; y < end; y++) {
        float *g = buffer + (size_t) (y - first) * a->row;
        for (int x = a->width; x < a->w; x++)
            g[a->width - 1] += g[x];
        if (y < a->height) {
            float *to = a->gradient + (plane * (size_t) a->height + (size_t) y) * width;
            for (size_t x = 0; x < width; x++)
                to[x] += g[x];
        } else
            memcpy(a->beyond +
                       (plane * (size_t) (a->h - a->height) + (size_t) (y - a->height)) * width,
                   g, width * sizeof(float));
    }
}

double fftw_anisotropy_loss(struct fftw_anisotropy *a, const float *planes, float *gradient)
{
    const size_t rows = 3 * row_pieces(a), columns = 3 * column_pieces(a),
                 width = (size_t) a->width;
    a->image = planes, a->gradient = gradient;
    sg_parallel_for(a->ctx, rows, transform_rows, a);
    sg_parallel_for(a->ctx, columns, transform_columns, a);
    const double loss = loss_of_bins(a);
    sg_parallel_for(a->ctx, columns, pull_columns, a);
    sg_parallel_for(a->ctx, rows, pull_rows, a);
    const float *from = a->beyond;
    for (size_t plane = 0; plane < 3; plane++)
        for (int y = a->height; y < a->h; y++, from += width)
            for (size_t x = 0; x < width; x++)
                gradient[((plane + 1) * (size_t) a->height - 1) * width + x] += from[x];
    return loss;
}
