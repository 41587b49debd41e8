/* SPDX-License-Identifier: Apache-2.0 */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(magnitudes);

void main()
{
    const uint i = thread_index();
    const float sum = group_sum(i < a.count ? abs(a.from.v[i]) : 0.0);
    if (gl_LocalInvocationID.x == 0 && i < a.count) /* groups beyond the last value have no sums */
        a.sums.v[group_index()] = sum;
}
