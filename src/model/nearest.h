/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_NEAREST_H
#define SG_NEAREST_H

#include "core/context.h"

/* out[i]: mean squared distance of point i to its 3 nearest other points, exact; points at equal
 * positions count with distance 0. xyz: n x 3 finite floats, n >= 4. SG_ERR_INPUT for more than
 * 2^32 - 1 points, SG_ERR_BUDGET. */
int sg_nearest3(sg_ctx *ctx, const float *xyz, size_t n, float *out);

#endif
