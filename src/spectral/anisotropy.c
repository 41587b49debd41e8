/* SPDX-License-Identifier: Apache-2.0 */
#include "anisotropy.h"

#include <complex.h>
#include <fftw3.h>
#include <math.h>
#include <string.h>

#include "fft.h"

#define OUTSIDE 255 /* of the band; directions are fewer */
#define ROWS 16     /* a piece of work */

struct sg_anisotropy {
    sg_ctx *ctx;
    int width, height, columns, bins;
    size_t pieces;
    fftwf_plan forward, backward;           /* of one plane, executed on others */
    uint8_t *direction;                     /* height x columns: bin of each coefficient */
    float *plane;                           /* 3 planes: FFTW may not read the caller's, which may be unaligned */
    float complex *f;                       /* 3 half spectra */
    double *energy;                         /* pieces x bins */
    float factor[SG_SPECTRUM_BINS_MAX + 2]; /* of each bin's coefficients in the gradient; of OUTSIDE 0 */
    float *gradient;
};

static void fill_directions(struct sg_anisotropy *a, const struct sg_spectrum_params *p)
{
    for (int u = 0; u < a->height; u++)
        for (int v = 0; v < a->columns; v++)
            a->direction[u * a->columns + v] = (uint8_t) sg_spectrum_bin(u, v, a->width, a->height, p, OUTSIDE);
}

int sg_anisotropy_create(sg_ctx *ctx, int width, int height, const struct sg_spectrum_params *params,
                         struct sg_anisotropy **out)
{
    const struct sg_spectrum_params p = params ? *params : *sg_spectrum_params();
    const size_t pixels = (size_t) width * (size_t) height, half = (size_t) height * SG_FFT_COLUMNS(width);
    *out = NULL;
    struct sg_anisotropy *a = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*a));
    if (!a)
        return SG_ERR_BUDGET;
    *a = (struct sg_anisotropy){.ctx = ctx,
                                .width = width,
                                .height = height,
                                .columns = (int) SG_FFT_COLUMNS(width),
                                .bins = p.bins,
                                .pieces = ((size_t) height + ROWS - 1) / ROWS};
    a->direction = sg_alloc_raw(ctx, SG_MEM_FRAME, half, 1);
    a->plane = sg_alloc_raw(ctx, SG_MEM_FRAME, 3 * pixels, sizeof(float));
    a->f = sg_alloc_raw(ctx, SG_MEM_FRAME, 3 * half, sizeof(float complex));
    a->energy = sg_alloc_raw(ctx, SG_MEM_FRAME, a->pieces * (size_t) p.bins, sizeof(double));
    int code = a->direction && a->plane && a->f && a->energy ? SG_OK : SG_ERR_BUDGET;
    if (!code)
        code = sg_fft_plan(ctx, width, height, a->plane, a->f, &a->forward, &a->backward);
    if (code) {
        sg_anisotropy_destroy(&a);
        return code;
    }
    fill_directions(a, &p);
    *out = a;
    return SG_OK;
}

void sg_anisotropy_destroy(struct sg_anisotropy **p)
{
    struct sg_anisotropy *a = *p;
    if (!a)
        return;
    sg_fft_forget(a->forward);
    sg_fft_forget(a->backward);
    sg_free(a->ctx, a->direction);
    sg_free(a->ctx, a->plane);
    sg_free(a->ctx, a->f);
    sg_free(a->ctx, a->energy);
    sg_free(a->ctx, a);
    *p = NULL;
}

static size_t pixels_of(const struct sg_anisotropy *a)
{
    return (size_t) a->width * (size_t) a->height;
}

static float complex *spectrum_of(const struct sg_anisotropy *a, size_t channel)
{
    return a->f + channel * (size_t) a->height * (size_t) a->columns;
}

/* Planes of odd sizes are not aligned as the plans' own is: FFTW_UNALIGNED in the plans. */
static void transform(void *arg, size_t channel, int thread)
{
    const struct sg_anisotropy *a = arg;
    (void) thread;
    fftwf_execute_dft_r2c(a->forward, a->plane + channel * pixels_of(a), spectrum_of(a, channel));
}

static void sum_piece(void *arg, size_t piece, int thread)
{
    const struct sg_anisotropy *a = arg;
    (void) thread;
    double *energy = a->energy + piece * (size_t) a->bins;
    memset(energy, 0, (size_t) a->bins * sizeof(double));
    const int first = (int) piece * ROWS, end = first + ROWS < a->height ? first + ROWS : a->height;
    for (size_t channel = 0; channel < 3; channel++)
        for (int u = first; u < end; u++) {
            const float complex *row = spectrum_of(a, channel) + (ptrdiff_t) u * a->columns;
            const uint8_t *bin = a->direction + (ptrdiff_t) u * a->columns;
            for (int v = 0; v < a->columns; v++) {
                if (bin[v] == OUTSIDE)
                    continue;
                const float re = crealf(row[v]), im = cimagf(row[v]);
                const double e = (double) (re * re + im * im);
                energy[bin[v]] += e;
                if (v > 0) /* its conjugate, which is not stored */
                    energy[(bin[v] + a->bins / 2) % a->bins] += e;
            }
        }
}

/* The loss, and each bin's factor in the gradient: dL/dE_b = (ln P_b + H) / (S ln B). */
static double loss_of_bins(struct sg_anisotropy *a)
{
    double energy[SG_SPECTRUM_BINS_MAX] = {0}, total = 0, entropy = 0;
    for (size_t piece = 0; piece < a->pieces; piece++)
        for (int b = 0; b < a->bins; b++)
            energy[b] += a->energy[piece * (size_t) a->bins + (size_t) b];
    for (int b = 0; b < a->bins; b++)
        total += energy[b];
    memset(a->factor, 0, sizeof(a->factor));
    const double pixels = (double) pixels_of(a);
    if (!(total > 1e-12 * 9 * pixels * pixels)) /* rounding of a flat image */
        return 0;
    for (int b = 0; b < a->bins; b++)
        entropy -= energy[b] > 0 ? energy[b] / total * log(energy[b] / total) : 0;
    for (int b = 0; b < a->bins; b++)
        a->factor[b] = (float) ((log(fmax(energy[b] / total, 1e-12)) + entropy) / (total * log(a->bins)));
    return 1 - entropy / log(a->bins);
}

/* dL/dx = 2 c2r(factor F): the inverse transform, not normalised, brings the conjugates. */
static void pull_back(void *arg, size_t channel, int thread)
{
    const struct sg_anisotropy *a = arg;
    (void) thread;
    float complex *f = spectrum_of(a, channel);
    for (size_t i = 0; i < (size_t) a->height * (size_t) a->columns; i++)
        f[i] *= a->direction[i] == OUTSIDE ? 0 : 2 * a->factor[a->direction[i]];
    float *plane = a->plane + channel * pixels_of(a);
    fftwf_execute_dft_c2r(a->backward, f, plane);
    memcpy(a->gradient + channel * pixels_of(a), plane, pixels_of(a) * sizeof(float));
}

double sg_anisotropy_loss(struct sg_anisotropy *a, const float *planes, float *gradient)
{
    memcpy(a->plane, planes, 3 * pixels_of(a) * sizeof(float));
    sg_parallel_for(a->ctx, 3, transform, a);
    sg_parallel_for(a->ctx, a->pieces, sum_piece, a);
    const double loss = loss_of_bins(a);
    a->gradient = gradient;
    if (gradient)
        sg_parallel_for(a->ctx, 3, pull_back, a);
    return loss;
}
