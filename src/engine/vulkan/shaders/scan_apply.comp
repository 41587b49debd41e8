/* SPDX-License-Identifier: Apache-2.0 */
/* Exclusive sums within VK_SCAN numbers, on top of those before them. Each workgroup adds up the
 * sums of the earlier ones itself, which is one kernel less to wait for. Even with the most
 * instances that a list may have they take a fraction of the time of the sort. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "scan.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(scan_apply);

void main()
{
    const uint count = a.count.v[0];
    const uint group = group_index(), each = VK_SCAN / VK_GROUP, t = gl_LocalInvocationID.x;
    const uint first = group * VK_SCAN + t * each;
    const uint last = count > 0 ? (count - 1) / VK_SCAN : 0; /* the workgroup with the sum of all */
    uint earlier = 0, before, all;
    if (group > last)
        return;
    for (uint i = t; i < group; i += VK_GROUP)
        earlier += a.sums.v[i];
    group_scan(earlier, before);
    uint sum = 0;
    for (uint i = first; i < first + each; i++)
        sum += i < count ? a.from.v[i] : 0;
    uint at = before + group_scan(sum, all);
    for (uint i = first; i < first + each && i < count; i++) {
        const uint value = a.from.v[i];
        a.to.v[i] = at;
        at += value;
    }
    if (group == last && t == 0)
        a.to.v[count] = before + all;
}
