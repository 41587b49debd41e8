/* SPDX-License-Identifier: Apache-2.0 */
/* The stage of Mip-Splatting's 3D filter between parameters and projection, and its gradient. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/mip.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(mip_shape);

void main()
{
    const uint i = thread_index();
    if (i >= a.count || !(a.filters.v[i] > 0.0))
        return;
    const float log_filter = log(a.filters.v[i]);
    const uint opacity_at = param_at(a.planes, i, P_OPACITY);
    const float logit = a.params.v[opacity_at];
    float scales[3], values[3];
    for (uint k = 0; k < 3; k++) {
        const uint at = param_at(a.planes, i, P_SCALE + k);
        scales[k] = a.params.v[at];
        values[k] = a.to.v[at];
    }
    a.to.v[opacity_at] =
        a.back == 0 ? mip_draw(scales, logit, log_filter, values)
                    : mip_draw_backward(scales, logit, log_filter, values, a.to.v[opacity_at]);
    for (uint k = 0; k < 3; k++)
        a.to.v[param_at(a.planes, i, P_SCALE + k)] = values[k];
}
