/* SPDX-License-Identifier: Apache-2.0 */
/* From how near the cameras see each Gaussian. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/mip.h"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(mip_depth);

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    float xyz[3], camera[SG_MIP_CAMERA], least = MIP_UNSEEN;
    for (uint k = 0; k < 3; k++)
        xyz[k] = a.params.v[param_at(a.planes, i, k)];
    for (uint c = 0; c < a.views; c++) {
        for (uint k = 0; k < SG_MIP_CAMERA; k++)
            camera[k] = a.cameras.v[c * SG_MIP_CAMERA + k];
        const float depth = mip_depth(camera, xyz, a.margin);
        if (depth > 0.0 && depth < least)
            least = depth;
    }
    a.depths.v[i] = least;
    if (least < MIP_UNSEEN) /* bits of positive floats are in the order of the floats */
        atomicMax(a.most.v[0], floatBitsToUint(least));
}
