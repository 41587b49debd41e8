/* SPDX-License-Identifier: Apache-2.0 */
/* Moves keys and values to their places: those of a digit in the order in which they came. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "radix.glsl"

layout(local_size_x = VK_SORT_GROUP) in;
ARGUMENTS(radix_scatter);

void main()
{
    const uint count = a.count.v[0], groups = (count + VK_SORT - 1) / VK_SORT;
    const uint group = group_index(), t = gl_LocalInvocationID.x, first = group * VK_SORT;
    if (group >= groups)
        return;
    count_runs(a.keys, first, count, a.shift);
    uint digits[RUN]; /* of this run */
    [[unroll]] for (uint k = 0; k < RUN; k++)
        digits[k] = key_digit(run_keys[t][k], a.shift);
    [[unroll]] for (uint k = 0; k < RUN; k++) {
        if (first + t * RUN + k >= count)
            break;
        uint place = a.digits.v[digits[k] * groups + group];
        for (uint w = 0; w < t / 4; w++) /* keys of this digit in earlier runs */
            place += sum_four(counters[digits[k]][w]);
        place += sum_four(counters[digits[k]][t / 4] & (1u << 8 * (t % 4)) - 1);
        [[unroll]] for (uint earlier = 0; earlier < k; earlier++) /* and in this one */
            place += digits[earlier] == digits[k] ? 1 : 0;
        a.to_keys.v[place] = run_keys[t][k];
        a.to_values.v[place] = a.values.v[first + t * RUN + k];
    }
}
