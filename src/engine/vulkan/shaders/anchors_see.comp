/* SPDX-License-Identifier: Apache-2.0 */
/* Which anchors a view sees: an anchor is seen if it would be drawn as a Gaussian with its offsets'
 * unit as scales. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/tile_rect.h"
#include "view.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(anchors_see);

#define NO_NUMBER uintBitsToFloat(0x7fc00000)

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    float position[3], scales[3];
    for (uint k = 0; k < 3; k++) {
        position[k] = a.params.v[param_at(14, i, k)];
        scales[k] = a.params.v[param_at(14, i, P_SCALE + k)];
    }
    const pinhole v = view_load(a.view);
    splat s;
    projection p;
    project(v, position, scales, float[](1.0, 0.0, 0.0, 0.0), s, p);
    const tile_rect t = tile_rect_make(s.x, s.y, s.sigma, int(a.grid_x), int(a.grid_y));
    const bool seen = s.visible && t.radius > 0 && t.x0 < t.x1 && t.y0 < t.y1;
    a.places.v[i] = seen ? 1 : 0;
    a.exists.v[i] = seen ? VK_A_SEEN : 0;
    a.opacities.v[i] = 0.0;
    for (uint k = 0; k < VK_ANCHOR && !seen; k++)
        a.to.v[param_at(14, i * VK_ANCHOR + k, P_OPACITY)] = NO_NUMBER;
}
