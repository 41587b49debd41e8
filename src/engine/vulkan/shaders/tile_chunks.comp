/* SPDX-License-Identifier: Apache-2.0 */
/* Chunks of each tile's list, and the longest list. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(tile_chunks);

void main()
{
    const uint tile = thread_index();
    if (tile >= a.tiles)
        return;
    const uint n = a.tile_start.v[tile + 1] - a.tile_start.v[tile];
    a.chunks.v[tile] = (n + VK_CHUNK - 1) / VK_CHUNK;
    atomicMax(a.results.v[VK_RESULT_LONGEST], n);
}
