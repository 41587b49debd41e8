/* SPDX-License-Identifier: Apache-2.0 */
/* The largest radii on the screen, as sg_host_count_radii. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/tile_rect.h"
#include "view.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(radii);

void main()
{
    const uint i = thread_index();
    if (i >= a.count || a.stop.v[0] != 0)
        return;
    float xyz[3], scales[3], rot[4];
    for (uint k = 0; k < 3; k++) {
        xyz[k] = a.params.v[param_at(a.planes, i, k)];
        scales[k] = a.params.v[param_at(a.planes, i, P_SCALE + k)];
    }
    for (uint k = 0; k < 4; k++)
        rot[k] = a.params.v[param_at(a.planes, i, P_ROT + k)];
    splat s;
    projection p;
    project(view_load(a.view), xyz, scales, rot, s, p);
    const tile_rect t = tile_rect_make(s.x, s.y, s.sigma, int(a.grid_x), int(a.grid_y));
    if (s.visible && t.x0 < t.x1 && t.y0 < t.y1)
        a.radii.v[i] = r_max(a.radii.v[i], float(t.radius));
}
