/* SPDX-License-Identifier: Apache-2.0 */
/* The 3D filter's standard deviations, from the depths of mip_depth. Where no camera sees any
 * Gaussian they stay. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/mip.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(mip_filter);

void main()
{
    const uint i = thread_index();
    const float most = a.depths.v[a.count];
    if (i < a.count && most > 0.0)
        a.filters.v[i] = mip_filter(r_min(a.depths.v[i], most), a.focal, a.pixels);
}
