/* SPDX-License-Identifier: Apache-2.0 */
/* The anisotropy loss of an image: 1 - H / ln B, H the entropy of its spectral energy in a band of
 * frequencies over B directions. 0 = the same in all directions. */
#ifndef SG_SPECTRAL_ANISOTROPY_H
#define SG_SPECTRAL_ANISOTROPY_H

#include "core/context.h"
#include "splatguard/spectrum.h"

/* For one size: transforms, table of directions, room. Thread safety: unsafe. */
struct sg_anisotropy;
struct sg_fft_kernels;

/* params may be NULL, and so may fft: the fastest kernels. A side with other factors than 2, 3, 5,
 * 7 and a single 11 or 13 is slow to transform, and so is an odd width. From 256 pixels on, such a
 * side is extended to the next quick length by repeating the last row or column, unless params ask
 * for the exact size. Loss and gradient are then those of the extended image. */
int sg_anisotropy_create(sg_ctx *ctx, int width, int height,
                         const struct sg_anisotropy_params *params,
                         const struct sg_fft_kernels *fft, struct sg_anisotropy **out);
void sg_anisotropy_destroy(struct sg_anisotropy **a);

const struct sg_anisotropy_params *sg_anisotropy_params_of(const struct sg_anisotropy *a);

/* planes: 3 planes of height x width. gradient: NULL, or 3 planes to add weight x dL/dplanes to.
 * Flat images have loss and gradient 0. Same bytes for any number of threads. */
double sg_anisotropy_loss(struct sg_anisotropy *a, const float *planes, double weight,
                          float *gradient);

/* The loss of the energies of a band by direction, which negative ones of rounding become 0 in.
 * values: planes x width x height of the transform. factor: NULL, or the factor of each direction's
 * coefficients in the gradient. */
double sg_anisotropy_of_bins(const struct sg_anisotropy_params *params, double values,
                             double *energy, float *factor);

/* The size that is transformed. */
int sg_anisotropy_width(int width, bool exact);
int sg_anisotropy_height(int height, bool exact);

#endif
