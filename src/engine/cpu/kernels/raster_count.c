/* SPDX-License-Identifier: Apache-2.0 */
/* The forward pass without colour: what each instance contributes to its tile. */
#include "tile.h"

SIMD uint64_t tally(const struct cpu_raster_args *a, int tile, enum sg_hit hit)
{
    const bool weigh = hit == SG_HIT_WEIGHT || hit == SG_HIT_TRANSMITTANCE;
    const int x0 = tile % a->grid_x * SG_TILE, y0 = tile / a->grid_x * SG_TILE;
    const size_t first = a->tile_start[tile - a->first_tile],
                 end = a->tile_start[tile - a->first_tile + 1];
    real chains[BLOCKS][PARTS]; /* of math/pair.h; 0 outside the image */
    struct batch batch;
    float weights[BATCH + 1];
    int32_t pixels[BATCH + 1];
    uint64_t pairs = 0;
    for (int block = 0; block < BLOCKS; block++)
        for (int part = 0; part < PARTS; part++) {
            const real px = part_x(part) + (float) (x0 + block % 4 * BLOCK);
            const real py = part_y(part) + (float) (y0 + block / 4 * BLOCK);
            chains[block][part] = r_keep(part_inside(a, px, py), r_set(1));
        }

    bool anyone = true;
    for (size_t at = first; at < end; at += BATCH) {
        const int count = end - at < BATCH ? (int) (end - at) : BATCH;
        memset(weights, 0, sizeof(weights));
        memset(pixels, 0, sizeof(pixels));
        if (anyone) {
            batch_load(&batch, a, at, count);
            batch_find(&batch, count, x0, y0, a->block_mask + at);
            batch_list(&batch, a->block_mask + at, count);
            anyone = false;
            for (int block = 0; block < BLOCKS; block++)
                for (int part = 0; part < PARTS; part++) {
                    real chain = chains[block][part];
                    if (!m_any(chain_open(chain)))
                        continue;
                    const real px = part_x(part) + (float) (x0 + block % 4 * BLOCK);
                    const real py = part_y(part) + (float) (y0 + block / 4 * BLOCK);
                    const uint8_t *list = batch.list[block];
                    const int n = batch.length[block];
                    int i = 0;
                    while (i < n) {
                        struct pairs p;
                        mask blended[GROUP], open = m_all;
                        real weight[GROUP];
                        pairs_eval(&p, &batch, list + i, px, py);
                        for (int u = 0; u < GROUP; u++) {
                            weight[u] = hit == SG_HIT_TRANSMITTANCE ? chain : p.alpha[u] * chain;
                            chain = chain_next(chain, p.alpha[u]);
                            open = chain_open(chain);
                            blended[u] = r_and(p.drawn[u], open);
                        }
                        /* Padding adds to the last one, which nobody reads. */
                        for (int u = 0; u < GROUP; u++)
                            if (weigh)
                                weights[list[i + u]] += r_sum(r_keep(blended[u], weight[u]));
                            else
                                pixels[list[i + u]] += __builtin_popcount(m_bits(blended[u]));
                        i += GROUP;
                        if (!m_any(open))
                            break;
                    }
                    pairs += (uint64_t) (i < n ? i : n) * LANES;
                    chains[block][part] = chain;
                    anyone |= m_any(chain_open(chain));
                }
        }
        for (int i = 0; i < count; i++)
            a->slots[a->instances[at + (size_t) i].slot] = weigh ? weights[i] : (float) pixels[i];
    }
    return pairs;
}

uint64_t KERNEL(raster_count)(const struct cpu_raster_args *a, int tile)
{
    return a->hit == SG_HIT_WEIGHT          ? tally(a, tile, SG_HIT_WEIGHT)
           : a->hit == SG_HIT_TRANSMITTANCE ? tally(a, tile, SG_HIT_TRANSMITTANCE)
                                            : tally(a, tile, SG_HIT_PIXELS);
}
