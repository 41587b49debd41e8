/* SPDX-License-Identifier: Apache-2.0 */
/* Bytes as a zip archive of a scene: every file of it is read, and the scene if it is one. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "core/folder.h"
#include "splatguard/scene.h"

#include "spill.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void read_files(sg_ctx *ctx, const char *path)
{
    struct sg_folder folder;
    if (sg_folder_open(ctx, path, false, &folder))
        return;
    for (size_t i = 0; folder.zip && i < folder.zip->count; i++) {
        struct sg_source in;
        sg_clear_error(ctx);
        if (!sg_zip_source(folder.zip, &folder.zip->entries[i], "fuzz", 1 << 20, &in))
            while (sg_source_fill(&in, SG_SOURCE_WINDOW))
                sg_source_skip(&in, in.ready);
        sg_source_close(&in);
    }
    sg_folder_close(&folder);
    sg_clear_error(ctx);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char path[96];
    snprintf(path, sizeof(path), "/tmp/sg-fuzz-archive-%ld.zip", (long) getpid());
    struct sg_scene_params params = sg_scene_params_default();
    struct sg_scene *scene;
    sg_ctx *ctx;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    spill(path, data, size);
    read_files(ctx, path);
    params.max_images = 8;
    params.max_points = 10000;
    params.max_pixels = 1 << 16;
    sg_scene_load(ctx, path, &params, &scene);
    sg_scene_destroy(&scene);
    unlink(path);
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
