/* SPDX-License-Identifier: Apache-2.0 */
/* Multiply-adds in CHAINS chains, each of which waits for itself alone: what a device computes at
 * best, and with one chain, how well its threads hide that they wait. */
#version 460
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 256) in;
layout(constant_id = 1) const uint CHAINS = 8;
#define MOST_CHAINS 8
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Floats {
    float v[];
};
layout(push_constant) uniform Arguments
{
    Floats to;
    uint rounds;
    float factor, term;
}
a;

void main()
{
    float x[MOST_CHAINS], sum = 0.0;
    [[unroll]] for (uint k = 0; k < CHAINS; k++)
        x[k] = float(gl_LocalInvocationID.x + 256 * k); /* all different */
    for (uint i = 0; i < a.rounds; i++)
        [[unroll]] for (uint j = 0; j < 8; j++) /* so that the loop itself costs little */
            [[unroll]] for (uint k = 0; k < CHAINS; k++)
                x[k] = fma(x[k], a.factor, a.term);
    [[unroll]] for (uint k = 0; k < CHAINS; k++)
        sum += x[k];
    if (sum < 0.0) /* never, which compilers do not know */
        a.to.v[0] = sum;
}
