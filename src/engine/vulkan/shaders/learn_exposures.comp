/* SPDX-License-Identifier: Apache-2.0 */
/* A step of Adam of all exposures, as sg_host_learn_exposures. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/exposure.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(learn_exposures);

void main()
{
    const uint i = thread_index(), values = a.count * SG_EXPOSURE;
    if (i >= values || a.stop.v[0] != 0)
        return;
    const float g = i / SG_EXPOSURE == a.number ? a.gradient.v[i % SG_EXPOSURE] : 0.0;
    const float m = SG_ADAM_BETA1 * a.exposures.v[values + i] + (1.0 - SG_ADAM_BETA1) * g;
    const float v = SG_ADAM_BETA2 * a.exposures.v[2 * values + i] + (1.0 - SG_ADAM_BETA2) * g * g;
    a.exposures.v[values + i] = m;
    a.exposures.v[2 * values + i] = v;
    a.exposures.v[i] -= a.rate * m / (sqrt(v) * a.root + SG_EXPOSURE_EPS);
}
