/* SPDX-License-Identifier: Apache-2.0 */
/* The networks of Scaffold-GS on 16 anchors that a view sees, by a workgroup. Layers are in shared
 * memory. Between their rows is a float more than there are anchors: without it a column would be
 * in one bank. Loads bound these kernels, not multiply-adds: so an invocation computes several rows
 * or anchors of a layer from each value that it loads, and loads weights by four where they lie so.
 */
#include "math/neural.h"

#define ROW 17
/* Where an invocation has one anchor and the rows FIRST_ROW, FIRST_ROW + 16 and so on. */
#define LANE (gl_LocalInvocationID.x % 16)
#define FIRST_ROW (gl_LocalInvocationID.x / 16)

/* Of weights; they begin where an allocation does. */
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Fours
{
    vec4 v[];
};

shared float n_input[(VK_N_INPUTS + 1) * ROW]; /* the last row: 1 */
shared float n_hidden[VK_N_ALL * ROW];
shared float n_output[VK_N_OUTPUTS * ROW];
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

/* An invocation has four columns and two anchors. */
void hidden_layer(Floats w, uint parts)
{
    Fours w4 = Fours(w);
    const uint column = gl_LocalInvocationID.x % (VK_N_ALL / 4) * 4;
    const uint lane = gl_LocalInvocationID.x / (VK_N_ALL / 4);
    if (lane >= 8)
        return;
    vec4 sum[2] = vec4[](vec4(0.0), vec4(0.0));
    for (uint k = 0; k <= VK_N_INPUTS; k++) {
        const vec4 weight = w4.v[(k * VK_N_ALL + column) / 4];
        sum[0] += weight * n_input[k * ROW + lane];
        sum[1] += weight * n_input[k * ROW + lane + 8];
    }
    [[unroll]] for (uint j = 0; j < 2; j++)
    {
        const uint to = lane + 8 * j;
        [[unroll]] for (uint c = 0; c < 4; c++)
        {
            if ((parts & VK_N_PART_DISTANCE) != 0)
                sum[j][c] += w.v[VK_W_DISTANCE + column + c] * n_bank_input[3 * ROW + to];
            n_hidden[(column + c) * ROW + to] = r_max(sum[j][c], 0.0);
        }
    }
}

/* The output layer's rows by fours, each of one network; the last one of a network can be shorter. */
#define OPACITY_FOURS ((VK_N_COVARIANCE + 3) / 4)
#define COVARIANCE_FOURS (OPACITY_FOURS + (VK_N_COLOUR - VK_N_COVARIANCE + 3) / 4)
#define OUTPUT_FOURS (COVARIANCE_FOURS + (VK_N_OUTPUTS - VK_N_COLOUR + 3) / 4)

struct output_rows
{
    uint network, first, last;
};

output_rows output_four(uint four)
{
    return four < OPACITY_FOURS ? output_rows(0, 4 * four, VK_N_COVARIANCE - 1)
           : four < COVARIANCE_FOURS
               ? output_rows(1, VK_N_COVARIANCE + 4 * (four - OPACITY_FOURS), VK_N_COLOUR - 1)
               : output_rows(2, VK_N_COLOUR + 4 * (four - COVARIANCE_FOURS), VK_N_OUTPUTS - 1);
}

/* An invocation has four rows and two anchors. */
void output_layer(Floats w)
{
    Fours w4 = Fours(w);
    const uint lane = gl_LocalInvocationID.x % 8, four = gl_LocalInvocationID.x / 8;
    if (four >= OUTPUT_FOURS)
        return;
    const output_rows rows = output_four(four);
    float sum[8];
    [[unroll]] for (uint j = 0; j < 4; j++) sum[j] = sum[4 + j] =
        w.v[VK_W_BIAS + min(rows.first + j, rows.last)];
    for (uint h = 0; h < VK_N_HIDDEN; h += 4) {
        vec4 x[2];
        [[unroll]] for (uint c = 0; c < 4; c++)
        {
            const uint from = (rows.network * VK_N_HIDDEN + h + c) * ROW + lane;
            x[0][c] = n_hidden[from];
            x[1][c] = n_hidden[from + 8];
        }
        [[unroll]] for (uint j = 0; j < 4; j++)
        {
            const uint o = min(rows.first + j, rows.last);
            const vec4 weight = w4.v[(VK_W_OUTPUT + o * VK_N_HIDDEN + h) / 4];
            [[unroll]] for (uint l = 0; l < 2; l++)
                [[unroll]] for (uint c = 0; c < 4; c++) sum[4 * l + j] += weight[c] * x[l][c];
        }
    }
    [[unroll]] for (uint j = 0; j < 4; j++) if (rows.first + j <= rows.last)
    {
        n_output[(rows.first + j) * ROW + lane] = sum[j];
        n_output[(rows.first + j) * ROW + lane + 8] = sum[4 + j];
    }
}

