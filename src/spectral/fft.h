/* SPDX-License-Identifier: Apache-2.0 */
/* Two-dimensional Fourier transforms of real images. */
#ifndef SG_SPECTRAL_FFT_H
#define SG_SPECTRAL_FFT_H

#include <complex.h>

#include "core/internal.h"

/* Columns of a half spectrum: horizontal frequencies 0 .. width / 2. */
#define SG_FFT_COLUMNS(width) ((size_t) (width) / 2 + 1)

/* image: height x width, kept. out: height x SG_FFT_COLUMNS(width), not normalised. Both from sg_alloc_raw. Plans are
 * made by estimate, so that the same size gives the same bytes. Thread safe. */
int sg_fft_forward(sg_ctx *ctx, float *image, int width, int height, float complex *out);

#endif
