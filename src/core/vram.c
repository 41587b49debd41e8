/* SPDX-License-Identifier: Apache-2.0 */
#include "vram.h"

#include <string.h>

void sg_vram_limit(sg_ctx *ctx, uint64_t free, uint64_t largest, uint64_t most)
{
    struct sg_vram *v = sg_ctx_vram(ctx);
    const uint64_t usable = v->current[SG_MEM_TAGS] + free / 10 * 9;
    v->limit = v->given ? v->given : usable ? usable : 1;
    v->largest = largest;
    v->most = most;
}

void sg_vram_forget(sg_ctx *ctx)
{
    struct sg_vram *v = sg_ctx_vram(ctx);
    if (v->current[SG_MEM_TAGS])
        return;
    memset(v->peak, 0, sizeof(v->peak));
    v->limit = v->largest = v->most = 0;
}

static void charge(struct sg_vram *v, int tag, uint64_t bytes)
{
    v->current[tag] += bytes;
    if (v->current[tag] > v->peak[tag])
        v->peak[tag] = v->current[tag];
}

int sg_vram_take(sg_ctx *ctx, enum sg_mem_tag tag, uint64_t bytes)
{
    struct sg_vram *v = sg_ctx_vram(ctx);
    const uint64_t held = v->current[SG_MEM_TAGS];
    if (v->limit && (held > v->limit || bytes > v->limit - held))
        return sg_fail(ctx, SG_ERR_BUDGET,
                       "memory of the device: %llu bytes for %s refused: %llu held, limit %llu",
                       (unsigned long long) bytes, sg_mem_tag_name(tag), (unsigned long long) held,
                       (unsigned long long) v->limit);
    if (v->largest && bytes > v->largest)
        return sg_fail(ctx, SG_ERR_BUDGET,
                       "memory of the device: %llu bytes for %s refused: its driver gives at most "
                       "%llu at once",
                       (unsigned long long) bytes, sg_mem_tag_name(tag),
                       (unsigned long long) v->largest);
    charge(v, (int) tag, bytes);
    charge(v, SG_MEM_TAGS, bytes);
    return SG_OK;
}

void sg_vram_give(sg_ctx *ctx, enum sg_mem_tag tag, uint64_t bytes)
{
    struct sg_vram *v = sg_ctx_vram(ctx);
    v->current[tag] -= bytes;
    v->current[SG_MEM_TAGS] -= bytes;
}

bool sg_fail_device(sg_ctx *ctx, enum sg_device_call call, uint64_t nth)
{
    uint64_t *left = &sg_ctx_vram(ctx)->to_failure[call];
    const bool failed = *left == 0;
    *left = nth;
    return failed;
}

bool sg_device_fails(sg_ctx *ctx, enum sg_device_call call)
{
    uint64_t *left = &sg_ctx_vram(ctx)->to_failure[call];
    return *left && --*left == 0;
}
