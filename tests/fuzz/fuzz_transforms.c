/* SPDX-License-Identifier: Apache-2.0 */
/* Both JSON formats. */
#include "scene/reader.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    sg_ctx *ctx;
    struct sg_shots shots = {0};
    struct sg_scene_params params = {SG_SCENE_DEFAULTS};
    char *points = NULL;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    params.eval = true;
    params.max_images = 1000;
    sg_nerfstudio_parse(ctx, "fuzz", (const char *) data, size, &params, &shots, &points);
    sg_shots_clear(&shots);
    sg_clear_error(ctx);
    sg_blender_parse(ctx, "fuzz", (const char *) data, size, params.max_images, true, &shots);
    sg_shots_sort(&shots);
    sg_shots_clear(&shots);
    sg_free(points);
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
