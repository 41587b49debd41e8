/* SPDX-License-Identifier: Apache-2.0 */
/* Photos in, pictures out: PNG, JPEG and WebP files as 8-bit pixels. */
#ifndef SG_IMAGE_IMAGE_H
#define SG_IMAGE_IMAGE_H

#include "core/source.h"

#define SG_IMAGE_SIDE_MAX 65535 /* pixels; what a JPEG can hold */

/* 8-bit pixels, row-major, interleaved; channels: 1 grey, 3 RGB, 4 RGBA (not premultiplied). */
struct sg_image {
    int width, height, channels;
    bool lossless; /* the file keeps every value: PNG, lossless WebP */
    uint8_t *pixels;
};

/* The format is recognised by content, never by extension. 16-bit samples keep their high byte,
 * palettes are looked up, grey with alpha becomes RGBA. More than max_pixels pixels: SG_ERR_INPUT,
 * before anything is allocated for them. Safe from worker threads. The caller owns out->pixels:
 * sg_image_clear. */
int sg_image_read(sg_ctx *ctx, const char *path, uint64_t max_pixels, struct sg_image *out);
int sg_image_read_source(sg_ctx *ctx, struct sg_source *in, uint64_t max_pixels,
                         struct sg_image *out);

/* Whether the first bytes are those of a format that is read. */
bool sg_image_recognised(struct sg_source *in);

/* Same from memory; name stands for the file in messages. */
int sg_image_decode(sg_ctx *ctx, const char *name, const void *data, size_t size,
                    uint64_t max_pixels, struct sg_image *out);

/* 8-bit PNG of 1, 3 or 4 channels. The file appears whole or not at all. */
int sg_image_write_png(sg_ctx *ctx, const char *path, const uint8_t *pixels, int width, int height,
                       int channels);

/* The same with a text "Software: splatguard VERSION", by which a file is known to be the tool's to
 * replace. */
int sg_image_write_picture(sg_ctx *ctx, const char *path, const uint8_t *pixels, int width,
                           int height, int channels);

/* The same into memory, without the text: sg_free(*data). */
int sg_image_encode_png(sg_ctx *ctx, const uint8_t *pixels, int width, int height, int channels,
                        void **data, size_t *size);

/* Baseline JPEG of RGB pixels. quality: 1..100. full_chroma: 4:4:4 instead of 4:2:0. */
int sg_image_write_jpeg(sg_ctx *ctx, const char *path, const uint8_t *rgb, int width, int height,
                        int quality, bool full_chroma);

/* The same into memory: sg_free(*data). */
int sg_image_encode_jpeg(sg_ctx *ctx, const uint8_t *rgb, int width, int height, int quality,
                         bool full_chroma, void **data, size_t *size);

/* WebP of RGBA pixels that keeps every byte, into memory: sg_free(*data). Sides of at most
 * SG_WEBP_SIDE_MAX. */
#define SG_WEBP_SIDE_MAX 16383
int sg_image_encode_webp(sg_ctx *ctx, const uint8_t *rgba, int width, int height, void **data,
                         size_t *size);

void sg_image_clear(struct sg_image *image); /* safe on a zeroed image */

enum sg_alpha { SG_ALPHA_ON_BLACK, SG_ALPHA_ON_WHITE, SG_ALPHA_DROP };

/* RGB of any image: grey is repeated; alpha is composited in double precision and truncated, as the
 * reference does for Blender's renders (at alpha 255 this is exact), or dropped, as for COLMAP's
 * photos. rgb: height x width x 3. */
void sg_image_flatten(const struct sg_image *image, enum sg_alpha alpha, uint8_t *rgb);

/* Antialiased bicubic resampling (Keys 1981, a = -0.5; the support widens when shrinking), along
 * rows then along columns, rounded to 8 bits after each pass: what Pillow does. dst: dst_height x
 * dst_width x channels. */
int sg_resample(sg_ctx *ctx, const uint8_t *src, int width, int height, int channels, uint8_t *dst,
                int dst_width, int dst_height);

#endif
