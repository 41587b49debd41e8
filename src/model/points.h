/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_MODEL_POINTS_H
#define SG_MODEL_POINTS_H

#include "core/source.h"

/* As sg_points_read_ply, from a source at the beginning of the file. */
int sg_points_read_source(sg_ctx *ctx, struct sg_source *in, uint64_t max_points, float **xyz,
                          uint8_t **rgb, size_t *n);

#endif
