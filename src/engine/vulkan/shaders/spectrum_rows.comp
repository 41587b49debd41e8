/* SPDX-License-Identifier: Apache-2.0 */
/* The half spectra of the rows of an image, two rows as one complex line. Beyond the image its last
 * column repeats. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
ARGUMENTS(spectrum_rows);
#include "fft.glsl"
#include "luma.glsl"

float image_at(uint plane, uint y, uint x)
{
    const uint pixels = a.width * a.height, at = y * a.width + min(x, a.width - 1);
    if (a.planes == 3)
        return a.image.v[plane * pixels + at];
    return luma[0] * a.image.v[at] + luma[1] * a.image.v[pixels + at] +
           luma[2] * a.image.v[2 * pixels + at];
}

void main()
{
    const uint pairs = (a.height + 1) / 2;
    line_room(Points(a.room), a.longest);
    for (uint line = group_index(); line < a.planes * pairs; line += a.groups) {
        const uint plane = line / pairs, y = line % pairs * 2;
        const bool two = y + 1 < a.height;
        for (uint x = gl_LocalInvocationID.x; x < a.points; x += VK_LINE_GROUP)
            line_put(x, vec2(image_at(plane, y, x), two ? image_at(plane, y + 1, x) : 0.0));
        line_transform();
        for (uint v = gl_LocalInvocationID.x; v < a.columns; v += VK_LINE_GROUP) {
            const vec2 z = line_get(v), t = line_get((a.points - v) % a.points);
            const uint at = 2 * ((plane * a.rows + y) * a.columns + v);
            a.spectrum.v[at] = 0.5 * (z.x + t.x);
            a.spectrum.v[at + 1] = 0.5 * (z.y - t.y);
            if (two) {
                a.spectrum.v[at + 2 * a.columns] = 0.5 * (z.y + t.y);
                a.spectrum.v[at + 2 * a.columns + 1] = 0.5 * (t.x - z.x);
            }
        }
    }
}
