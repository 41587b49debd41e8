/* SPDX-License-Identifier: Apache-2.0 */
/* What every kernel begins with. Buffers are read by address; an address that a kernel does not
 * use is still valid, for drivers load before they know. */
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_control_flow_attributes : require
#include "args.h"

/* Planes of a Gaussian's parameters, as SG_P_* of the host. */
#define P_OPACITY 3
#define P_SCALE 4
#define P_ROT 7
#define P_SH 11

layout(buffer_reference, std430, buffer_reference_align = 4) buffer Floats {
    float v[];
};
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Uints {
    uint v[];
};

#define ARG_POINTER(type, name) type name;
#define ARG_UINT(name) uint name;
#define ARG_FLOAT(name) float name;
#define ARGUMENTS(kernel)                                                                          \
    layout(push_constant) uniform Arguments                                                        \
    {                                                                                              \
        ARGS_##kernel(ARG_POINTER, ARG_UINT, ARG_FLOAT)                                            \
    }                                                                                              \
    a

#include "math/real_glsl.h"

#include "math/constants.h"

layout(constant_id = 3) const uint WITHOUT = 0;

bool with_part(uint part)
{
    return (WITHOUT & part) == 0;
}
/* The same for what is done with `value`. No value is as large, but compilers do not know that, and
 * compute it although nothing is done with it. */
bool with_part_of(uint part, float value)
{
    return with_part(part) || value > 1e30;
}

/* Workgroups are folded into two dimensions: some devices have 65535 in one. */
uint group_index()
{
    return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}
/* Of a kernel with workgroups of VK_GROUP. */
uint thread_index()
{
    return group_index() * VK_GROUP + gl_LocalInvocationID.x;
}

/* Place of a plane of Gaussian i, as sg_param_index. */
uint param_at(uint planes, uint i, uint plane)
{
    return (i / 16) * planes * 16 + plane * 16 + i % 16;
}

/* Adds to a number of two words; integers, so that the order of the additions does not matter. */
#define ADD_WIDE(results, place, amount)                                                           \
    do {                                                                                           \
        uint amount_ = (amount), old_ = atomicAdd((results).v[place], amount_);                    \
        if (old_ + amount_ < old_)                                                                 \
            atomicAdd((results).v[(place) + 1], 1);                                                \
    } while (false)
