/* SPDX-License-Identifier: Apache-2.0 */
/* The state of the engine for anchors, and its own stages: view.c makes Gaussians of anchors,
 * learn.c takes their gradients back. However work is cut into pieces, every sum is taken in a
 * fixed order, so that any number of threads gives the same bytes. */
#ifndef SG_SCAFFOLD_STATE_H
#define SG_SCAFFOLD_STATE_H

#include "engine/host/host_model.h"
#include "engine/ops.h"
#include "neural.h"

/* What a view makes of an anchor that it sees. */
struct seen {
    uint32_t anchor;
    uint32_t first;  /* its first Gaussian */
    uint16_t exists; /* a bit for each that it has */
};

struct scaffold_engine {
    struct sg_engine base;
    struct sg_engine_ops ops; /* its own, as far as `inner` has what they need */
    struct sg_engine *inner;
    void (*neural)(const struct sg_neural_args *, const struct sg_anchor_block *,
                   float (*)[SG_DRAWN_PLANES][SG_LANES]);
    void (*neural_backward)(const struct sg_neural_args *, const struct sg_anchor_block *,
                            float (*)[SG_DRAWN_PLANES][SG_LANES], struct sg_anchor_gradient *,
                            struct sg_weight_sums *);
    void (*pick)(const float *, int, int, int, const uint32_t *, float (*)[SG_LANES]);
    struct sg_host_model anchors;
    struct sg_networks *networks;
    /* Not NULL: they learn on the device of the engine that draws. Then the two above are a copy;
     * at most one of both is newer. */
    const struct sg_anchor_ops *device;
    bool host_newer, device_newer;
    /* of the view */
    struct sg_neural_args args;
    size_t photo;                   /* whose appearance it has; SIZE_MAX: of none */
    struct sg_weights *own_weights; /* those that it is drawn with, where appearances are learned */
    float appearance[SG_APPEARANCE], appearance_gradient[SG_APPEARANCE];
    uint8_t *sees;                                 /* of each anchor */
    struct seen *seen;                             /* first those that have a Gaussian */
    size_t seen_count, drawing_count, drawn_count; /* drawing: with a Gaussian */
    sg_drawn_block *drawn;                         /* of a chunk */
    struct sg_anchor_gradient *gradient;           /* by block of anchors that have a Gaussian */
    struct sg_weight_sums *weight_sums;            /* of each piece */
    struct sg_weights *weight_gradient;
    uint32_t *place; /* of each anchor among those that have a Gaussian */
    bool learns;     /* weight_gradient is that of the newest view */
    size_t cap_sees, cap_seen, cap_drawn, cap_gradient, cap_place, cap_weight_sums;
};

/* The view's Gaussians: the model of the engine that draws, which is in host memory. */
static inline struct sg_host_model *sg_scaffold_drawn_model(struct scaffold_engine *b)
{
    return b->inner->ops->host_model(b->inner);
}

/* The Gaussians that the engine has which draws. A view without any gets one that is not drawn. */
static inline size_t sg_scaffold_drawn(const struct scaffold_engine *b)
{
    if (b->device)
        return b->anchors.count * SG_ANCHOR_GAUSSIANS;
    return b->drawn_count ? b->drawn_count : 1;
}

/* Waits for the engine that draws, before what is not a stage of it: see ops.h. */
static inline int sg_scaffold_wait(const struct scaffold_engine *b)
{
    return b->inner->ops->finish ? b->inner->ops->finish(b->inner) : SG_OK;
}

/* Makes the view's Gaussians, and hands them to the engine that draws. appearance: as of struct
 * sg_render_params. */
int sg_scaffold_view(struct scaffold_engine *b, const struct sg_camera *camera, int appearance);
/* The values of a block of the first `count` seen anchors. Lanes beyond the last are its copies
 * with all Gaussians hidden: they count in no sum over the lanes. */
void sg_scaffold_gather(const struct scaffold_engine *b, size_t count, size_t block,
                        struct sg_anchor_block *out);
/* device.c: the same on the device. */
int sg_scaffold_device_view(struct scaffold_engine *b, const struct sg_camera *camera,
                            int appearance);
int sg_scaffold_device_pull(struct scaffold_engine *b, bool statistics);
int sg_scaffold_device_optimise(struct scaffold_engine *b, const struct sg_update *u);
int sg_scaffold_device_learn(struct scaffold_engine *b, const struct sg_network_update *u);
/* The copy on the host is up to date after this. */
int sg_scaffold_fetch(struct scaffold_engine *b);

/* Gradients of the view's Gaussians to those of anchors and weights. */
int sg_scaffold_pull(struct scaffold_engine *b, bool statistics);
int sg_scaffold_optimise(struct scaffold_engine *b, const struct sg_update *u);
void sg_scaffold_learn(struct scaffold_engine *b, const struct sg_network_update *u);

#endif
