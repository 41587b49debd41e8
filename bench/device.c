/* SPDX-License-Identifier: Apache-2.0 */
/* The Vulkan engine's device. What runs here are kernels of the benchmark and of the engine, by the
 * engine's own commands. */
#include "device.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/clock.h"
#include "core/vram.h"
#include "engine/vulkan/engine.h"

#include "device_copy.h"
#include "device_issue.h"

#define COPY_BYTES                                                                                 \
    ((uint64_t) 256 << 20)            /* beyond every cache; less where there is little memory */
#define COPY_GROUP ((uint64_t) 16384) /* bytes of a workgroup */
#define TRIES 5
#define CHAINS 8
#define ISSUE_GROUPS 4096 /* more than devices run at once */
#define ISSUE_EACH 8      /* of a chain in a round */
#define LONG_ENOUGH 0.01  /* seconds */
#define EMPTY 256         /* dispatches */

static struct gpu *gpu_of(const struct sg_engine *e)
{
    return ((const struct vulkan_engine *) e)->gpu;
}

bool device_has(const struct sg_engine *e)
{
    return !strcmp(e->ops->name, "vulkan");
}

uint64_t device_dispatches(const struct sg_engine *e)
{
    return gpu_of(e)->dispatches;
}

/* ---- rates ---- */

struct copy_arguments {
    VkDeviceAddress from, to;
};

struct issue_arguments {
    VkDeviceAddress to;
    uint32_t rounds;
    float factor, term;
};

static int compile(struct gpu *g, const uint32_t *words, size_t bytes, uint32_t variant,
                   VkPipeline *out)
{
    const struct gpu_code code = {words, bytes};
    const struct gpu_build build = {.code = &code, .constants = {0, variant}};
    const VkResult result = sg_gpu_compile(&g->vk, g->device, g->shared->layout, &build, out);
    return result ? sg_vk_fail(g->ctx, &g->chosen, result, "the benchmark's kernels") : SG_OK;
}

/* Seconds of `times` dispatches, one after the other. */
static int time_of(struct gpu *g, VkPipeline pipeline, const void *args, size_t size,
                   uint64_t groups, int times, double *out)
{
    double sum = 0;
    int code = SG_OK;
    sg_gpu_clock(g, &sum);
    for (int i = 0; i < times && !code; i++)
        code = sg_gpu_dispatch_pipeline(g, pipeline, args, size, groups);
    sg_gpu_clock(g, NULL);
    const double start = sg_seconds();
    if (!code)
        code = sg_gpu_flush(g);
    *out = g->flights[0].timestamps ? sum : sg_seconds() - start;
    return code;
}

static int copy_rate(struct gpu *g, double *out)
{
    struct gpu_buffer from = {0}, to = {0};
    const struct sg_vram *v = sg_ctx_vram(g->ctx);
    const uint64_t eighth = v->limit / 8 / COPY_GROUP * COPY_GROUP;
    const uint64_t bytes = eighth > COPY_BYTES || !eighth ? COPY_BYTES : eighth;
    VkPipeline pipeline = VK_NULL_HANDLE;
    double best = INFINITY;
    int code = sg_gpu_reserve(g, SG_MEM_MISC, &from, bytes);
    if (!code)
        code = sg_gpu_reserve(g, SG_MEM_MISC, &to, bytes);
    if (!code)
        code = sg_gpu_fill(g, &from, 0, bytes, 1);
    if (!code)
        code = sg_gpu_flush(g);
    if (!code)
        code = compile(g, sg_spirv_device_copy, sizeof(sg_spirv_device_copy), 0, &pipeline);
    const struct copy_arguments args = {from.address, to.address};
    for (int i = 0; i < TRIES && !code; i++) {
        double seconds;
        code = time_of(g, pipeline, &args, sizeof(args), bytes / COPY_GROUP, 1, &seconds);
        best = fmin(best, seconds);
    }
    g->vk.DestroyPipeline(g->device, pipeline, NULL);
    sg_gpu_release(g, &from);
    sg_gpu_release(g, &to);
    *out = 2 * (double) bytes / best;
    return code;
}

/* Operations a second with so many chains, and seconds of a dispatch that does nothing. */
static int issue_rate(struct gpu *g, uint32_t chains, double *out, double *dispatch)
{
    VkPipeline pipeline = VK_NULL_HANDLE;
    struct issue_arguments args = {
        .to = g->none.address, .rounds = 0, .factor = 0.999f, .term = 1.0f};
    double seconds = 0, least = INFINITY;
    int code = compile(g, sg_spirv_device_issue, sizeof(sg_spirv_device_issue), chains, &pipeline);
    for (int i = 0; i < TRIES && !code; i++) {
        code = time_of(g, pipeline, &args, sizeof(args), 1, EMPTY, &seconds);
        least = fmin(least, seconds / EMPTY);
    }
    *dispatch = least;
    for (args.rounds = 16, seconds = 0; seconds < LONG_ENOUGH && args.rounds < 1u << 30 && !code;
         args.rounds *= 2)
        code = time_of(g, pipeline, &args, sizeof(args), ISSUE_GROUPS, 1, &seconds);
    least = INFINITY;
    for (int i = 0; i < TRIES && !code; i++) {
        code = time_of(g, pipeline, &args, sizeof(args), ISSUE_GROUPS, 1, &seconds);
        least = fmin(least, seconds);
    }
    g->vk.DestroyPipeline(g->device, pipeline, NULL);
    *out = (double) ISSUE_GROUPS * VK_GROUP * ISSUE_EACH * chains * args.rounds / least;
    return code;
}

