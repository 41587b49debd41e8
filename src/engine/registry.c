/* SPDX-License-Identifier: Apache-2.0 */
#include "registry.h"

#include <string.h>

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

/* "auto": an engine whose device nobody has to name, else the first. */
static const struct sg_engine_kind *best(void)
{
    for (size_t i = 0; i < KINDS; i++) {
        struct sg_engine_info info = {0};
        if (kinds[i]->devices && kinds[i]->describe(0, &info) && info.available)
            return kinds[i];
    }
    return kinds[0];
}

static const struct sg_engine_kind *find(const char *name)
{
    if (name && !strcmp(name, SG_ENGINE_AUTO))
        return best();
    for (size_t i = 0; i < KINDS; i++)
        if (!name || is(kinds[i], name))
            return kinds[i];
    return NULL;
}

const struct sg_engine_kind *sg_engine_find(sg_ctx *ctx, const char *name)
{
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
