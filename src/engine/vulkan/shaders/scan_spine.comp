/* SPDX-License-Identifier: Apache-2.0 */
/* Exclusive sums of the workgroups' sums, in one workgroup, and the sum of all. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "scan.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(scan_spine);

void main()
{
    const uint count = a.count.v[0];
    const uint groups = (count + VK_SCAN - 1) / VK_SCAN;
    uint before = 0;
    for (uint first = 0; first < groups; first += VK_GROUP) {
        const uint i = first + gl_LocalInvocationID.x;
        uint all;
        const uint sum = group_scan(i < groups ? a.sums.v[i] : 0, all);
        if (i < groups)
            a.sums.v[i] = before + sum;
        before += all;
    }
    if (gl_LocalInvocationID.x == 0)
        a.to.v[count] = before;
}
