/* SPDX-License-Identifier: Apache-2.0 */
/* What a test puts between the engine and its driver: it counts what is alive there, and lets calls
 * fail. Programs with this are linked with WRAPPED_BY_CALLS of cmake/tests.cmake. The engine calls
 * from one thread. */
#ifndef TESTS_DRIVER_CALLS_H
#define TESTS_DRIVER_CALLS_H

#include "engine/vulkan/loader.h"
#include "models.h"

/* ---- the calls ---- */

/* vkCreate and vkDestroy of an object, in the usual form. */
#define CALLS_OF_OBJECTS(C)                                                                        \
    C(Buffer)                                                                                      \
    C(ShaderModule)                                                                                \
    C(PipelineLayout)                                                                              \
    C(CommandPool)                                                                                 \
    C(QueryPool)                                                                                   \
    C(Fence)
/* The others that can fail: name, parameters, arguments. */
#define CALLS_OF_WORK(C)                                                                           \
    C(BindBufferMemory,                                                                            \
      (VkDevice device, VkBuffer buffer, VkDeviceMemory memory, VkDeviceSize offset),              \
      (device, buffer, memory, offset))                                                            \
    C(MapMemory,                                                                                   \
      (VkDevice device, VkDeviceMemory memory, VkDeviceSize offset, VkDeviceSize size,             \
       VkMemoryMapFlags flags, void **out),                                                        \
      (device, memory, offset, size, flags, out))                                                  \
    C(AllocateCommandBuffers,                                                                      \
      (VkDevice device, const VkCommandBufferAllocateInfo *info, VkCommandBuffer *out),            \
      (device, info, out))                                                                         \
    C(BeginCommandBuffer, (VkCommandBuffer commands, const VkCommandBufferBeginInfo *info),        \
      (commands, info))                                                                            \
    C(ResetFences, (VkDevice device, uint32_t n, const VkFence *fences), (device, n, fences))      \
    C(QueueSubmit, (VkQueue queue, uint32_t n, const VkSubmitInfo *info, VkFence fence),           \
      (queue, n, info, fence))

/* Commands that read or write memory: name, parameters, arguments. */
#define CALLS_OF_COMMANDS(C)                                                                       \
    C(CmdDispatch, (VkCommandBuffer commands, uint32_t x, uint32_t y, uint32_t z),                 \
      (commands, x, y, z))                                                                         \
    C(CmdDispatchIndirect, (VkCommandBuffer commands, VkBuffer buffer, VkDeviceSize offset),       \
      (commands, buffer, offset))                                                                  \
    C(CmdCopyBuffer,                                                                               \
      (VkCommandBuffer commands, VkBuffer from, VkBuffer to, uint32_t n,                           \
       const VkBufferCopy *regions),                                                               \
      (commands, from, to, n, regions))                                                            \
    C(CmdFillBuffer,                                                                               \
      (VkCommandBuffer commands, VkBuffer buffer, VkDeviceSize offset, VkDeviceSize size,          \
       uint32_t value),                                                                            \
      (commands, buffer, offset, size, value))                                                     \
    C(CmdUpdateBuffer,                                                                             \
      (VkCommandBuffer commands, VkBuffer buffer, VkDeviceSize offset, VkDeviceSize size,          \
       const void *data),                                                                          \
      (commands, buffer, offset, size, data))

enum driver_call {
#define C(object) CALL_Create##object,
    CALLS_OF_OBJECTS(C)
#undef C
#define C(name, parameters, arguments) CALL_##name,
        CALLS_OF_WORK(C)
#undef C
            CALL_CreateDevice,
    CALL_CreateComputePipelines,
    CALL_AllocateMemory,
    CALL_EndCommandBuffer,
    CALL_WaitForFences,
    CALL_DeviceWaitIdle,
    CALL_GetQueryPoolResults,
    CALLS
};

#define MOST_ALLOCATIONS 4096

