/* SPDX-License-Identifier: Apache-2.0 */
/* The sum over the 256 invocations of a workgroup, in a fixed order. */
shared float tree[256];

float group_sum(float value)
{
    const uint k = gl_LocalInvocationID.x;
    barrier(); /* an earlier call may still be reading */
    tree[k] = value;
    barrier(); /* all values are there */
    for (uint half_way = 128; half_way > 0; half_way /= 2) {
        if (k < half_way)
            tree[k] += tree[k + half_way];
        barrier(); /* the next level reads what all have written */
    }
    return tree[0];
}
