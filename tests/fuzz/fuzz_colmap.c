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
    const double pinhole[] = {30, 30, 10, 5};
    if (!text || sg_colmap_add_camera(ctx, &cameras, "fuzz", 1, 1, 20, 10, pinhole))
        __builtin_trap();
    memcpy(text, data, size);
    if (which == 0)
        sg_colmap_cameras_bin(ctx, "fuzz", text, size, &cameras);
    else if (which == 1)
        sg_colmap_images_bin(ctx, "fuzz", text, size, 1000, &cameras, &shots);
    else if (which == 2)
        sg_colmap_points_bin(ctx, "fuzz", text, size, 100000, &points);
    else if (which == 3)
        sg_colmap_cameras_txt(ctx, "fuzz", text, size, &cameras);
    else if (which == 4)
        sg_colmap_images_txt(ctx, "fuzz", text, size, 1000, &cameras, &shots);
    else
        sg_colmap_points_txt(ctx, "fuzz", text, size, 100000, &points);
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
