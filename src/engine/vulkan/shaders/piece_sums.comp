/* SPDX-License-Identifier: Apache-2.0 */
/* Sums of few pieces of many values. Four sums, so that four values are on their way at once. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(piece_sums);

void main()
{
    const uint j = thread_index();
    float sum[4] = float[](0.0, 0.0, 0.0, 0.0);
    if (j >= a.width)
        return;
    for (uint i = 0; i < a.count; i += 4)
        [[unroll]] for (uint k = 0; k < 4; k++)
            sum[k] += i + k < a.count ? a.from.v[(i + k) * a.width + j] : 0.0;
    a.to.v[j] = (sum[0] + sum[1]) + (sum[2] + sum[3]);
}
