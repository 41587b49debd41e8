/* SPDX-License-Identifier: Apache-2.0 */
/* The networks of Scaffold-GS on a block of 16 anchors, by a workgroup: invocation 16 r + l has
 * anchor l, and of each layer the rows r, r + 16 and so on. Layers are in shared memory. Between
 * their rows is a float more than there are anchors: without it a column would be in one bank. */
#include "math/neural.h"

#define ROW 17
#define LANE (gl_LocalInvocationID.x % 16)
#define FIRST_ROW (gl_LocalInvocationID.x / 16)

shared float n_input[(VK_N_INPUTS + 1) * ROW]; /* the last row: 1 */
shared float n_hidden[VK_N_ALL * ROW];
shared float n_output[VK_N_OUTPUTS * ROW];
/* Of the feature bank: direction, distance, 1. The distance is there without it too. */
shared float n_bank_input[5 * ROW];
shared float n_bank_hidden[VK_N_HIDDEN * ROW];
shared float n_share[3 * ROW];
shared uint n_exists[16]; /* of each anchor, as in the buffer */

/* See sg_bank_source. */
uint bank_source(uint share, uint f)
{
    return share == 0 ? f % 8 * 4 : share == 1 ? f % 16 * 2 : f;
}

float anchor_value(Floats anchors, uint i, uint plane)
{
    return anchors.v[param_at(VK_A_PLANES, i, plane)];
}

/* Which network an output is of. */
uint network_of(uint o)
{
    return o < VK_N_COVARIANCE ? 0 : o < VK_N_COLOUR ? 1 : 2;
}

/* The layers of the anchors of block i0 / 16 that have a bit in n_exists, which all have written;
 * inputs of the others are 0, so that no value is without a number. Ends with a barrier. */
void layers(Floats params, Floats anchors, Floats w, Floats view, uint i0, uint parts)
{
    const uint lane = LANE, row = FIRST_ROW, i = i0 + lane;
    const bool there = n_exists[lane] != 0;
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
                    z[j] += w.v[VK_W_BANK_OUTPUT + j * VK_N_HIDDEN + h] *
                            n_bank_hidden[h * ROW + lane];
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
    for (uint h = row; h < VK_N_ALL; h += 16) {
        float sum = 0.0;
        for (uint k = 0; k <= VK_N_INPUTS; k++)
            sum += w.v[k * VK_N_ALL + h] * n_input[k * ROW + lane];
        if ((parts & VK_N_PART_DISTANCE) != 0)
            sum += w.v[VK_W_DISTANCE + h] * n_bank_input[3 * ROW + lane];
        n_hidden[h * ROW + lane] = r_max(sum, 0.0);
    }
    barrier(); /* n_hidden */
    for (uint o = row; o < VK_N_OUTPUTS; o += 16) {
        const uint first = network_of(o) * VK_N_HIDDEN;
        float sum = w.v[VK_W_BIAS + o];
        for (uint h = 0; h < VK_N_HIDDEN; h++)
            sum += w.v[VK_W_OUTPUT + o * VK_N_HIDDEN + h] * n_hidden[(first + h) * ROW + lane];
        n_output[o * ROW + lane] = sum;
    }
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
