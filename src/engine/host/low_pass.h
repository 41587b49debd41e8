/* SPDX-License-Identifier: Apache-2.0 */
/* The low-pass term of the photometric loss, for an image in host memory. */
#ifndef SG_HOST_LOW_PASS_H
#define SG_HOST_LOW_PASS_H

#include "engine/ops.h"

/* What is kept from call to call; starts zeroed. Thread safety: unsafe. */
struct sg_host_low_pass {
    float *difference, *passed; /* 3 planes each */
    double *rows;
    size_t cap_difference, cap_passed, cap_rows;
};

/* Bytes a pixel of the above. */
#define SG_HOST_LOW_PASS_PIXEL (2 * 3 * sizeof(float))

/* The term without its weight, to *out. Adds the weighted gradient to `gradient`. image, gradient:
 * 3 planes of the target's size. Same bytes for any number of threads. Errors: SG_ERR_BUDGET. */
int sg_host_low_pass(sg_ctx *ctx, struct sg_host_low_pass *state, const float *image,
                     const struct sg_target_pixels *target, const struct sg_photometric *p,
                     int width, int height, float *gradient, double *out);
void sg_host_low_pass_clear(struct sg_host_low_pass *state);

#endif
