/* SPDX-License-Identifier: Apache-2.0 */
/* The defense's two losses on a render: anisotropy of its spectrum and total variation. */
#ifndef SG_SPECTRAL_REGULARISER_H
#define SG_SPECTRAL_REGULARISER_H

#include "plans.h"
#include "splatguard/defense.h"

struct sg_regulariser_params {
    double anisotropy, total_variation; /* weights; 0 = neither measured nor felt */
    enum sg_tv_norm tv;
    struct sg_anisotropy_params spectrum; /* the same in all calls */
    const uint8_t *mask;                  /* height x width: pixels of 0 pull at nothing; NULL = none */
};

struct sg_regulariser_value {
    double anisotropy, total_variation; /* the losses, without their weights; NAN = not measured */
    double anisotropy_seconds, total_variation_seconds;
};

/* What is kept from call to call; start zeroed. Thread safety: unsafe. */
struct sg_regulariser {
    struct sg_plans plans;
    double *rows;
    size_t cap_rows;
};

/* Adds the weighted gradients to `gradient`, which is 0 where the mask is. Both: 3 planes. Same bytes for any number of
 * threads. Errors: SG_ERR_BUDGET. */
int sg_regularise(sg_ctx *ctx, struct sg_regulariser *r, const struct sg_regulariser_params *params,
                  const float *planes, int width, int height, float *gradient, struct sg_regulariser_value *out);
void sg_regulariser_clear(struct sg_regulariser *r);

#endif
