/* SPDX-License-Identifier: Apache-2.0 */
#include "lists.h"

/* Makes room for n words. */
static int words(struct gpu *g, struct gpu_buffer *b, uint64_t n)
{
    return sg_gpu_reserve(g, SG_MEM_INSTANCES, b, n * sizeof(uint32_t));
}

/* Exclusive sums of n words of `from`, n + 1 to `to`. They may be the same buffer. */
static int scan(struct gpu *g, struct gpu_lists *l, const struct gpu_buffer *from,
                const struct gpu_buffer *to, uint64_t n)
{
    const uint64_t groups = gpu_groups(n, VK_SCAN);
    int code = words(g, &l->sums, groups);
    const struct args_scan_sum args = {
        .from = from->address, .to = to->address, .sums = l->sums.address, .count = (uint32_t) n};
    if (!code)
        code = sg_gpu_dispatch(g, GPU_scan_sum, 0, &args, sizeof(args), groups);
    if (!code)
        code = sg_gpu_dispatch(g, GPU_scan_spine, 0, &args, sizeof(args), 1);
    return code ? code : sg_gpu_dispatch(g, GPU_scan_apply, 0, &args, sizeof(args), groups);
}

/* Sorts n keys and their values by `bits` bits; *at: which of each pair holds them. */
static int sort(struct gpu *g, struct gpu_lists *l, struct gpu_buffer keys[2],
                struct gpu_buffer values[2], uint64_t n, int bits, int *at)
{
    const uint64_t groups = gpu_groups(n, VK_SORT);
    int code = words(g, &l->digits, groups * VK_DIGITS + 1);
    for (int shift = 0; shift < bits && n && !code; shift += 8) {
        const int from = *at, to = 1 - from;
        code = GPU_RUN(g, radix_count, 0, groups, .keys = keys[from].address,
                       .digits = l->digits.address, .count = (uint32_t) n,
                       .groups = (uint32_t) groups, .shift = (uint32_t) shift);
        if (!code)
            code = scan(g, l, &l->digits, &l->digits, groups * VK_DIGITS);
        if (!code)
            code = GPU_RUN(g, radix_scatter, 0, groups, .keys = keys[from].address,
                           .values = values[from].address, .digits = l->digits.address,
                           .to_keys = keys[to].address, .to_values = values[to].address,
                           .count = (uint32_t) n, .groups = (uint32_t) groups,
                           .shift = (uint32_t) shift);
        *at = to;
    }
    return code;
}

int sg_gpu_lists_begin(struct gpu *g, struct gpu_lists *l, size_t count, int width, int height,
                       bool reference_tiles)
{
    l->grid_x = ((uint32_t) width + 15) / 16, l->grid_y = ((uint32_t) height + 15) / 16;
    l->count = (uint32_t) count;
    l->reference_tiles = reference_tiles;
    l->band = -1;
    l->band_count = 0;
    int code;
    if ((code = sg_gpu_reserve(g, SG_MEM_SPLATS, &l->rects, 8 * count)) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &l->keys, 4 * count)) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &l->flags, 4 * (count + 1))) ||
        (code = sg_gpu_reserve(g, SG_MEM_MISC, &l->results, VK_RESULTS * sizeof(uint32_t))))
        return code;
    return sg_gpu_fill(g, &l->results, 0, VK_RESULTS * sizeof(uint32_t), 0);
}

/* Tiles of a band that each Gaussian touches. */
static int count_tiles(struct gpu *g, struct gpu_lists *l, uint32_t first, uint32_t end)
{
    return GPU_RUN(g, count, 0, FOR_EACH(l->count), .splats = l->splats->address,
                   .rects = l->rects.address, .counts = l->counts.address,
                   .results = l->results.address, .count = l->count, .grid_x = l->grid_x,
                   .first = first, .end = end, .reference_tiles = l->reference_tiles);
}

