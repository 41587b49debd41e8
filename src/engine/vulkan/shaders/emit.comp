/* SPDX-License-Identifier: Apache-2.0 */
/* The instances of each Gaussian, in the order of depth. One that was counted and is not met
 * again, which no driver should do, gets a tile past the last and is never drawn. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "splat.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(emit);

void main()
{
    const uint count = a.count.v[0];
    const uint k = thread_index();
    if (k >= count)
        return;
    const uint i = a.order.v[k], first = a.places.v[k], end = a.places.v[k + 1];
    uint at = first;
    EACH_TILE(i, a.first, a.end, if (at < end) a.keys.v[at++] = tile - a.first);
    for (; at < end; at++)
        a.keys.v[at] = a.end - a.first;
    for (uint e = first; e < end; e++) {
        a.values.v[e] = e;
        a.emitted.v[2 * e] = i;
        a.emitted.v[2 * e + 1] = a.slot_start.v[i] + e - first;
    }
}
