/* SPDX-License-Identifier: Apache-2.0 */
/* The render with the exposure of its photo. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/exposure.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(expose);

void main()
{
    const uint i = thread_index();
    if (i >= a.pixels)
        return;
    float exposure[SG_EXPOSURE], colour[3], shown[3];
    for (uint k = 0; k < SG_EXPOSURE; k++)
        exposure[k] = a.exposure.v[k];
    for (uint c = 0; c < 3; c++)
        colour[c] = a.image.v[c * a.pixels + i];
    sg_expose(exposure, colour, shown);
    for (uint c = 0; c < 3; c++)
        a.exposed.v[c * a.pixels + i] = shown[c];
}
