/* SPDX-License-Identifier: Apache-2.0 */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(planes);

void main()
{
    const uint i = thread_index();
    for (uint plane = 0; i < a.count && plane < a.width; plane++)
        a.to.v[param_at(a.width, i, plane)] = a.from.v[param_at(a.planes, i, plane)];
}
