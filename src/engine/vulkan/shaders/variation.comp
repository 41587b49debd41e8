/* SPDX-License-Identifier: Apache-2.0 */
/* The total variation in the forms that an attack raises, as sg_tv_planes. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/total_variation.h"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(variation);

void main()
{
    const uint i = thread_index(), pixels = a.width * a.height;
    const bool inside = i < 3 * pixels;
    float term = 0.0;
    if (inside) {
        const uint at = i % pixels;
        const float here = a.image.v[i];
        const float v = at / a.width + 1 < a.height ? a.image.v[i + a.width] - here : 0.0;
        const float h = at % a.width + 1 < a.width ? a.image.v[i + 1] - here : 0.0;
        term = a.form == VK_TV_VERTICAL2 ? 2.0 * tv_sign_term(v, h, false)
               : a.form == VK_TV_ANISO   ? tv_sign_term(v, h, true)
                                         : tv_iso_term(v, h);
    }
    const float sum = group_sum(term);
    if (gl_LocalInvocationID.x == 0 && inside) /* groups beyond the last value have no sums */
        a.sums.v[group_index()] = sum;
}
