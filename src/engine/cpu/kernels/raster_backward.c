/* SPDX-License-Identifier: Apache-2.0 */
/* Gradients of one tile's pixels with respect to its splats.
 *
 * The published code walks back to front. We walk front to back again: with q = colour . g and the
 * prefix P_i = sum of alpha_j T_j q_j over j <= i, the light behind splat i is image . g - P_i, so
 * that dL/dalpha_i = T_i q_i - (image . g - P_i) / (1 - alpha_i) needs no state from the forward
 * pass but the image, stops where it stopped, and covers the background. All gradients of position
 * and conic are moments of w = opacity G dL/dalpha: summed about the tile's centre, where they are
 * the same few functions of the pixel for every splat, and moved to the splat's centre once a
 * tile. */
#include "moments.h"

#define LN2 0.693147181f

struct part_state {
    real chain, prefix, total; /* chain: as in the forward pass */
    real g[3];
};

SIMD real load_part(const struct cpu_raster_args *a, const float *plane, int x0, int y0, int part)
{
    float lanes[LANES] = {0};
    for (int i = 0; i < LANES; i += BLOCK) {
        const int y = y0 + (part * LANES + i) / BLOCK;
        if (y >= a->height)
            break;
        const float *row = plane + (size_t) y * (size_t) a->width + (size_t) x0;
        if (x0 + BLOCK <= a->width)
            memcpy(lanes + i, row, BLOCK * sizeof(float));
        else
            for (int x = 0; x0 + x < a->width; x++)
                lanes[i + x] = row[x];
    }
    return r_load(lanes);
}

/* Moments about the tile's centre (x, y) to moments about the splat's. */
SIMD void store_slot(float *slot, const float *sums, const struct cpu_splat *s, float x, float y)
{
    const float dx = x - s->x, dy = y - s->y;
    moments_move(sums, dx, dy, slot);
    slot[6] = sums[6];
    slot[7] = sums[7];
    slot[8] = sums[8];
}

/* Adds to the sums of a group's splats those of the absolute slopes. */
SIMD void add_absolute(const struct pairs *p, const real *w, real px, real py, float (*sums)[SUMS],
                       const uint8_t *list)
{
    for (int u = 0; u < GROUP; u++) {
        const struct cpu_splat *s = p->splat[u];
        const real dy = py - s->y, along = pair_along(px - s->x, dy, s->across, s->shear);
        sums[list[u]][9] += r_sum(r_abs(pair_slope_x(w[u], along, s->across)));
        sums[list[u]][10] += r_sum(r_abs(pair_slope_y(w[u], along, dy, s->shear, s->down)));
    }
}

SIMD uint64_t backward(const struct cpu_raster_args *a, int tile, const bool absolute)
{
    const int x0 = tile % a->grid_x * SG_TILE, y0 = tile / a->grid_x * SG_TILE;
    const size_t first = a->tile_start[tile - a->first_tile],
                 end = a->tile_start[tile - a->first_tile + 1];
    const size_t plane = (size_t) a->width * (size_t) a->height;
    struct part_state states[BLOCKS][PARTS];
    struct batch batch;
    _Alignas(64) float sums[BATCH + 1][SUMS]; /* the last row takes the padding */
    uint64_t pairs = 0;
    if (first == end)
        return 0;
    for (int block = 0; block < BLOCKS; block++)
        for (int part = 0; part < PARTS; part++) {
            const int bx = x0 + block % 4 * BLOCK, by = y0 + block / 4 * BLOCK;
            struct part_state *s = &states[block][part];
            *s = (struct part_state){0};
            for (int ch = 0; ch < 3; ch++) {
                s->g[ch] = load_part(a, a->gradient + (size_t) ch * plane, bx, by, part);
                s->total += s->g[ch] * load_part(a, a->rgb + (size_t) ch * plane, bx, by, part);
            }
            s->chain = r_keep(part_inside(a, part_x(part) + (float) bx, part_y(part) + (float) by),
                              r_set(1));
        }

    bool anyone = true;
    size_t at = first;
    /* The forward pass has written block masks up to here. */
    const size_t reached = a->tile_end[tile - a->first_tile];
    for (; at < reached && anyone; at += BATCH) {
        const int count = reached - at < BATCH ? (int) (reached - at) : BATCH;
        batch_load(&batch, a, at, count);
        batch_list(&batch, a->block_mask + at, count);
        memset(sums, 0, sizeof(sums[0]) * (size_t) count);
        anyone = false;
        for (int block = 0; block < BLOCKS; block++)
            for (int part = 0; part < PARTS; part++) {
                struct part_state s = states[block][part];
                if (!m_any(chain_open(s.chain)))
                    continue;
                const real px = part_x(part) + (float) (x0 + block % 4 * BLOCK);
                const real py = part_y(part) + (float) (y0 + block / 4 * BLOCK);
                const uint8_t *list = batch.list[block];
                struct window window;
                window_make(&window, s.g, block, part);
                int i = 0;
                const int n = batch.length[block];
                while (i < n) {
                    struct pairs p;
                    pairs_eval(&p, &batch, list + i, px, py);
                    /* Values that depend on the pair before come first, so that the pairs are
                     * independent in the long part below. */
                    mask last[GROUP];
                    real t[GROUP], weight[GROUP], q[GROUP], behind[GROUP], w[GROUP];
                    for (int u = 0; u < GROUP; u++) {
                        t[u] = s.chain;
                        s.chain = chain_next(t[u], p.alpha[u]);
                        last[u] = chain_open(s.chain);
                    }
                    for (int u = 0; u < GROUP; u++) {
                        const struct cpu_splat *splat = p.splat[u];
                        weight[u] = r_keep(last[u], p.alpha[u] * t[u]);
                        q[u] = pair_light(splat->r, splat->g, splat->b, s.g[0], s.g[1], s.g[2]);
                    }
                    for (int u = 0; u < GROUP; u++) {
                        s.prefix = s.prefix + weight[u] * q[u];
                        behind[u] = s.total - s.prefix;
                    }
                    for (int u = 0; u < GROUP; u++)
                        w[u] = r_keep(r_and(last[u], p.drawn[u]),
                                      pair_gradient(p.raw[u], p.alpha[u], t[u], q[u], behind[u]));
                    window_add(&window, w, weight, sums, list + i);
                    if (absolute)
                        add_absolute(&p, w, px, py, sums, list + i);
                    i += GROUP;
                    if (!m_any(last[GROUP - 1]))
                        break;
                }
                pairs += (uint64_t) (i < n ? i : n) * LANES;
                states[block][part] = s;
                anyone |= m_any(chain_open(s.chain));
            }
        for (int i = 0; i < count; i++) {
            float *slot = a->slots + (size_t) a->instances[at + (size_t) i].slot * CPU_SLOT_FLOATS;
            store_slot(slot, sums[i], &batch.splats[i], (float) x0 - centred(0),
                       (float) y0 - centred(0));
            if (absolute)
                slot[9] = 2 * LN2 * sums[i][9], slot[10] = 2 * LN2 * sums[i][10];
        }
    }
    /* What is behind everything no pixel sees. */
    for (at = at < reached ? at : reached; at < end; at++)
        memset(a->slots + (size_t) a->instances[at].slot * CPU_SLOT_FLOATS, 0,
               CPU_SLOT_FLOATS * sizeof(float));
    return pairs;
}

uint64_t KERNEL(raster_backward)(const struct cpu_raster_args *a, int tile)
{
    return backward(a, tile, false);
}

uint64_t KERNEL(raster_backward_absolute)(const struct cpu_raster_args *a, int tile)
{
    return backward(a, tile, true);
}
