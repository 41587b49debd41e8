/* SPDX-License-Identifier: Apache-2.0 */
/* How many Gaussians touch each tile of the image. totals: zeros before. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "splat.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(tile_totals);

void main()
{
    const uint i = thread_index();
    if (i < a.count)
        EACH_TILE(i, 0, a.tiles, atomicAdd(a.totals.v[tile], 1));
}
