/* SPDX-License-Identifier: Apache-2.0 */
/* A step of an image up its total variation. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/total_variation.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(ascend);

void main()
{
    const uint i = thread_index(), pixels = a.width * a.height;
    if (i >= 3 * pixels)
        return;
    const uint at = i % pixels, x = at % a.width, y = at / a.width;
    const uint up = y > 0 ? a.width : 0, down = y + 1 < a.height ? a.width : 0;
    const uint left = x > 0 ? 1 : 0, right = x + 1 < a.width ? 1 : 0;
    const tv_pixels p =
        tv_pixels(a.from.v[i - up], a.from.v[i - up + right], a.from.v[i - left], a.from.v[i],
                  a.from.v[i + right], a.from.v[i + down - left], a.from.v[i + down]);
    float gradient = a.form == VK_TV_ISO ? tv_iso_gradient(p)
                                         : tv_sign_gradient(p, a.form == VK_TV_ANISO);
    if (a.more != 0 && a.magnitude.v[0] > 0.0) /* that of a flat image is 0 */
        gradient -= a.extra.v[i] * (a.weight / a.magnitude.v[0]);
    const float epsilon = a.bounded != 0 ? a.bound.v[at] : a.epsilon;
    a.to.v[i] = tv_step(p.here, gradient, a.size, a.photo.v[i], epsilon);
}
