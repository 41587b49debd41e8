/* SPDX-License-Identifier: Apache-2.0 */
/* Adaptive density control (Kerbl et al. 2023, section 5.2) as the released code does it. */
#ifndef SG_DENSIFY_H
#define SG_DENSIFY_H

#include "defense/filter.h"

struct sg_densify_params {
    float gradient; /* a mean view-space gradient of this or more densifies */
    /* As Mip-Splatting: so does one among the steepest by the absolute statistic, of which there
     * are as many as reach `gradient`. */
    bool absolute;
    float split_scale;      /* scene units: larger Gaussians split, others are cloned */
    float prune_scale;      /* scene units: larger ones are removed; 0 = off */
    uint64_t max_gaussians; /* of the model afterwards; 0 = no limit */
    /* All grow where there are fewer than the limit. At it none does, statistics go on, and with
     * prune_scale Gaussians that are large on the screen are removed. */
    bool overshoot;
    /* Called where the limit binds: the lowest scored make room for what grows most, but for at
     * most this share of the model at a time, so that what is new has time to show its worth. NULL:
     * growth stops at the limit. */
    int (*score)(void *arg, struct sg_scores *out);
    void *arg;
    float replace;
    uint64_t seed, stream; /* of the children's positions */
};

struct sg_densify_result {
    size_t cloned, split, pruned;
    size_t replaced; /* of those pruned: for their score */
    bool limited;    /* something could not grow */
};

int sg_densify(struct sg_engine *engine, const struct sg_densify_params *params,
               struct sg_densify_result *result);

#endif
