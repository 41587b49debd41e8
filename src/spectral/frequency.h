/* SPDX-License-Identifier: Apache-2.0 */
/* Where the coefficients of a half spectrum lie in the plane of frequencies, and an image's
 * spectrum. */
#ifndef SG_SPECTRAL_FREQUENCY_H
#define SG_SPECTRAL_FREQUENCY_H

#include "core/context.h"
#include "splatguard/spectrum.h"

/* Direction of the coefficient in row u and column v of a half spectrum, `outside` if it is not in
 * the band. The Nyquist lines have none. The direction of its conjugate is bins / 2 further. */
int sg_spectrum_bin(int u, int v, int width, int height, const struct sg_spectrum_params *p,
                    int outside);

/* Columns of a half spectrum, the first ones, that have all coefficients of the band; at least 1.
 */
int sg_spectrum_columns(int width, int height, const struct sg_spectrum_params *p);

/* |frequency| of that coefficient as a part of the Nyquist frequency. */
double sg_spectrum_radius(int u, int v, int width, int height);

/* sg_spectrum_measure for worker threads: it does not clear the error of another thread. */
int sg_spectrum_of(sg_ctx *ctx, const uint8_t *rgb, int width, int height,
                   const struct sg_spectrum_params *params, struct sg_spectrum *out,
                   float *amplitude);

#endif