int device_rates(struct sg_engine *e, struct rates *out)
{
    struct gpu *g = gpu_of(e);
    int code = copy_rate(g, &out->bytes);
    if (!code)
        code = issue_rate(g, 1, &out->dependent, &out->dispatch);
    if (!code)
        code = issue_rate(g, CHAINS, &out->operations, &out->dispatch);
    return code;
}

/* ---- parts ---- */

#define PART(kernel, name, stage, bit)                                                             \
    {                                                                                              \
        {#kernel "." name, stage}, GPU_##kernel, bit                                               \
    }
static const struct {
    struct device_part part;
    enum gpu_kernel kernel;
    uint32_t bit;
} kernel_parts[] = {
    PART(project, "colours", "project", VK_WITHOUT_COLOURS),
    PART(project, "splats", "project", VK_WITHOUT_SPLATS),
    PART(raster, "pairs", "raster", VK_WITHOUT_PAIRS),
    PART(raster, "writes", "raster", VK_WITHOUT_WRITES),
    PART(raster_backward, "pairs", "raster backward", VK_WITHOUT_PAIRS),
    PART(raster_backward, "sums", "raster backward", VK_WITHOUT_SUMS),
    PART(raster_backward, "slots", "raster backward", VK_WITHOUT_SLOTS),
    PART(learn, "gradients", "update", VK_WITHOUT_GRADIENTS),
    PART(learn, "steps", "update", VK_WITHOUT_STEPS),
};
#define PARTS ((int) (sizeof(kernel_parts) / sizeof(kernel_parts[0])))

int device_parts(const struct device_part **out)
{
    static struct device_part parts[PARTS];
    for (int k = 0; k < PARTS; k++)
        parts[k] = kernel_parts[k].part;
    *out = parts;
    return PARTS;
}

/* Compiles a kernel that has run again. */
static int replace(struct gpu *g, enum gpu_kernel kernel, int variant, uint32_t without)
{
    VkPipeline *at = &g->shared->pipelines[kernel][variant];
    if (!*at)
        return SG_OK;
    struct gpu_build build = sg_gpu_build(kernel, variant, g->lanes);
    build.constants[GPU_WITHOUT] = without;
    g->vk.DestroyPipeline(g->device, *at, NULL);
    *at = VK_NULL_HANDLE;
    const VkResult result = sg_gpu_compile(&g->vk, g->device, g->shared->layout, &build, at);
    return result ? sg_vk_fail(g->ctx, &g->chosen, result, "a kernel without parts") : SG_OK;
}

int device_leave_out(struct sg_engine *e, unsigned parts)
{
    static uint32_t present[GPU_KERNELS]; /* parts that are left out now */
    struct gpu *g = gpu_of(e);
    uint32_t without[GPU_KERNELS] = {0};
    int code = sg_gpu_flush(g);
    for (int k = 0; k < PARTS; k++)
        without[kernel_parts[k].kernel] |= parts >> k & 1 ? kernel_parts[k].bit : 0;
    for (int k = 0; k < GPU_KERNELS && !code; k++) {
        if (without[k] == present[k])
            continue;
        for (int v = 0; v < GPU_VARIANTS && !code; v++)
            code = replace(g, (enum gpu_kernel) k, v, without[k]);
        present[k] = without[k];
    }
    return code;
}

/* ---- kernels ---- */

static struct gpu_profile profile;

int device_profile_begin(struct sg_engine *e)
{
    struct gpu *g = gpu_of(e);
    if (!g->flights[0].timestamps)
        return sg_fail(g->ctx, SG_ERR_USAGE, "vulkan: %s has no timestamps, which kernels need",
                       g->chosen.info.name);
    profile = (struct gpu_profile){0};
    g->profile = &profile;
    return SG_OK;
}

void device_profile_print(struct sg_engine *e, int iterations)
{
    static const char *const names[] = {
#define K(name) #name,
        VK_KERNELS(K)
#undef K
    };
    (void) e;
    double all = 0;
    for (int k = 0; k < GPU_KERNELS; k++)
        all += profile.seconds[k];
    printf("\n| kernel | dispatches | ms | share |\n|---|---:|---:|---:|\n");
    for (int k = 0; k < GPU_KERNELS; k++)
        if (profile.dispatches[k])
            printf("| %s | %.1f | %.3f | %.1f %% |\n", names[k],
                   (double) profile.dispatches[k] / iterations,
                   1e3 * profile.seconds[k] / iterations, 100 * profile.seconds[k] / all);
}
