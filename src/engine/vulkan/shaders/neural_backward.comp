/* SPDX-License-Identifier: Apache-2.0 */
/* Gradients of a view's Gaussians to those of their anchors and of the weights. A workgroup takes
 * 16 of the seen anchors at a time, every a.pieces-th of such blocks. Sums of the weights'
 * gradients over its blocks stay in its registers: the block is small, and so each sum has a fixed
 * order. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#define SG_NEURAL_DRAWN
#define D_HIDDEN FORWARD_FOURS
#define N_FOURS (D_HIDDEN + VK_N_ALL / 4)
#define EACH 4 /* since the sums of the weights' gradients take registers too */
#include "neural.glsl"

layout(local_size_x = GROUP) in;
ARGUMENTS(neural_backward);

/* Gradients: those of outputs replace them, those of hidden values are the layer D_HIDDEN; here are
 * those of inputs that are a mixture, and of the shares. */
shared float d_mixture[VK_A_FEATURES * ROW];
shared float d_share[3 * ROW];

void put(uint i, uint plane, float value)
{
    a.gradient.v[param_at(VK_A_VALUES, i, plane)] = value;
}

/* Of the outputs, and of the anchors' own values. */
void pull_outputs()
{
    const uint lane = LANE, i = n_anchor[lane];
    for (uint k = FIRST_ROW; k < VK_ANCHOR; k += ROWS) {
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
            for (uint p = 0; p < SG_NEURAL_PLANES; p++) {
                planes[p] = a.made.v[param_at(14, i * VK_ANCHOR + k, p)];
                g[p] = a.from.v[param_at(14, i * VK_ANCHOR + k, p)];
            }
            neural_backward(n, planes, g, a.volume / float(a.drawn.v[0]), d);
        }
        VALUE(OUTPUT, k, lane) = d.y;
        for (uint j = 0; j < 7; j++)
            VALUE(OUTPUT, COVARIANCE_ROW + 7 * k + j, lane) = d.cov[j];
        for (uint j = 0; j < 3; j++) {
            VALUE(OUTPUT, COLOUR_ROW + 3 * k + j, lane) = d.colour[j];
            if (i < a.count)
                put(i, 3 + 3 * k + j, d.offset[j]);
            /* until D_HIDDEN is known */
            VALUE(D_HIDDEN, j * VK_ANCHOR + k, lane) = d.reach[j];
            VALUE(D_HIDDEN, (3 + j) * VK_ANCHOR + k, lane) = d.size[j];
        }
    }
    if (FIRST_ROW < 3) { /* behind the last row of a network */
        const uint end = FIRST_ROW == 0   ? VK_N_COVARIANCE
                         : FIRST_ROW == 1 ? COVARIANCE_ROW + VK_N_COLOUR - VK_N_COVARIANCE
                                          : COLOUR_ROW + VK_N_OUTPUTS - VK_N_COLOUR;
        for (uint o = end; o % 4 != 0; o++)
            VALUE(OUTPUT, o, lane) = 0.0;
    }
    barrier(); /* what all have written */
    if (FIRST_ROW < 6 && i < a.count) {
        const uint j = FIRST_ROW;
        float sum = 0.0;
        for (uint g = 0; g < VK_ANCHOR; g++)
            sum += VALUE(D_HIDDEN, j * VK_ANCHOR + g, lane);
        put(i, j < 3 ? j : 3 + VK_A_SIZE + j - 3, sum);
    }
    barrier(); /* before D_HIDDEN is written again */
}

/* Before the ReLU. */
void pull_hidden()
{
    Fours w4 = Fours(a.weights);
    const uint column = gl_LocalInvocationID.x % (VK_N_ALL / 4);
    const uint first = gl_LocalInvocationID.x / (VK_N_ALL / 4) * EACH;
    const uint network = column / (VK_N_HIDDEN / 4);
    const uint end = first_four(network + 1);
    if (first < 16) {
        vec4 sum[EACH];
        [[unroll]] for (uint l = 0; l < EACH; l++) sum[l] = vec4(0.0);
        for (uint four = first_four(network); four < end; four++) {
            vec4 weight[4];
            output_weights(w4, output_four(four), 4 * column % VK_N_HIDDEN, weight);
            [[unroll]] for (uint l = 0; l < EACH; l++)
            {
                const vec4 d = FOUR(OUTPUT, four, first + l);
                [[unroll]] for (uint j = 0; j < 4; j++) sum[l] += weight[j] * d[j];
            }
        }
        [[unroll]] for (uint l = 0; l < EACH; l++)
        {
            const vec4 hidden = FOUR(HIDDEN, column, first + l);
            FOUR(D_HIDDEN, column, first + l) =
                mix(vec4(0.0), sum[l], greaterThan(hidden, vec4(0.0)));
        }
    }
    barrier(); /* D_HIDDEN */
}

