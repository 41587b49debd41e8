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

void output_layer()
{
    Fours w4 = Fours(a.weights);
    const uint four = gl_LocalInvocationID.x / (16 / EACH);
    const uint first = gl_LocalInvocationID.x % (16 / EACH) * EACH;
    if (four >= OUTPUT_FOURS)
        return;
    const output_rows rows = output_four(four);
    vec4 bias, sum[EACH];
    [[unroll]] for (uint j = 0; j < 4; j++) bias[j] =
        a.weights.v[VK_W_BIAS + min(rows.first + j, rows.last)];
    [[unroll]] for (uint l = 0; l < EACH; l++) sum[l] = bias;
    for (uint h = 0; h < VK_N_HIDDEN; h += 4) {
        vec4 weight[4];
        output_weights(w4, rows, h, weight);
        [[unroll]] for (uint l = 0; l < EACH; l++)
        {
            const vec4 x = FOUR(HIDDEN, (rows.network * VK_N_HIDDEN + h) / 4, first + l);
            [[unroll]] for (uint j = 0; j < 4; j++) [[unroll]] for (uint c = 0; c < 4; c++)
                sum[l][j] += weight[j][c] * x[c];
        }
    }
    [[unroll]] for (uint l = 0; l < EACH; l++) FOUR(OUTPUT, four, first + l) = sum[l];
}

void main()
{
    const uint id = gl_LocalInvocationID.x, lane = LANE;
    const uint first = group_index() * 16;
    if (first >= a.seen_count.v[0])
        return;
    hidden_layers(a.seen, first, a.seen_count.v[0], a.params, a.anchors, a.weights, a.view,
                  a.count);
    barrier(); /* HIDDEN, and n_anchor */
    output_layer();
    barrier(); /* OUTPUT */
    const uint i = n_anchor[lane];
    for (uint k = FIRST_ROW; k < VK_ANCHOR && i < a.count; k += ROWS) {
        const uint to = i * VK_ANCHOR + k;
        float opacity = 0.0;
        if (!neural_shown(anchor_value(a.anchors, i, 3 * k)))
            VALUE(OUTPUT, k, lane) = 0.0;
        if (VALUE(OUTPUT, k, lane) > 0.0) {
            float planes[SG_NEURAL_PLANES];
            neural n = neural_of(a.params, a.anchors, i, k);
            n.y = VALUE(OUTPUT, k, lane);
            for (uint j = 0; j < 7; j++)
                n.cov[j] = VALUE(OUTPUT, COVARIANCE_ROW + 7 * k + j, lane);
            for (uint j = 0; j < 3; j++)
                n.colour[j] = VALUE(OUTPUT, COLOUR_ROW + 3 * k + j, lane);
            neural_forward(n, planes);
            for (uint p = 0; p < SG_NEURAL_PLANES; p++)
                a.to.v[param_at(14, to, p)] = planes[p];
            opacity = 1.0 / (1.0 + exp(-planes[P_OPACITY]));
        } else
            a.to.v[param_at(14, to, P_OPACITY)] = NO_NUMBER;
        opacity_of[k * ROW + lane] = opacity;
    }
    barrier(); /* opacity_of, and OUTPUT again */
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
