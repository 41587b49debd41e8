/* SPDX-License-Identifier: Apache-2.0 */
/* The transforms of the columns of half spectra, beyond the image its last row again, and the
 * energy of each by direction. A column has the energy of its conjugates too, in the opposite
 * direction; column 0 has them itself. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
ARGUMENTS(spectrum_columns);
#include "direction.glsl"
#include "fft.glsl"

void main()
{
    line_room(Points(a.room), a.longest);
    for (uint line = group_index(); line < a.planes * a.columns; line += a.groups) {
        const uint plane = line / a.columns, column = line % a.columns;
        const uint first = 2 * (plane * a.points * a.columns + column);
        for (uint u = gl_LocalInvocationID.x; u < a.points; u += VK_LINE_GROUP) {
            const uint at = first + 2 * min(u, a.height - 1) * a.columns;
            line_put(u, vec2(a.spectrum.v[at], a.spectrum.v[at + 1]));
        }
        line_transform();
        for (uint u = gl_LocalInvocationID.x; u < a.points; u += VK_LINE_GROUP) {
            const vec2 f = line_get(u);
            const uint at = first + 2 * u * a.columns;
            a.spectrum.v[at] = f.x;
            a.spectrum.v[at + 1] = f.y;
        }
        for (uint b = gl_LocalInvocationID.x; b < a.bins; b += VK_LINE_GROUP) {
            const uint opposite = column > 0 ? (b + a.bins / 2) % a.bins : b;
            float sum = 0.0;
            for (uint u = 0; u < a.points; u++) {
                const uint bin = direction_at(column, u);
                if (bin != b && bin != opposite)
                    continue;
                const vec2 f = line_get(u);
                const float power = f.x * f.x + f.y * f.y;
                sum += a.amplitude != 0 ? sqrt(power) : power;
            }
            a.energy.v[line * a.bins + b] = sum;
        }
    }
}
