/* SPDX-License-Identifier: Apache-2.0 */
/* Two-dimensional Fourier transforms of real images, not normalised. Plans are made by estimate, so that the same size
 * gives the same bytes. */
#ifndef SG_SPECTRAL_FFT_H
#define SG_SPECTRAL_FFT_H

#include <complex.h>
#include <fftw3.h>

#include "core/internal.h"
#include "splatguard/spectrum.h"

/* Columns of a half spectrum: horizontal frequencies 0 .. width / 2. */
#define SG_FFT_COLUMNS(width) ((size_t) (width) / 2 + 1)

/* A plan for image (height x width) to f (height x SG_FFT_COLUMNS(width)); also for other arrays, whatever their
 * alignment. Thread safe, unlike FFTW's planner. */
int sg_fft_plan(sg_ctx *ctx, int width, int height, float *image, float complex *f, fftwf_plan *plan);

/* Plans for the two halves of that, a part at a time, and back: `count` rows of `width` values, row floats apart, to
 * rows of f, stride coefficients apart, which going back destroys; `count` neighbouring columns of f, in place. image,
 * f: as aligned as what the plans are used on, that is to 64 bytes; row, stride: multiples of 64 bytes. */
int sg_fft_plan_rows(sg_ctx *ctx, int width, int count, int row, int stride, float *image, float complex *f,
                     fftwf_plan *forward, fftwf_plan *backward);
int sg_fft_plan_columns(sg_ctx *ctx, int height, int count, int stride, float complex *f, fftwf_plan *forward,
                        fftwf_plan *backward);

void sg_fft_forget(fftwf_plan plan); /* may be NULL */

/* Direction of the coefficient in row u and column v of a half spectrum, `outside` if it is not in the band. The
 * Nyquist lines have none. That of its conjugate is bins / 2 further. */
int sg_spectrum_bin(int u, int v, int width, int height, const struct sg_spectrum_params *p, int outside);

/* sg_spectrum_measure for worker threads: it keeps the error of another. */
int sg_spectrum_of(sg_ctx *ctx, const uint8_t *rgb, int width, int height, const struct sg_spectrum_params *params,
                   struct sg_spectrum *out, float *amplitude);

/* |frequency| of that coefficient as a part of the Nyquist frequency. */
double sg_spectrum_radius(int u, int v, int width, int height);

#endif
