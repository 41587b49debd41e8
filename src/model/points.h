/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_MODEL_POINTS_H
#define SG_MODEL_POINTS_H

#include <stdio.h>

#include "core/internal.h"

/* As sg_points_read_ply, from a file that is open; path stands for it in messages. */
int sg_points_read_stream(sg_ctx *ctx, FILE *stream, const char *path, uint64_t max_points,
                          float **xyz, uint8_t **rgb, size_t *n);

#endif
