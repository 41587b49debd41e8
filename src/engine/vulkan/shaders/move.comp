/* SPDX-License-Identifier: Apache-2.0 */
/* Floor of the scales, reset of the opacities. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/mip.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(move);

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    if (a.what == 0) {
        for (uint k = 0; k < 3; k++) {
            const uint at = param_at(a.planes, i, P_SCALE + k);
            a.params.v[at] = r_max(a.params.v[at], a.limit);
        }
        return;
    }
    const uint at = param_at(a.planes, i, P_OPACITY);
    if (a.what == 2)
        a.params.v[at] = mip_limited(a.params.v[at], a.shaped.v[at], a.limit);
    else
        a.params.v[at] = r_min(a.params.v[at], a.limit);
    if (a.moments != 0)
        a.m.v[at] = a.v.v[at] = 0.0;
}
