/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/picture.h"

#include "core/file.h"
#include "image.h"

int sg_picture_read(sg_ctx *ctx, const char *path, uint64_t max_pixels, struct sg_picture *out)
{
    struct sg_image image = {0};
    sg_clear_error(ctx);
    *out = (struct sg_picture){0};
    int code = sg_image_read(ctx, path, max_pixels, &image);
    if (code)
        return code;
    const size_t n = (size_t) image.width * (size_t) image.height;
    out->width = image.width, out->height = image.height;
    out->rgb = sg_alloc_raw(ctx, SG_MEM_IMAGES, n, 3);
    if (out->rgb)
        sg_image_flatten(&image, SG_ALPHA_ON_BLACK, out->rgb);
    sg_image_clear(&image);
    return out->rgb ? SG_OK : SG_ERR_BUDGET;
}

void sg_picture_clear(struct sg_picture *picture)
{
    sg_free(picture->rgb);
    *picture = (struct sg_picture){0};
}

int sg_picture_write_png(sg_ctx *ctx, const char *path, const uint8_t *pixels, int width,
                         int height, int channels)
{
    sg_clear_error(ctx);
    return sg_image_write_picture(ctx, path, pixels, width, height, channels);
}

static int check_size(sg_ctx *ctx, int width, int height)
{
    if (width >= 1 && height >= 1 && width <= SG_IMAGE_SIDE_MAX && height <= SG_IMAGE_SIDE_MAX)
        return SG_OK;
    return sg_fail(ctx, SG_ERR_USAGE, "picture: found %d x %d pixels, expected sides of 1 to %d",
                   width, height, SG_IMAGE_SIDE_MAX);
}

int sg_picture_encode(sg_ctx *ctx, enum sg_picture_format format, const uint8_t *pixels, int width,
                      int height, void **out, size_t *size)
{
    sg_clear_error(ctx);
    *out = NULL;
    const int code = check_size(ctx, width, height);
    if (code)
        return code;
    if ((unsigned) format > SG_PICTURE_JPEG)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "picture: found format %d, expected one of enum sg_picture_format",
                       (int) format);
    return format == SG_PICTURE_JPEG
               ? sg_image_encode_jpeg(ctx, pixels, width, height, 90, true, out, size)
               : sg_image_encode_png(ctx, pixels, width, height, 3, out, size);
}

/* PFM stores rows bottom to top; a negative scale says little endian. */
int sg_picture_write_pfm(sg_ctx *ctx, const char *path, const float *planes, int width, int height,
                         int channels)
{
    struct sg_file_writer w;
    sg_clear_error(ctx);
    int code = check_size(ctx, width, height);
    if (code)
        return code;
    if (channels != 1 && channels != 3)
        return sg_fail(ctx, SG_ERR_USAGE, "picture: found %d channels, expected 1 or 3", channels);
    if ((code = sg_file_create(ctx, &w, path)))
        return code;
    fprintf(w.stream, "%s\n%d %d\n-1.0\n", channels == 3 ? "PF" : "Pf", width, height);
    const size_t plane = (size_t) width * (size_t) height;
    for (int y = height - 1; y >= 0; y--)
        for (int x = 0; x < width; x++)
            for (int ch = 0; ch < channels; ch++)
                fwrite(&planes[(size_t) ch * plane + (size_t) y * (size_t) width + (size_t) x],
                       sizeof(float), 1, w.stream);
    return sg_file_commit(ctx, &w);
}
