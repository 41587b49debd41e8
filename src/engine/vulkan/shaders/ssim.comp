/* SPDX-License-Identifier: Apache-2.0 */
/* |d|, d^2 and S of a tile of a channel, summed, and the partial derivatives of S. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sums.glsl"
#include "window.glsl"
ARGUMENTS(ssim);

shared float image[WIDE * WIDE], other[WIDE * WIDE];
shared vec4 along[WIDE][SIDE]; /* the window along the rows, of x, t, xx + tt, xt */

void main()
{
    const place p = place_of(a.width, a.height);
    const uint t = gl_LocalInvocationID.x;
    if (p.channel >= 3)
        return;
    for (uint k = t; k < WIDE * WIDE; k += SIDE * SIDE) {
        const int at = bordered(p, k, a.width, a.height);
        image[k] = at >= 0 ? a.image.v[at] : 0.0;
        other[k] = at >= 0 ? a.target.v[at] : 0.0;
    }
    barrier(); /* both are staged */
    for (uint k = t; k < WIDE * SIDE; k += SIDE * SIDE) {
        const uint row = k / SIDE, column = k % SIDE;
        vec4 sum = vec4(0.0);
        for (uint i = 0; i < SG_SSIM_TAPS; i++) {
            const float x = image[row * WIDE + column + i], y = other[row * WIDE + column + i];
            sum += sg_ssim_window[i] * vec4(x, y, x * x + y * y, x * y);
        }
        along[row][column] = sum;
    }
    barrier(); /* all rows are there */
    const uint x = t % SIDE, y = t / SIDE;
    float l1 = 0.0, l2 = 0.0, s = 0.0;
    if (p.x0 + x < a.width && p.y0 + y < a.height) {
        vec4 m = vec4(0.0);
        for (uint i = 0; i < SG_SSIM_TAPS; i++)
            m += sg_ssim_window[i] * along[y + i][x];
        const ssim here = ssim_point(m.x, m.y, m.z, m.w);
        const uint at = (p.channel * a.height + p.y0 + y) * a.width + p.x0 + x,
                   plane = 3 * a.width * a.height;
        a.maps.v[at] = here.d_m;
        a.maps.v[plane + at] = here.d_xx;
        a.maps.v[2 * plane + at] = here.d_xy;
        const uint centre = (y + SG_SSIM_RADIUS) * WIDE + x + SG_SSIM_RADIUS;
        const float d = image[centre] - other[centre];
        l1 = abs(d), l2 = d * d, s = here.s;
    }
    const float sums[3] = {group_sum(l1), group_sum(l2), group_sum(s)};
    if (t < 3)
        a.sums.v[3 * group_index() + t] = t == 0 ? sums[0] : t == 1 ? sums[1] : sums[2];
}