static int add_band(sg_ctx *ctx, struct gpu_lists *l, struct gpu_band band)
{
    if (band.instances > UINT32_MAX)
        return sg_fail(ctx, SG_ERR_BUDGET,
                       "render: one tile has %llu instances, at most %u are supported",
                       (unsigned long long) band.instances, UINT32_MAX);
    if (sg_grow(ctx, SG_MEM_INSTANCES, &l->bands, &l->cap_bands, (size_t) l->band_count + 1,
                (size_t) l->band_count, sizeof(*l->bands)))
        return SG_ERR_BUDGET;
    l->bands[l->band_count++] = band;
    return SG_OK;
}

static int cut_bands(struct gpu *g, struct gpu_lists *l, uint64_t limit, uint64_t *max_tile)
{
    const uint32_t tiles = l->grid_x * l->grid_y;
    uint32_t *totals = sg_alloc_raw(g->ctx, SG_MEM_INSTANCES, tiles, sizeof(*totals));
    int code = totals ? words(g, &l->totals, tiles) : SG_ERR_BUDGET;
    if (!code)
        code = sg_gpu_fill(g, &l->totals, 0, 4 * (uint64_t) tiles, 0);
    if (!code)
        code = GPU_RUN(g, tile_totals, 0, FOR_EACH(l->count), .splats = l->splats->address,
                       .rects = l->rects.address, .totals = l->totals.address, .count = l->count,
                       .grid_x = l->grid_x, .tiles = tiles, .reference_tiles = l->reference_tiles);
    if (!code)
        code = sg_gpu_read(g, &l->totals, 0, totals, 4 * (uint64_t) tiles);
    for (uint32_t tile = 0; tile < tiles && !code;) {
        struct gpu_band band = {tile, tile, 0};
        while (band.end < tiles &&
               (band.end == tile || band.instances + totals[band.end] <= limit)) {
            *max_tile = totals[band.end] > *max_tile ? totals[band.end] : *max_tile;
            band.instances += totals[band.end++];
        }
        code = add_band(g->ctx, l, band);
        tile = band.end;
    }
    sg_free(totals);
    return code;
}

int sg_gpu_lists_make(struct gpu *g, struct gpu_lists *l, const struct gpu_buffer *splats,
                      uint64_t max_instances, struct sg_render_stats *stats)
{
    const uint32_t tiles = l->grid_x * l->grid_y, n = l->count;
    uint32_t r[VK_RESULTS];
    l->splats = splats;
    int code;
    if ((code = words(g, &l->counts, (uint64_t) n + 1)) ||
        (code = words(g, &l->places, (uint64_t) n + 1)) || (code = count_tiles(g, l, 0, tiles)))
        return code;
    code = scan(g, l, &l->flags, &l->places, n);
    if (!code)
        code = sg_gpu_copy(g, &l->places, 4 * (uint64_t) n, &l->results, 4 * VK_RESULT_DRAWN, 4);
    if (!code)
        code = sg_gpu_read(g, &l->results, 0, r, sizeof(r));
    if (code)
        return code;
    const uint64_t total = r[VK_RESULT_INSTANCES] | (uint64_t) r[VK_RESULT_INSTANCES + 1] << 32;
    *stats = (struct sg_render_stats){.visible = r[VK_RESULT_VISIBLE], .instances = total};
    l->drawn = r[VK_RESULT_DRAWN];
    for (int k = 0; k < 2; k++)
        if ((code = words(g, &l->order[k], l->drawn)) || (code = words(g, &l->depths[k], l->drawn)))
            return code;
    l->sorted = 0;
    code = GPU_RUN(g, compact, 0, FOR_EACH(n), .flags = l->flags.address,
                   .places = l->places.address, .keys = l->keys.address,
                   .to_keys = l->depths[0].address, .to_values = l->order[0].address, .count = n);
    if (!code)
        code = sort(g, l, l->depths, l->order, l->drawn, 32, &l->sorted);
    const uint64_t limit = max_instances < UINT32_MAX ? max_instances : UINT32_MAX;
    if (!code && total > limit)
        code = cut_bands(g, l, limit, &stats->max_tile);
    else if (!code)
        code = add_band(g->ctx, l, (struct gpu_band){0, tiles, total});
    stats->bands = (uint32_t) l->band_count;
    return code;
}

