/* SPDX-License-Identifier: Apache-2.0 */
/* Gradients of one chunk of a tile's list: VK_CHUNK instances.
 *
 * Front to back again: with q = colour . g and the prefix P_i = sum of alpha_j T_j q_j over j <= i,
 * the light behind splat i is image . g - P_i, so that dL/dalpha_i = T_i q_i - (image . g - P_i) /
 * (1 - alpha_i). A chunk begins with the state that the forward pass left there. All gradients of
 * position and conic are moments of w = opacity G dL/dalpha: summed about the tile's centre, and
 * moved to the splat's centre at the end. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "tile.glsl"
#include "rounds.glsl"
ARGUMENTS(raster_backward);

layout(constant_id = 2) const uint SLOT = VK_SLOT; /* or VK_SLOT_ABSOLUTE */

#define LN2 0.693147181
#define PARTS 4 /* of a block: its rows of 8 pixels */
#define ITEMS (VK_BLOCKS * ROWS * PARTS)
#define CENTRE (0.5 * (SG_TILE - 1))

shared float row_w[VK_BLOCKS][ROWS][ROW], row_weight[VK_BLOCKS][ROWS][ROW];
shared float parts[ITEMS][SLOT];
shared float sums[VK_BLOCKS][VK_BATCH][SLOT];
shared uint round_rows[2][VK_BLOCKS]; /* rows of a round and later ones; rounds take turns */
shared vec3 pull[256]; /* dL/dimage of block b, pixel q at 32 b + q */

/* An item of a round: a row of 8 pixels of a block, for one of its ROWS instances. */
struct row_item {
    uint part, row, block;
};
row_item item_of(uint item)
{
    return row_item(item % PARTS, item / PARTS % ROWS, item / (PARTS * ROWS));
}

/* Sums over the pixels of an item, of instance k of the batch; 32: none. */
void sum_absolute(uint item, uint k, vec2 corner)
{
    const row_item o = item_of(item);
    float sx = 0.0, sy = 0.0;
    if (k < 32) {
        const vec4 shape = batch_shape[k];
        const float down = batch_light[k].x,
                    dy = corner.y + float(o.block / 2 * 4 + o.part) - shape.y;
        for (uint p = 0; p < 8; p++) {
            const float w = row_w[o.block][o.row][8 * o.part + p];
            const float dx = corner.x + float(o.block % 2 * 8 + p) - shape.x;
            const float along = pair_along(dx, dy, shape.z, shape.w);
            sx += abs(pair_slope_x(w, along, shape.z));
            sy += abs(pair_slope_y(w, along, dy, shape.w, down));
        }
    }
    parts[item][SLOT - 2] = 2.0 * LN2 * sx;
    parts[item][SLOT - 1] = 2.0 * LN2 * sy;
}

void sum_moments(uint item)
{
    const row_item o = item_of(item);
    const float y = float(o.block / 2 * 4 + o.part) - CENTRE;
    float s0 = 0.0, s1 = 0.0, s2 = 0.0;
    for (uint k = 0; k < 8; k++) {
        const float w = row_w[o.block][o.row][8 * o.part + k];
        const float x = float(o.block % 2 * 8 + k) - CENTRE;
        s0 += w, s1 += w * x, s2 += w * x * x;
    }
    parts[item][0] = s0, parts[item][1] = s0 * y, parts[item][2] = s0 * y * y;
    parts[item][3] = s1, parts[item][4] = s1 * y, parts[item][5] = s2;
}

void sum_colours(uint item)
{
    const row_item o = item_of(item);
    vec3 colour = vec3(0.0);
    for (uint k = 0; k < 8; k++) {
        const uint q = 8 * o.part + k;
        colour += row_weight[o.block][o.row][q] * pull[32 * o.block + q];
    }
    parts[item][6] = colour.x, parts[item][7] = colour.y, parts[item][8] = colour.z;
}

