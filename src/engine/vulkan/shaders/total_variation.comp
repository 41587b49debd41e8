/* SPDX-License-Identifier: Apache-2.0 */
/* Total variation: its value summed over groups of 256 values, without the weight, and its gradient
 * added to the image's. Beyond the border the border's value repeats, which adds no gradient. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "photo.glsl"
#include "math/total_variation.h"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(total_variation);

void main()
{
    const uint i = thread_index(), pixels = a.width * a.height;
    float value = 0.0;
    if (i < 3 * pixels) {
        const uint at = i % pixels, x = at % a.width, y = at / a.width;
        const float here = a.image.v[i];
        const float above = here - a.image.v[y > 0 ? i - a.width : i];
        const float below = a.image.v[y + 1 < a.height ? i + a.width : i] - here;
        const float before = here - a.image.v[x > 0 ? i - 1 : i];
        const float after = a.image.v[x + 1 < a.width ? i + 1 : i] - here;
        value = a.down * tv_norm(below, int(a.norm), a.edge) +
                a.across * tv_norm(after, int(a.norm), a.edge);
        const float g =
            a.gradient.v[i] + a.weight * tv_gradient(above, below, before, after, int(a.norm),
                                                     a.edge, a.down, a.across);
        a.gradient.v[i] = a.masked != 0 && !photo_counts(a.photo.v[at]) ? 0.0 : g;
    }
    const float sum = group_sum(value);
    if (gl_LocalInvocationID.x == 0 && i < 3 * pixels)
        a.sums.v[group_index()] = sum;
}