/* Takes 16 anchors of the list from `first` on. Ends with a barrier. */
void anchors_begin(Uints seen, uint first, uint seen_count, uint count)
{
    const uint id = gl_LocalInvocationID.x;
    if (id < 16)
        n_anchor[id] = first + id < seen_count ? seen.v[first + id] : count;
    barrier(); /* n_anchor */
}

/* Their layers. Inputs of those behind the end of the list are 0, so that no value is without a
 * number. Ends with a barrier. */
void layers(Floats params, Floats anchors, Floats w, Floats view, uint count, uint parts)
{
    const uint lane = LANE, row = FIRST_ROW, i = n_anchor[lane];
    const bool there = i < count;
    if (row == 0) {
        float d[3], length = 0.0;
        for (uint k = 0; k < 3; k++) {
            d[k] = there ? params.v[param_at(14, i, k)] - view.v[12 + k] : 0.0;
            length += d[k] * d[k];
        }
        length = sqrt(length);
        for (uint k = 0; k < 3; k++) {
            const float along = there ? d[k] / length : 0.0;
            n_input[(VK_A_FEATURES + k) * ROW + lane] = along;
            n_bank_input[k * ROW + lane] = along;
        }
        n_input[VK_N_INPUTS * ROW + lane] = 1.0;
        n_bank_input[3 * ROW + lane] = length;
        n_bank_input[4 * ROW + lane] = 1.0;
    }
    if ((parts & VK_N_PART_BANK) != 0) {
        barrier(); /* n_bank_input */
        for (uint h = row; h < VK_N_HIDDEN; h += 16) {
            float sum = 0.0;
            for (uint k = 0; k < 5; k++)
                sum += w.v[VK_W_BANK_INPUT + k * VK_N_HIDDEN + h] * n_bank_input[k * ROW + lane];
            n_bank_hidden[h * ROW + lane] = r_max(sum, 0.0);
        }
        barrier(); /* n_bank_hidden */
        if (row == 0) {
            float z[3], sum = 0.0;
            for (uint j = 0; j < 3; j++) {
                z[j] = w.v[VK_W_BANK_BIAS + j];
                for (uint h = 0; h < VK_N_HIDDEN; h++)
                    z[j] +=
                        w.v[VK_W_BANK_OUTPUT + j * VK_N_HIDDEN + h] * n_bank_hidden[h * ROW + lane];
            }
            const float most = r_max(r_max(z[0], z[1]), z[2]);
            for (uint j = 0; j < 3; j++) {
                z[j] = exp(z[j] - most);
                sum += z[j];
            }
            for (uint j = 0; j < 3; j++)
                n_share[j * ROW + lane] = z[j] / sum;
        }
        barrier(); /* n_share */
    }
    for (uint f = row; f < VK_A_FEATURES; f += 16) {
        float value = 0.0;
        if (there && (parts & VK_N_PART_BANK) == 0)
            value = anchor_value(anchors, i, VK_A_FEATURE + f);
        else if (there)
            for (uint j = 0; j < 3; j++)
                value += n_share[j * ROW + lane] *
                         anchor_value(anchors, i, VK_A_FEATURE + bank_source(j, f));
        n_input[f * ROW + lane] = value;
    }
    barrier(); /* n_input */
    hidden_layer(w, parts);
    barrier(); /* n_hidden */
    output_layer(w);
    barrier(); /* n_output */
}

/* Gaussian k of the anchor of this invocation. */
neural neural_of(Floats params, Floats anchors, uint i, uint k)
{
    neural n;
    n.y = n_output[k * ROW + LANE];
    for (uint j = 0; j < 7; j++)
        n.cov[j] = n_output[(VK_N_COVARIANCE + 7 * k + j) * ROW + LANE];
    for (uint j = 0; j < 3; j++) {
        n.colour[j] = n_output[(VK_N_COLOUR + 3 * k + j) * ROW + LANE];
        n.offset[j] = anchor_value(anchors, i, 3 * k + j);
        n.anchor[j] = params.v[param_at(14, i, j)];
        n.reach[j] = params.v[param_at(14, i, P_SCALE + j)];
        n.size[j] = anchor_value(anchors, i, VK_A_SIZE + j);
    }
    return n;
}
