/* SPDX-License-Identifier: Apache-2.0 */
/* dL/dimage from the derivatives of S under the window. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "photo.glsl"
#define WINDOWED vec3
#include "windowed.glsl"
ARGUMENTS(ssim_gradient);

void main()
{
    const place p = place_of(a.width, a.height);
    const uint t = gl_LocalInvocationID.x, plane = a.width * a.height;
    if (p.channel >= 3)
        return;
    for (uint k = t; k < WIDE * WIDE; k += SIDE * SIDE) {
        const int at = bordered(p, k, a.width, a.height);
        staged[k] = at >= 0 ? vec3(a.maps.v[at], a.maps.v[3 * plane + at], a.maps.v[6 * plane + at])
                            : vec3(0.0);
    }
    const vec3 m = windowed(t);
    const uint column = t % SIDE, row = t / SIDE, x = p.x0 + column, y = p.y0 + row;
    if (x >= a.width || y >= a.height)
        return;
    const uint at = y * a.width + x;
    const float image = a.image.v[p.channel * plane + at],
                other = a.target.v[p.channel * plane + at];
    float g = photometric_gradient(image, other, m.x, m.y, m.z, a.l1, a.dssim, a.tolerant != 0);
    if (a.masked != 0 && !photo_counts(a.photo.v[at]))
        g = 0.0;
    a.gradient.v[p.channel * plane + at] = g;
}
