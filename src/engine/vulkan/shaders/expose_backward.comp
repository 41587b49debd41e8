/* SPDX-License-Identifier: Apache-2.0 */
/* The gradient of the exposed render becomes that of the render, and the exposure's is summed over
 * groups of 256 pixels. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/exposure.h"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(expose_backward);

void main()
{
    const uint i = thread_index();
    const bool inside = i < a.pixels;
    float exposure[SG_EXPOSURE], shown[3], colour[3], moved[3];
    for (uint k = 0; k < SG_EXPOSURE; k++)
        exposure[k] = a.exposure.v[k];
    for (uint c = 0; c < 3; c++) {
        shown[c] = inside ? a.gradient.v[c * a.pixels + i] : 0.0;
        colour[c] = inside ? a.image.v[c * a.pixels + i] : 0.0;
    }
    sg_expose_backward(exposure, shown, moved);
    for (uint c = 0; c < 3 && inside; c++)
        a.gradient.v[c * a.pixels + i] = moved[c];
    for (uint k = 0; k < SG_EXPOSURE; k++) {
        const uint row = k / 4, c = k % 4;
        const float sum = group_sum(c < 3 ? colour[row] * shown[c] : shown[row]);
        if (gl_LocalInvocationID.x == 0 && inside) /* groups beyond the last pixel have no sums */
            a.sums.v[SG_EXPOSURE * group_index() + k] = sum;
    }
}
