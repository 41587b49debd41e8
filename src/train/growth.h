/* SPDX-License-Identifier: Apache-2.0 */
/* Growth of anchors (Lu et al. 2024, section 3.3) in the order of the released code: where
 * Gaussians have large gradients, the cells of three grids that have no anchor get one. */
#ifndef SG_TRAIN_GROWTH_H
#define SG_TRAIN_GROWTH_H

#include "model/columns.h"

/* What an anchor or its Gaussians are, in host memory. */
struct sg_anchor_view {
    size_t count;
    const float *params, *anchor, *statistics; /* the columns of these names */
};

struct sg_growth_params {
    float voxel;
    int factor; /* cells of the coarsest grid, in voxels */
    int grids;  /* their number */
    int finer;  /* times, from each to the next */
    /* The mean that makes a Gaussian grow; finer / 2 times as much for each finer grid. */
    float gradient;
    float drawn;        /* Gaussians that were drawn in more views count */
    float drop;         /* of a Gaussian, on the coarsest grid, the probability to be left out; its
                           powers on the others */
    float log_size_max; /* of new anchors */
    size_t limit; /* the most new anchors: those of the largest gradients; the others stay out */
    uint64_t seed, stream;
};

/* New anchors as rows of a model, NULL if there is none. bound: there were more than the limit. */
int sg_grow_anchors(sg_ctx *ctx, const struct sg_anchor_view *anchors,
                    const struct sg_growth_params *params, struct sg_model **rows, bool *bound);

#endif