/* What there is on all devices of the process. */
static struct {
    struct vk_functions driver;
    long objects[CALLS];  /* by the call that makes one */
    uint64_t made[CALLS]; /* of each, since the process began */
    struct {
        VkDeviceMemory memory;
        uint64_t bytes;
    } allocations[MOST_ALLOCATIONS];
    size_t allocation_count;
    uint64_t bytes, peak; /* of the allocations */
    /* The plan of fail_call, and whether its device is lost since. */
    enum driver_call call;
    uint64_t left;
    VkResult result;
    bool failed, lost;
    /* Commands so far, and those that no barrier came after; whether the newest is one of these. */
    uint64_t commands, unordered;
    bool open;
    bool no_barriers; /* leave them out */
} calls;

/* The nth such call from now on has this result. Once a device is lost, it stays so: what it has is
 * waited for all the same, since nothing is wrong with the driver. */
static inline void fail_call(enum driver_call call, uint64_t nth, VkResult result)
{
    calls.call = call;
    calls.left = nth;
    calls.result = result;
    calls.failed = calls.lost = false;
}

/* Ends the plan. Returns whether there was such a call. */
static inline bool call_failed(void)
{
    calls.left = 0;
    calls.lost = false;
    return calls.failed;
}

static inline bool call_fails(enum driver_call call)
{
    calls.made[call]++;
    if (!calls.left || call != calls.call || --calls.left)
        return false;
    calls.failed = true;
    calls.lost = calls.result == VK_ERROR_DEVICE_LOST;
    return true;
}

/* From now on the peak is that of allocations beside those that are there. */
static uint64_t calls_base;
static inline void forget_peak(void)
{
    calls.peak = calls_base = calls.bytes;
}
static inline uint64_t peak_of_calls(void)
{
    return calls.peak - calls_base;
}

/* ---- what the engine calls ---- */

