/* SPDX-License-Identifier: Apache-2.0 */
/* Whole zstd frames (RFC 8878) in memory. */
#ifndef SG_FORMAT_ZSTD_FRAME_H
#define SG_FORMAT_ZSTD_FRAME_H

#include "core/context.h"

/* One frame that holds exactly n bytes. path: for messages. SG_ERR_INPUT for a damaged frame;
 * SG_ERR_USAGE: built without zstd. */
int sg_zstd_unpack(sg_ctx *ctx, const char *path, const void *packed, size_t size, void *to,
                   size_t n);
/* sg_free(*packed). */
int sg_zstd_pack(sg_ctx *ctx, const char *path, const void *from, size_t n, void **packed,
                 size_t *size);

#endif
