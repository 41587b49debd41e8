/* SPDX-License-Identifier: Apache-2.0 */
/* The amplitude of a photo's noise, from the residual of a model that cannot fit it.
 *
 * A model of many photos, early in training and with a tolerance, shows the scene without the
 * noise of a single photo. The residual, photo minus render, is then noise, and detail that the
 * model does not have yet. The detail is removed as far as possible: the difference is
 * high-passed, and only the quietest tenth of the photo counts. There a bounded poison leaves
 * values near its bound.
 *
 * Where the render is evenly black or white, as the background of many objects is, the photo has no
 * detail, and shows the bound of a poison itself. */
#ifndef SG_DEFENSE_RESIDUAL_H
#define SG_DEFENSE_RESIDUAL_H

#include "core/context.h"

struct sg_residual {
    size_t blocks; /* of 8 x 8 pixels that were measured, the quietest tenth; 0 = too few */
    double level;  /* grey levels that nine tenths of their values stay below */
    /* Fourth moment over the squared second: 1 for +-epsilon, 1.8 for even noise up to a bound, 3
     * for normal noise, more for edges and texture. */
    double kurtosis;
};

/* photo: height x width x 3, 0..255; mask: height x width, 0 = unused, or NULL; render: 3 planes of
 * height x width, 0..1. Pixels where either is near black or white do not count, since clipping
 * hides what the photo holds there. SG_ERR_BUDGET. */
int sg_residual_measure(sg_ctx *ctx, const uint8_t *photo, const uint8_t *mask, const float *render,
                        int width, int height, struct sg_residual *out);

/* Of the same: grey levels that the photo differs from black or white by, where its render is that.
 * 0 if there is little of it, or if the differences have no sharp bound, or hardly any.
 * SG_ERR_BUDGET. */
int sg_residual_bound(sg_ctx *ctx, const uint8_t *photo, const uint8_t *mask, const float *render,
                      int width, int height, double *out);

#endif
