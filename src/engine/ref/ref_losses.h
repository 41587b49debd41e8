/* SPDX-License-Identifier: Apache-2.0 */
/* The losses on an image that need no target, as plainly as their definitions allow, in double
 * precision. */
#ifndef SG_REF_IMAGE_LOSSES_H
#define SG_REF_IMAGE_LOSSES_H

#include "core/context.h"
#include "engine/losses.h"

/* A loss of this list without its weight, to *out. gradient: NULL, or 3 planes that get
 * dL/dplanes without the weight (assigned). planes: 3 planes. Errors: SG_ERR_BUDGET. */
int sg_ref_image_loss(sg_ctx *ctx, const struct sg_loss *loss, const float *planes, int width,
                      int height, double *gradient, double *out);

/* A kind of loss: the same. */
#define L(kind, name, type)                                                                        \
    int sg_ref_loss_##name(sg_ctx *ctx, const struct sg_loss *loss, const float *planes,           \
                           int width, int height, double *gradient, double *out);
SG_IMAGE_LOSSES(L)
#undef L

#endif
