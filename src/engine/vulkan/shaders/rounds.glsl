/* SPDX-License-Identifier: Apache-2.0 */
/* Sums over the pixels of a tile without atomics, in an order that nothing but the lists decides.
 * Blocks walk their lists in step, ROWS instances a round: every pixel leaves its numbers in
 * shared memory, then the invocations turn and each sums the pixels of a row. */
#define ROWS 4                  /* instances of each block in a round */
#define ROW (VK_BLOCK_SIZE + 1) /* its pixels, at an odd stride: rows begin in other banks */

/* The list of a block without its first rows: clears the `n` lowest bits that are set. */
uint without_first(uint list, uint n)
{
    for (uint k = 0; k < n && list != 0; k++)
        list &= list - 1;
    return list;
}

/* Number of the row-th instance of a list; 32: there is none. */
uint row_of(uint list, uint row)
{
    const uint rest = without_first(list, row);
    return rest != 0 ? findLSB(rest) : 32;
}

/* Rounds that the longest list of the batch needs; the same for all invocations. */
uint rounds_of()
{
    uint most = 0;
    for (uint block = 0; block < VK_BLOCKS; block++)
        most = max(most, bitCount(batch_rows[block]));
    return (most + ROWS - 1) / ROWS;
}
