/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians that become copies of others in place, as sg_host_relocate. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(relocate);

void main()
{
    const uint entry = a.first + thread_index();
    if (entry >= a.end)
        return;
    const uint at = entry * VK_ENTRY;
    const uint to = a.entries.v[at], from = a.entries.v[at + 1];
    const float opacity = uintBitsToFloat(a.entries.v[at + 2]);
    const float scale = uintBitsToFloat(a.entries.v[at + 3]);
    const bool fresh = a.moments != 0 && a.entries.v[at + 4] != 0;
    for (uint plane = 0; plane < a.planes; plane++) {
        const uint place = param_at(a.planes, to, plane);
        float value = a.params.v[param_at(a.planes, from, plane)];
        if (plane == P_OPACITY)
            value = opacity;
        else if (plane >= P_SCALE && plane < P_ROT)
            value += scale;
        a.params.v[place] = value;
        if (fresh)
            a.m.v[place] = a.v.v[place] = 0.0;
    }
}
