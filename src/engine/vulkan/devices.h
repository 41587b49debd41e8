/* SPDX-License-Identifier: Apache-2.0 */
/* Which devices there are, and which of them a name chooses. */
#ifndef SG_VULKAN_DEVICES_H
#define SG_VULKAN_DEVICES_H

#include "core/context.h"
#include "loader.h"
#include "splatguard/engine.h"

#define VK_DEVICES 16 /* the most that are looked at */

struct vk_device_choice {
    VkPhysicalDevice physical;
    struct sg_device_info info;
    VkPhysicalDeviceType type;
    uint32_t queue_family;
    uint32_t lanes;          /* its subgroup size */
    uint32_t timestamp_bits; /* of that queue; 0: it has no timestamps */
    double tick;             /* seconds between two timestamps that differ by 1 */
    bool memory_budget;
    uint64_t largest;     /* bytes of one allocation at most */
    uint32_t allocations; /* at once at most */
};

/* All devices of an open loader, in its order; returns their number. */
int sg_vk_devices(const struct vk_functions *vk, struct vk_device_choice out[VK_DEVICES]);

/* selector: NULL (a GPU: a card before one that shares the host's memory, then the one with more
 * memory), a number of the list, or part of a name in any case. SG_ERR_USAGE where none is meant or
 * it cannot be used. */
int sg_vk_choose_device(sg_ctx *ctx, const struct vk_device_choice *devices, int n,
                        const char *selector, const struct vk_device_choice **out);

/* Whether the system has a file that each driver of a GPU needs. To ask the drivers themselves
 * loads them, which takes time and memory, and some print. */
bool sg_vulkan_may_have_gpu(void);

/* Of sg_engine_vulkan. */
bool sg_vulkan_describe(size_t index, struct sg_engine_info *out);

#endif
