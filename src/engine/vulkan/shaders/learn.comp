/* SPDX-License-Identifier: Apache-2.0 */
/* Splat gradients to parameter gradients to Adam. Where both are asked for, parameters and moments
 * are touched once, and the gradients never leave the registers. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/adam.h"
#include "math/sh.h"
#include "splat.glsl"
#include "view.glsl"

layout(local_size_x = VK_GROUP) in;
layout(constant_id = 1) const int DEGREE = 3;
const int COEFFICIENTS = (DEGREE + 1) * (DEGREE + 1);
const int PLANES = 11 + 3 * COEFFICIENTS; /* of the active degree: the others are not moved */
ARGUMENTS(learn);

#define PARAMS_MAX 59
#define AHEAD 4 /* slots that are loaded at once */

float shaped(uint i, int plane)
{
    return a.shaped.v[param_at(a.planes, i, plane)];
}

/* enum sg_group of a plane */
int group_of(int plane)
{
    return plane < P_OPACITY  ? 0
           : plane < P_SCALE  ? 1
           : plane < P_ROT    ? 2
           : plane < P_SH     ? 3
           : plane < P_SH + 3 ? 4
                              : 5;
}

/* Gradients of the parameters of a visible Gaussian, and the statistics of densification. */
void pull(uint i, out float g[PARAMS_MAX])
{
    float sums[VK_SLOT_ABSOLUTE], xyz[3], scales[3], rot[4], at_xyz[3], at_scale[3], at_rot[4];
    float dir[3], basis[16], weight[16], d[3], rgb[3];
    const bool banded = (a.what & VK_LEARN_BANDED) != 0;
    const uint first = banded ? i : a.slot_start.v[i], end = banded ? i + 1 : a.slot_start.v[i + 1];
    const bool absolute = (a.what & VK_LEARN_ABSOLUTE) != 0;
    const uint width = absolute ? VK_SLOT_ABSOLUTE : VK_SLOT;
    for (int j = 0; j < VK_SLOT_ABSOLUTE; j++)
        sums[j] = 0.0;
    uint k = first;
    /* A Gaussian of many tiles has one invocation: loads that do not wait for one another. */
    for (; k + AHEAD <= end; k += AHEAD) {
        float slots[AHEAD][VK_SLOT_ABSOLUTE];
        [[unroll]] for (uint s = 0; s < AHEAD; s++)
            [[unroll]] for (int j = 0; j < VK_SLOT_ABSOLUTE; j++) {
                const float slot = a.slots.v[(k + s) * width + min(uint(j), width - 1)];
                slots[s][j] = j < VK_SLOT || absolute ? slot : 0.0;
            }
        [[unroll]] for (uint s = 0; s < AHEAD; s++)
            [[unroll]] for (int j = 0; j < VK_SLOT_ABSOLUTE; j++)
                sums[j] += slots[s][j];
    }
    for (; k < end; k++)
        for (int j = 0; j < width; j++)
            sums[j] += a.slots.v[k * width + j];
    for (int k = 0; k < 3; k++) {
        xyz[k] = shaped(i, k);
        scales[k] = shaped(i, P_SCALE + k);
    }
    for (int k = 0; k < 4; k++)
        rot[k] = shaped(i, P_ROT + k);
    const pinhole v = view_load(a.view);
    splat s;
    projection p;
    project(v, xyz, scales, rot, s, p);
    const splat_grad o = splat_pull(s, sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]);
    if ((a.what & VK_LEARN_STATISTICS) != 0) {
        const bool beside = (a.what & VK_LEARN_BESIDE) != 0;
        const float gx = (absolute && !beside ? sums[9] : o.x) * v.half_w;
        const float gy = (absolute && !beside ? sums[10] : o.y) * v.half_h;
        if (beside)
            a.grad_absolute.v[i] += sums[9] * v.half_w + sums[10] * v.half_h;
        a.grad_sum.v[i] += sqrt(gx * gx + gy * gy);
        a.grad_count.v[i] += 1.0;
    }
    project_backward(v, p, s, o, at_xyz, at_scale, at_rot);
    g[P_OPACITY] = logit_pull(sums[0], shaped(i, P_OPACITY));
    const float inv = sh_direction(xyz, v.centre, dir);
    sh_basis(DEGREE, dir[0], dir[1], dir[2], basis);
    for (int ch = 0; ch < 3; ch++)
        rgb[ch] = colour_pull(a.splats.v[i * SPLAT + S_R + ch], sums[6 + ch]);
    for (int k = 0; k < 16; k++)
        weight[k] = 0.0;
    for (int k = 0; k < COEFFICIENTS; k++)
        for (int ch = 0; ch < 3; ch++) {
            weight[k] += rgb[ch] * shaped(i, P_SH + 3 * k + ch);
            g[P_SH + 3 * k + ch] = basis[k] * rgb[ch];
        }
    sh_direction_gradient(DEGREE, dir[0], dir[1], dir[2], weight, d);
    sh_direction_pull(d, dir, inv, at_xyz);
    for (int k = 0; k < 3; k++) {
        g[k] = at_xyz[k];
        g[P_SCALE + k] = at_scale[k];
    }
    for (int k = 0; k < 4; k++)
        g[P_ROT + k] = at_rot[k];
}

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    float g[PARAMS_MAX];
    for (int plane = 0; plane < PLANES; plane++)
        g[plane] = 0.0;
    if ((a.what & VK_LEARN_PULL) == 0)
        for (int plane = 0; plane < PLANES; plane++)
            g[plane] = a.gradients.v[param_at(a.planes, i, plane)];
    else if ((a.rects.v[2 * i + 1] & 0xffff) > 0 && with_part(VK_WITHOUT_GRADIENTS))
        pull(i, g);
    if ((a.what & VK_LEARN_ACCUMULATE) != 0)
        for (int plane = 0; plane < PLANES; plane++) {
            const uint at = param_at(a.planes, i, plane);
            g[plane] += a.accumulated.v[at];
            a.accumulated.v[at] = (a.what & VK_LEARN_ADAM) != 0 ? 0.0 : g[plane];
        }
    if ((a.what & VK_LEARN_STORE) != 0)
        for (int plane = 0; plane < PLANES; plane++)
            a.gradients.v[param_at(a.planes, i, plane)] = g[plane];
    if ((a.what & VK_LEARN_ADAM) == 0)
        return;
    float all = 0.0;
    for (int plane = 0; plane < PLANES; plane++)
        all += g[plane];
    if (!with_part_of(VK_WITHOUT_STEPS, all))
        return;
    const float mean_opacity = a.view.v[VK_VIEW + 12], mean_scale = a.view.v[VK_VIEW + 13];
    if (mean_opacity > 0.0) {
        const float o = 1.0 / (1.0 + exp(-a.params.v[param_at(a.planes, i, P_OPACITY)]));
        g[P_OPACITY] += mean_opacity / float(a.count) * (o * (1.0 - o));
    }
    if (mean_scale > 0.0)
        for (int plane = P_SCALE; plane < P_SCALE + 3; plane++)
            g[plane] +=
                mean_scale / (3.0 * float(a.count)) * exp(a.params.v[param_at(a.planes, i, plane)]);
    for (int plane = 0; plane < PLANES; plane++) {
        const int group = group_of(plane);
        const float rate = a.view.v[VK_VIEW + group], root = a.view.v[VK_VIEW + 6 + group];
        if (!(rate > 0.0))
            continue;
        const uint at = param_at(a.planes, i, plane);
        const adam_state s =
            adam_step(adam_state(a.params.v[at], a.m.v[at], a.v.v[at]), g[plane], rate, root);
        a.params.v[at] = s.p;
        a.m.v[at] = s.m;
        a.v.v[at] = s.v;
    }
}
