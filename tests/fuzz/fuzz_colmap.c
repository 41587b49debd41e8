/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP models in both encodings. The first byte chooses the parser. */
#include <string.h>

#include "scene/colmap.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    sg_ctx *ctx;
    if (!size || sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    int which = *data++ % 6;
    size--;
    struct sg_colmap_cameras cameras = {0};
    struct sg_shots shots = {0};
    struct sg_points points = {0};
    char *text = sg_alloc(ctx, SG_MEM_MISC, size + 1, 1); /* its own block, so that overruns show */
    const double simple[] = {30, 30, 10, 5};
    if (!text || sg_colmap_add_camera(ctx, &cameras, "fuzz", 1, 1, 20, 10, simple))
        __builtin_trap();
    memcpy(text, data, size);
    struct sg_source in;
    sg_source_of_memory(&in, "fuzz", text, size);
    int code = SG_ERR_INPUT; /* of images */
    if (which == 0)
        sg_colmap_cameras_bin(ctx, &in, &cameras);
    else if (which == 1)
        code = sg_colmap_images_bin(ctx, &in, 1000, &cameras, &shots);
    else if (which == 2)
        sg_colmap_points_bin(ctx, &in, 100000, &points);
    else if (which == 3)
        sg_colmap_cameras_txt(ctx, &in, &cameras);
    else if (which == 4)
        code = sg_colmap_images_txt(ctx, &in, 1000, &cameras, &shots);
    else
        sg_colmap_points_txt(ctx, &in, 100000, &points);
    for (size_t i = 0; i < cameras.count;
         i++) { /* whatever a lens is like, a photo of it is undone */
        static uint8_t photo[16 * 12 * 3], pinhole[sizeof(photo)], valid[16 * 12];
        size_t lost;
        if (sg_undistort(ctx, &cameras.items[i].lens, 16, 12, photo, pinhole, valid, NULL, &lost))
            __builtin_trap();
    }
    for (size_t i = 0; i < shots.count && !code; i++) { /* a copy has other names there */
        const struct sg_shot *shot = &shots.items[i];
        const size_t length = strlen(shot->file);
        if (shot->file_at > size || length > size - shot->file_at ||
            memcmp(text + shot->file_at, shot->file, length))
            __builtin_trap();
    }
    sg_shots_check_names(ctx, &shots, 0, "fuzz");
    sg_shots_sort(&shots);
    sg_shots_clear(&shots);
    sg_free(text);
    sg_free(cameras.items);
    sg_free(points.xyz);
    sg_free(points.rgb);
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
