/* SPDX-License-Identifier: Apache-2.0 */
/* The anisotropy loss of an image: 1 - H / ln B, H the entropy of its energy |DFT|^2 (summed over the channels) in a
 * band of frequencies over B directions. 0 = the same in all directions. */
#ifndef SG_SPECTRAL_ANISOTROPY_H
#define SG_SPECTRAL_ANISOTROPY_H

#include "core/internal.h"
#include "splatguard/spectrum.h"

/* For one size: plans, table of directions, room. Thread safety: unsafe. */
struct sg_anisotropy;

int sg_anisotropy_create(sg_ctx *ctx, int width, int height, const struct sg_spectrum_params *params,
                         struct sg_anisotropy **out);
void sg_anisotropy_destroy(struct sg_anisotropy **a);

/* planes: 3 planes of height x width. gradient: NULL, or 3 planes for dL/dplanes. Flat images have loss and gradient 0.
 * Same bytes for any number of threads. */
double sg_anisotropy_loss(struct sg_anisotropy *a, const float *planes, float *gradient);

#endif
