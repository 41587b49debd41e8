/* SPDX-License-Identifier: Apache-2.0 */
/* The drawn Gaussians and their depths, in index order. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(compact);

void main()
{
    const uint i = thread_index();
    if (i >= a.count || a.flags.v[i] == 0)
        return;
    a.to_keys.v[a.places.v[i]] = a.keys.v[i];
    a.to_values.v[a.places.v[i]] = i;
}
