/* SPDX-License-Identifier: Apache-2.0 */
/* How often each digit occurs in each group's keys; digit by digit, so that their exclusive sums
 * are places. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "radix.glsl"

layout(local_size_x = VK_SORT_GROUP) in;
ARGUMENTS(radix_count);

void main()
{
    const uint count = a.count.v[0], groups = (count + VK_SORT - 1) / VK_SORT;
    const uint group = group_index();
    if (group >= groups)
        return;
    count_runs(a.keys, group * VK_SORT, count, a.shift);
    for (uint digit = gl_LocalInvocationID.x; digit < VK_DIGITS; digit += VK_SORT_GROUP) {
        uint sum = 0;
        for (uint k = 0; k < WORDS; k++)
            sum += sum_four(counters[digit][k]);
        a.digits.v[digit * groups + group] = sum;
    }
}
