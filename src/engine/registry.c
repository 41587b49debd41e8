/* SPDX-License-Identifier: Apache-2.0 */
#include "registry.h"

#include <string.h>

#include "core/vram.h"
#include "ops.h"

static const struct sg_engine_kind *const kinds[] = {&sg_engine_cpu, &sg_engine_vulkan,
                                                     &sg_engine_ref};
#define KINDS (sizeof(kinds) / sizeof(kinds[0]))

/* An engine with devices takes the choice of one behind its name and a colon. */
static bool is(const struct sg_engine_kind *kind, const char *name)
{
    const size_t n = strlen(kind->name);
    return !strncmp(name, kind->name, n) && (!name[n] || (kind->devices && name[n] == ':'));
}

bool sg_engine_is_auto(const char *name, const char *variant)
{
    return !variant && (!name || !strcmp(name, SG_ENGINE_AUTO));
}

const struct sg_engine_kind *sg_engine_choose(sg_ctx *ctx, const struct sg_engine_kind *candidate)
{
    struct sg_failure failure = {0};
    struct sg_engine *engine = NULL;
    sg_failures_apart(&failure);
    int code = candidate->create(ctx, NULL, &engine);
    if (!code)
        code = sg_engine_try(engine);
    sg_engine_destroy(&engine);
    sg_failures_apart(NULL);
    if (!code)
        return candidate;
    sg_vram_forget(ctx);
    sg_log(ctx, SG_LOG_WARN, "engine: auto takes %s: %s", kinds[0]->name, failure.text);
    return kinds[0];
}

static const struct sg_engine_kind *best(sg_ctx *ctx)
{
    for (size_t i = 0; i < KINDS; i++) {
        struct sg_engine_info info = {0};
        if (kinds[i]->may_run && kinds[i]->may_run() && kinds[i]->describe(0, &info) &&
            info.available)
            return sg_engine_choose(ctx, kinds[i]);
    }
    return kinds[0];
}

static const struct sg_engine_kind *find(const char *name)
{
    for (size_t i = 0; i < KINDS; i++)
        if (is(kinds[i], name))
            return kinds[i];
    return NULL;
}

const struct sg_engine_kind *sg_engine_find(sg_ctx *ctx, const char *name, const char *variant)
{
    if (sg_engine_is_auto(name, variant)) {
        const struct sg_engine_kind **chosen = sg_ctx_auto_engine(ctx);
        *chosen = *chosen ? *chosen : best(ctx);
        return *chosen;
    }
    if (sg_engine_is_auto(name, NULL))
        return kinds[0];
    const struct sg_engine_kind *kind = find(name);
    char list[64] = SG_ENGINE_AUTO;
    for (size_t i = 0; !kind && i < KINDS; i++) {
        strcat(list, i + 1 < KINDS ? ", " : " or ");
        strcat(list, kinds[i]->name);
    }
    if (!kind)
        sg_fail(ctx, SG_ERR_USAGE, "engine: found \"%s\", expected %s", name, list);
    return kind;
}

/* What an engine is to run on or with. */
static const char *choice_of(const struct sg_engine_kind *kind, const char *name,
                             const char *variant)
{
    if (!kind || !kind->devices)
        return variant;
    const char *colon = name ? strchr(name, ':') : NULL;
    return colon ? colon + 1 : NULL;
}

/* Of an engine that has none a variant is one of the CPU's all the same: a run that goes on on
 * another engine still has it. */
static int check_variant(sg_ctx *ctx, const struct sg_engine_kind *kind, const char *variant)
{
    return variant && kind != kinds[0] ? kinds[0]->check(ctx, variant) : SG_OK;
}

int sg_engine_check(sg_ctx *ctx, const char *name, const char *variant)
{
    if (sg_engine_is_auto(name, variant))
        return SG_OK;
    const struct sg_engine_kind *kind = sg_engine_find(ctx, name, variant);
    if (!kind)
        return SG_ERR_USAGE;
    const int code = check_variant(ctx, kind, variant);
    return code || !kind->check ? code : kind->check(ctx, choice_of(kind, name, variant));
}

int sg_engine_create(sg_ctx *ctx, const char *name, const char *variant, struct sg_engine **out)
{
    *out = NULL;
    const struct sg_engine_kind *kind = sg_engine_find(ctx, name, variant);
    if (!kind)
        return SG_ERR_USAGE;
    int made = check_variant(ctx, kind, variant);
    if (!made)
        made = kind->create(ctx, choice_of(kind, name, variant), out);
    if (!made && kind->devices && sg_engine_is_auto(name, variant))
        sg_log(ctx, SG_LOG_INFO, "engine: auto takes %s: %s", kind->name, sg_engine_variant(*out));
    if (!made)
        sg_log(ctx, SG_LOG_DEBUG, "engine: %s, kernels %s, %d threads", kind->name,
               sg_engine_variant(*out), sg_ctx_threads(ctx));
    return made;
}

bool sg_engine_give_way(sg_ctx *ctx, const char *name, const char *variant, int code)
{
    const struct sg_engine_kind **chosen = sg_ctx_auto_engine(ctx);
    if (code != SG_ERR_BUDGET || !sg_engine_is_auto(name, variant) || !*chosen ||
        !(*chosen)->devices)
        return false;
    sg_log(ctx, SG_LOG_WARN, "engine: auto takes %s: %s", kinds[0]->name, sg_last_error(ctx));
    sg_clear_error(ctx);
    sg_vram_forget(ctx);
    *chosen = kinds[0];
    return true;
}

int sg_engine_names(const char *out[SG_ENGINES])
{
    for (size_t i = 0; i < KINDS; i++)
        out[i] = kinds[i]->name;
    return (int) KINDS;
}

int sg_engine_variants(const char *name, const char *out[SG_ENGINE_VARIANTS])
{
    const struct sg_engine_kind *kind = find(name);
    return kind && kind->variants ? kind->variants(out) : 0;
}

bool sg_engine_list(size_t index, struct sg_engine_info *out)
{
    for (size_t k = 0; k < KINDS; k++)
        for (size_t i = 0;; i++) {
            if (!kinds[k]->describe(i, NULL))
                break;
            *out = (struct sg_engine_info){.engine = kinds[k]->name};
            if (!index--)
                return kinds[k]->describe(i, out);
        }
    *out = (struct sg_engine_info){0};
    return false;
}
