/* SPDX-License-Identifier: Apache-2.0 */
#include "lists.h"

#include "core/vram.h"

/* Makes room for n words. */
static int words(struct gpu *g, struct gpu_buffer *b, uint64_t n)
{
    return sg_gpu_reserve(g, SG_MEM_INSTANCES, b, n * sizeof(uint32_t));
}

/* Address of the number of items of a kind of work. */
static VkDeviceAddress items(const struct gpu_lists *l, uint32_t item)
{
    return l->work.address + 4 * (item * VK_WORK_WORDS + VK_WORK_ITEMS);
}

int sg_gpu_scan(struct gpu *g, struct gpu_buffer *sums, const struct gpu_buffer *from,
                const struct gpu_buffer *to, VkDeviceAddress count, uint64_t most)
{
    const uint64_t groups = most ? gpu_groups(most, VK_SCAN) : 1; /* the sum of none is 0 */
    int code = words(g, sums, groups);
    const struct args_scan_sum args = {
        .from = from->address, .to = to->address, .sums = sums->address, .count = count};
    if (code || (code = sg_gpu_dispatch(g, GPU_scan_sum, 0, &args, sizeof(args), groups)))
        return code;
    return sg_gpu_dispatch(g, GPU_scan_apply, 0, &args, sizeof(args), groups);
}

/* The same, of as many words as a kind of work has items. groups: item with the workgroups, or
 * VK_WORKS: there are always `most` words. Of no item there is no workgroup and no sum of all. */
static int scan(struct gpu *g, struct gpu_lists *l, const struct gpu_buffer *from,
                const struct gpu_buffer *to, uint64_t most, uint32_t item, uint32_t groups)
{
    if (groups == VK_WORKS)
        return sg_gpu_scan(g, &l->sums, from, to, items(l, item), most);
    int code = words(g, &l->sums, gpu_groups(most, VK_SCAN));
    const struct args_scan_sum args = {
        .from = from->address, .to = to->address, .sums = l->sums.address, .count = items(l, item)};
    if (code ||
        (code = sg_gpu_dispatch_work(g, GPU_scan_sum, 0, &args, sizeof(args), &l->work, groups)))
        return code;
    return sg_gpu_dispatch_work(g, GPU_scan_apply, 0, &args, sizeof(args), &l->work, groups);
}

/* Sorts keys and their values by `bits` bits. Work: item `groups`, and `digits` of their counters;
 * *at: which of each pair holds them. */
static int sort(struct gpu *g, struct gpu_lists *l, struct gpu_buffer keys[2],
                struct gpu_buffer values[2], uint64_t most, uint32_t groups, uint32_t digits,
                int bits, int *at)
{
    const uint64_t counters = gpu_groups(most, VK_SORT) * VK_DIGITS;
    int code = words(g, &l->digits, counters + 1);
    for (int shift = 0; shift < bits && !code; shift += 8) {
        const int from = *at, to = 1 - from;
        code = GPU_RUN_WORK(g, radix_count, 0, &l->work, groups, .keys = keys[from].address,
                            .digits = l->digits.address, .count = items(l, groups),
                            .shift = (uint32_t) shift);
        if (!code)
            code = scan(g, l, &l->digits, &l->digits, counters, digits, digits);
        if (!code)
            code = GPU_RUN_WORK(g, radix_scatter, 0, &l->work, groups, .keys = keys[from].address,
                                .values = values[from].address, .digits = l->digits.address,
                                .to_keys = keys[to].address, .to_values = values[to].address,
                                .count = items(l, groups), .shift = (uint32_t) shift);
        *at = to;
    }
    return code;
}

/* Sizes of later work; total: what they come from. */
static int size(struct gpu *g, struct gpu_lists *l, uint32_t what, VkDeviceAddress total,
                uint32_t tiles)
{
    return GPU_RUN(g, size, 0, 1, .work = l->work.address, .stop = g->stop.address,
                   .results = l->results.address, .total = total, .most = l->most.address,
                   .what = what, .count = l->count, .tiles = tiles, .whole = l->band_count == 1,
                   .capacity = (uint32_t) l->capacity);
}

int sg_gpu_lists_learned(struct gpu *g, struct gpu_lists *l)
{
    return size(g, l, VK_SIZE_MOST, l->results.address, 0);
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
        (code = sg_gpu_reserve(g, SG_MEM_MISC, &l->results, VK_RESULTS * sizeof(uint32_t))) ||
        (code =
             sg_gpu_reserve(g, SG_MEM_MISC, &l->work, VK_WORKS * VK_WORK_WORDS * sizeof(uint32_t))))
        return code;
    if (!l->most.buffer && ((code = sg_gpu_reserve(g, SG_MEM_MISC, &l->most, 8)) ||
                            (code = sg_gpu_fill(g, &l->most, 0, 8, 0))))
        return code;
    code = sg_gpu_update(g, &l->work, items(l, VK_WORK_ALL) - l->work.address, &l->count,
                         sizeof(l->count));
    return code ? code : sg_gpu_fill(g, &l->results, 0, VK_RESULTS * sizeof(uint32_t), 0);
}

