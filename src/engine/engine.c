/* SPDX-License-Identifier: Apache-2.0 */
#include "engine.h"

#include <string.h>

#include "cpu/dispatch.h"

int sg_engine_kernels(sg_ctx *ctx, const char *name, const char *cpu, const struct cpu_kernels **out)
{
    *out = NULL;
    if (!name || !strcmp(name, "cpu"))
        return sg_cpu_select(ctx, cpu, out);
    if (!strcmp(name, "ref"))
        return SG_OK;
    return sg_fail(ctx, SG_ERR_USAGE, "engine: found \"%s\", expected cpu or ref", name);
}

int sg_engine_create(sg_ctx *ctx, const char *name, const char *cpu, struct sg_engine **out)
{
    const struct cpu_kernels *kernels;
    *out = NULL;
    const int code = sg_engine_kernels(ctx, name, cpu, &kernels);
    if (code)
        return code;
    return kernels ? sg_engine_create_cpu(ctx, cpu, out) : sg_engine_create_ref(ctx, out);
}

void sg_engine_destroy(struct sg_engine **engine)
{
    if (engine && *engine)
        (*engine)->ops->destroy(*engine);
    if (engine)
        *engine = NULL;
}

int sg_optimiser_create(sg_ctx *ctx, size_t count, int sh_degree, struct sg_optimiser *o)
{
    const size_t capacity = (count + SG_LANES - 1) / SG_LANES * SG_LANES, planes = (size_t) sg_param_count(sh_degree);
    *o = (struct sg_optimiser){.capacity = capacity};
    o->m = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, planes * sizeof(float));
    o->v = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, planes * sizeof(float));
    o->grad_sum = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, sizeof(float));
    o->grad_count = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, sizeof(float));
    if (o->m && o->v && o->grad_sum && o->grad_count)
        return SG_OK;
    sg_optimiser_clear(o);
    return SG_ERR_BUDGET;
}

void sg_optimiser_clear(struct sg_optimiser *o)
{
    sg_free(o->m);
    sg_free(o->v);
    sg_free(o->grad_sum);
    sg_free(o->grad_count);
    *o = (struct sg_optimiser){0};
}
