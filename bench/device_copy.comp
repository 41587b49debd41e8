/* SPDX-License-Identifier: Apache-2.0 */
/* Copies 16 bytes four times an invocation: what a device moves at best. */
#version 460
#extension GL_EXT_buffer_reference : require

#define GROUP 256
#define EACH 4

layout(local_size_x = GROUP) in;
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Vectors {
    uvec4 v[];
};
layout(push_constant) uniform Arguments
{
    Vectors from, to;
}
a;

void main()
{
    const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    const uint first = group * GROUP * EACH + gl_LocalInvocationID.x;
    for (uint k = 0; k < EACH; k++)
        a.to.v[first + k * GROUP] = a.from.v[first + k * GROUP];
}
