/* SPDX-License-Identifier: Apache-2.0 */
/* Linked into programs that print hashes: a device with subgroups of 32, which no driver for the
 * CPU has, as far as the engine sees it. Its kernels use no subgroup operations, so that they run
 * on any device. */
#include "engine/vulkan/device.h"

#define LANES 32

extern __typeof__(sg_gpu_take_device) __real_sg_gpu_take_device, __wrap_sg_gpu_take_device;

int __wrap_sg_gpu_take_device(sg_ctx *ctx, const char *selector, struct vk_device_choice *chosen,
                              struct gpu_device **out)
{
    const int code = __real_sg_gpu_take_device(ctx, selector, chosen, out);
    if (!code)
        chosen->lanes = (*out)->chosen.lanes = LANES;
    return code;
}
