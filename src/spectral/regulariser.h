/* SPDX-License-Identifier: Apache-2.0 */
/* The defense's two losses on a render: anisotropy of its spectrum and total variation. */
#ifndef SG_SPECTRAL_REGULARISER_H
#define SG_SPECTRAL_REGULARISER_H

#include "anisotropy.h"
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

/* Plans for the newest few image sizes; start zeroed. Thread safety: unsafe. */
#define SG_REGULARISER_SIZES 4
struct sg_regulariser {
    struct {
        int width, height;
        unsigned used;
        struct sg_anisotropy *plan;
    } sizes[SG_REGULARISER_SIZES];
    unsigned clock;
    double *rows;
    size_t cap_rows;
};

/* Adds the weighted gradients to `gradient`, which is 0 where the mask is. Both: 3 planes. Same bytes for any number of
 * threads. Errors: SG_ERR_BUDGET. */
int sg_regularise(sg_ctx *ctx, struct sg_regulariser *r, const struct sg_regulariser_params *params,
                  const float *planes, int width, int height, float *gradient, struct sg_regulariser_value *out);
void sg_regulariser_clear(sg_ctx *ctx, struct sg_regulariser *r);

/* Mean over the vertical differences plus mean over the horizontal ones of the norm of d. gradient: adds weight x its
 * own. rows: scratch, 3 x height x 2. */
double sg_tv_loss(sg_ctx *ctx, const float *planes, int width, int height, enum sg_tv_norm norm, double weight,
                  float *gradient, double *rows);

#endif
