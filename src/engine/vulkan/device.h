/* SPDX-License-Identifier: Apache-2.0 */
/* An open device and its kernels. All engines of the process that use a device share it. Thread
 * safety: safe, where nothing else is said. */
#ifndef SG_VULKAN_DEVICE_H
#define SG_VULKAN_DEVICE_H

#include <pthread.h>

#include "devices.h"
#include "shaders/args.h"

#define GPU_ARGUMENTS 128 /* bytes of push constants */
#define GPU_VARIANTS 4    /* of a kernel: see sg_gpu_dispatch */

struct gpu_code {
    const uint32_t *words; /* SPIR-V */
    size_t bytes;
};

enum gpu_kernel {
#define K(name) GPU_##name,
    VK_KERNELS(K)
#undef K
        GPU_KERNELS
};

extern const struct gpu_code sg_vulkan_code[GPU_KERNELS];

/* Specialisation constants: the invocations of a workgroup that draws a tile; those of its blocks,
 * or the variant; the floats of a slot; parts that are left out, VK_WITHOUT_. */
#define GPU_CONSTANTS 4
#define GPU_WITHOUT 3

/* What a pipeline is made of. */
struct gpu_build {
    const struct gpu_code *code;
    uint32_t constants[GPU_CONSTANTS];
    VkPipelineCreateFlags flags;
};

struct gpu_device {
    struct vk_functions vk;
    struct vk_device_choice chosen; /* its free memory was that when the device was opened */
    VkDevice device;
    VkPipelineLayout layout;
    pthread_mutex_t lock;                            /* of the next two */
    VkQueue queue;                                   /* see sg_gpu_queue */
    VkPipeline pipelines[GPU_KERNELS][GPU_VARIANTS]; /* see sg_gpu_pipeline */
    /* Of device.c. */
    unsigned users;
    uint32_t allocations; /* that are alive, under `lock` */
    bool lost;            /* nobody else takes it */
    struct gpu_device *next;
};

/* Invocations of a block of pixels, on a device with subgroups of so many. */
static inline uint32_t sg_gpu_lanes(uint32_t subgroup)
{
    return subgroup < 4 ? 4 : subgroup > 32 ? 32 : subgroup;
}

/* selector: see sg_vk_choose_device. chosen: what it is, with the memory that is free now.
 * SG_ERR_USAGE, SG_ERR_BUDGET, SG_ERR_INTERNAL. */
int sg_gpu_take_device(sg_ctx *ctx, const char *selector, struct vk_device_choice *chosen,
                       struct gpu_device **out);
/* After everything that was made of it is destroyed. NULL: nothing. */
void sg_gpu_give_device(struct gpu_device *d);
/* Who takes this device from now on gets another one. */
void sg_gpu_lose_device(struct gpu_device *d);

/* A kernel's pipeline, which is compiled when it is first asked for. */
int sg_gpu_pipeline(sg_ctx *ctx, struct gpu_device *d, enum gpu_kernel kernel, int variant,
                    VkPipeline *out);
/* The same without a gpu_device. */
struct gpu_build sg_gpu_build(enum gpu_kernel kernel, int variant, uint32_t lanes);
VkResult sg_gpu_compile(const struct vk_functions *vk, VkDevice device, VkPipelineLayout layout,
                        const struct gpu_build *build, VkPipeline *out);
/* vkAllocateMemory; VK_ERROR_TOO_MANY_OBJECTS where the device allows no more. */
VkResult sg_gpu_allocate(struct gpu_device *d, const VkMemoryAllocateInfo *info,
                         VkDeviceMemory *out);
/* NULL: nothing. */
void sg_gpu_free(struct gpu_device *d, VkDeviceMemory memory);
/* vkQueueSubmit. */
VkResult sg_gpu_queue(struct gpu_device *d, VkCommandBuffer commands, VkFence fence);
/* vkDeviceWaitIdle. */
VkResult sg_gpu_idle(struct gpu_device *d);

/* Records what a result other than VK_SUCCESS means: SG_ERR_BUDGET or SG_ERR_INTERNAL. */
int sg_vk_fail(sg_ctx *ctx, const struct vk_device_choice *device, VkResult result,
               const char *what);

#endif
