/* SPDX-License-Identifier: Apache-2.0 */
/* The anchors that a view sees, in index order. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(anchors_list);

void main()
{
    const uint i = thread_index();
    if (i < a.count && a.exists.v[i] != 0)
        a.seen.v[a.places.v[i]] = i;
}
