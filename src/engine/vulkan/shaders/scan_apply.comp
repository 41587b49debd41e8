/* SPDX-License-Identifier: Apache-2.0 */
/* Exclusive sums within VK_SCAN numbers, on top of those before them. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "scan.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(scan_apply);

void main()
{
    const uint count = a.count.v[0];
    const uint group = group_index(), each = VK_SCAN / VK_GROUP;
    const uint first = group * VK_SCAN + gl_LocalInvocationID.x * each;
    uint sum = 0, all;
    for (uint i = first; i < first + each; i++)
        sum += i < count ? a.from.v[i] : 0;
    uint before = group_scan(sum, all);
    if (group * VK_SCAN < count)
        before += a.sums.v[group];
    for (uint i = first; i < first + each && i < count; i++) {
        const uint value = a.from.v[i];
        a.to.v[i] = before;
        before += value;
    }
}
