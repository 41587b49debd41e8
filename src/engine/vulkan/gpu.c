/* SPDX-License-Identifier: Apache-2.0 */
#include "gpu.h"

#include <string.h>

#include "core/vram.h"

#define STAGING (4u << 20) /* bytes */

static int fail_result(struct gpu *g, VkResult result, const char *what)
{
    if (result == VK_ERROR_DEVICE_LOST && !g->lost) {
        g->lost = true;
        sg_gpu_lose_device(g->shared);
    }
    return sg_vk_fail(g->ctx, &g->chosen, result, what);
}

/* ---- buffers ---- */

/* A type of memory with all of `flags`, and if possible with `better`. */
static int find_memory(const struct gpu *g, uint32_t types, VkMemoryPropertyFlags flags,
                       VkMemoryPropertyFlags better)
{
    VkPhysicalDeviceMemoryProperties2 m = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2};
    g->vk.GetPhysicalDeviceMemoryProperties2(g->chosen.physical, &m);
    int best = -1;
    for (int i = (int) m.memoryProperties.memoryTypeCount - 1; i >= 0; i--) {
        const VkMemoryPropertyFlags has = m.memoryProperties.memoryTypes[i].propertyFlags;
        if ((types >> i & 1) && (has & flags) == flags &&
            (best < 0 || (has & better) == better ||
             (m.memoryProperties.memoryTypes[best].propertyFlags & better) != better))
            best = i;
    }
    return best;
}

static void destroy_buffer(struct gpu *g, struct gpu_buffer *b)
{
    if (b->buffer)
        g->vk.DestroyBuffer(g->device, b->buffer, NULL);
    sg_gpu_free(g->shared, b->memory);
    sg_vram_give(g->ctx, b->tag, b->charged);
    *b = (struct gpu_buffer){0};
}

static int create_buffer(struct gpu *g, enum sg_mem_tag tag, struct gpu_buffer *b, uint64_t bytes,
                         bool mapped)
{
    const uint64_t size = (bytes + 255) / 256 * 256;
    *b = (struct gpu_buffer){.tag = tag};
    const VkBufferCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
        .size = size,
        .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT |
                 VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT |
                 VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
    VkResult result = g->vk.CreateBuffer(g->device, &info, NULL, &b->buffer);
    if (result)
        return fail_result(g, result, sg_mem_tag_name(tag));
    VkMemoryRequirements need;
    g->vk.GetBufferMemoryRequirements(g->device, b->buffer, &need);
    const int refused = sg_vram_take(g->ctx, tag, need.size);
    if (refused) {
        destroy_buffer(g, b);
        return refused;
    }
    b->charged = need.size;
    const int type =
        mapped ? find_memory(g, need.memoryTypeBits,
                             VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT |
                                 VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                             VK_MEMORY_PROPERTY_HOST_CACHED_BIT)
               : find_memory(g, need.memoryTypeBits, 0, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
    const VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                             .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    const VkMemoryAllocateInfo memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                         .pNext = &flags,
                                         .allocationSize = need.size,
                                         .memoryTypeIndex = (uint32_t) type};
    result =
        type < 0 ? VK_ERROR_OUT_OF_DEVICE_MEMORY : sg_gpu_allocate(g->shared, &memory, &b->memory);
    if (!result) {
        b->bytes = size;
        result = g->vk.BindBufferMemory(g->device, b->buffer, b->memory, 0);
    }
    if (!result && mapped)
        result = g->vk.MapMemory(g->device, b->memory, 0, VK_WHOLE_SIZE, 0, &b->mapped);
    if (result) {
        destroy_buffer(g, b);
        return fail_result(g, result, sg_mem_tag_name(tag));
    }
    b->address = g->vk.GetBufferDeviceAddress(
        g->device, &(VkBufferDeviceAddressInfo){
                       .sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = b->buffer});
    return SG_OK;
}

static int wait_all(struct gpu *g);

