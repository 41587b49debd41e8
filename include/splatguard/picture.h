/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures in files: photos to look at, renders to keep. */
#ifndef SPLATGUARD_PICTURE_H
#define SPLATGUARD_PICTURE_H

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sg_picture {
    int width, height;
    uint8_t *rgb; /* height x width x 3 */
};

/* PNG, JPEG or WebP, by content; transparent pixels are put on black. The caller releases *out with
 * sg_picture_clear. Errors: SG_ERR_INPUT, also for more than max_pixels; SG_ERR_BUDGET. */
SG_API int sg_picture_read(sg_ctx *ctx, const char *path, uint64_t max_pixels,
                           struct sg_picture *out);
SG_API void sg_picture_clear(struct sg_picture *picture); /* safe on a zeroed one */

/* 8-bit PNG of 1, 3 or 4 channels, with a text "Software: splatguard VERSION", by which
 * sg_output_check_replaced knows it. The file appears whole or not at all. Errors: SG_ERR_INPUT
 * where it cannot be written, SG_ERR_USAGE for sides or channels that a PNG cannot have,
 * SG_ERR_BUDGET. */
SG_API int sg_picture_write_png(sg_ctx *ctx, const char *path, const uint8_t *pixels, int width,
                                int height, int channels);

enum sg_picture_format { SG_PICTURE_PNG, SG_PICTURE_JPEG };

/* A file in memory: PNG, or JPEG of quality 90 with colour at full resolution. pixels: height x
 * width x 3. The caller frees *out with sg_mem_free. Errors: SG_ERR_USAGE, also for sides outside
 * 1..65535 of a PNG and 1..65500 of a JPEG; SG_ERR_BUDGET. Thread safety: as the context. */
SG_API int sg_picture_encode(sg_ctx *ctx, enum sg_picture_format format, const uint8_t *pixels,
                             int width, int height, void **out, size_t *size);

/* Portable float map, little endian. planes: 1 or 3 (channels) of height x width floats. The file
 * appears whole or not at all. Errors: SG_ERR_INPUT where it cannot be written, SG_ERR_USAGE for
 * other numbers of channels and for sides outside 1..65535, SG_ERR_BUDGET. */
SG_API int sg_picture_write_pfm(sg_ctx *ctx, const char *path, const float *planes, int width,
                                int height, int channels);

#ifdef __cplusplus
}
#endif

#endif
