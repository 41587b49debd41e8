/* SPDX-License-Identifier: Apache-2.0 */
/* Vulkan's functions, loaded at run time: nothing links the loader. */
#ifndef SG_VULKAN_LOADER_H
#define SG_VULKAN_LOADER_H

#define VK_NO_PROTOTYPES
#include <stdbool.h>
#include <vulkan/vulkan.h>

#define VK_GLOBAL_FUNCTIONS(F)                                                                     \
    F(CreateInstance)                                                                              \
    F(EnumerateInstanceVersion)
#define VK_INSTANCE_FUNCTIONS(F)                                                                   \
    F(EnumeratePhysicalDevices)                                                                    \
    F(GetPhysicalDeviceProperties2)                                                                \
    F(GetPhysicalDeviceFeatures2)                                                                  \
    F(GetPhysicalDeviceMemoryProperties2)                                                          \
    F(GetPhysicalDeviceQueueFamilyProperties)                                                      \
    F(EnumerateDeviceExtensionProperties)                                                          \
    F(CreateDevice)                                                                                \
    F(GetDeviceProcAddr)
#define VK_DEVICE_FUNCTIONS(F)                                                                     \
    F(DestroyDevice)                                                                               \
    F(GetDeviceQueue)                                                                              \
    F(CreateBuffer)                                                                                \
    F(DestroyBuffer)                                                                               \
    F(GetBufferMemoryRequirements)                                                                 \
    F(GetBufferDeviceAddress)                                                                      \
    F(AllocateMemory)                                                                              \
    F(FreeMemory)                                                                                  \
    F(BindBufferMemory)                                                                            \
    F(MapMemory)                                                                                   \
    F(CreateShaderModule)                                                                          \
    F(DestroyShaderModule)                                                                         \
    F(CreatePipelineLayout)                                                                        \
    F(DestroyPipelineLayout)                                                                       \
    F(CreateComputePipelines)                                                                      \
    F(DestroyPipeline)                                                                             \
    F(CreateCommandPool)                                                                           \
    F(DestroyCommandPool)                                                                          \
    F(AllocateCommandBuffers)                                                                      \
    F(BeginCommandBuffer)                                                                          \
    F(EndCommandBuffer)                                                                            \
    F(CmdBindPipeline)                                                                             \
    F(CmdPushConstants)                                                                            \
    F(CmdDispatch)                                                                                 \
    F(CmdDispatchIndirect)                                                                         \
    F(CmdPipelineBarrier)                                                                          \
    F(CmdCopyBuffer)                                                                               \
    F(CmdFillBuffer)                                                                               \
    F(CmdUpdateBuffer)                                                                             \
    F(CmdResetQueryPool)                                                                           \
    F(CmdWriteTimestamp)                                                                           \
    F(CreateQueryPool)                                                                             \
    F(DestroyQueryPool)                                                                            \
    F(GetQueryPoolResults)                                                                         \
    F(QueueSubmit)                                                                                 \
    F(CreateFence)                                                                                 \
    F(DestroyFence)                                                                                \
    F(WaitForFences)                                                                               \
    F(ResetFences)                                                                                 \
    F(DeviceWaitIdle)

/* vk->CreateBuffer is vkCreateBuffer. */
struct vk_functions {
#define F(name) PFN_vk##name name;
    VK_GLOBAL_FUNCTIONS(F)
    VK_INSTANCE_FUNCTIONS(F)
    VK_DEVICE_FUNCTIONS(F)
#undef F
    PFN_vkGetInstanceProcAddr GetInstanceProcAddr;
    void *library;
    VkInstance instance;
};

/* Opens the loader and makes an instance of Vulkan 1.2, once in a process: both stay until it ends.
 * NVIDIA's driver 580 failed after about 400 starts in one process. A child that was forked opens
 * them anew. Returns NULL, or what is missing (static text); then nothing is left open. Thread
 * safety: safe. */
const char *sg_vk_open(struct vk_functions *vk);
void sg_vk_open_device(struct vk_functions *vk, VkDevice device);

#endif
