/* SPDX-License-Identifier: Apache-2.0 */
/* The appearance of a photo, in one workgroup. It is the same for all anchors of a view, so that
 * the biases of the colours' network take it in. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(neural_look);

const uint BIAS = VK_N_INPUTS * VK_N_ALL + 2 * VK_N_HIDDEN; /* of the colours */

float value(uint photo, uint k)
{
    return a.looks.v[photo * 3 * VK_N_LOOK + k];
}

shared float look[VK_N_LOOK];

void main()
{
    const uint id = gl_LocalInvocationID.x;
    if (id < VK_N_LOOK && a.back == 0) {
        float sum = 0.0;
        const bool mean = a.photo >= a.photos && a.photo != VK_NO_LOOK;
        for (uint photo = 0; photo < a.photos && mean; photo++)
            sum += value(photo, id);
        look[id] = a.photo < a.photos ? value(a.photo, id) : mean ? sum / float(a.photos) : 0.0;
        a.look.v[id] = look[id];
    } else if (id < VK_N_LOOK)
        look[id] = a.look.v[id];
    barrier(); /* look */
    if (a.back == 0) {
        if (id < VK_N_HIDDEN) {
            float bias = a.weights.v[BIAS + id];
            for (uint k = 0; k < VK_N_LOOK; k++)
                bias += a.weights.v[VK_W_LOOK + k * VK_N_HIDDEN + id] * look[k];
            a.to.v[BIAS + id] = bias;
        }
        return;
    }
    for (uint at = id; at < VK_N_LOOK * VK_N_HIDDEN; at += VK_GROUP)
        a.to.v[VK_W_LOOK + at] = look[at / VK_N_HIDDEN] * a.to.v[BIAS + at % VK_N_HIDDEN];
    if (id < VK_N_LOOK) {
        float sum = 0.0;
        for (uint h = 0; h < VK_N_HIDDEN; h++)
            sum += a.weights.v[VK_W_LOOK + id * VK_N_HIDDEN + h] * a.to.v[BIAS + h];
        a.to.v[VK_W_ALL + id] = sum;
    }
}
