/* SPDX-License-Identifier: Apache-2.0 */
/* A step of Adam of all anchors: an invocation has one value. Anchors that drew nothing move on by
 * their momentum. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/adam.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(anchors_learn);

void main()
{
    const uint at = thread_index(), value = at / 16 % VK_A_VALUES;
    const uint i = at / 16 / VK_A_VALUES * 16 + at % 16;
    if (i >= a.count || a.stop.v[0] != 0)
        return;
    const float g = (a.exists.v[i] & ~VK_A_SEEN) != 0 ? a.gradient.v[at] : 0.0;
    if (value < 3) {
        const uint p = param_at(14, i, P_SCALE + value);
        const adam_state s = adam_step(adam_state(a.params.v[p], a.m.v[p], a.v.v[p]), g,
                                       a.rate_scale, a.root_scale);
        a.params.v[p] = s.p;
        a.m.v[p] = s.m;
        a.v.v[p] = s.v;
        return;
    }
    const uint plane = value - 3, p = param_at(VK_A_PLANES, i, plane);
    const bool offset = plane < VK_A_FEATURE, feature = !offset && plane < VK_A_SIZE;
    const adam_state s =
        adam_step(adam_state(a.anchors.v[p], a.anchor_m.v[p], a.anchor_v.v[p]), g,
                  offset ? a.rate_offset : feature ? a.rate_feature : a.rate_scale,
                  offset ? a.root_offset : feature ? a.root_feature : a.root_scale);
    a.anchors.v[p] = s.p;
    a.anchor_m.v[p] = s.m;
    a.anchor_v.v[p] = s.v;
}
