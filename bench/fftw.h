/* SPDX-License-Identifier: Apache-2.0 */
#ifndef BENCH_FFTW_H
#define BENCH_FFTW_H

#include "spectral/anisotropy.h"

/* The anisotropy loss as the library computed it with FFTW: power, three channels, default band. */
struct fftw_anisotropy;

struct fftw_anisotropy *fftw_anisotropy_create(sg_ctx *ctx, int width, int height, bool exact);
void fftw_anisotropy_destroy(struct fftw_anisotropy *a);
/* As sg_anisotropy_loss, with weight 1. */
double fftw_anisotropy_loss(struct fftw_anisotropy *a, const float *planes, float *gradient);

#endif
