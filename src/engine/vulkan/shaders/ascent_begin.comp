/* SPDX-License-Identifier: Apache-2.0 */
/* What the steps of an ascent begin with. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "photo.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(ascent_begin);

void main()
{
    const uint i = thread_index();
    if (i >= a.pixels)
        return;
    const uint photo = a.photo.v[i];
    for (uint ch = 0; ch < 3; ch++) {
        const uint at = ch * a.pixels + i;
        const float x = a.image.v[at];
        a.values.v[at] = photo_value(photo, ch);
        a.to.v[at] = a.clamped != 0 ? r_min(r_max(x, 0.0), 1.0) : x;
    }
}
