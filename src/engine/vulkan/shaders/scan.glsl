/* SPDX-License-Identifier: Apache-2.0 */
/* Exclusive sums within a workgroup of VK_GROUP invocations (Hillis and Steele 1986). */
shared uint scan_sums[2][VK_GROUP];

/* Returns the sum of the values of all invocations before this one; *all is that of all. Every
 * invocation of the workgroup calls it. */
uint group_scan(uint value, out uint all)
{
    const uint k = gl_LocalInvocationID.x;
    int from = 0;
    barrier(); /* an earlier call may still be reading */
    scan_sums[0][k] = value;
    barrier(); /* all values are there */
    for (uint step = 1; step < VK_GROUP; step *= 2) {
        scan_sums[1 - from][k] =
            scan_sums[from][k] + (k >= step ? scan_sums[from][k - step] : 0);
        from = 1 - from;
        barrier(); /* the next step reads what all have written */
    }
    all = scan_sums[from][VK_GROUP - 1];
    return scan_sums[from][k] - value;
}
