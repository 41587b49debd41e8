/* SPDX-License-Identifier: Apache-2.0 */
/* Files of a model of anchors: the networks, and from "ply" on the anchors. A model that loads must
 * survive being drawn, written and read. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "model/anchors.h"
#include "splatguard/format.h"
#include "splatguard/render.h"

#include "camera.h"
#include "spill.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static char folder[64], model_path[96], networks_path[96];

static void make_folder(void)
{
    snprintf(folder, sizeof(folder), "/tmp/sg-fuzz-anchors-XXXXXX");
    if (!mkdtemp(folder))
        abort();
    snprintf(model_path, sizeof(model_path), "%s/anchors.ply", folder);
    snprintf(networks_path, sizeof(networks_path), "%s/" SG_NETWORKS_FILE, folder);
}

static void remove_folder(void)
{
    unlink(model_path);
    unlink(networks_path);
    rmdir(folder);
}

#define SIDE 32

static void draw(sg_ctx *ctx, const struct sg_model *m)
{
    const struct sg_camera camera = front_camera(SIDE, 3);
    static float rgb[3 * SIDE * SIDE];
    sg_renderer *r;
    int code = sg_renderer_create(ctx, "cpu", NULL, m, NULL, &r);
    if (!code) {
        code = sg_render(r, &camera, rgb, NULL, NULL, NULL);
        sg_renderer_destroy(&r);
    }
    if (code && code != SG_ERR_BUDGET)
        __builtin_trap();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    sg_ctx *ctx;
    if (!folder[0]) {
        make_folder();
        atexit(remove_folder);
    }
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    const uint8_t *ply = memmem(data, size, "ply\n", 4);
    const size_t networks = ply ? (size_t) (ply - data) : size;
    spill(networks_path, data, networks);
    spill(model_path, ply ? ply : data, size - networks);
    struct sg_model *m, *back = NULL;
    bool found;
    if (!sg_anchors_recognise(ctx, model_path, &found) && found &&
        !sg_model_read_drawable(ctx, model_path, 1 << 12, &m)) {
        struct sg_model_info info;
        draw(ctx, m);
        if (sg_model_inspect(ctx, m, &info) || sg_model_write_ply(ctx, m, model_path) ||
            sg_model_read_drawable(ctx, model_path, 1 << 12, &back) || back->count != m->count ||
            memcmp(back->columns->networks, m->columns->networks, sizeof(struct sg_networks)) != 0)
            __builtin_trap();
        sg_model_destroy(&back);
        sg_model_destroy(&m);
    }
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
