/* SPDX-License-Identifier: Apache-2.0 */
/* PNG, JPEG and WebP decoding, then what every loaded image goes through. */
#include "image/image.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    sg_ctx *ctx;
    struct sg_image image;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    if (!sg_image_decode(ctx, "fuzz", data, size, 1 << 18, &image)) {
        uint8_t small[5 * 4 * 4];
        uint8_t *rgb =
            sg_alloc(ctx, SG_MEM_IMAGES, (size_t) image.width * (size_t) image.height, 3);
        if (rgb)
            sg_image_flatten(&image, SG_ALPHA_ON_WHITE, rgb);
        sg_resample(ctx, image.pixels, image.width, image.height, image.channels, small, 5, 4);
        sg_free(rgb);
        sg_image_clear(&image);
    }
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
