/* SPDX-License-Identifier: Apache-2.0 */
/* Total variation: its value summed over groups of 256 values, without the weight, and its gradient
 * added to the image's. Beyond the border the border's value repeats, which adds no gradient. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "photo.glsl"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(total_variation);

/* enum sg_tv_penalty */
#define NORM_L2 0
#define NORM_L1 1

float norm_of(float d)
{
    const float size = abs(d);
    if (a.norm == NORM_L1)
        return size;
    return a.norm == NORM_L2 || size < a.edge ? d * d : a.edge * (2.0 * size - a.edge);
}

float slope_of(float d)
{
    if (a.norm == NORM_L1)
        return d > 0.0 ? 1.0 : d < 0.0 ? -1.0 : 0.0;
    return a.norm == NORM_L2 || abs(d) < a.edge ? 2.0 * d : d > 0.0 ? 2.0 * a.edge : -2.0 * a.edge;
}

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
        value = a.down * norm_of(below) + a.across * norm_of(after);
        const float g = a.gradient.v[i] +
                        a.weight * (a.down * (slope_of(above) - slope_of(below)) +
                                    a.across * (slope_of(before) - slope_of(after)));
        a.gradient.v[i] = a.masked != 0 && !photo_counts(a.photo.v[at]) ? 0.0 : g;
    }
    const float sum = group_sum(value);
    if (gl_LocalInvocationID.x == 0 && i < 3 * pixels)
        a.sums.v[group_index()] = sum;
}
