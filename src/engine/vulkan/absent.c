/* SPDX-License-Identifier: Apache-2.0 */
/* In place of the Vulkan engine in a build without it. */
#include "engine/ops.h"

#define MISSING "a build with Vulkan: glslangValidator and Vulkan's headers"

static int check(sg_ctx *ctx, const char *selector)
{
    (void) selector;
    return sg_fail(ctx, SG_ERR_USAGE, "vulkan: this program lacks " MISSING);
}

static int create(sg_ctx *ctx, const char *selector, struct sg_engine **out)
{
    *out = NULL;
    return check(ctx, selector);
}

static struct sg_footprint footprint(const struct sg_work *work)
{
    (void) work;
    return (struct sg_footprint){0};
}

static bool describe(size_t index, struct sg_engine_info *out)
{
    if (index == 0 && out) {
        out->description = "Vulkan compute";
        out->missing = MISSING;
    }
    return index == 0;
}

const struct sg_engine_kind sg_engine_vulkan = {
    .name = "vulkan",
    .devices = true,
    .create = create,
    .check = check,
    .footprint = footprint,
    .describe = describe,
};

size_t sg_device_list(struct sg_device_info *out, size_t most, const char **missing)
{
    (void) out, (void) most;
    if (missing)
        *missing = MISSING;
    return 0;
}