uint64_t sg_gpu_lists_units(const struct gpu_lists *l)
{
    const struct gpu_band *b = &l->bands[l->band];
    return b->instances / VK_CHUNK + (b->end - b->first);
}

int sg_gpu_lists_band(struct gpu *g, struct gpu_lists *l, int band)
{
    if (l->band == band)
        return SG_OK;
    const struct gpu_band *b = &l->bands[band];
    const uint32_t tiles = b->end - b->first;
    const uint64_t m = b->instances;
    int code = SG_OK, at = 0, bits = 0;
    l->band = -1;
    while (tiles >> bits) /* the number of tiles is a key too */
        bits++;
    for (int k = 0; k < 2; k++)
        if ((code = words(g, &l->tiles[k], m)) || (code = words(g, &l->values[k], m)))
            return code;
    if ((code = words(g, &l->slot_start, (uint64_t) l->count + 1)) ||
        (code = words(g, &l->emitted, 2 * m)) || (code = words(g, &l->instances, 2 * m)) ||
        (code = words(g, &l->tile_start, (uint64_t) tiles + 1)) ||
        (code = words(g, &l->chunks, tiles)) ||
        (code = words(g, &l->chunk_start, (uint64_t) tiles + 1)))
        return code;
    if (l->band_count > 1)
        code = count_tiles(g, l, b->first, b->end);
    if (!code)
        code = scan(g, l, &l->counts, &l->slot_start, l->count);
    if (!code)
        code = GPU_RUN(g, gather, 0, FOR_EACH(l->drawn), .from = l->counts.address,
                       .index = l->order[l->sorted].address, .to = l->places.address,
                       .count = l->drawn);
    if (!code)
        code = scan(g, l, &l->places, &l->places, l->drawn);
    if (!code)
        code = GPU_RUN(g, emit, 0, FOR_EACH(l->drawn), .splats = l->splats->address,
                       .rects = l->rects.address, .order = l->order[l->sorted].address,
                       .places = l->places.address, .slot_start = l->slot_start.address,
                       .keys = l->tiles[0].address, .values = l->values[0].address,
                       .emitted = l->emitted.address, .count = l->drawn, .grid_x = l->grid_x,
                       .first = b->first, .end = b->end, .reference_tiles = l->reference_tiles);
    if (!code)
        code = sort(g, l, l->tiles, l->values, m, bits, &at);
    if (!code)
        code = GPU_RUN(g, tile_start, 0, FOR_EACH(m + 1), .keys = l->tiles[at].address,
                       .values = l->values[at].address, .emitted = l->emitted.address,
                       .instances = l->instances.address, .tile_start = l->tile_start.address,
                       .count = (uint32_t) m, .tiles = tiles);
    if (!code)
        code = GPU_RUN(g, tile_chunks, 0, FOR_EACH(tiles), .tile_start = l->tile_start.address,
                       .chunks = l->chunks.address, .results = l->results.address, .tiles = tiles);
    if (!code)
        code = scan(g, l, &l->chunks, &l->chunk_start, tiles);
    if (!code)
        l->band = band;
    return code;
}

void sg_gpu_lists_clear(struct gpu *g, struct gpu_lists *l)
{
    struct gpu_buffer *owned[] = {
        &l->rects,     &l->keys,        &l->flags,    &l->results,  &l->order[0],   &l->order[1],
        &l->depths[0], &l->depths[1],   &l->counts,   &l->places,   &l->slot_start, &l->tile_start,
        &l->chunks,    &l->chunk_start, &l->tiles[0], &l->tiles[1], &l->values[0],  &l->values[1],
        &l->emitted,   &l->instances,   &l->sums,     &l->digits,   &l->totals};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        sg_gpu_release(g, owned[i]);
    sg_free(l->bands);
    *l = (struct gpu_lists){.band = -1};
}