void sg_gpu_release(struct gpu *g, struct gpu_buffer *b)
{
    if (!b->buffer)
        return;
    if (!g->lost)
        sg_gpu_submit(g);
    wait_all(g); /* commands may use it; a failure is met again by the next one */
    destroy_buffer(g, b);
}

int sg_gpu_reserve(struct gpu *g, enum sg_mem_tag tag, struct gpu_buffer *b, uint64_t bytes)
{
    bytes = bytes ? bytes : 4;
    if (b->bytes >= bytes)
        return SG_OK;
    const uint64_t more = b->bytes + b->bytes / 2;
    const int flushed = b->buffer ? sg_gpu_flush(g) : SG_OK;
    if (flushed == GPU_STOPPED) /* what is done again needs it */
        return flushed;
    destroy_buffer(g, b);
    if (flushed)
        return flushed;
    const struct sg_vram *v = sg_ctx_vram(g->ctx);
    if (more > bytes && v->current[SG_MEM_TAGS] + more <= v->limit / 2) {
        const int code = create_buffer(g, tag, b, more, false);
        if (code != SG_ERR_BUDGET)
            return code;
        sg_clear_error(g->ctx); /* less is enough */
    }
    return create_buffer(g, tag, b, bytes, false);
}

int sg_gpu_window(struct gpu *g, struct gpu_buffer *b, uint64_t bytes)
{
    return b->buffer ? SG_OK : create_buffer(g, SG_MEM_MISC, b, bytes, true);
}

VkDeviceAddress sg_gpu_at(const struct gpu *g, const struct gpu_buffer *b)
{
    return b->buffer ? b->address : g->none.address;
}

/* ---- commands ---- */

static VkCommandBuffer commands(const struct gpu *g)
{
    return g->flights[g->now].commands;
}

/* A timestamp after all that is recorded. */
static void mark(struct gpu *g)
{
    struct gpu_flight *f = &g->flights[g->now];
    if (!f->timestamps)
        return;
    f->clocks[f->marks] = g->clock;
    g->vk.CmdWriteTimestamp(f->commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, f->timestamps,
                            f->marks++);
}

/* Time between the marks of commands that are done, to their clocks. */
static void read_marks(struct gpu *g, const struct gpu_flight *f)
{
    uint64_t ticks[GPU_MARKS];
    if (!f->marks || g->vk.GetQueryPoolResults(g->device, f->timestamps, 0, f->marks, sizeof(ticks),
                                               ticks, sizeof(ticks[0]), VK_QUERY_RESULT_64_BIT))
        return;
    const uint64_t valid = UINT64_MAX >> (64 - g->chosen.timestamp_bits);
    for (uint32_t i = 0; i + 1 < f->marks; i++)
        if (f->clocks[i])
            *f->clocks[i] += (double) ((ticks[i + 1] - ticks[i]) & valid) * g->chosen.tick;
}

/* Waits for a submission. Where memory is too short for that, waits for the device, so that nobody
 * frees what it uses. */
static VkResult wait_for(struct gpu *g, struct gpu_flight *f)
{
    if (!f->busy)
        return VK_SUCCESS;
    f->busy = false;
    const VkResult result = g->vk.WaitForFences(g->device, 1, &f->fence, VK_TRUE, UINT64_MAX);
    return result && result != VK_ERROR_DEVICE_LOST ? sg_gpu_idle(g->shared) : result;
}

static int retire(struct gpu *g, uint32_t flight)
{
    struct gpu_flight *f = &g->flights[flight];
    if (!f->busy)
        return SG_OK;
    const VkResult result = wait_for(g, f);
    if (result)
        return fail_result(g, result, "waiting");
    read_marks(g, f);
    g->finished = f->number > g->finished ? f->number : g->finished;
    if (!g->stopped && ((const uint32_t *) g->told.mapped)[flight])
        g->stopped = f->number;
    return SG_OK;
}

static int wait_all(struct gpu *g)
{
    int code = SG_OK;
    for (uint32_t i = 0; i < GPU_FLIGHTS; i++) {
        const int one = retire(g, (g->now + i) % GPU_FLIGHTS); /* the oldest first */
        code = code ? code : one;
    }
    return code;
}

