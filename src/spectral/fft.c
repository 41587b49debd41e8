/* SPDX-License-Identifier: Apache-2.0 */
#include "fft.h"

#include <math.h>
#include <pthread.h>

#define TAU 6.283185307179586

/* FFTW's planner is the only part of it that threads must not share. */
static pthread_mutex_t planner = PTHREAD_MUTEX_INITIALIZER;

int sg_fft_plan(sg_ctx *ctx, int width, int height, float *image, float complex *f, fftwf_plan *plan)
{
    pthread_mutex_lock(&planner);
    *plan = fftwf_plan_dft_r2c_2d(height, width, image, f, FFTW_ESTIMATE | FFTW_UNALIGNED | FFTW_PRESERVE_INPUT);
    pthread_mutex_unlock(&planner);
    return *plan ? SG_OK : sg_fail(ctx, SG_ERR_BUDGET, "no Fourier transform of %d x %d pixels", width, height);
}

int sg_fft_plan_rows(sg_ctx *ctx, int width, int count, int row, int stride, float *image, float complex *f,
                     fftwf_plan *forward, fftwf_plan *backward)
{
    pthread_mutex_lock(&planner);
    *forward = fftwf_plan_many_dft_r2c(1, &width, count, image, NULL, 1, row, f, NULL, 1, stride, FFTW_ESTIMATE);
    *backward = fftwf_plan_many_dft_c2r(1, &width, count, f, NULL, 1, stride, image, NULL, 1, row, FFTW_ESTIMATE);
    pthread_mutex_unlock(&planner);
    return *forward && *backward ? SG_OK : sg_fail(ctx, SG_ERR_BUDGET, "no Fourier transform of %d pixels", width);
}

int sg_fft_plan_columns(sg_ctx *ctx, int height, int count, int stride, float complex *f, fftwf_plan *forward,
                        fftwf_plan *backward)
{
    pthread_mutex_lock(&planner);
    *forward =
        fftwf_plan_many_dft(1, &height, count, f, NULL, stride, 1, f, NULL, stride, 1, FFTW_FORWARD, FFTW_ESTIMATE);
    *backward =
        fftwf_plan_many_dft(1, &height, count, f, NULL, stride, 1, f, NULL, stride, 1, FFTW_BACKWARD, FFTW_ESTIMATE);
    pthread_mutex_unlock(&planner);
    return *forward && *backward ? SG_OK : sg_fail(ctx, SG_ERR_BUDGET, "no Fourier transform of %d pixels", height);
}

void sg_fft_forget(fftwf_plan plan)
{
    if (!plan)
        return;
    pthread_mutex_lock(&planner);
    fftwf_destroy_plan(plan);
    pthread_mutex_unlock(&planner);
}

/* Signed frequency of a row, in cycles a pixel. */
static double vertical(int u, int height)
{
    return (double) (u <= (height - 1) / 2 ? u : u - height) / height;
}

double sg_spectrum_radius(int u, int v, int width, int height)
{
    return hypot(vertical(u, height), (double) v / width) / 0.5;
}

int sg_spectrum_bin(int u, int v, int width, int height, const struct sg_spectrum_params *p, int outside)
{
    const double fu = vertical(u, height), fv = (double) v / width, r = sg_spectrum_radius(u, v, width, height);
    if (!(r > 0 && r >= p->low && r <= p->high) || 2 * v == width || 2 * u == height)
        return outside;
    /* Exact multiples of a bin, as the axes are, belong to the upper one on every machine; the pairs with v = 0 are
     * opposite whatever atan2 says. */
    const bool lower = v == 0 && fu < 0;
    const int b = (int) floor((atan2(lower ? -fu : fu, fv) + TAU / 2) * p->bins / TAU + 1e-9) % p->bins;
    return lower ? (b + p->bins / 2) % p->bins : b;
}
