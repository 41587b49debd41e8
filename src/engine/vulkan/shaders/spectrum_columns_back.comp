/* SPDX-License-Identifier: Apache-2.0 */
/* Each coefficient times its factor, and the columns back. The image's last row has the rows beyond
 * it too. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
ARGUMENTS(spectrum_columns_back);
#include "direction.glsl"
#include "fft.glsl"

void main()
{
    line_room(Points(a.room), a.longest);
    for (uint line = group_index(); line < a.planes * a.columns; line += a.groups) {
        const uint plane = line / a.columns, column = line % a.columns;
        const uint first = 2 * (plane * a.points * a.columns + column);
        for (uint u = gl_LocalInvocationID.x; u < a.points; u += VK_LINE_GROUP) {
            const uint at = first + 2 * u * a.columns, bin = direction_at(column, u);
            const vec2 f = vec2(a.spectrum.v[at], a.spectrum.v[at + 1]);
            float factor = bin == SG_OUTSIDE ? 0.0 : a.factors.v[bin];
            if (a.amplitude != 0) {
                const float size = sqrt(f.x * f.x + f.y * f.y);
                factor = size > 1e-15 ? factor / size : 0.0;
            }
            line_put(u, factor * f.yx);
        }
        line_transform();
        for (uint u = gl_LocalInvocationID.x; u < a.height; u += VK_LINE_GROUP) {
            vec2 g = line_get(u);
            for (uint beyond = a.height; u == a.height - 1 && beyond < a.points; beyond++)
                g += line_get(beyond);
            const uint at = first + 2 * u * a.columns;
            a.spectrum.v[at] = g.y;
            a.spectrum.v[at + 1] = g.x;
        }
    }
}
