/* SPDX-License-Identifier: Apache-2.0 */
/* Instances in their final order, and where each tile's begin. One invocation more than there are
 * instances. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(tile_start);

void main()
{
    const uint count = a.count.v[0];
    const uint j = thread_index();
    if (j > count)
        return;
    const uint first = j > 0 ? a.keys.v[j - 1] + 1 : 0;
    const uint last = j < count ? min(a.keys.v[j], a.tiles) : a.tiles;
    for (uint tile = first; tile <= last; tile++)
        a.tile_start.v[tile] = j;
    if (j < count) {
        const uint e = a.values.v[j];
        a.instances.v[2 * j] = a.emitted.v[2 * e];
        a.instances.v[2 * j + 1] = a.emitted.v[2 * e + 1];
    }
}
