/* SPDX-License-Identifier: Apache-2.0 */
/* The differences from the photo under the window, and the sum of their squares by tile. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sums.glsl"
ARGUMENTS(low_pass);
#include "low_pass.glsl"

void main()
{
    const place p = place_of(a.width, a.height);
    const uint t = gl_LocalInvocationID.x, x = p.x0 + t % SIDE, y = p.y0 + t / SIDE;
    if (p.channel >= 3)
        return;
    for (uint k = t; k < WIDE * WIDE; k += SIDE * SIDE) {
        const int at = bordered(p, k, a.width, a.height);
        bool counts;
        staged[k] =
            at >= 0 ? low_pass_difference(uint(at), p.channel, a.width * a.height, counts) : 0.0;
    }
    float passed = windowed(t);
    if (x < a.width && y < a.height)
        a.passed.v[(p.channel * a.height + y) * a.width + x] = passed;
    else
        passed = 0.0;
    const float sum = group_sum(passed * passed);
    if (t == 0)
        a.sums.v[group_index()] = sum;
}
