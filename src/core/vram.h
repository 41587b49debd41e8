/* SPDX-License-Identifier: Apache-2.0 */
/* The ledger of memory on a device, of which a context has one: an engine charges every allocation
 * there. Thread safety: one call at a time per context. */
#ifndef SG_CORE_VRAM_H
#define SG_CORE_VRAM_H

#include "context.h"

/* What a test can make fail. */
enum sg_device_call {
    SG_DEVICE_SUBMISSION,
    SG_DEVICE_TIMESTAMPS, /* asked for when a device is opened: it has none */
    SG_DEVICE_CALLS
};

struct sg_vram {
    uint64_t given;   /* sg_ctx_params.max_vram */
    uint64_t limit;   /* bytes that may be held at once; 0 = none is known yet */
    uint64_t largest; /* bytes of one allocation at most; 0 = any */
    uint64_t most;    /* allocations at once at most; 0 = any number */
    uint64_t current[SG_MEM_TAGS + 1], peak[SG_MEM_TAGS + 1]; /* the last one is the total */
    uint64_t to_failure[SG_DEVICE_CALLS]; /* calls until one is made to fail; 0 = none */
};
struct sg_vram *sg_ctx_vram(sg_ctx *ctx);

/* Where sg_ctx_params.max_vram gives no limit: nine tenths of what is free now, beside what is held
 * already. largest, most: see struct sg_vram. */
void sg_vram_limit(sg_ctx *ctx, uint64_t free, uint64_t largest, uint64_t most);
/* After an engine that was not taken: nothing was held, if nothing is. */
void sg_vram_forget(sg_ctx *ctx);
/* SG_ERR_BUDGET where the limit is too low; then nothing is charged. */
int sg_vram_take(sg_ctx *ctx, enum sg_mem_tag tag, uint64_t bytes);
void sg_vram_give(sg_ctx *ctx, enum sg_mem_tag tag, uint64_t bytes);

/* For tests: the nth such call of an engine from now on fails; 0 = none. Returns whether the one of
 * the request before has failed. */
bool sg_fail_device(sg_ctx *ctx, enum sg_device_call call, uint64_t nth);
/* For engines: whether this call is to fail. */
bool sg_device_fails(sg_ctx *ctx, enum sg_device_call call);

#endif
