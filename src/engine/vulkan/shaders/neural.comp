/* SPDX-License-Identifier: Apache-2.0 */
/* What a view makes of the anchors that it sees: see view.c of the engine for anchors. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "neural.glsl"

layout(local_size_x = GROUP) in;
ARGUMENTS(neural);

#define NO_NUMBER uintBitsToFloat(0x7fc00000)

shared float opacity_of[VK_ANCHOR * ROW];

void main()
{
    const uint id = gl_LocalInvocationID.x, lane = LANE;
    const uint first = group_index() * 16;
    if (first >= a.seen_count.v[0])
        return;
    layers(a.seen, first, a.seen_count.v[0], a.params, a.anchors, a.weights, a.view, a.count);
    const uint i = n_anchor[lane];
    for (uint k = FIRST_ROW; k < VK_ANCHOR && i < a.count; k += ROWS) {
        const uint to = i * VK_ANCHOR + k;
        float opacity = 0.0;
        if (VALUE(OUTPUT, k, lane) > 0.0) {
            float planes[SG_NEURAL_PLANES];
            neural_forward(neural_of(a.params, a.anchors, i, k), planes);
            for (uint p = 0; p < SG_NEURAL_PLANES; p++)
                a.to.v[param_at(14, to, p)] = planes[p];
            opacity = 1.0 / (1.0 + exp(-planes[P_OPACITY]));
        } else
            a.to.v[param_at(14, to, P_OPACITY)] = NO_NUMBER;
        opacity_of[k * ROW + lane] = opacity;
    }
    barrier(); /* opacity_of */
    if (id < 16 && i < a.count) {
        uint exists = VK_A_SEEN;
        float sum = 0.0;
        for (uint j = 0; j < VK_ANCHOR; j++) {
            sum += opacity_of[j * ROW + id];
            exists |= VALUE(OUTPUT, j, id) > 0.0 ? 1u << j : 0;
        }
        a.exists.v[i] = exists;
        a.opacities.v[i] = sum;
        if (exists != VK_A_SEEN)
            atomicAdd(a.drawn.v[0], bitCount(exists & ~VK_A_SEEN));
    }
}
