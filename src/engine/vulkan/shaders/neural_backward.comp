/* SPDX-License-Identifier: Apache-2.0 */
/* Gradients of a view's Gaussians to those of their anchors and of the weights. A workgroup takes
 * 16 of the seen anchors at a time, every a.pieces-th of such blocks. Sums of the weights'
 * gradients over its blocks stay in its registers: the block is small, and so each sum has a fixed
 * order. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "neural.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(neural_backward);

/* Gradients: of n_output, which they replace, of hidden values, of inputs that are a mixture, and
 * of the shares. */
shared float d_hidden[VK_N_ALL * ROW];
shared float d_mixture[VK_A_FEATURES * ROW];
shared float d_share[3 * ROW];

void put(uint i, uint plane, float value)
{
    a.gradient.v[param_at(VK_A_VALUES, i, plane)] = value;
}

/* Of the outputs, and of the anchors' own values. */
void pull_outputs()
{
    const uint lane = LANE, k = FIRST_ROW, i = n_anchor[lane];
    if (k < VK_ANCHOR) {
        const bool exists = i < a.count && (a.exists.v[i] >> k & 1) != 0;
        neural d;
        d.y = 0.0;
        for (uint j = 0; j < 7; j++)
            d.cov[j] = 0.0;
        for (uint j = 0; j < 3; j++)
            d.colour[j] = d.offset[j] = d.reach[j] = d.size[j] = 0.0;
        if (exists) {
            float planes[SG_NEURAL_PLANES], g[SG_NEURAL_PLANES];
            const neural n = neural_of(a.params, a.anchors, i, k);
            neural_forward(n, planes);
            for (uint p = 0; p < SG_NEURAL_PLANES; p++)
                g[p] = a.from.v[param_at(14, i * VK_ANCHOR + k, p)];
            neural_backward(n, planes, g, a.volume / float(a.drawn.v[0]), d);
        }
        n_output[k * ROW + lane] = d.y;
        for (uint j = 0; j < 7; j++)
            n_output[(VK_N_COVARIANCE + 7 * k + j) * ROW + lane] = d.cov[j];
        for (uint j = 0; j < 3; j++) {
            n_output[(VK_N_COLOUR + 3 * k + j) * ROW + lane] = d.colour[j];
            if (i < a.count)
                put(i, 3 + 3 * k + j, d.offset[j]);
            /* until d_hidden is known */
            d_hidden[(j * VK_ANCHOR + k) * ROW + lane] = d.reach[j];
            d_hidden[((3 + j) * VK_ANCHOR + k) * ROW + lane] = d.size[j];
        }
    }
    barrier(); /* what all have written */
    if (FIRST_ROW < 6 && i < a.count) {
        const uint j = FIRST_ROW;
        float sum = 0.0;
        for (uint g = 0; g < VK_ANCHOR; g++)
            sum += d_hidden[(j * VK_ANCHOR + g) * ROW + lane];
        put(i, j < 3 ? j : 3 + VK_A_SIZE + j - 3, sum);
    }
    barrier(); /* before d_hidden is written again */
}

/* Before the ReLU. An invocation has four hidden values of a network, and two anchors. */
void pull_hidden()
{
    Fours w4 = Fours(a.weights);
    const uint id = gl_LocalInvocationID.x, column = id % 8 * 4, lane = id / 8 % 8, n = id / 64;
    if (n < VK_N_ALL / VK_N_HIDDEN) {
        const uint first = n == 0 ? 0 : n == 1 ? VK_N_COVARIANCE : VK_N_COLOUR;
        const uint end = n == 0 ? VK_N_COVARIANCE : n == 1 ? VK_N_COLOUR : VK_N_OUTPUTS;
        vec4 sum[2] = vec4[](vec4(0.0), vec4(0.0));
        for (uint o = first; o < end; o++) {
            const vec4 weight = w4.v[(VK_W_OUTPUT + o * VK_N_HIDDEN + column) / 4];
            sum[0] += weight * n_output[o * ROW + lane];
            sum[1] += weight * n_output[o * ROW + lane + 8];
        }
        [[unroll]] for (uint j = 0; j < 8; j++)
        {
            const uint at = (n * VK_N_HIDDEN + column + j % 4) * ROW + lane + j / 4 * 8;
            d_hidden[at] = n_hidden[at] > 0.0 ? sum[j / 4][j % 4] : 0.0;
        }
    }
    barrier(); /* d_hidden */
}