static int record(struct gpu *g)
{
    struct gpu_flight *f = &g->flights[g->now];
    if (g->recording) {
        if (f->marks && f->clocks[f->marks - 1] != g->clock && f->marks < GPU_MARKS - 1)
            mark(g); /* the last one is of the end */
        return SG_OK;
    }
    if (g->lost)
        return fail_result(g, VK_ERROR_DEVICE_LOST, "recording");
    const int code = retire(g, g->now);
    if (code)
        return code;
    const VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                           .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    const VkResult result = g->vk.BeginCommandBuffer(f->commands, &info);
    if (result)
        return fail_result(g, result, "recording");
    g->recording = true;
    if (f->timestamps)
        g->vk.CmdResetQueryPool(f->commands, f->timestamps, 0, GPU_MARKS);
    f->marks = 0;
    mark(g);
    return g->goes_on ? sg_gpu_fill(g, &g->stop, 0, sizeof(uint32_t), 0) : SG_OK;
}

void sg_gpu_clock(struct gpu *g, double *sum)
{
    g->clock = sum;
}

/* What was recorded so far is done and seen by all that follows. */
static void barrier(struct gpu *g)
{
    const VkPipelineStageFlags stages = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT |
                                        VK_PIPELINE_STAGE_TRANSFER_BIT,
                               readers =
                                   VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT | VK_PIPELINE_STAGE_HOST_BIT;
    const VkAccessFlags writes = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    const VkMemoryBarrier all = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
        .srcAccessMask = writes,
        .dstAccessMask = writes | VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_TRANSFER_READ_BIT |
                         VK_ACCESS_INDIRECT_COMMAND_READ_BIT | VK_ACCESS_HOST_READ_BIT};
    g->vk.CmdPipelineBarrier(commands(g), stages, stages | readers, 0, 1, &all, 0, NULL, 0, NULL);
}

