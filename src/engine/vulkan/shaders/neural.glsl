/* SPDX-License-Identifier: Apache-2.0 */
/* The networks of Scaffold-GS on 16 anchors that a view sees, by a workgroup. Layers are in shared
 * memory, four rows of an anchor in a vector. Loads bound these kernels, not multiply-adds: so an
 * invocation computes four rows of EACH anchors, and uses a value that it loads in several of
 * them. That some invocations rest costs less. */
#include "math/neural.h"

layout(constant_id = 1) const uint PARTS = 0; /* VK_N_PART_ */

#define GROUP 128 /* invocations */
/* Where an invocation has one anchor and the rows FIRST_ROW, FIRST_ROW + ROWS and so on. */
#define ROWS (GROUP / 16)
#define LANE (gl_LocalInvocationID.x % 16)
#define FIRST_ROW (gl_LocalInvocationID.x / 16)

/* Of weights; they begin where an allocation does. */
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Fours
{
    vec4 v[];
};

/* The rows of the output layer by network, each network from a new vector on. Where the rows of a
 * network end within a vector, the rest is not read, and gradients there are 0. */
#define OPACITY_FOURS ((VK_N_COVARIANCE + 3) / 4)
#define COVARIANCE_FOURS (OPACITY_FOURS + (VK_N_COLOUR - VK_N_COVARIANCE + 3) / 4)
#define OUTPUT_FOURS (COVARIANCE_FOURS + (VK_N_OUTPUTS - VK_N_COLOUR + 3) / 4)
#define COVARIANCE_ROW (4 * OPACITY_FOURS)
#define COLOUR_ROW (4 * COVARIANCE_FOURS)

/* The layers in `n_fours`. The pitch is one vector more than there are anchors: without it a column
 * would be in few banks. */
#define PITCH 17
#define INPUT 0 /* the last row: 1 */
#define HIDDEN ((VK_N_INPUTS + 1) / 4)
#define OUTPUT (HIDDEN + VK_N_ALL / 4)
#define FORWARD_FOURS (OUTPUT + OUTPUT_FOURS)
#ifndef N_FOURS
#define N_FOURS FORWARD_FOURS
#endif
#define FOUR_AT(layer, four, lane) (((layer) + (four)) * PITCH + (lane))
#define FOUR(layer, four, lane) n_fours[FOUR_AT(layer, four, lane)]
#define VALUE(layer, row, lane) FOUR(layer, (row) / 4, lane)[(row) % 4]

#define ROW 17 /* the same of rows of single values */

#ifndef EACH
#define EACH 8 /* anchors of an invocation */
#endif

shared vec4 n_fours[N_FOURS * PITCH];
/* Of the feature bank: direction, distance, 1. The distance is there without it too. */
shared float n_bank_input[5 * ROW];
shared float n_bank_hidden[VK_N_HIDDEN * ROW];
shared float n_share[3 * ROW];
shared uint n_anchor[16]; /* their numbers; behind the end of the list: the number of anchors */

/* See sg_bank_source. */
uint bank_source(uint share, uint f)
{
    return share == 0 ? f % 8 * 4 : share == 1 ? f % 16 * 2 : f;
}

float anchor_value(Floats anchors, uint i, uint plane)
{
    return anchors.v[param_at(VK_A_PLANES, i, plane)];
}

/* The first vector of a network's rows; of network 3: behind the last one. */
uint first_four(uint network)
{
    return network == 0   ? 0
           : network == 1 ? OPACITY_FOURS
           : network == 2 ? COVARIANCE_FOURS
                          : OUTPUT_FOURS;
}

/* The rows of a vector of the output layer, and their network. */
struct output_rows {
    uint network, first, last;
};

output_rows output_four(uint four)
{
    return four < OPACITY_FOURS ? output_rows(0, 4 * four, VK_N_COVARIANCE - 1)
           : four < COVARIANCE_FOURS
               ? output_rows(1, VK_N_COVARIANCE + 4 * (four - OPACITY_FOURS), VK_N_COLOUR - 1)
               : output_rows(2, VK_N_COLOUR + 4 * (four - COVARIANCE_FOURS), VK_N_OUTPUTS - 1);
}

/* Weights of hidden values h to h + 3 for the four rows. */
void output_weights(Fours w4, output_rows rows, uint h, out vec4 weight[4])
{
    [[unroll]] for (uint j = 0; j < 4; j++) weight[j] =
        w4.v[(VK_W_OUTPUT + min(rows.first + j, rows.last) * VK_N_HIDDEN + h) / 4];
}

