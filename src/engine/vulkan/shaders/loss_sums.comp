/* SPDX-License-Identifier: Apache-2.0 */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(loss_sums);

void main()
{
    const uint j = group_index();
    float sum = 0.0;
    for (uint i = gl_LocalInvocationID.x; i < a.count; i += VK_GROUP)
        sum += a.from.v[i * a.width + j];
    const float all = group_sum(sum);
    if (gl_LocalInvocationID.x == 0)
        a.to.v[j] = all;
}
