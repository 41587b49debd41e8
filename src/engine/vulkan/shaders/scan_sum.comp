/* SPDX-License-Identifier: Apache-2.0 */
/* Sums of VK_SCAN numbers each. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "scan.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(scan_sum);

void main()
{
    const uint count = a.count.v[0];
    const uint group = group_index(), each = VK_SCAN / VK_GROUP;
    const uint first = group * VK_SCAN + gl_LocalInvocationID.x * each;
    uint sum = 0, all;
    for (uint i = first; i < first + each; i++)
        sum += i < count ? a.from.v[i] : 0;
    group_scan(sum, all);
    if (gl_LocalInvocationID.x == 0 && group * VK_SCAN < count)
        a.sums.v[group] = all;
}
