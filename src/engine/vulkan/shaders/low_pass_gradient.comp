/* SPDX-License-Identifier: Apache-2.0 */
/* Adds the gradient of the low-pass term to the image's: what low_pass left, under the window. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
ARGUMENTS(low_pass_gradient);
#include "low_pass.glsl"

void main()
{
    const place p = place_of(a.width, a.height);
    const uint t = gl_LocalInvocationID.x, x = p.x0 + t % SIDE, y = p.y0 + t / SIDE;
    if (p.channel >= 3)
        return;
    for (uint k = t; k < WIDE * WIDE; k += SIDE * SIDE) {
        const int at = bordered(p, k, a.width, a.height);
        staged[k] = at >= 0 ? a.passed.v[at] : 0.0;
    }
    const float twice = windowed(t);
    if (x >= a.width || y >= a.height)
        return;
    const uint at = (p.channel * a.height + y) * a.width + x;
    bool counts;
    low_pass_difference(at, p.channel, a.width * a.height, counts);
    if (counts)
        a.gradient.v[at] += a.scale * twice;
}