/* Of features, or of the mixtures in their place: invocation `id` of some has four of them and four
 * anchors. */
void pull_features(uint id)
{
    Fours w4 = Fours(a.weights);
    const uint first = id / (VK_A_FEATURES / 4) * 4, feature = id % (VK_A_FEATURES / 4) * 4;
    if (first >= 16)
        return;
    vec4 sum[4];
    [[unroll]] for (uint l = 0; l < 4; l++) sum[l] = vec4(0.0);
    for (uint four = 0; four < VK_N_ALL / 4; four++) {
        vec4 weight[4];
        [[unroll]] for (uint j = 0; j < 4; j++) weight[j] =
            w4.v[(feature + j) * (VK_N_ALL / 4) + four];
        [[unroll]] for (uint l = 0; l < 4; l++)
        {
            const vec4 d = FOUR(D_HIDDEN, four, first + l);
            [[unroll]] for (uint j = 0; j < 4; j++)
                [[unroll]] for (uint c = 0; c < 4; c++) sum[l][j] += weight[j][c] * d[c];
        }
    }
    [[unroll]] for (uint l = 0; l < 4; l++)
    {
        const uint i = n_anchor[first + l];
        [[unroll]] for (uint j = 0; j < 4; j++) if ((PARTS & VK_N_PART_BANK) != 0)
            d_mixture[(feature + j) * ROW + first + l] = sum[l][j];
        else if (i < a.count) put(i, 3 + VK_A_FEATURE + feature + j, sum[l][j]);
    }
}

/* From the gradients of the mixtures to those of the features, of the arguments of the shares
 * (d_share), and of the bank's hidden values, which replace the mixtures' in d_mixture. */