/* Of features, or of the mixtures in their place. An invocation has four of them, and two anchors. */
void pull_features()
{
    Fours w4 = Fours(a.weights);
    const uint lane = gl_LocalInvocationID.x % 8, first = gl_LocalInvocationID.x / 8 * 4;
    if (first >= VK_A_FEATURES)
        return;
    float sum[8];
    [[unroll]] for (uint j = 0; j < 8; j++) sum[j] = 0.0;
    for (uint h = 0; h < VK_N_ALL; h += 4) {
        vec4 d[2];
        [[unroll]] for (uint c = 0; c < 4; c++)
        {
            d[0][c] = d_hidden[(h + c) * ROW + lane];
            d[1][c] = d_hidden[(h + c) * ROW + lane + 8];
        }
        [[unroll]] for (uint j = 0; j < 4; j++)
        {
            const vec4 weight = w4.v[((first + j) * VK_N_ALL + h) / 4];
            [[unroll]] for (uint l = 0; l < 2; l++)
                [[unroll]] for (uint c = 0; c < 4; c++) sum[4 * l + j] += weight[c] * d[l][c];
        }
    }
    [[unroll]] for (uint l = 0; l < 2; l++)
    {
        const uint i = n_anchor[lane + 8 * l];
        [[unroll]] for (uint j = 0; j < 4; j++) if ((a.parts & VK_N_PART_BANK) != 0)
            d_mixture[(first + j) * ROW + lane + 8 * l] = sum[4 * l + j];
        else if (i < a.count) put(i, 3 + VK_A_FEATURE + first + j, sum[4 * l + j]);
    }
}

/* From the gradients of the mixtures to those of the features, of the arguments of the shares
 * (d_share), and of the bank's hidden values, which replace the mixtures' in d_mixture. */
void pull_mixtures()
{
    const uint lane = LANE, j = FIRST_ROW, i = n_anchor[lane];
    barrier(); /* d_mixture */
    if (i < a.count)
        for (uint f = FIRST_ROW; f < VK_A_FEATURES; f += 16) {
            float sum = n_share[2 * ROW + lane] * d_mixture[f * ROW + lane];
            if (f % 2 == 0)
                for (uint m = f / 2; m < VK_A_FEATURES; m += 16)
                    sum += n_share[ROW + lane] * d_mixture[m * ROW + lane];
            if (f % 4 == 0)
                for (uint m = f / 4; m < VK_A_FEATURES; m += 8)
                    sum += n_share[lane] * d_mixture[m * ROW + lane];
            put(i, 3 + VK_A_FEATURE + f, sum);
        }
    float sum = 0.0;
    if (j < 3) {
        if (i < a.count)
            for (uint f = 0; f < VK_A_FEATURES; f++)
                sum += d_mixture[f * ROW + lane] *
                       anchor_value(a.anchors, i, VK_A_FEATURE + bank_source(j, f));
        d_share[j * ROW + lane] = sum;
    }
    barrier(); /* d_share, and nobody reads d_mixture any more */
    float mean = 0.0;
    if (j < 3)
        for (uint m = 0; m < 3; m++)
            mean += n_share[m * ROW + lane] * d_share[m * ROW + lane];
    barrier(); /* all have read d_share */
    if (j < 3)
        d_share[j * ROW + lane] = n_share[j * ROW + lane] * (sum - mean);
    barrier(); /* d_share, now of the arguments of the shares */
    for (uint h = FIRST_ROW; h < VK_N_HIDDEN; h += 16) {
        float d = 0.0;
        for (uint m = 0; m < 3; m++)
            d += a.weights.v[VK_W_BANK_OUTPUT + m * VK_N_HIDDEN + h] * d_share[m * ROW + lane];
        d_mixture[h * ROW + lane] = n_bank_hidden[h * ROW + lane] > 0.0 ? d : 0.0;
    }
    barrier(); /* d_mixture, now of the bank's hidden values */
}

