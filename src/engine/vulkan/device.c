/* SPDX-License-Identifier: Apache-2.0 */
/* Open devices. Engines of a process that are alive at once share one, so that its kernels are
 * compiled once: an engine is made for each renderer. */
#include "device.h"

#include <stdlib.h>

static struct {
    pthread_mutex_t lock;
    struct gpu_device *first;
} shared = {.lock = PTHREAD_MUTEX_INITIALIZER};

int sg_vk_fail(sg_ctx *ctx, const struct vk_device_choice *device, VkResult result,
               const char *what)
{
    if (result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY)
        return sg_fail(ctx, SG_ERR_BUDGET, "vulkan: %s: out of memory on %s", what,
                       device->info.name);
    if (result == VK_ERROR_TOO_MANY_OBJECTS)
        return sg_fail(ctx, SG_ERR_BUDGET, "vulkan: %s: %s allows %u allocations at once", what,
                       device->info.name, device->allocations);
    return sg_fail(ctx, SG_ERR_INTERNAL, "vulkan: %s: %s (error %d of %s)", what,
                   result == VK_ERROR_DEVICE_LOST ? "the device is lost" : "failed", (int) result,
                   device->info.name);
}

/* ---- memory ---- */

static void count_freed(struct gpu_device *d)
{
    pthread_mutex_lock(&d->lock);
    d->allocations--;
    pthread_mutex_unlock(&d->lock);
}

VkResult sg_gpu_allocate(struct gpu_device *d, const VkMemoryAllocateInfo *info,
                         VkDeviceMemory *out)
{
    pthread_mutex_lock(&d->lock);
    const bool allowed = d->allocations < d->chosen.allocations;
    d->allocations += allowed;
    pthread_mutex_unlock(&d->lock);
    if (!allowed)
        return VK_ERROR_TOO_MANY_OBJECTS;
    const VkResult result = d->vk.AllocateMemory(d->device, info, NULL, out);
    if (result)
        count_freed(d);
    return result;
}

void sg_gpu_free(struct gpu_device *d, VkDeviceMemory memory)
{
    if (!memory)
        return;
    d->vk.FreeMemory(d->device, memory, NULL);
    count_freed(d);
}

/* ---- kernels ---- */

static bool draws_tiles(enum gpu_kernel kernel)
{
    return kernel == GPU_raster || kernel == GPU_raster_backward || kernel == GPU_raster_count;
}

struct gpu_build sg_gpu_build(enum gpu_kernel kernel, int variant, uint32_t lanes)
{
    return (struct gpu_build){.code = &sg_vulkan_code[kernel],
                              .constants = {VK_BLOCKS * lanes,
                                            draws_tiles(kernel) ? lanes : (uint32_t) variant,
                                            variant ? VK_SLOT_ABSOLUTE : VK_SLOT}};
}

VkResult sg_gpu_compile(const struct vk_functions *vk, VkDevice device, VkPipelineLayout layout,
                        const struct gpu_build *build, VkPipeline *out)
{
    const VkShaderModuleCreateInfo code = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                           .codeSize = build->code->bytes,
                                           .pCode = build->code->words};
    VkShaderModule module;
    VkResult result = vk->CreateShaderModule(device, &code, NULL, &module);
    if (result)
        return result;
    VkSpecializationMapEntry entries[GPU_CONSTANTS];
    for (uint32_t i = 0; i < GPU_CONSTANTS; i++)
        entries[i] = (VkSpecializationMapEntry){i, 4 * i, 4};
    const VkSpecializationInfo special = {GPU_CONSTANTS, entries, sizeof(build->constants),
                                          build->constants};
    const VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .flags = build->flags,
        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                  .module = module,
                  .pName = "main",
                  .pSpecializationInfo = &special},
        .layout = layout};
    result = vk->CreateComputePipelines(device, VK_NULL_HANDLE, 1, &info, NULL, out);
    vk->DestroyShaderModule(device, module, NULL);
    return result;
}

int sg_gpu_pipeline(sg_ctx *ctx, struct gpu_device *d, enum gpu_kernel kernel, int variant,
                    VkPipeline *out)
{
    static const char *const names[] = {
#define K(name) #name,
        VK_KERNELS(K)
#undef K
    };
    const struct gpu_build build = sg_gpu_build(kernel, variant, sg_gpu_lanes(d->chosen.lanes));
    VkPipeline *pipeline = &d->pipelines[kernel][variant];
    pthread_mutex_lock(&d->lock);
    const VkResult result =
        *pipeline ? VK_SUCCESS : sg_gpu_compile(&d->vk, d->device, d->layout, &build, pipeline);
    *out = *pipeline;
    pthread_mutex_unlock(&d->lock);
    return result ? sg_vk_fail(ctx, &d->chosen, result, names[kernel]) : SG_OK;
}

