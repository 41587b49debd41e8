/* SPDX-License-Identifier: Apache-2.0 */
/* Noise on the positions, as sg_host_explore. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/explore.h"
#include "math/random.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(explore);

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    const float gate = explore_gate(a.params.v[param_at(a.planes, i, P_OPACITY)], a.gate, a.dead);
    if (!(gate > 0.0))
        return;
    const words key = words_of(a.key_low, a.key_high);
    const words first = words_multiply(words_of(i, 0), words_of(3, 0));
    float rot[4], scales[3], n[3], xyz[3];
    for (uint k = 0; k < 4; k++)
        rot[k] = a.params.v[param_at(a.planes, i, P_ROT + k)];
    for (uint k = 0; k < 3; k++) {
        xyz[k] = a.params.v[param_at(a.planes, i, k)];
        scales[k] = a.params.v[param_at(a.planes, i, P_SCALE + k)];
        const words place = words_add(first, words_of(k, 0));
        n[k] = a.amount * gate * random_normal(random_mix(words_add(key, place)));
    }
    explore_move(rot, scales, n, xyz);
    for (uint k = 0; k < 3; k++)
        a.params.v[param_at(a.planes, i, k)] = xyz[k];
}