void main()
{
    const uint id = gl_LocalInvocationID.x, piece = group_index();
    if (piece >= a.pieces)
        return;
    const uint column = id % VK_N_HIDDEN, row = id / VK_N_HIDDEN; /* of the bank's sums */
    /* Of either layer an invocation has sums of four rows and four columns. */
    const uint output_column = id % 8 * 4;
    const bool has_output = id / 8 < OUTPUT_FOURS;
    const output_rows outputs = output_four(id / 8);
    const uint input_row = id / (VK_N_ALL / 4) * 4, input_column = id % (VK_N_ALL / 4) * 4;
    const bool has_input = input_row <= VK_N_INPUTS;
    const uint seen_count = a.seen_count.v[0];
    vec4 output_sum[4], input_sum[4];
    float bias = 0.0, distance = 0.0, bank_input = 0.0, bank_output = 0.0;
    [[unroll]] for (uint j = 0; j < 4; j++) output_sum[j] = input_sum[j] = vec4(0.0);
    for (uint first = piece * 16; first < seen_count; first += a.pieces * 16) {
        barrier(); /* the last block's sums are taken */
        anchors_begin(a.seen, first, seen_count, a.count);
        layers(a.params, a.anchors, a.weights, a.view, a.count, a.parts);
        pull_outputs();
        pull_hidden();
        pull_features();
        if ((a.parts & VK_N_PART_BANK) != 0)
            pull_mixtures();
        for (uint l = 0; l < 16; l++) {
            if (has_output) {
                vec4 hidden;
                [[unroll]] for (uint c = 0; c < 4; c++) hidden[c] =
                    n_hidden[(outputs.network * VK_N_HIDDEN + output_column + c) * ROW + l];
                [[unroll]] for (uint j = 0; j < 4; j++) output_sum[j] +=
                    hidden * n_output[min(outputs.first + j, outputs.last) * ROW + l];
            }
            if (has_input) {
                vec4 d;
                [[unroll]] for (uint c = 0; c < 4; c++) d[c] = d_hidden[(input_column + c) * ROW + l];
                [[unroll]] for (uint j = 0; j < 4; j++) input_sum[j] +=
                    d * n_input[(input_row + j) * ROW + l];
            }
            if (id < VK_N_OUTPUTS)
                bias += n_output[id * ROW + l];
            if (id < VK_N_ALL && (a.parts & VK_N_PART_DISTANCE) != 0)
                distance += d_hidden[id * ROW + l] * n_bank_input[3 * ROW + l];
            if ((a.parts & VK_N_PART_BANK) != 0) {
                if (row < 5)
                    bank_input += d_mixture[column * ROW + l] * n_bank_input[row * ROW + l];
                if (row < 4) /* the last row: the biases */
                    bank_output += row < 3
                                       ? d_share[row * ROW + l] * n_bank_hidden[column * ROW + l]
                                   : column < 3 ? d_share[column * ROW + l]
                                                : 0.0;
            }
        }
    }
    const uint to = piece * VK_W_LOOK;
    [[unroll]] for (uint j = 0; j < 4; j++)
    {
        const uint o = outputs.first + j;
        if (has_output && o <= outputs.last)
            [[unroll]] for (uint c = 0; c < 4; c++)
                a.sums.v[to + VK_W_OUTPUT + o * VK_N_HIDDEN + output_column + c] = output_sum[j][c];
        if (has_input)
            [[unroll]] for (uint c = 0; c < 4; c++)
                a.sums.v[to + (input_row + j) * VK_N_ALL + input_column + c] = input_sum[j][c];
    }
    if (id < VK_N_OUTPUTS)
        a.sums.v[to + VK_W_BIAS + id] = bias;
    if (id < VK_N_ALL)
        a.sums.v[to + VK_W_DISTANCE + id] = distance;
    if (row < 5)
        a.sums.v[to + VK_W_BANK_INPUT + id] = bank_input;
    if (row < 3)
        a.sums.v[to + VK_W_BANK_OUTPUT + id] = bank_output;
    else if (row == 3 && column < 3)
        a.sums.v[to + VK_W_BANK_BIAS + column] = bank_output;
}