void main()
{
    const uint unit = group_index(), t = gl_LocalInvocationID.x;
    if (unit >= a.chunk_start.v[a.tiles])
        return;
    const uint tile = a.units.v[unit * VK_UNIT + VK_UNIT_TILE];
    const uint x0 = (tile + a.first_tile) % a.grid_x * SG_TILE,
               y0 = (tile + a.first_tile) / a.grid_x * SG_TILE;
    const uint first = a.tile_start.v[tile] + (unit - a.chunk_start.v[tile]) * VK_CHUNK;
    const uint end = min(first + VK_CHUNK, a.tile_start.v[tile + 1]);
    const uint reached = min(end, a.reached.v[tile]); /* behind it no pixel sees anything */
    for (uint k = max(first, reached) + t; k < end; k += INVOCATIONS)
        for (uint j = 0; j < SLOT; j++)
            a.slots.v[a.instances.v[2 * k + 1] * SLOT + j] = 0.0;
    if (first >= reached)
        return;

    const uint plane = a.width * a.height, block = block_of();
    float chain[MOST_PIXELS], prefix[MOST_PIXELS], total[MOST_PIXELS];
    [[unroll]] for (uint p = 0; p < PIXELS; p++) {
        const uvec2 pixel = uvec2(x0, y0) + pixel_of(p);
        const uint q = 32 * block + t % LANES + p * LANES;
        const uint from = 4 * (unit * 256 + p * INVOCATIONS + t);
        chain[p] = prefix[p] = total[p] = 0.0;
        pull[q] = vec3(0.0);
        if (pixel.x < a.width && pixel.y < a.height) {
            const uint at = pixel.y * a.width + pixel.x;
            const vec3 g = vec3(a.gradient.v[at], a.gradient.v[plane + at],
                                a.gradient.v[2 * plane + at]);
            pull[q] = g;
            total[p] = g.x * a.image.v[at] + g.y * a.image.v[plane + at] +
                       g.z * a.image.v[2 * plane + at];
            prefix[p] = g.x * a.checkpoints.v[from] + g.y * a.checkpoints.v[from + 1] +
                        g.z * a.checkpoints.v[from + 2];
            chain[p] = a.checkpoints.v[from + 3];
        }
    }
    for (uint at = first; at < reached; at += VK_BATCH) {
        const uint n = min(reached - at, VK_BATCH);
        barrier(); /* all have left the last batch */
        if (t < VK_BLOCKS)
            batch_rows[t] = a.units.v[unit_at(unit, at - first) + t];
        [[unroll]] for (uint p = 0; p < STAGE_PASSES; p++) {
            const uint item = t + p * INVOCATIONS, k = item / STAGES;
            if (k < n)
                batch_stage(a.splats, a.instances.v[2 * (at + k)], k, item % STAGES);
        }
        barrier(); /* the batch is staged */
        const uint rounds = rounds_of();
        uint rest = batch_rows[block];
        for (uint round = 0; round < rounds; round++) {
            const uint list = rest; /* without the rows of earlier rounds */
            if (t % LANES == 0)
                round_rows[round % 2][block] = list;
            [[unroll]] for (uint p = 0; p < PIXELS; p++) {
                const vec2 pixel = vec2(uvec2(x0, y0) + pixel_of(p));
                const uint q = t % LANES + p * LANES;
                const vec3 g = pull[32 * block + q];
                uint todo = list;
                /* Without branches, which cost more: behind the end of the list it is any splat,
                 * also one of an earlier batch, and nothing of it counts. */
                for (uint row = 0; row < ROWS; row++) {
                    if (!with_part(VK_WITHOUT_PAIRS)) {
                        row_w[block][row][q] = row_weight[block][row][q] = 0.0;
                        todo &= todo - 1;
                        continue;
                    }
                    const uint k = findLSB(todo) & VK_BATCH - 1;
                    const pair o = pair_of(k, pixel.x, pixel.y);
                    const float before = chain[p], next = chain_next(before, o.alpha);
                    const bool counts = todo != 0 && chain_open(next) && o.alpha > 0.0;
                    const vec4 c = batch_colour[k];
                    const float light = pair_light(c.r, c.g, c.b, g.r, g.g, g.b);
                    const float weight = o.alpha * before, sum = prefix[p] + weight * light;
                    const float w = pair_gradient(o.raw, o.alpha, before, light, total[p] - sum);
                    chain[p] = todo != 0 ? next : before;
                    prefix[p] = counts ? sum : prefix[p];
                    row_w[block][row][q] = counts ? w : 0.0;
                    row_weight[block][row][q] = counts ? weight : 0.0;
                    todo &= todo - 1;
                }
                rest = todo;
            }
            barrier(); /* the pixels of the round are there */
            if (!with_part(VK_WITHOUT_SUMS))
                continue;
            /* Two halves of the workgroup, where it has so many invocations. */
            for (uint item = t; item < 2 * ITEMS; item += INVOCATIONS)
                if (item < ITEMS)
                    sum_moments(item);
                else
                    sum_colours(item - ITEMS);
            for (uint item = t; item < ITEMS && SLOT > VK_SLOT; item += INVOCATIONS) {
                const row_item o = item_of(item);
                sum_absolute(item, row_of(round_rows[round % 2][o.block], o.row), vec2(x0, y0));
            }
            barrier(); /* the parts are there, and the pixels read */
            for (uint item = t; item < VK_BLOCKS * ROWS * SLOT; item += INVOCATIONS) {
                const uint j = item % SLOT, of = item / SLOT, first_part = of * PARTS;
                const uint b = of / ROWS, k = row_of(round_rows[round % 2][b], of % ROWS);
                if (k < 32)
                    sums[b][k][j] = (parts[first_part][j] + parts[first_part + 1][j]) +
                                    (parts[first_part + 2][j] + parts[first_part + 3][j]);
            }
        }
        barrier(); /* the sums of all blocks are there */
        for (uint item = t; item < n * SLOT; item += INVOCATIONS) {
            const uint k = item / SLOT, j = item % SLOT;
            float s = 0.0;
            for (uint b = 0; b < VK_BLOCKS && with_part(VK_WITHOUT_SUMS); b++)
                if ((batch_rows[b] >> k & 1) != 0)
                    s += sums[b][k][j];
            if (!with_part(VK_WITHOUT_SUMS) && j == 0) /* something that depends on the pixels */
                s = row_w[k % VK_BLOCKS][0][k] + row_weight[k % VK_BLOCKS][0][k];
            parts[k][j] = s; /* of the batch: those of the rounds have been read */
        }
        barrier(); /* the sums of the instances are there */
        for (uint k = t; k < n; k += INVOCATIONS) {
            float all = 0.0;
            for (uint j = 0; j < SLOT; j++)
                all += parts[k][j];
            if (!with_part_of(VK_WITHOUT_SLOTS, all))
                continue;
            const float dx = float(x0) + CENTRE - batch_shape[k].x;
            const float dy = float(y0) + CENTRE - batch_shape[k].y;
            const uint to = a.instances.v[2 * (at + k) + 1] * SLOT;
            const float about[6] = float[6](parts[k][0], parts[k][1], parts[k][2], parts[k][3],
                                            parts[k][4], parts[k][5]);
            float moved[6];
            moments_move(about, dx, dy, moved);
            for (uint j = 0; j < 6; j++)
                a.slots.v[to + j] = moved[j];
            for (uint j = 6; j < SLOT; j++)
                a.slots.v[to + j] = parts[k][j];
        }
    }
}
