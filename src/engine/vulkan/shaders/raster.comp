/* SPDX-License-Identifier: Apache-2.0 */
/* One tile, front to back: Kerbl et al. 2023, algorithm 2. Every VK_CHUNK instances each pixel
 * leaves its state, from which the backward pass goes on. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "tile.glsl"
ARGUMENTS(raster);

shared uint open_pixels, rows_walked;

/* Something that depends on all that a pixel has. */
float light_of(vec3 colour, float more)
{
    return colour.x + colour.y + colour.z + more;
}

void main()
{
    const uint tile = group_index(), t = gl_LocalInvocationID.x;
    if (tile >= a.tiles)
        return;
    const uint x0 = (tile + a.first_tile) % a.grid_x * SG_TILE,
               y0 = (tile + a.first_tile) / a.grid_x * SG_TILE;
    const uint first = a.tile_start.v[tile], end = a.tile_start.v[tile + 1];
    const uint first_unit = a.chunk_start.v[tile];
    for (uint unit = first_unit + t; unit < a.chunk_start.v[tile + 1]; unit += INVOCATIONS)
        a.units.v[unit * VK_UNIT + VK_UNIT_TILE] = tile;
    float chain[MOST_PIXELS], left[MOST_PIXELS], depth[MOST_PIXELS];
    vec3 colour[MOST_PIXELS];
    uint rows = 0;
    [[unroll]] for (uint p = 0; p < PIXELS; p++) {
        const uvec2 at = uvec2(x0, y0) + pixel_of(p);
        chain[p] = at.x < a.width && at.y < a.height ? 1.0 : 0.0;
        left[p] = 1.0, depth[p] = 0.0, colour[p] = vec3(0.0);
    }
    if (t == 0)
        rows_walked = 0;
    uint at = first;
    for (; at < end; at += VK_BATCH) {
        const uint n = min(end - at, VK_BATCH);
        if ((at - first) % VK_CHUNK == 0) {
            const uint chunk = first_unit + (at - first) / VK_CHUNK;
            [[unroll]] for (uint p = 0; p < PIXELS; p++) {
                if (!with_part_of(VK_WITHOUT_WRITES, light_of(colour[p], chain[p])))
                    continue;
                const uint to = 4 * (chunk * 256 + p * INVOCATIONS + t);
                a.checkpoints.v[to] = colour[p].x;
                a.checkpoints.v[to + 1] = colour[p].y;
                a.checkpoints.v[to + 2] = colour[p].z;
                a.checkpoints.v[to + 3] = chain[p];
            }
        }
        barrier(); /* all have left the last batch, and read open_pixels */
        if (t < VK_BLOCKS)
            batch_rows[t] = 0;
        if (t == 0)
            open_pixels = 0;
        barrier(); /* lists are empty */
        batch_read(a.splats, a.instances, at, n, x0, y0);
        barrier(); /* the batch is staged */
        if (t < VK_BLOCKS)
            a.units.v[unit_at(first_unit, at - first) + t] = batch_rows[t];
        const uint list = batch_rows[block_of()];
        bool open = false;
        [[unroll]] for (uint p = 0; p < PIXELS; p++) {
            const vec2 pixel = vec2(uvec2(x0, y0) + pixel_of(p));
            float c = chain[p];
            /* Without branches: a pair that the pixel does not see adds zeros. */
            const bool walks = chain_open(c) && with_part(VK_WITHOUT_PAIRS);
            for (uint todo = walks ? list : 0; todo != 0;) {
                const uint k = findLSB(todo);
                const float alpha = pair_of(k, pixel.x, pixel.y).alpha;
                const float weight = alpha * c;
                const vec4 colour_depth = batch_colour[k];
                c = chain_next(c, alpha);
                const bool sees = chain_open(c);
                const float seen = sees ? weight : 0.0;
                colour[p] += seen * colour_depth.xyz;
                depth[p] += seen * colour_depth.w;
                left[p] = sees ? c : left[p];
                todo = sees ? todo & todo - 1 : 0;
            }
            chain[p] = c;
            open = open || chain_open(c);
        }
        if (t % LANES == 0)
            rows += bitCount(list);
        if (open)
            atomicOr(open_pixels, 1);
        barrier(); /* all have told whether they are open */
        if (open_pixels == 0) {
            at += n;
            break;
        }
    }
    if (rows > 0)
        atomicAdd(rows_walked, rows);
    [[unroll]] for (uint p = 0; p < PIXELS; p++) {
        const uvec2 pixel = uvec2(x0, y0) + pixel_of(p);
        if (pixel.x >= a.width || pixel.y >= a.height ||
            !with_part_of(VK_WITHOUT_WRITES, light_of(colour[p], left[p] + depth[p])))
            continue;
        const uint to = pixel.y * a.width + pixel.x, plane = a.width * a.height;
        a.image.v[to] = colour[p].x + left[p] * a.background_r;
        a.image.v[plane + to] = colour[p].y + left[p] * a.background_g;
        a.image.v[2 * plane + to] = colour[p].z + left[p] * a.background_b;
        if (a.auxiliary != 0) {
            a.alpha.v[to] = 1.0 - left[p];
            a.depth.v[to] = depth[p];
        }
    }
    barrier(); /* all have added their rows */
    if (t == 0) {
        a.reached.v[tile] = min(at, end);
        ADD_WIDE(a.results, VK_RESULT_PAIRS, rows_walked * VK_BLOCK_SIZE);
    }
}
