/* SPDX-License-Identifier: Apache-2.0 */
/* Linked into tests: memory of the device that is new has garbage in it, as on a GPU. Drivers for
 * the CPU give zeros. */
#include <string.h>

#include "engine/vulkan/device.h"

extern __typeof__(sg_gpu_allocate) __real_sg_gpu_allocate, __wrap_sg_gpu_allocate;

VkResult __wrap_sg_gpu_allocate(struct gpu_device *d, const VkMemoryAllocateInfo *info,
                                VkDeviceMemory *out)
{
    const PFN_vkVoidFunction found = d->vk.GetDeviceProcAddr(d->device, "vkUnmapMemory");
    PFN_vkUnmapMemory unmap;
    void *at;
    VkResult result = __real_sg_gpu_allocate(d, info, out);
    if (result)
        return result;
    memcpy(&unmap, &found, sizeof(found));
    if ((result = d->vk.MapMemory(d->device, *out, 0, VK_WHOLE_SIZE, 0, &at))) {
        sg_gpu_free(d, *out);
        return result;
    }
    memset(at, 0xff, info->allocationSize); /* large numbers, and no numbers */
    unmap(d->device, *out);
    return VK_SUCCESS;
}
