/* SPDX-License-Identifier: Apache-2.0 */
/* What the render is compared with: the photo or given planes; the render itself where it is
 * masked out, and the nearest value within the tolerance. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/photometric.h"
#include "photo.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(target);

void main()
{
    const uint i = thread_index();
    if (i >= a.pixels)
        return;
    const uint photo = a.photo.v[i];
    for (uint ch = 0; ch < 3; ch++) {
        const uint at = ch * a.pixels + i;
        const float x = a.image.v[at];
        float t = a.planes != 0 ? a.given.v[at] : photo_value(photo, ch);
        if (a.masked != 0 && !photo_counts(photo))
            t = x;
        if (a.tolerance > 0.0)
            t = photometric_target(x, t, a.tolerance);
        a.target.v[at] = t;
    }
}
