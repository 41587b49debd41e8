/* SPDX-License-Identifier: Apache-2.0 */
/* The factor of each direction's coefficients in the gradient: that of their energy E_b in the loss
 * is (ln P_b + H) / (S ln B). The host computes the loss itself, in double precision. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sums.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(spectrum_factors);

void main()
{
    const uint b = gl_LocalInvocationID.x;
    const float energy = b < a.bins ? a.energy.v[b] : 0.0;
    const float total = group_sum(energy);
    const bool none = !(total > a.least); /* rounding of a flat image */
    const float share = none ? 0.0 : energy / total;
    const float entropy = group_sum(share > 0.0 ? -share * log(share) : 0.0);
    a.factors.v[b] = none || b >= a.bins ? 0.0
                                         : a.weight * (log(r_max(share, 1e-12)) + entropy) /
                                               (total * log(float(a.bins)));
}
