/* SPDX-License-Identifier: Apache-2.0 */
/* How many tiles of the band each Gaussian touches. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "splat.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(count);

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    uint n = 0;
    EACH_TILE(i, a.first, a.end, n++);
    a.counts.v[i] = n;
    if (n > 0)
        ADD_WIDE(a.results, VK_RESULT_INSTANCES, n);
}