static int bind(struct gpu *g, VkPipeline pipeline, const void *args, size_t size)
{
    const int code = record(g);
    if (code)
        return code;
    g->vk.CmdBindPipeline(commands(g), VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    g->vk.CmdPushConstants(commands(g), g->shared->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0,
                           (uint32_t) size, args);
    g->dispatches++;
    return SG_OK;
}

static int prepare(struct gpu *g, enum gpu_kernel kernel, int variant, const void *args,
                   size_t size)
{
    VkPipeline pipeline;
    double *const clock = g->clock;
    int code = sg_gpu_pipeline(g->ctx, g->shared, kernel, variant, &pipeline);
    if (code)
        return code;
    if (g->profile) {
        g->profile->dispatches[kernel]++;
        g->clock = &g->profile->seconds[kernel];
    }
    code = bind(g, pipeline, args, size);
    g->clock = clock;
    return code;
}

static void run_groups(struct gpu *g, uint64_t groups)
{
    const uint64_t rows = gpu_groups(groups, VK_MOST_GROUPS);
    g->vk.CmdDispatch(commands(g), (uint32_t) gpu_groups(groups, rows), (uint32_t) rows, 1);
    barrier(g);
}

int sg_gpu_dispatch(struct gpu *g, enum gpu_kernel kernel, int variant, const void *args,
                    size_t size, uint64_t groups)
{
    if (!groups)
        return SG_OK;
    if (gpu_groups(groups, VK_MOST_GROUPS) > VK_MOST_GROUPS)
        return sg_fail(g->ctx, SG_ERR_BUDGET, "vulkan: found %llu workgroups, which is too many",
                       (unsigned long long) groups);
    const int code = prepare(g, kernel, variant, args, size);
    if (!code)
        run_groups(g, groups);
    return code;
}

int sg_gpu_dispatch_pipeline(struct gpu *g, VkPipeline pipeline, const void *args, size_t size,
                             uint64_t groups)
{
    const int code = bind(g, pipeline, args, size);
    if (!code)
        run_groups(g, groups);
    return code;
}

int sg_gpu_dispatch_work(struct gpu *g, enum gpu_kernel kernel, int variant, const void *args,
                         size_t size, const struct gpu_buffer *work, uint32_t item)
{
    const int code = prepare(g, kernel, variant, args, size);
    if (code)
        return code;
    g->vk.CmdDispatchIndirect(commands(g), work->buffer,
                              (VkDeviceSize) item * VK_WORK_WORDS * sizeof(uint32_t));
    barrier(g);
    return SG_OK;
}

int sg_gpu_fill(struct gpu *g, const struct gpu_buffer *b, uint64_t offset, uint64_t bytes,
                uint32_t value)
{
    const int code = record(g);
    if (code || !bytes)
        return code;
    g->vk.CmdFillBuffer(commands(g), b->buffer, offset, bytes, value);
    barrier(g);
    return SG_OK;
}

int sg_gpu_update(struct gpu *g, const struct gpu_buffer *b, uint64_t offset, const void *from,
                  uint64_t bytes)
{
    const int code = record(g);
    if (code)
        return code;
    g->vk.CmdUpdateBuffer(commands(g), b->buffer, offset, bytes, from);
    barrier(g);
    return SG_OK;
}

int sg_gpu_copy(struct gpu *g, const struct gpu_buffer *from, uint64_t from_offset,
                const struct gpu_buffer *to, uint64_t to_offset, uint64_t bytes)
{
    const int code = record(g);
    if (code || !bytes)
        return code;
    g->vk.CmdCopyBuffer(commands(g), from->buffer, to->buffer, 1,
                        &(VkBufferCopy){from_offset, to_offset, bytes});
    barrier(g);
    return SG_OK;
}

int sg_gpu_submit(struct gpu *g)
{
    if (!g->recording)
        return SG_OK;
    struct gpu_flight *f = &g->flights[g->now];
    sg_gpu_copy(g, &g->stop, 0, &g->told, sizeof(uint32_t) * g->now, sizeof(uint32_t));
    mark(g);
    g->recording = false;
    VkResult result = g->vk.EndCommandBuffer(f->commands);
    if (!result)
        result = g->vk.ResetFences(g->device, 1, &f->fence);
    if (!result)
        result = sg_device_fails(g->ctx, SG_DEVICE_SUBMISSION)
                     ? VK_ERROR_DEVICE_LOST
                     : sg_gpu_queue(g->shared, f->commands, f->fence);
    f->number = ++g->submissions;
    if (result)
        return fail_result(g, result, "submitting");
    f->busy = true;
    g->goes_on = false;
    g->now = (g->now + 1) % g->depth;
    return g->depth > 1 ? SG_OK : retire(g, g->now);
}

int sg_gpu_flush(struct gpu *g)
{
    int code = g->lost ? fail_result(g, VK_ERROR_DEVICE_LOST, "waiting") : sg_gpu_submit(g);
    const int waited = wait_all(g); /* also after an error */
    code = code ? code : waited;
    return !code && g->stopped ? GPU_STOPPED : code;
}

int sg_gpu_go_on(struct gpu *g)
{
    g->stopped = 0;
    g->goes_on = true; /* also after a submission that is refused */
    return g->recording ? sg_gpu_fill(g, &g->stop, 0, sizeof(uint32_t), 0) : record(g);
}

int sg_gpu_write(struct gpu *g, const struct gpu_buffer *to, uint64_t offset, const void *from,
                 uint64_t bytes)
{
    int code = sg_gpu_flush(g); /* the window may be in use */
    for (uint64_t done = 0; done < bytes && !code;) {
        const uint64_t n = bytes - done < STAGING ? bytes - done : STAGING;
        memcpy(g->staging.mapped, (const char *) from + done, n);
        if (!(code = sg_gpu_copy(g, &g->staging, 0, to, offset + done, n)))
            code = sg_gpu_flush(g);
        done += n;
    }
    return code;
}

int sg_gpu_read(struct gpu *g, const struct gpu_buffer *from, uint64_t offset, void *to,
                uint64_t bytes)
{
    int code = SG_OK;
    for (uint64_t done = 0; done < bytes && !code;) {
        const uint64_t n = bytes - done < STAGING ? bytes - done : STAGING;
        if (!(code = sg_gpu_copy(g, from, offset + done, &g->staging, 0, n)) &&
            !(code = sg_gpu_flush(g)))
            memcpy((char *) to + done, g->staging.mapped, n);
        done += n;
    }
    return code;
}

/* ---- creation ---- */

static VkResult open_flight(struct gpu *g, struct gpu_flight *f)
{
    const VkCommandBufferAllocateInfo list = {.sType =
                                                  VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                              .commandPool = g->pool,
                                              .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                              .commandBufferCount = 1};
    const VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    const VkQueryPoolCreateInfo timestamps = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                              .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                              .queryCount = GPU_MARKS};
    VkResult result = g->vk.AllocateCommandBuffers(g->device, &list, &f->commands);
    if (!result)
        result = g->vk.CreateFence(g->device, &fence, NULL, &f->fence);
    if (!result && g->chosen.timestamp_bits)
        result = g->vk.CreateQueryPool(g->device, &timestamps, NULL, &f->timestamps);
    return result;
}

