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
    for (uint k = t * RUN; k < (t + 1) * RUN && first + k < count; k++) {
        const uint key = run_keys[k], digit = key_digit(key, a.shift);
        uint place = a.digits.v[digit * groups + group];
        for (uint w = 0; w <= t / 4; w++) { /* keys of this digit in earlier runs */
            const uint four = w < t / 4 ? counters[digit][w]
                                        : counters[digit][w] & ((1u << 8 * (t % 4)) - 1);
            place += (four & 255) + (four >> 8 & 255) + (four >> 16 & 255) + (four >> 24);
        }
        for (uint earlier = t * RUN; earlier < k; earlier++) /* and in this one */
            place += key_digit(run_keys[earlier], a.shift) == digit ? 1 : 0;
        a.to_keys.v[place] = key;
        a.to_values.v[place] = a.values.v[first + k];
    }
}