VkResult sg_gpu_queue(struct gpu_device *d, VkCommandBuffer commands, VkFence fence)
{
    const VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                               .commandBufferCount = 1,
                               .pCommandBuffers = &commands};
    pthread_mutex_lock(&d->lock);
    const VkResult result = d->vk.QueueSubmit(d->queue, 1, &info, fence);
    pthread_mutex_unlock(&d->lock);
    return result;
}

VkResult sg_gpu_idle(struct gpu_device *d)
{
    pthread_mutex_lock(&d->lock); /* nobody may submit meanwhile */
    const VkResult result = d->vk.DeviceWaitIdle(d->device);
    pthread_mutex_unlock(&d->lock);
    return result;
}

/* ---- opening ---- */

static void close_device(struct gpu_device *d)
{
    if (d->device) {
        d->vk.DeviceWaitIdle(d->device);
        for (int k = 0; k < GPU_KERNELS; k++)
            for (int v = 0; v < GPU_VARIANTS; v++)
                d->vk.DestroyPipeline(d->device, d->pipelines[k][v], NULL);
        d->vk.DestroyPipelineLayout(d->device, d->layout, NULL);
        d->vk.DestroyDevice(d->device, NULL);
    }
    pthread_mutex_destroy(&d->lock);
    free(d);
}

static VkResult open_device(struct gpu_device *d)
{
    const float priority = 1;
    const VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                           .queueFamilyIndex = d->chosen.queue_family,
                                           .queueCount = 1,
                                           .pQueuePriorities = &priority};
    VkPhysicalDeviceVulkan12Features features = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
        .bufferDeviceAddress = VK_TRUE};
    const VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                     .pNext = &features,
                                     .queueCreateInfoCount = 1,
                                     .pQueueCreateInfos = &queue};
    const VkPushConstantRange range = {VK_SHADER_STAGE_COMPUTE_BIT, 0, GPU_ARGUMENTS};
    const VkPipelineLayoutCreateInfo layout = {.sType =
                                                   VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                               .pushConstantRangeCount = 1,
                                               .pPushConstantRanges = &range};
    const VkResult result = d->vk.CreateDevice(d->chosen.physical, &info, NULL, &d->device);
    if (result)
        return result;
    sg_vk_open_device(&d->vk, d->device);
    d->vk.GetDeviceQueue(d->device, d->chosen.queue_family, 0, &d->queue);
    return d->vk.CreatePipelineLayout(d->device, &layout, NULL, &d->layout);
}

/* The open device that this is, or a new one. Contexts come and go while others use the device: its
 * few kilobytes belong to none of their ledgers. */
static int find_device(sg_ctx *ctx, const struct vk_functions *vk,
                       const struct vk_device_choice *chosen, struct gpu_device **out)
{
    for (*out = shared.first; *out; *out = (*out)->next)
        if ((*out)->chosen.physical == chosen->physical && !(*out)->lost)
            return SG_OK;
    struct gpu_device *d = calloc(1, sizeof(*d));
    if (!d)
        return sg_vk_fail(ctx, chosen, VK_ERROR_OUT_OF_HOST_MEMORY, "opening the device");
    d->vk = *vk;
    d->chosen = *chosen;
    pthread_mutex_init(&d->lock, NULL);
    const VkResult result = open_device(d);
    if (result) {
        close_device(d);
        return sg_vk_fail(ctx, chosen, result, "opening the device");
    }
    d->next = shared.first;
    shared.first = *out = d;
    return SG_OK;
}

static int take(sg_ctx *ctx, const char *selector, struct vk_device_choice *chosen,
                struct gpu_device **out)
{
    struct vk_functions vk;
    const char *missing = sg_vk_open(&vk);
    if (missing)
        return sg_fail(ctx, SG_ERR_USAGE, "vulkan: this machine lacks %s", missing);
    struct vk_device_choice devices[VK_DEVICES];
    const struct vk_device_choice *found;
    int code = sg_vk_choose_device(ctx, devices, sg_vk_devices(&vk, devices), selector, &found);
    if (!code)
        code = find_device(ctx, &vk, found, out);
    if (!code) {
        *chosen = *found;
        (*out)->users++;
    }
    return code;
}

int sg_gpu_take_device(sg_ctx *ctx, const char *selector, struct vk_device_choice *chosen,
                       struct gpu_device **out)
{
    *out = NULL;
    pthread_mutex_lock(&shared.lock);
    const int code = take(ctx, selector, chosen, out);
    pthread_mutex_unlock(&shared.lock);
    return code;
}

void sg_gpu_lose_device(struct gpu_device *d)
{
    pthread_mutex_lock(&shared.lock);
    d->lost = true;
    pthread_mutex_unlock(&shared.lock);
}

void sg_gpu_give_device(struct gpu_device *d)
{
    if (!d)
        return;
    pthread_mutex_lock(&shared.lock);
    if (!--d->users) {
        struct gpu_device **at = &shared.first;
        while (*at != d)
            at = &(*at)->next;
        *at = d->next;
        close_device(d);
    }
    pthread_mutex_unlock(&shared.lock);
}
