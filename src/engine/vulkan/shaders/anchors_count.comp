/* SPDX-License-Identifier: Apache-2.0 */
/* Statistics of growth: an invocation has one of an anchor's. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(anchors_count);

void main()
{
    const uint at = thread_index(), plane = at / 16 % VK_A_STATISTICS;
    const uint i = at / 16 / VK_A_STATISTICS * 16 + at % 16;
    if (i >= a.count || a.stop.v[0] != 0)
        return;
    const uint exists = a.exists.v[i], k = plane % VK_ANCHOR;
    if (exists == 0)
        return;
    float value = 1.0; /* SG_A_SEEN */
    if (plane < 2 * VK_ANCHOR) {
        if ((exists >> k & 1) == 0)
            return;
        const uint from = i * VK_ANCHOR + k;
        value = plane < VK_ANCHOR ? a.grad_sum.v[from] : a.grad_count.v[from];
    } else if (plane == 2 * VK_ANCHOR) /* SG_A_OPACITY */
        value = a.opacities.v[i];
    a.statistics.v[at] += value;
}