#define C(object)                                                                                  \
    static inline VkResult VKAPI_CALL test_Create##object(                                         \
        VkDevice device, const Vk##object##CreateInfo *info,                                       \
        const VkAllocationCallbacks *allocator, Vk##object *out)                                   \
    {                                                                                              \
        if (call_fails(CALL_Create##object))                                                       \
            return calls.result;                                                                   \
        const VkResult result = calls.driver.Create##object(device, info, allocator, out);         \
        calls.objects[CALL_Create##object] += result == VK_SUCCESS;                                \
        return result;                                                                             \
    }                                                                                              \
    static inline void VKAPI_CALL test_Destroy##object(VkDevice device, Vk##object o,              \
                                                       const VkAllocationCallbacks *allocator)     \
    {                                                                                              \
        calls.objects[CALL_Create##object] -= o != VK_NULL_HANDLE;                                 \
        calls.driver.Destroy##object(device, o, allocator);                                        \
    }
CALLS_OF_OBJECTS(C)
#undef C

#define C(name, parameters, arguments)                                                             \
    static inline VkResult VKAPI_CALL test_##name parameters                                       \
    {                                                                                              \
        if (CALL_##name == CALL_QueueSubmit && calls.lost)                                         \
            return VK_ERROR_DEVICE_LOST;                                                           \
        return call_fails(CALL_##name) ? calls.result : calls.driver.name arguments;               \
    }
CALLS_OF_WORK(C)
#undef C

static inline VkResult VKAPI_CALL test_CreateDevice(VkPhysicalDevice physical,
                                                    const VkDeviceCreateInfo *info,
                                                    const VkAllocationCallbacks *allocator,
                                                    VkDevice *out)
{
    if (call_fails(CALL_CreateDevice))
        return calls.result;
    const VkResult result = calls.driver.CreateDevice(physical, info, allocator, out);
    calls.objects[CALL_CreateDevice] += result == VK_SUCCESS;
    return result;
}

static inline void VKAPI_CALL test_DestroyDevice(VkDevice device,
                                                 const VkAllocationCallbacks *allocator)
{
    calls.objects[CALL_CreateDevice]--;
    calls.driver.DestroyDevice(device, allocator);
}

static inline VkResult VKAPI_CALL test_CreateComputePipelines(
    VkDevice device, VkPipelineCache cache, uint32_t n, const VkComputePipelineCreateInfo *info,
    const VkAllocationCallbacks *allocator, VkPipeline *out)
{
    if (call_fails(CALL_CreateComputePipelines))
        return calls.result;
    const VkResult result =
        calls.driver.CreateComputePipelines(device, cache, n, info, allocator, out);
    calls.objects[CALL_CreateComputePipelines] += result == VK_SUCCESS;
    return result;
}

static inline void VKAPI_CALL test_DestroyPipeline(VkDevice device, VkPipeline pipeline,
                                                   const VkAllocationCallbacks *allocator)
{
    calls.objects[CALL_CreateComputePipelines] -= pipeline != VK_NULL_HANDLE;
    calls.driver.DestroyPipeline(device, pipeline, allocator);
}

static inline VkResult VKAPI_CALL test_AllocateMemory(VkDevice device,
                                                      const VkMemoryAllocateInfo *info,
                                                      const VkAllocationCallbacks *allocator,
                                                      VkDeviceMemory *out)
{
    if (call_fails(CALL_AllocateMemory))
        return calls.result;
    const VkResult result = calls.driver.AllocateMemory(device, info, allocator, out);
    if (result)
        return result;
    assert_true(calls.allocation_count < MOST_ALLOCATIONS);
    calls.allocations[calls.allocation_count].memory = *out;
    calls.allocations[calls.allocation_count++].bytes = info->allocationSize;
    calls.objects[CALL_AllocateMemory]++;
    calls.bytes += info->allocationSize;
    calls.peak = calls.bytes > calls.peak ? calls.bytes : calls.peak;
    return VK_SUCCESS;
}

static inline void VKAPI_CALL test_FreeMemory(VkDevice device, VkDeviceMemory memory,
                                              const VkAllocationCallbacks *allocator)
{
    size_t i = 0;
    while (i < calls.allocation_count && calls.allocations[i].memory != memory)
        i++;
    assert_true(i < calls.allocation_count);
    calls.objects[CALL_AllocateMemory]--;
    calls.bytes -= calls.allocations[i].bytes;
    calls.allocations[i] = calls.allocations[--calls.allocation_count];
    calls.driver.FreeMemory(device, memory, allocator);
}

/* Nothing is recorded any more, also after an error. */
static inline VkResult VKAPI_CALL test_EndCommandBuffer(VkCommandBuffer commands)
{
    const VkResult result = calls.driver.EndCommandBuffer(commands);
    calls.unordered += calls.open;
    calls.open = false;
    return call_fails(CALL_EndCommandBuffer) ? calls.result : result;
}

static inline VkResult VKAPI_CALL test_DeviceWaitIdle(VkDevice device)
{
    const bool fails = call_fails(CALL_DeviceWaitIdle);
    const VkResult result = calls.driver.DeviceWaitIdle(device);
    return calls.lost ? VK_ERROR_DEVICE_LOST : fails ? calls.result : result;
}

static inline VkResult VKAPI_CALL test_WaitForFences(VkDevice device, uint32_t n,
                                                     const VkFence *fences, VkBool32 all,
                                                     uint64_t timeout)
{
    if (call_fails(CALL_WaitForFences) && !calls.lost)
        return calls.result;
    if (calls.lost) { /* it does nothing more */
        calls.driver.DeviceWaitIdle(device);
        return VK_ERROR_DEVICE_LOST;
    }
    return calls.driver.WaitForFences(device, n, fences, all, timeout);
}

static inline VkResult VKAPI_CALL test_GetQueryPoolResults(VkDevice device, VkQueryPool pool,
                                                           uint32_t first, uint32_t n, size_t size,
                                                           void *out, VkDeviceSize stride,
                                                           VkQueryResultFlags flags)
{
    if (calls.lost)
        return VK_ERROR_DEVICE_LOST;
    return call_fails(CALL_GetQueryPoolResults)
               ? calls.result
               : calls.driver.GetQueryPoolResults(device, pool, first, n, size, out, stride, flags);
}

#define C(name, parameters, arguments)                                                             \
    static inline void VKAPI_CALL test_##name parameters                                           \
    {                                                                                              \
        calls.unordered += calls.open;                                                             \
        calls.open = true;                                                                         \
        calls.commands++;                                                                          \
        calls.driver.name arguments;                                                               \
    }
CALLS_OF_COMMANDS(C)
#undef C

/* One that orders all commands before it and after it, and shows the latter what the former wrote.
 */
static inline bool orders_all(VkPipelineStageFlags before, VkPipelineStageFlags after, uint32_t n,
                              const VkMemoryBarrier *b)
{
    const VkPipelineStageFlags stages =
        VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
    const VkPipelineStageFlags readers =
        stages | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT | VK_PIPELINE_STAGE_HOST_BIT;
    const VkAccessFlags writes = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    const VkAccessFlags uses = writes | VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_TRANSFER_READ_BIT |
                               VK_ACCESS_INDIRECT_COMMAND_READ_BIT | VK_ACCESS_HOST_READ_BIT;
    return (before & stages) == stages && (after & readers) == readers && n == 1 &&
           (b->srcAccessMask & writes) == writes && (b->dstAccessMask & uses) == uses;
}

static inline void VKAPI_CALL test_CmdPipelineBarrier(
    VkCommandBuffer commands, VkPipelineStageFlags before, VkPipelineStageFlags after,
    VkDependencyFlags flags, uint32_t n, const VkMemoryBarrier *memory, uint32_t of_buffers,
    const VkBufferMemoryBarrier *buffers, uint32_t of_images, const VkImageMemoryBarrier *images)
{
    calls.open = calls.open && !orders_all(before, after, n, memory);
    if (!calls.no_barriers)
        calls.driver.CmdPipelineBarrier(commands, before, after, flags, n, memory, of_buffers,
                                        buffers, of_images, images);
}

const char *__real_sg_vk_open(struct vk_functions *vk);
const char *__wrap_sg_vk_open(struct vk_functions *vk);
void __real_sg_vk_open_device(struct vk_functions *vk, VkDevice device);
void __wrap_sg_vk_open_device(struct vk_functions *vk, VkDevice device);

const char *__wrap_sg_vk_open(struct vk_functions *vk)
{
    const char *missing = __real_sg_vk_open(vk);
    calls.driver.CreateDevice = vk->CreateDevice;
    vk->CreateDevice = test_CreateDevice;
    return missing;
}

void __wrap_sg_vk_open_device(struct vk_functions *vk, VkDevice device)
{
    __real_sg_vk_open_device(vk, device);
    const PFN_vkCreateDevice create = calls.driver.CreateDevice;
    calls.driver = *vk; /* the functions are the same on every device of a driver */
    calls.driver.CreateDevice = create;
#define C(object)                                                                                  \
    vk->Create##object = test_Create##object;                                                      \
    vk->Destroy##object = test_Destroy##object;
    CALLS_OF_OBJECTS(C)
#undef C
#define C(name, parameters, arguments) vk->name = test_##name;
    CALLS_OF_WORK(C)
    CALLS_OF_COMMANDS(C)
#undef C
    vk->CmdPipelineBarrier = test_CmdPipelineBarrier;
    vk->DestroyDevice = test_DestroyDevice;
    vk->CreateComputePipelines = test_CreateComputePipelines;
    vk->DestroyPipeline = test_DestroyPipeline;
    vk->AllocateMemory = test_AllocateMemory;
    vk->FreeMemory = test_FreeMemory;
    vk->EndCommandBuffer = test_EndCommandBuffer;
    vk->DeviceWaitIdle = test_DeviceWaitIdle;
    vk->WaitForFences = test_WaitForFences;
    vk->GetQueryPoolResults = test_GetQueryPoolResults;
}

#endif
