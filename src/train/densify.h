/* SPDX-License-Identifier: Apache-2.0 */
/* Adaptive density control (Kerbl et al. 2023, section 5.2) as the released code does it. */
#ifndef SG_DENSIFY_H
#define SG_DENSIFY_H

#include "backend/backend.h"

struct sg_densify_params {
    float gradient;         /* a mean view-space gradient of this or more densifies */
    float split_scale;      /* scene units: larger Gaussians split, others are cloned */
    float prune_scale;      /* scene units: larger ones are removed; 0 = off */
    uint64_t max_gaussians; /* growth stops there; 0 = no limit */
    uint64_t seed, stream;  /* of the children's positions */
};

struct sg_densify_result {
    size_t cloned, split, pruned;
};

int sg_densify(struct sg_backend *backend, const struct sg_densify_params *params, struct sg_densify_result *result);

#endif
