/* SPDX-License-Identifier: Apache-2.0 */
/* The losses on an image in host memory that need no target: anisotropy of its spectrum and total
 * variation. */
#ifndef SG_HOST_IMAGE_LOSSES_H
#define SG_HOST_IMAGE_LOSSES_H

#include "engine/losses.h"
#include "spectral/plans.h"

/* What is kept from call to call; start zeroed but for fft. Thread safety: unsafe. */
struct sg_image_losses {
    const struct sg_fft_kernels *fft; /* NULL: the fastest */
    struct sg_plans plans;
    double *rows;
    size_t cap_rows;
};

/* A kind of loss: what sg_image_loss does, without a mask. */
#define L(kind, name, type)                                                                        \
    int sg_image_loss_##name(sg_ctx *ctx, struct sg_image_losses *state,                           \
                             const struct sg_loss *loss, const float *planes, int width,           \
                             int height, float *gradient, double *out);
SG_IMAGE_LOSSES(L)
#undef L

/* The loss without its weight. Adds the weighted gradient to `gradient`, and then clears it where
 * the mask (height x width, or NULL) is 0. planes, gradient: 3 planes. Same bytes for any number of
 * threads. Errors: SG_ERR_BUDGET. */
int sg_image_loss(sg_ctx *ctx, struct sg_image_losses *state, const struct sg_loss *loss,
                  const float *planes, int width, int height, const uint8_t *mask, float *gradient,
                  double *out);
/* a->extra of a step with a->spectral. */
struct sg_ascend;
void sg_host_descend(const struct sg_ascend *a);
void sg_image_losses_clear(struct sg_image_losses *state);

#endif