static int open_flights(struct gpu *g)
{
    const VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                          .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                          .queueFamilyIndex = g->chosen.queue_family};
    VkResult result = g->vk.CreateCommandPool(g->device, &pool, NULL, &g->pool);
    if (sg_device_fails(g->ctx, SG_DEVICE_TIMESTAMPS))
        g->chosen.timestamp_bits = 0;
    for (int i = 0; i < GPU_FLIGHTS && !result; i++)
        result = open_flight(g, &g->flights[i]);
    if (result)
        return fail_result(g, result, "opening the device");
    /* A driver that does not tell what is free does not count what this context holds either. */
    const uint64_t free = g->chosen.info.memory_free,
                   held = g->chosen.memory_budget ? 0 : sg_vram_current(g->ctx, SG_MEM_TAGS);
    sg_vram_limit(g->ctx, free > held ? free - held : 0, g->chosen.largest, g->chosen.allocations);
    int code = create_buffer(g, SG_MEM_MISC, &g->staging, STAGING, true);
    if (!code)
        code = create_buffer(g, SG_MEM_MISC, &g->none, 256, false);
    if (!code)
        code = create_buffer(g, SG_MEM_MISC, &g->stop, 4, false);
    if (!code)
        code = create_buffer(g, SG_MEM_MISC, &g->told, 4 * GPU_FLIGHTS, true);
    return code ? code : sg_gpu_go_on(g);
}

int sg_gpu_open(sg_ctx *ctx, const char *selector, struct gpu **out)
{
    *out = NULL;
    struct gpu *g = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*g));
    if (!g)
        return SG_ERR_BUDGET;
    g->ctx = ctx;
    g->depth = GPU_FLIGHTS;
    int code = sg_gpu_take_device(ctx, selector, &g->chosen, &g->shared);
    if (!code) {
        g->vk = g->shared->vk;
        g->device = g->shared->device;
        g->lanes = sg_gpu_lanes(g->chosen.lanes);
        code = open_flights(g);
    }
    if (code)
        sg_gpu_close(&g);
    *out = g;
    return code;
}

void sg_gpu_close(struct gpu **gpu)
{
    struct gpu *g = *gpu;
    *gpu = NULL;
    if (!g)
        return;
    if (g->device) {
        for (int i = 0; i < GPU_FLIGHTS; i++)
            wait_for(g, &g->flights[i]);
        destroy_buffer(g, &g->staging);
        destroy_buffer(g, &g->none);
        destroy_buffer(g, &g->stop);
        destroy_buffer(g, &g->told);
        for (int i = 0; i < GPU_FLIGHTS; i++) {
            g->vk.DestroyFence(g->device, g->flights[i].fence, NULL);
            g->vk.DestroyQueryPool(g->device, g->flights[i].timestamps, NULL);
        }
        g->vk.DestroyCommandPool(g->device, g->pool, NULL);
    }
    sg_gpu_give_device(g->shared);
    sg_free(g);
}
