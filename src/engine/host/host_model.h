/* SPDX-License-Identifier: Apache-2.0 */
/* The model and optimiser state of an engine that computes in host memory, and the stages that only
 * move it. */
#ifndef SG_HOST_MODEL_H
#define SG_HOST_MODEL_H

#include "engine/engine.h"

struct sg_host_model {
    size_t count, capacity; /* Gaussians; capacity is a multiple of SG_LANES */
    int sh_degree, planes;
    float *params;
    /* nothing before the first update: a model that is only drawn needs none */
    struct sg_optimiser opt;
    /* Laid out as params; NULL while there are none. */
    float *gradients;   /* of the view */
    float *accumulated; /* of earlier views, see sg_update */
    float *shaped;      /* what is drawn in place of params */
};

int sg_host_upload(sg_ctx *ctx, struct sg_host_model *h, const struct sg_model *m,
                   const struct sg_optimiser *o);
void sg_host_adopt(struct sg_host_model *h, struct sg_model *m, struct sg_optimiser *o);
/* Make room, zeroed, unless there is some. */
int sg_host_alloc_optimiser(sg_ctx *ctx, struct sg_host_model *h);
int sg_host_alloc_gradients(sg_ctx *ctx, struct sg_host_model *h);
int sg_host_alloc_accumulated(sg_ctx *ctx, struct sg_host_model *h);
int sg_host_download(const struct sg_host_model *h, struct sg_model *m, struct sg_optimiser *o);
void sg_host_statistics(sg_ctx *ctx, const struct sg_host_model *h,
                        const struct sg_statistics *out);
/* Where memory runs out the model is as it was, or edited and without moments. */
int sg_host_edit(sg_ctx *ctx, struct sg_host_model *h, const struct sg_edit *edit);
void sg_host_floor_scale(struct sg_host_model *h, float smallest);
void sg_host_reset_opacity(struct sg_host_model *h, float limit);
/* The optional stage, forth and back: fills `shaped`; turns `gradients` of `shaped` into those of
 * the parameters. */
int sg_host_shape(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape);
int sg_host_shape_backward(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape);
void sg_host_clear(struct sg_host_model *h);

/* What is projected. */
static inline const float *sg_host_effective(const struct sg_host_model *h)
{
    return h->shaped ? h->shaped : h->params;
}

/* Which Adam group a plane belongs to. */
static inline enum sg_group sg_plane_group(int plane)
{
    return plane < SG_P_OPACITY  ? SG_G_XYZ
           : plane < SG_P_SCALE  ? SG_G_OPACITY
           : plane < SG_P_ROT    ? SG_G_SCALE
           : plane < SG_P_SH     ? SG_G_ROT
           : plane < SG_P_SH + 3 ? SG_G_DC
                                 : SG_G_REST;
}

#endif
