/* SPDX-License-Identifier: Apache-2.0 */
/* Bytes as a model file of one ending; a model that loads must survive being written and read. */
#ifndef FUZZ_MODEL_FILE_H
#define FUZZ_MODEL_FILE_H

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "splatguard/format.h"

#include "spill.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static inline void read_model_file(const char *ending, const uint8_t *data, size_t size)
{
    char path[96];
    snprintf(path, sizeof(path), "/tmp/sg-fuzz-model-%ld%s", (long) getpid(), ending);
    sg_ctx *ctx;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return;
    spill(path, data, size);
    struct sg_model *m, *back = NULL;
    if (!sg_model_read(ctx, path, 1 << 16, &m)) {
        unlink(path);
        const enum sg_model_format format = sg_model_format_of(path);
        const char *const written = format == SG_MODEL_KSPLAT ? ".glb" : ending;
        snprintf(path, sizeof(path), "/tmp/sg-fuzz-model-%ld%s", (long) getpid(), written);
        const int code = sg_model_write(ctx, m, path, NULL);
        if (code != SG_OK && code != SG_ERR_INPUT) /* NaN, or beyond the format's range */
            __builtin_trap();
        if (!code && written == ending &&
            (sg_model_read(ctx, path, 1 << 16, &back) || back->count != m->count))
            __builtin_trap();
        sg_model_destroy(&back);
    }
    sg_model_destroy(&m);
    unlink(path);
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
}

#endif
