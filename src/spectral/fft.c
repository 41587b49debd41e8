/* SPDX-License-Identifier: Apache-2.0 */
#include "fft.h"

#include <fftw3.h>
#include <pthread.h>

/* FFTW's planner is the only part of it that threads must not share. */
static pthread_mutex_t planner = PTHREAD_MUTEX_INITIALIZER;

int sg_fft_forward(sg_ctx *ctx, float *image, int width, int height, float complex *out)
{
    pthread_mutex_lock(&planner);
    fftwf_plan plan =
        fftwf_plan_dft_r2c_2d(height, width, image, (fftwf_complex *) out, FFTW_ESTIMATE | FFTW_PRESERVE_INPUT);
    pthread_mutex_unlock(&planner);
    if (!plan)
        return sg_fail(ctx, SG_ERR_INTERNAL, "no Fourier transform of %d x %d pixels", width, height);
    fftwf_execute(plan);
    pthread_mutex_lock(&planner);
    fftwf_destroy_plan(plan);
    pthread_mutex_unlock(&planner);
    return SG_OK;
}
