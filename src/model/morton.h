/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_MORTON_H
#define SG_MORTON_H

#include "core/context.h"

/* Where items lie: item s at the position of Gaussian s, or of row s - count from count on. */
struct sg_places {
    const float *params; /* planes of `count` Gaussians */
    size_t count;
    const float *rows;      /* NULL: there are none */
    int planes, row_planes; /* of each */
};

/* Orders n items along a space-filling curve (Morton 1966): neighbours in space become neighbours
 * in memory, so that what a tile draws comes from few places. Item i lies at place source[i]; NULL:
 * at place i. order[k]: the item that comes k-th; equal places keep their order. */
int sg_morton_order(sg_ctx *ctx, const struct sg_places *places, const uint32_t *source, size_t n,
                    uint32_t *order);

#endif
