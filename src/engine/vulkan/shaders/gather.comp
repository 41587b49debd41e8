/* SPDX-License-Identifier: Apache-2.0 */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(gather);

void main()
{
    const uint count = a.count.v[0];
    const uint i = thread_index();
    if (i < count)
        a.to.v[i] = a.from.v[a.index.v[i]];
}
