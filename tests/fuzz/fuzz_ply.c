/* SPDX-License-Identifier: Apache-2.0 */
/* Model and point PLYs; a model that loads must survive its statistics and a round trip. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/file.h"
#include "splatguard/model.h"

#include "spill.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static char path[64];
    if (!path[0])
        snprintf(path, sizeof(path), "/tmp/sg-fuzz-ply-%ld", (long) getpid());
    sg_ctx *ctx;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    spill(path, data, size);
    struct sg_model *m, *back;
    if (!sg_model_read_ply(ctx, path, 1 << 16, &m)) {
        struct sg_model_info info;
        if (sg_model_inspect(ctx, m, &info) || sg_model_write_ply(ctx, m, path) ||
            sg_model_read_ply(ctx, path, 1 << 16, &back) || back->count != m->count ||
            memcmp(sg_model_at(m, m->count - 1, 0), sg_model_at(back, m->count - 1, 0),
                   sizeof(float)))
            __builtin_trap();
        sg_model_destroy(&back);
    }
    sg_model_destroy(&m);
    float *xyz;
    uint8_t *rgb;
    size_t n;
    if (!sg_points_read_ply(ctx, path, 1 << 16, &xyz, &rgb, &n))
        sg_points_destroy(&xyz, &rgb);
    unlink(path);
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