/* Tiles of a band that each Gaussian touches. Their sum counts once, for the whole image. */
static int count_tiles(struct gpu *g, struct gpu_lists *l, uint32_t first, uint32_t end)
{
    const bool whole = l->band_count == 0;
    return GPU_RUN(g, count, 0, FOR_EACH(l->count), .splats = l->splats->address,
                   .rects = l->rects.address, .counts = l->counts.address,
                   .results = whole ? l->results.address : g->none.address, .count = l->count,
                   .grid_x = l->grid_x, .first = first, .end = end,
                   .reference_tiles = l->reference_tiles);
}

/* Kernels count its instances in 32 bits: those of one tile are as many as Gaussians at most. */
static int add_band(sg_ctx *ctx, struct gpu_lists *l, struct gpu_band band)
{
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

/* Room for so many instances, and half as many again as long as most of the memory is free. */
static void make_room(const struct gpu *g, struct gpu_lists *l, uint64_t instances, uint64_t limit,
                      uint64_t each)
{
    const uint64_t roomy = instances + instances / 2, more = roomy < limit ? roomy : limit;
    const struct sg_vram *v = sg_ctx_vram(g->ctx);
    if (instances <= l->capacity)
        return;
    const bool fits = v->current[SG_MEM_TAGS] + (more - l->capacity) * each <= v->limit / 2;
    l->capacity = fits && more > instances ? more : instances;
}

/* Waits for the number of instances. */
static int cut(struct gpu *g, struct gpu_lists *l, uint64_t limit, uint64_t each, uint64_t *longest)
{
    uint32_t r[VK_RESULTS];
    uint64_t most = 0;
    *longest = 0;
    int code = sg_gpu_read(g, &l->results, 0, r, sizeof(r));
    if (code)
        return code;
    const uint64_t total = r[VK_RESULT_INSTANCES] | (uint64_t) r[VK_RESULT_INSTANCES + 1] << 32;
    if (total > limit)
        code = cut_bands(g, l, limit, longest);
    else
        code = add_band(g->ctx, l, (struct gpu_band){0, l->grid_x * l->grid_y, total});
    for (int i = 0; i < l->band_count; i++)
        most = l->bands[i].instances > most ? l->bands[i].instances : most;
    if (!code)
        make_room(g, l, most, limit, each);
    l->known = l->band_count > 1;
    return code;
}

int sg_gpu_lists_make(struct gpu *g, struct gpu_lists *l, const struct gpu_buffer *splats,
                      uint64_t max_instances, uint64_t each, uint64_t *longest)
{
    const uint32_t tiles = l->grid_x * l->grid_y, n = l->count;
    const uint64_t limit = max_instances < VK_MOST_INSTANCES ? max_instances : VK_MOST_INSTANCES;
    l->splats = splats;
    l->band = -1;
    l->band_count = 0;
    l->capacity = l->starved ? 0 : l->capacity;
    l->starved = false;
    int code;
    if ((code = words(g, &l->counts, (uint64_t) n + 1)) ||
        (code = words(g, &l->places, (uint64_t) n + 1)))
        return code;
    for (int k = 0; k < 2; k++)
        if ((code = words(g, &l->order[k], n)) || (code = words(g, &l->depths[k], n)))
            return code;
    l->sorted = 0;
    if ((code = count_tiles(g, l, 0, tiles)) ||
        (code = scan(g, l, &l->flags, &l->places, n, VK_WORK_ALL, VK_WORKS)) ||
        (code = size(g, l, VK_SIZE_DRAWN, l->places.address + 4 * (uint64_t) n, tiles)))
        return code;
    code = GPU_RUN(g, compact, 0, FOR_EACH(n), .flags = l->flags.address,
                   .places = l->places.address, .keys = l->keys.address,
                   .to_keys = l->depths[0].address, .to_values = l->order[0].address, .count = n);
    if (!code)
        code = sort(g, l, l->depths, l->order, n, VK_WORK_DRAWN_SORT, VK_WORK_DRAWN_DIGITS, 32,
                    &l->sorted);
    if (code)
        return code;
    code = l->known || !l->capacity || l->capacity > limit
               ? cut(g, l, limit, each, longest)
               : add_band(g->ctx, l, (struct gpu_band){0, tiles, l->capacity});
    return code;
}

/* Of the largest image. A unit has 4 floats for each of 256 pixels. */
#define MOST_TILES ((SG_SIDE_MAX / 16) * (SG_SIDE_MAX / 16))
_Static_assert((uint64_t) VK_MOST_INSTANCES *VK_SLOT_ABSOLUTE <= VK_MOST_INDEX &&
                   ((uint64_t) VK_MOST_INSTANCES / VK_CHUNK + MOST_TILES) * 1024 - 1 <=
                       VK_MOST_INDEX,
               "places of slots and checkpoints");

uint64_t sg_gpu_lists_units(const struct gpu_lists *l)
{
    const struct gpu_band *b = &l->bands[l->band];
    return l->capacity / VK_CHUNK + (b->end - b->first);
}

int sg_gpu_lists_band(struct gpu *g, struct gpu_lists *l, int band)
{
    if (l->band == band)
        return SG_OK;
    const struct gpu_band *b = &l->bands[band];
    const uint32_t tiles = b->end - b->first;
    const uint64_t m = l->capacity;
    int code = SG_OK, at = 0, bits = 0;
    l->band = -1;
    while (tiles >> bits) /* the number of tiles is a key too */
        bits++;
    if ((code = words(g, &l->tiles[0], m)) || (code = words(g, &l->values[0], m)) ||
        (code = words(g, &l->tiles[1], m)) || (code = words(g, &l->values[1], m)) ||
        (code = words(g, &l->slot_start, (uint64_t) l->count + 1)) ||
        (code = words(g, &l->emitted, 2 * m)) || (code = words(g, &l->instances, 2 * m)) ||
        (code = words(g, &l->tile_start, (uint64_t) tiles + 1)) ||
        (code = words(g, &l->chunks, tiles)) ||
        (code = words(g, &l->chunk_start, (uint64_t) tiles + 1))) {
        l->starved |= code < 0;
        return code;
    }
    if (l->band_count > 1)
        code = count_tiles(g, l, b->first, b->end);
    if (!code)
        code = scan(g, l, &l->counts, &l->slot_start, l->count, VK_WORK_ALL, VK_WORKS);
    if (!code)
        code =
            size(g, l, VK_SIZE_INSTANCES, l->slot_start.address + 4 * (uint64_t) l->count, tiles);
    if (!code)
        code = GPU_RUN_WORK(g, gather, 0, &l->work, VK_WORK_DRAWN, .from = l->counts.address,
                            .index = l->order[l->sorted].address, .to = l->places.address,
                            .count = items(l, VK_WORK_DRAWN));
    if (!code)
        code = scan(g, l, &l->places, &l->places, l->count, VK_WORK_DRAWN, VK_WORK_DRAWN_SCAN);
    if (!code)
        code = GPU_RUN_WORK(g, emit, 0, &l->work, VK_WORK_EMIT, .splats = l->splats->address,
                            .rects = l->rects.address, .order = l->order[l->sorted].address,
                            .places = l->places.address, .slot_start = l->slot_start.address,
                            .keys = l->tiles[0].address, .values = l->values[0].address,
                            .emitted = l->emitted.address, .count = items(l, VK_WORK_EMIT),
                            .grid_x = l->grid_x, .first = b->first, .end = b->end,
                            .reference_tiles = l->reference_tiles);
    if (!code)
        code = sort(g, l, l->tiles, l->values, m, VK_WORK_SORT, VK_WORK_DIGITS, bits, &at);
    if (!code)
        code =
            GPU_RUN_WORK(g, tile_start, 0, &l->work, VK_WORK_STARTS, .keys = l->tiles[at].address,
                         .values = l->values[at].address, .emitted = l->emitted.address,
                         .instances = l->instances.address, .tile_start = l->tile_start.address,
                         .count = items(l, VK_WORK_STARTS), .tiles = tiles);
    if (!code)
        code = GPU_RUN(g, tile_chunks, 0, FOR_EACH(tiles), .tile_start = l->tile_start.address,
                       .chunks = l->chunks.address, .results = l->results.address, .tiles = tiles);
    if (!code)
        code = scan(g, l, &l->chunks, &l->chunk_start, tiles, VK_WORK_TILES, VK_WORKS);
    if (!code)
        code = size(g, l, VK_SIZE_UNITS, l->chunk_start.address + 4 * (uint64_t) tiles, tiles);
    if (!code)
        l->band = band;
    l->starved |= code < 0;
    return code;
}

void sg_gpu_lists_clear(struct gpu *g, struct gpu_lists *l)
{
    struct gpu_buffer *owned[] = {
        &l->rects,      &l->keys,       &l->flags,     &l->results,     &l->order[0],
        &l->order[1],   &l->depths[0],  &l->depths[1], &l->counts,      &l->places,
        &l->slot_start, &l->tile_start, &l->chunks,    &l->chunk_start, &l->tiles[0],
        &l->tiles[1],   &l->values[0],  &l->values[1], &l->emitted,     &l->instances,
        &l->sums,       &l->digits,     &l->totals,    &l->work,        &l->most};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        sg_gpu_release(g, owned[i]);
    sg_free(l->bands);
    *l = (struct gpu_lists){.band = -1};
}
