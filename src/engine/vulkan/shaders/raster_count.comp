/* SPDX-License-Identifier: Apache-2.0 */
/* The forward pass without colour: what each instance contributes to its tile, one float a slot. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "tile.glsl"
#include "rounds.glsl"
ARGUMENTS(raster_count);

shared float rows[VK_BLOCKS][ROWS][ROW];
shared float sums[VK_BLOCKS][VK_BATCH];
shared uint open_pixels;

void main()
{
    const uint tile = group_index(), t = gl_LocalInvocationID.x, block = block_of();
    if (tile >= a.tiles)
        return;
    const uint x0 = (tile + a.first_tile) % a.grid_x * SG_TILE,
               y0 = (tile + a.first_tile) / a.grid_x * SG_TILE;
    const uint first = a.tile_start.v[tile], end = a.tile_start.v[tile + 1];
    float chain[MOST_PIXELS];
    [[unroll]] for (uint p = 0; p < PIXELS; p++) {
        const uvec2 at = uvec2(x0, y0) + pixel_of(p);
        chain[p] = at.x < a.width && at.y < a.height ? 1.0 : 0.0;
    }
    uint at = first;
    for (; at < end; at += VK_BATCH) {
        const uint n = min(end - at, VK_BATCH);
        barrier(); /* all have left the last batch, and read open_pixels */
        if (t < VK_BLOCKS)
            batch_rows[t] = 0;
        if (t == 0)
            open_pixels = 0;
        barrier(); /* lists are empty */
        batch_read(a.splats, a.instances, at, n, x0, y0);
        barrier(); /* the batch is staged */
        const uint rounds = rounds_of();
        uint rest = batch_rows[block];
        for (uint round = 0; round < rounds; round++) {
            const uint list = rest; /* without the rows of earlier rounds */
            [[unroll]] for (uint p = 0; p < PIXELS; p++) {
                const uvec2 pixel = uvec2(x0, y0) + pixel_of(p);
                uint todo = list;
                for (uint row = 0; row < ROWS; row++) {
                    float hit = 0.0;
                    if (todo != 0 && chain_open(chain[p])) {
                        const pair o = pair_of(findLSB(todo), float(pixel.x), float(pixel.y));
                        const float before = chain[p];
                        chain[p] = chain_next(before, o.alpha);
                        if (chain_open(chain[p]) && o.alpha > 0.0)
                            hit = a.hit == VK_HIT_WEIGHT          ? o.alpha * before
                                  : a.hit == VK_HIT_TRANSMITTANCE ? before
                                                                  : 1.0;
                    }
                    todo &= todo - 1;
                    rows[block][row][t % LANES + p * LANES] = hit;
                }
                rest = todo;
            }
            barrier(); /* the pixels of the round are there */
            for (uint item = t; item < VK_BLOCKS * ROWS; item += INVOCATIONS) {
                const uint b = item / ROWS, row = item % ROWS;
                const uint k = row_of(batch_rows[b], round * ROWS + row);
                float sum = 0.0;
                for (uint q = 0; q < VK_BLOCK_SIZE; q++)
                    sum += rows[b][row][q];
                if (k < 32)
                    sums[b][k] = sum;
            }
            barrier(); /* the pixels have been read, and the sums are there */
        }
        for (uint k = t; k < n; k += INVOCATIONS) {
            float sum = 0.0;
            for (uint b = 0; b < VK_BLOCKS; b++)
                if ((batch_rows[b] >> k & 1) != 0)
                    sum += sums[b][k];
            a.slots.v[a.instances.v[2 * (at + k) + 1]] = sum;
        }
        bool open = false;
        [[unroll]] for (uint p = 0; p < PIXELS; p++)
            open = open || chain_open(chain[p]);
        if (open)
            atomicOr(open_pixels, 1);
        barrier(); /* all have told whether they are open */
        if (open_pixels == 0) {
            at += n;
            break;
        }
    }
    for (uint k = min(at, end) + t; k < end; k += INVOCATIONS)
        a.slots.v[a.instances.v[2 * k + 1]] = 0.0;
}
