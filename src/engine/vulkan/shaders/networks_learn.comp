/* SPDX-License-Identifier: Apache-2.0 */
/* A step of Adam of the weights, and of the appearances of all photos: those of other photos than
 * the view's move on by their momentum. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/adam.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(networks_learn);

void main()
{
    const uint i = thread_index();
    if (a.stop.v[0] != 0)
        return;
    if (i < VK_W_ALL) {
        const uint network = a.networks.v[i];
        const float rate = network == 0   ? a.rate0
                           : network == 1 ? a.rate1
                           : network == 2 ? a.rate2
                                          : a.rate3;
        const adam_state s = adam_step(adam_state(a.weights.v[i], a.m.v[i], a.v.v[i]),
                                       a.gradient.v[i], rate, a.root);
        a.weights.v[i] = s.p;
        a.m.v[i] = s.m;
        a.v.v[i] = s.v;
    } else if (i < VK_W_ALL + a.photos * VK_N_LOOK) {
        const uint photo = (i - VK_W_ALL) / VK_N_LOOK, k = (i - VK_W_ALL) % VK_N_LOOK;
        const uint at = photo * 3 * VK_N_LOOK + k, m = at + VK_N_LOOK, v = m + VK_N_LOOK;
        const adam_state s = adam_step(adam_state(a.looks.v[at], a.looks.v[m], a.looks.v[v]),
                                       photo == a.photo ? a.gradient.v[VK_W_ALL + k] : 0.0,
                                       a.rate4, a.root);
        a.looks.v[at] = s.p;
        a.looks.v[m] = s.m;
        a.looks.v[v] = s.v;
    }
}
