/* SPDX-License-Identifier: Apache-2.0 */
/* The rows back, two at a time, which are added to the image's gradient. The last column has those
 * beyond it too. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
ARGUMENTS(spectrum_rows_back);
#include "fft.glsl"
#include "luma.glsl"
#include "photo.glsl"

/* Coefficient k of a row; the column 0 of a real row is real. */
vec2 coefficient(uint plane, uint y, uint k)
{
    if (y >= a.height)
        return vec2(0.0);
    const uint at = 2 * ((plane * a.rows + y) * a.columns + k);
    return vec2(a.spectrum.v[at], k > 0 ? a.spectrum.v[at + 1] : 0.0);
}

void add(uint plane, uint y, uint x, float g)
{
    if (y >= a.height)
        return;
    const uint pixels = a.width * a.height, at = y * a.width + x;
    const bool counts = a.masked == 0 || photo_counts(a.photo.v[at]);
    for (uint ch = a.planes == 3 ? plane : 0; ch < (a.planes == 3 ? plane + 1 : 3); ch++) {
        const float share = a.planes == 3 ? 1.0 : luma[ch];
        const uint to = ch * pixels + at;
        a.gradient.v[to] = counts ? a.gradient.v[to] + share * g : 0.0;
    }
}

void main()
{
    const uint pairs = (a.height + 1) / 2;
    line_room(Points(a.room), a.longest);
    for (uint line = group_index(); line < a.planes * pairs; line += a.groups) {
        const uint plane = line / pairs, y = line % pairs * 2;
        for (uint k = gl_LocalInvocationID.x; k < a.points; k += VK_LINE_GROUP) {
            const bool conjugate = k >= a.columns;
            const uint own = conjugate ? a.points - k : k;
            vec2 z = vec2(0.0);
            if (own < a.columns) {
                const vec2 one = coefficient(plane, y, own), two = coefficient(plane, y + 1, own);
                z = conjugate ? vec2(one.x + two.y, two.x - one.y)
                              : vec2(one.x - two.y, one.y + two.x);
            }
            line_put(k, z.yx);
        }
        line_transform();
        for (uint x = gl_LocalInvocationID.x; x < a.width; x += VK_LINE_GROUP) {
            vec2 g = line_get(x);
            for (uint beyond = a.width; x == a.width - 1 && beyond < a.points; beyond++)
                g += line_get(beyond);
            add(plane, y, x, g.y);
            add(plane, y + 1, x, g.x);
        }
    }
}
