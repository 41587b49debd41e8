/* SPDX-License-Identifier: Apache-2.0 */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(slots_add);

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    for (uint k = a.slot_start.v[i]; k < a.slot_start.v[i + 1]; k++)
        for (uint j = 0; j < a.width; j++)
            a.sums.v[i * a.width + j] += a.slots.v[k * a.width + j];
}
