/* SPDX-License-Identifier: Apache-2.0 */
/* One tile, front to back: Kerbl et al. 2023, algorithm 2. */
#include "tile.h"

/* With the chain of math/pair.h the loop's only dependency from pair to pair is one multiplication.
 * t is its last value before the stop. */
struct part_state {
    real chain, t, r, g, b, depth;
};

SIMD void store_part(const struct cpu_raster_args *a, float *plane, int x0, int y0, int part,
                     real value)
{
    float lanes[LANES];
    r_store(lanes, value);
    for (int i = 0; i < LANES; i += BLOCK) {
        const int y = y0 + (part * LANES + i) / BLOCK;
        if (y >= a->height)
            break;
        float *row = plane + (size_t) y * (size_t) a->width + (size_t) x0;
        if (x0 + BLOCK <= a->width)
            memcpy(row, lanes + i, BLOCK * sizeof(float));
        else
            for (int x = 0; x0 + x < a->width; x++)
                row[x] = lanes[i + x];
    }
}

SIMD uint64_t draw(const struct cpu_raster_args *a, int tile, bool depth)
{
    const int x0 = tile % a->grid_x * SG_TILE, y0 = tile / a->grid_x * SG_TILE;
    const size_t first = a->tile_start[tile - a->first_tile],
                 end = a->tile_start[tile - a->first_tile + 1];
    struct part_state states[BLOCKS][PARTS];
    struct batch batch;
    uint64_t pairs = 0;
    for (int block = 0; block < BLOCKS; block++)
        for (int part = 0; part < PARTS; part++) {
            const real px = part_x(part) + (float) (x0 + block % 4 * BLOCK);
            const real py = part_y(part) + (float) (y0 + block / 4 * BLOCK);
            states[block][part] = (struct part_state){
                .chain = r_keep(part_inside(a, px, py), r_set(1)), .t = r_set(1)};
        }

    bool anyone = true;
    size_t reached = first;
    for (size_t at = first; at < end && anyone; at += BATCH) {
        const int count = end - at < BATCH ? (int) (end - at) : BATCH;
        batch_load(&batch, a, at, count);
        batch_find(&batch, count, x0, y0, a->block_mask + at);
        batch_list(&batch, a->block_mask + at, count);
        reached = at + (size_t) count;
        anyone = false;
        for (int block = 0; block < BLOCKS; block++)
            for (int part = 0; part < PARTS; part++) {
                struct part_state s = states[block][part];
                if (!m_any(chain_open(s.chain)))
                    continue;
                const real px = part_x(part) + (float) (x0 + block % 4 * BLOCK);
                const real py = part_y(part) + (float) (y0 + block / 4 * BLOCK);
                const uint8_t *list = batch.list[block];
                int i = 0;
                const int n = batch.length[block];
                while (i < n) {
                    struct pairs p;
                    pairs_eval(&p, &batch, list + i, px, py);
                    mask last[GROUP];
                    real weight[GROUP];
                    for (int u = 0; u < GROUP; u++) {
                        weight[u] = p.alpha[u] * s.chain;
                        s.chain = chain_next(s.chain, p.alpha[u]);
                        last[u] = chain_open(s.chain);
                        s.t = r_sel(last[u], s.chain, s.t);
                    }
                    for (int u = 0; u < GROUP; u++) {
                        s.r = r_fma_if(last[u], s.r, weight[u], r_set(p.splat[u]->r));
                        s.g = r_fma_if(last[u], s.g, weight[u], r_set(p.splat[u]->g));
                        s.b = r_fma_if(last[u], s.b, weight[u], r_set(p.splat[u]->b));
                        if (depth)
                            s.depth = r_fma_if(last[u], s.depth, weight[u], r_set(p.splat[u]->z));
                    }
                    i += GROUP;
                    if (!m_any(last[GROUP - 1]))
                        break;
                }
                pairs += (uint64_t) (i < n ? i : n) * LANES;
                states[block][part] = s;
                anyone |= m_any(chain_open(s.chain));
            }
    }

    a->tile_end[tile - a->first_tile] = (uint32_t) reached;
    const size_t plane = (size_t) a->width * (size_t) a->height;
    for (int block = 0; block < BLOCKS; block++)
        for (int part = 0; part < PARTS; part++) {
            const struct part_state *s = &states[block][part];
            const int bx = x0 + block % 4 * BLOCK, by = y0 + block / 4 * BLOCK;
            store_part(a, a->rgb, bx, by, part, s->r + s->t * a->background[0]);
            store_part(a, a->rgb + plane, bx, by, part, s->g + s->t * a->background[1]);
            store_part(a, a->rgb + 2 * plane, bx, by, part, s->b + s->t * a->background[2]);
            if (depth) {
                store_part(a, a->alpha, bx, by, part, 1 - s->t);
                store_part(a, a->depth, bx, by, part, s->depth);
            }
        }
    return pairs;
}

uint64_t KERNEL(raster)(const struct cpu_raster_args *a, int tile)
{
    return a->depth ? draw(a, tile, true) : draw(a, tile, false);
}
