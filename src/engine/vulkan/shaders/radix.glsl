/* SPDX-License-Identifier: Apache-2.0 */
/* A stable radix sort, 8 bits a pass: count, scan, scatter. Each invocation owns a run of keys and
 * a column of counters, a byte a digit, so that no step depends on the subgroup size. The odd
 * strides keep neighbours out of each other's banks of shared memory. */
#define RUN (VK_SORT / VK_SORT_GROUP) /* keys of an invocation: at most 255 */
#define WORDS (VK_SORT_GROUP / 4)     /* of the counters of a digit */

shared uint run_keys[VK_SORT_GROUP][RUN + 1];
shared uint counters[VK_DIGITS][WORDS + 1];

uint key_digit(uint key, uint shift)
{
    return key >> shift & (VK_DIGITS - 1);
}

/* The counts of a word. */
uint sum_four(uint four)
{
    return (four & 255) + (four >> 8 & 255) + (four >> 16 & 255) + (four >> 24);
}

/* Stages the group's keys, and counts the digits of each run. */
void count_runs(Uints keys, uint first, uint count, uint shift)
{
    const uint t = gl_LocalInvocationID.x;
    for (uint k = t; k < VK_DIGITS * WORDS; k += VK_SORT_GROUP)
        counters[k / WORDS][k % WORDS] = 0;
    for (uint k = t; k < VK_SORT && first + k < count; k += VK_SORT_GROUP)
        run_keys[k / RUN][k % RUN] = keys.v[first + k];
    barrier(); /* keys are staged and counters are 0 */
    for (uint k = 0; k < RUN && first + t * RUN + k < count; k++)
        atomicAdd(counters[key_digit(run_keys[t][k], shift)][t / 4], 1u << 8 * (t % 4));
    barrier(); /* all have counted */
}
