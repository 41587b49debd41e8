/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_MORTON_H
#define SG_MORTON_H

#include "core/internal.h"

/* Orders n items along a space-filling curve (Morton 1966): neighbours in space become neighbours
 * in memory, so that what a tile draws comes from few places. params: the model's planes, `count`
 * Gaussians; item i lies where Gaussian source[i] is. order[k]: the item that comes k-th; equal
 * places keep their order. */
int sg_morton_order(sg_ctx *ctx, const float *params, int planes, size_t count,
                    const uint32_t *source, size_t n, uint32_t *order);

#endif