void pull_mixtures()
{
    const uint lane = LANE, j = FIRST_ROW, i = n_anchor[lane];
    barrier(); /* d_mixture */
    if (i < a.count)
        for (uint f = FIRST_ROW; f < VK_A_FEATURES; f += ROWS) {
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
    for (uint h = FIRST_ROW; h < VK_N_HIDDEN; h += ROWS) {
        float d = 0.0;
        for (uint m = 0; m < 3; m++)
            d += a.weights.v[VK_W_BANK_OUTPUT + m * VK_N_HIDDEN + h] * d_share[m * ROW + lane];
        d_mixture[h * ROW + lane] = n_bank_hidden[h * ROW + lane] > 0.0 ? d : 0.0;
    }
    barrier(); /* d_mixture, now of the bank's hidden values */
}

/* Eight rows and eight columns of a layer's weights. Of outputs the rows are their gradients, the
 * columns hidden values; of inputs the rows are inputs, the columns gradients of hidden values.
 * Where a network ends within the rows, the second vector is of something else, and its sums are
 * left out. */
struct weights_tile
{
    bool output_; /* which layer */
    uint network, four, end; /* the first vector of rows, and where the network ends */
    uint column;             /* the first vector of columns, in the network of an output */
};

#define PAIRS(fours) (((fours) + 1) / 2)
#define COVARIANCE_PAIRS PAIRS(OPACITY_FOURS) /* the first one */
#define COLOUR_PAIRS (COVARIANCE_PAIRS + PAIRS(COVARIANCE_FOURS - OPACITY_FOURS))
#define OUTPUT_TILES ((COLOUR_PAIRS + PAIRS(OUTPUT_FOURS - COVARIANCE_FOURS)) * (VK_N_HIDDEN / 8))
#define TILES (OUTPUT_TILES + PAIRS(HIDDEN) * (VK_N_ALL / 8))

weights_tile tile_of(uint id)
{
    weights_tile t;
    t.output_ = id < OUTPUT_TILES;
    const uint across = t.output_ ? VK_N_HIDDEN / 8 : VK_N_ALL / 8;
    const uint number = t.output_ ? id : id - OUTPUT_TILES, pair = number / across;
    t.column = number % across * 2;
    t.network = pair < COVARIANCE_PAIRS ? 0 : pair < COLOUR_PAIRS ? 1 : 2;
    const uint pairs = t.network == 0 ? 0 : t.network == 1 ? COVARIANCE_PAIRS : COLOUR_PAIRS;
    t.four = t.output_ ? first_four(t.network) + 2 * (pair - pairs) : 2 * pair;
    t.end = t.output_ ? first_four(t.network + 1) : HIDDEN;
    return t;
}

/* The sums of row k of the tile's eight, in two vectors. */
void put_row(weights_tile t, uint k, uint to, vec4 sum[2])
{
    const uint four = t.four + k / 4;
    const output_rows rows = output_four(four);
    if (four >= t.end || (t.output_ && rows.first + k % 4 > rows.last))
        return;
    const uint first = t.output_ ? VK_W_OUTPUT + (rows.first + k % 4) * VK_N_HIDDEN
                                 : (4 * four + k % 4) * VK_N_ALL;
    [[unroll]] for (uint c = 0; c < 8; c++) a.sums.v[to + first + 4 * t.column + c] =
        sum[c / 4][c % 4];
}

/* Which invocations have what: a vector of biases, or of the weights of distances; four features of
 * four anchors. The tiles are those of the first ones. */
#define FIRST_FEATURE 96
#define FIRST_BIAS 32
#define FIRST_DISTANCE 64

void main()
{
    const uint id = gl_LocalInvocationID.x, piece = group_index();
    if (piece >= a.pieces)
        return;
    const uint column = id % VK_N_HIDDEN, row = id / VK_N_HIDDEN; /* of the bank's sums */
    const bool has_bias = id >= FIRST_BIAS && id < FIRST_BIAS + OUTPUT_FOURS;
    const bool has_distance = id >= FIRST_DISTANCE && id < FIRST_DISTANCE + VK_N_ALL / 4;
    const uint seen_count = a.seen_count.v[0];
    vec4 sum[16], beside = vec4(0.0); /* of the tile; of biases or distances */
    float bank_input[2] = float[](0.0, 0.0), bank_output = 0.0;
    [[unroll]] for (uint j = 0; j < 16; j++) sum[j] = vec4(0.0);
    for (uint first = piece * 16; first < seen_count; first += a.pieces * 16) {
        barrier(); /* the last block's sums are taken */
        hidden_layers(a.seen, first, seen_count, a.params, a.anchors, a.weights, a.view, a.count);
        pull_outputs();
        pull_hidden();
        if (id >= FIRST_FEATURE)
            pull_features(id - FIRST_FEATURE);
        if ((PARTS & VK_N_PART_BANK) != 0)
            pull_mixtures();
        if (id < TILES) {
            const weights_tile t = tile_of(id);
            const uint rows = FOUR_AT(t.output_ ? OUTPUT : INPUT, t.four, 0);
            const uint columns =
                FOUR_AT(t.output_ ? HIDDEN + t.network * (VK_N_HIDDEN / 4) : D_HIDDEN, t.column, 0);
            for (uint l = 0; l < 16; l++) {
                const vec4 y[2] = vec4[](n_fours[columns + l], n_fours[columns + PITCH + l]);
                [[unroll]] for (uint k = 0; k < 2; k++)
                {
                    const vec4 x = n_fours[rows + k * PITCH + l];
                    [[unroll]] for (uint j = 0; j < 8; j++) sum[8 * k + j] += x[j / 2] * y[j % 2];
                }
            }
        }
        if (has_bias)
            for (uint l = 0; l < 16; l++)
                beside += FOUR(OUTPUT, id - FIRST_BIAS, l);
        if (has_distance && (PARTS & VK_N_PART_DISTANCE) != 0)
            for (uint l = 0; l < 16; l++)
                beside += FOUR(D_HIDDEN, id - FIRST_DISTANCE, l) * n_bank_input[3 * ROW + l];
        for (uint l = 0; l < 16 && (PARTS & VK_N_PART_BANK) != 0; l++) {
            const float d = d_mixture[column * ROW + l];
            bank_input[0] += d * n_bank_input[row * ROW + l];
            if (row == 0)
                bank_input[1] += d * n_bank_input[4 * ROW + l];
            /* The last row: the biases. */
            bank_output += row < 3      ? d_share[row * ROW + l] * n_bank_hidden[column * ROW + l]
                           : column < 3 ? d_share[column * ROW + l]
                                        : 0.0;
        }
    }
    const uint to = piece * VK_W_LOOK;
    if (id < TILES)
        [[unroll]] for (uint k = 0; k < 8; k++)
            put_row(tile_of(id), k, to, vec4[](sum[2 * k], sum[2 * k + 1]));
    [[unroll]] for (uint c = 0; c < 4; c++)
    {
        const output_rows rows = output_four(id - FIRST_BIAS);
        if (has_bias && rows.first + c <= rows.last)
            a.sums.v[to + VK_W_BIAS + rows.first + c] = beside[c];
        if (has_distance)
            a.sums.v[to + VK_W_DISTANCE + (id - FIRST_DISTANCE) * 4 + c] = beside[c];
    }
    a.sums.v[to + VK_W_BANK_INPUT + id] = bank_input[0];
    if (row == 0)
        a.sums.v[to + VK_W_BANK_INPUT + 4 * VK_N_HIDDEN + column] = bank_input[1];
    if (row < 3)
        a.sums.v[to + VK_W_BANK_OUTPUT + id] = bank_output;
    else if (row == 3 && column < 3)
        a.sums.v[to + VK_W_BANK_BIAS + column] = bank_output;
}