void hidden_layer(Floats w)
{
    Fours w4 = Fours(w);
    const uint column = gl_LocalInvocationID.x % (VK_N_ALL / 4);
    const uint first = gl_LocalInvocationID.x / (VK_N_ALL / 4) * EACH;
    if (first >= 16)
        return;
    vec4 sum[EACH];
    [[unroll]] for (uint l = 0; l < EACH; l++) sum[l] = vec4(0.0);
    for (uint four = 0; four < HIDDEN - INPUT; four++) {
        vec4 weight[4];
        [[unroll]] for (uint j = 0; j < 4; j++) weight[j] =
            w4.v[(4 * four + j) * (VK_N_ALL / 4) + column];
        [[unroll]] for (uint l = 0; l < EACH; l++)
        {
            const vec4 x = FOUR(INPUT, four, first + l);
            [[unroll]] for (uint j = 0; j < 4; j++) sum[l] += weight[j] * x[j];
        }
    }
    [[unroll]] for (uint l = 0; l < EACH; l++)
    {
        for (uint c = 0; c < 4 && (PARTS & VK_N_PART_DISTANCE) != 0; c++)
            sum[l][c] += w.v[VK_W_DISTANCE + 4 * column + c] * n_bank_input[3 * ROW + first + l];
        [[unroll]] for (uint c = 0; c < 4; c++) sum[l][c] = r_max(sum[l][c], 0.0);
        FOUR(HIDDEN, column, first + l) = sum[l];
    }
}

/* The inputs and hidden values of 16 anchors of the list from `first` on. Features and directions
 * of those behind its end are 0, so that no value is without a number. A barrier has to follow. */
void hidden_layers(Uints seen, uint first, uint seen_count, Floats params, Floats anchors, Floats w,
                   Floats view, uint count)
{
    const uint lane = LANE, row = FIRST_ROW;
    const uint i = first + lane < seen_count ? seen.v[first + lane] : count;
    const bool there = i < count;
    if (row == 0) {
        float d[3], length = 0.0;
        n_anchor[lane] = i;
        for (uint k = 0; k < 3; k++) {
            d[k] = there ? params.v[param_at(14, i, k)] - view.v[12 + k] : 0.0;
            length += d[k] * d[k];
        }
        length = sqrt(length);
        for (uint k = 0; k < 3; k++) {
            const float along = there ? d[k] / length : 0.0;
            VALUE(INPUT, VK_A_FEATURES + k, lane) = along;
            n_bank_input[k * ROW + lane] = along;
        }
        VALUE(INPUT, VK_N_INPUTS, lane) = 1.0;
        n_bank_input[3 * ROW + lane] = length;
        n_bank_input[4 * ROW + lane] = 1.0;
    }
    if ((PARTS & VK_N_PART_BANK) != 0) {
        barrier(); /* n_bank_input */
        for (uint h = row; h < VK_N_HIDDEN; h += ROWS) {
            float sum = 0.0;
            for (uint k = 0; k < 5; k++)
                sum += w.v[VK_W_BANK_INPUT + k * VK_N_HIDDEN + h] * n_bank_input[k * ROW + lane];
            n_bank_hidden[h * ROW + lane] = r_max(sum, 0.0);
        }
        barrier(); /* n_bank_hidden */
        if (row == 0) {
            float z[3];
            for (uint j = 0; j < 3; j++) {
                z[j] = w.v[VK_W_BANK_BIAS + j];
                for (uint h = 0; h < VK_N_HIDDEN; h++)
                    z[j] +=
                        w.v[VK_W_BANK_OUTPUT + j * VK_N_HIDDEN + h] * n_bank_hidden[h * ROW + lane];
            }
            neural_shares(z);
            for (uint j = 0; j < 3; j++)
                n_share[j * ROW + lane] = z[j];
        }
        barrier(); /* n_share */
    }
    for (uint f = row; f < VK_A_FEATURES; f += ROWS) {
        float value = 0.0;
        if (there && (PARTS & VK_N_PART_BANK) == 0)
            value = anchor_value(anchors, i, VK_A_FEATURE + f);
        else if (there)
            for (uint j = 0; j < 3; j++)
                value += n_share[j * ROW + lane] *
                         anchor_value(anchors, i, VK_A_FEATURE + bank_source(j, f));
        VALUE(INPUT, f, lane) = value;
    }
    barrier(); /* INPUT */
    hidden_layer(w);
}

/* Gaussian k of anchor i, but for what the networks say of it. */
neural neural_of(Floats params, Floats anchors, uint i, uint k)
{
    neural n;
    n.y = 0.0;
    for (uint j = 0; j < 7; j++)
        n.cov[j] = 0.0;
    for (uint j = 0; j < 3; j++) {
        n.colour[j] = 0.0;
        n.offset[j] = anchor_value(anchors, i, 3 * k + j);
        n.anchor[j] = params.v[param_at(14, i, j)];
        n.reach[j] = params.v[param_at(14, i, P_SCALE + j)];
        n.size[j] = anchor_value(anchors, i, VK_A_SIZE + j);
    }
    return n;
}
