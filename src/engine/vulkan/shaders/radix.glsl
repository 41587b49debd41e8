/* SPDX-License-Identifier: Apache-2.0 */
/* A stable radix sort, 8 bits a pass: count, scan, scatter. Each invocation owns a run of keys and
 * a column of counters, a byte a digit, so that no step depends on the subgroup size. */
#define RUN (VK_SORT / VK_SORT_GROUP) /* keys of an invocation: at most 255 */
#define WORDS (VK_SORT_GROUP / 4)     /* of the counters of a digit */

shared uint run_keys[VK_SORT];
shared uint counters[VK_DIGITS][WORDS];

uint key_digit(uint key, uint shift)
{
    return key >> shift & (VK_DIGITS - 1);
}

/* Stages the group's keys, and counts the digits of each run. */
void count_runs(Uints keys, uint first, uint count, uint shift)
{
    const uint t = gl_LocalInvocationID.x;
    for (uint k = t; k < VK_DIGITS * WORDS; k += VK_SORT_GROUP)
        counters[k / WORDS][k % WORDS] = 0;
    for (uint k = t; k < VK_SORT && first + k < count; k += VK_SORT_GROUP)
        run_keys[k] = keys.v[first + k];
    barrier(); /* keys are staged and counters are 0 */
    for (uint k = t * RUN; k < (t + 1) * RUN && first + k < count; k++)
        atomicAdd(counters[key_digit(run_keys[k], shift)][t / 4], 1u << 8 * (t % 4));
    barrier(); /* all have counted */
}
