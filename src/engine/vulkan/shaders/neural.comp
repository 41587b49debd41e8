/* SPDX-License-Identifier: Apache-2.0 */
/* What a view makes of a block of anchors: see view.c of the engine for anchors. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/tile_rect.h"
#include "neural.glsl"
#include "view.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(neural);

#define NO_NUMBER uintBitsToFloat(0x7fc00000)

shared float opacity_of[VK_ANCHOR * ROW];

/* An anchor is seen if it would be drawn as a Gaussian with its offsets' unit as scales. */
bool is_seen(uint i)
{
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
    return s.visible && t.radius > 0 && t.x0 < t.x1 && t.y0 < t.y1;
}

void main()
{
    const uint id = gl_LocalInvocationID.x, lane = LANE, k = FIRST_ROW;
    const uint i0 = group_index() * 16, i = i0 + lane;
    if (i0 >= a.count)
        return;
    if (id < 16)
        n_exists[id] = i < a.count && is_seen(i) ? VK_A_SEEN : 0;
    barrier(); /* n_exists */
    uint any = 0;
    for (uint l = 0; l < 16; l++)
        any |= n_exists[l];
    if (any != 0) /* the same for all */
        layers(a.params, a.anchors, a.weights, a.view, i0, a.parts);
    if (k < VK_ANCHOR && i < a.count) {
        const uint to = i * VK_ANCHOR + k;
        float opacity = 0.0;
        const bool exists = n_exists[lane] != 0 && n_output[k * ROW + lane] > 0.0;
        if (exists) {
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
        uint exists = n_exists[id];
        float sum = 0.0;
        for (uint j = 0; j < VK_ANCHOR && exists != 0; j++) {
            sum += opacity_of[j * ROW + id];
            exists |= n_output[j * ROW + id] > 0.0 ? 1u << j : 0;
        }
        a.exists.v[i] = exists;
        a.opacities.v[i] = sum;
        if ((exists & ~VK_A_SEEN) != 0)
            atomicAdd(a.drawn.v[0], bitCount(exists & ~VK_A_SEEN));
    }
}
