/* SPDX-License-Identifier: Apache-2.0 */
#include "bin.h"

#include <stdatomic.h>
#include <string.h>

#include "math/real_f32.h"

#include "math/tiles.h"

#define CHUNK 4096 /* Gaussians a piece of work, in index order */
/* pieces of the sorted order; fixed, so that nothing depends on the number of threads */
#define ORDER_CHUNKS 16
#define AHEAD 16 /* entries of the order to prefetch: they point all over the model */
#define RADIX_BITS 11
#define RADIX (1 << RADIX_BITS)

/* First and end tile of row ty that a splat touches, within its rectangle. One function for
 * counting and emitting. */
static void __attribute__((noinline))
row_tiles(const struct bins *b, const struct cpu_splat *s, const struct ellipse *e, int ty, int x0,
          int x1, int *first, int *end)
{
    *first = x0, *end = x1;
    if (b->reference_tiles)
        return;
    const float top = (float) (ty * SG_TILE) - s->y;
    const struct row_span span = ellipse_row_span(*e, top, top + (SG_TILE - 1));
    if (!span.hit) {
        *end = x0;
        return;
    }
    const struct cell_range cells = row_span_cells(span, s->x, SG_TILE, (float) x0, (float) x1);
    const int c0 = (int) cells.first, c1 = (int) cells.end;
    *first = c0, *end = c1 > c0 ? c1 : c0;
}

/* Runs the last argument for each tile of splat i in the job's band, in row-major order, with
 * `tile` its index. Of large rectangles, rows outside the band are not walked over. */
#define EACH_TILE(job, i, tile, ...)                                                               \
    do {                                                                                           \
        const struct bins *b_ = (job)->b;                                                          \
        const struct cpu_extent *e_ = &b_->extents[i];                                             \
        const int width_ = e_->x1 - e_->x0;                                                        \
        if (e_->tiles) {                                                                           \
            const uint32_t row_ = (1u << width_) - 1;                                              \
            int first_ = e_->y0 * b_->grid_x + e_->x0;                                             \
            for (uint32_t left_ = e_->tiles; left_; left_ >>= width_, first_ += b_->grid_x)        \
                for (uint32_t bits_ = left_ & row_; bits_; bits_ &= bits_ - 1) {                   \
                    const int tile = first_ + __builtin_ctz(bits_);                                \
                    if (tile >= (job)->first && tile < (job)->end) {                               \
                        __VA_ARGS__;                                                               \
                    }                                                                              \
                }                                                                                  \
        } else if (width_ > 0) {                                                                   \
            const struct cpu_splat *s_ = &b_->splats[i];                                           \
            const struct ellipse el_ = {s_->slope, s_->reach, s_->taper, s_->ymax, s_->yright};    \
            const int y0_ = e_->y0 > (job)->low ? e_->y0 : (job)->low;                             \
            const int y1_ = e_->y1 < (job)->high ? e_->y1 : (job)->high;                           \
            for (int ty_ = y0_; ty_ < y1_; ty_++) {                                                \
                int first_, end_;                                                                  \
                row_tiles(b_, s_, &el_, ty_, e_->x0, e_->x1, &first_, &end_);                      \
                for (int tx_ = first_; tx_ < end_; tx_++) {                                        \
                    const int tile = ty_ * b_->grid_x + tx_;                                       \
                    if (tile >= (job)->first && tile < (job)->end) {                               \
                        __VA_ARGS__;                                                               \
                    }                                                                              \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
    } while (0)

/* Depth order: least significant digit first, stable, on the bits of the depth above the near
 * limit. */
static uint32_t depth_key(float z)
{
    const float near = SG_Z_MIN;
    uint32_t bits, base;
    memcpy(&bits, &z, 4);
    memcpy(&base, &near, 4);
    return bits - base;
}

struct sort_job {
    struct bins *b;
    const struct bin_entry *from;
    struct bin_entry *to;
    int shift;
    size_t *chunk_start; /* of the drawn splats of each index chunk */
    size_t n;
    atomic_uint_least64_t visible;
};

static size_t order_begin(size_t n, size_t chunk)
{
    return n * chunk / ORDER_CHUNKS;
}

static void count_drawn(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct sort_job *j = arg;
    const size_t end = (chunk + 1) * CHUNK < j->b->count ? (chunk + 1) * CHUNK : j->b->count;
    size_t n = 0;
    uint64_t visible = 0;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        n += j->b->extents[i].x1 > j->b->extents[i].x0;
        visible += j->b->extents[i].x1 > 0;
    }
    j->b->chunk_start[chunk] = n;
    atomic_fetch_add_explicit(&j->visible, visible, memory_order_relaxed);
}

static void list_drawn(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct sort_job *j = arg;
    const size_t end = (chunk + 1) * CHUNK < j->b->count ? (chunk + 1) * CHUNK : j->b->count;
    struct bin_entry *to = j->to + j->b->chunk_start[chunk];
    for (size_t i = chunk * CHUNK; i < end; i++)
        if (j->b->extents[i].x1 > j->b->extents[i].x0)
            *to++ = (struct bin_entry){depth_key(j->b->splats[i].z), (uint32_t) i};
}

static void count_digits(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct sort_job *j = arg;
    uint32_t *h = j->b->digits + chunk * RADIX;
    memset(h, 0, RADIX * sizeof(*h));
    for (size_t i = order_begin(j->n, chunk); i < order_begin(j->n, chunk + 1); i++)
        h[j->from[i].key >> j->shift & (RADIX - 1)]++;
}

static void place_digits(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct sort_job *j = arg;
    uint32_t *h = j->b->digits + chunk * RADIX;
    for (size_t i = order_begin(j->n, chunk); i < order_begin(j->n, chunk + 1); i++)
        j->to[h[j->from[i].key >> j->shift & (RADIX - 1)]++] = j->from[i];
}

/* Turns the counts per chunk and key into the place of each chunk's first element of each key.
 * start: `keys` + 1 numbers, set to the first place of each key. */
static void place_counts(uint32_t *counts, size_t keys, size_t stride, uint32_t *start)
{
    memset(start, 0, (keys + 1) * sizeof(*start));
    for (size_t c = 0; c < ORDER_CHUNKS; c++)
        for (size_t k = 0; k < keys; k++)
            start[k + 1] += counts[c * stride + k];
    for (size_t k = 0; k < keys; k++)
        start[k + 1] += start[k];
    /* Leaves the end of each key in `start`, which is the first place of the next one. */
    for (size_t c = 0; c < ORDER_CHUNKS; c++)
        for (size_t k = 0; k < keys; k++) {
            const uint32_t n = counts[c * stride + k];
            counts[c * stride + k] = start[k];
            start[k] += n;
        }
    memmove(start + 1, start, keys * sizeof(*start));
    start[0] = 0;
}

static int sort_by_depth(sg_ctx *ctx, struct bins *b)
{
    const size_t chunks = (b->count + CHUNK - 1) / CHUNK;
    struct sort_job j = {.b = b};
    if (sg_grow(ctx, SG_MEM_INSTANCES, &b->chunk_start, &b->cap_chunks, chunks, 0,
                sizeof(size_t)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->digits, &b->cap_digits, ORDER_CHUNKS * RADIX, 0,
                sizeof(uint32_t)))
        return SG_ERR_BUDGET;
    sg_parallel_for(ctx, chunks, count_drawn, &j);
    size_t sum = 0;
    for (size_t c = 0; c < chunks; c++) {
        const size_t n = b->chunk_start[c];
        b->chunk_start[c] = sum;
        sum += n;
    }
    b->drawn = j.n = sum;
    b->visible = j.visible;
    if (!sum)
        return SG_OK;
    if (sg_grow(ctx, SG_MEM_INSTANCES, &b->order, &b->cap_order, sum, 0, sizeof(*b->order)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->order_swap, &b->cap_swap, sum, 0, sizeof(*b->order)))
        return SG_ERR_BUDGET;
    j.to = b->order;
    sg_parallel_for(ctx, chunks, list_drawn, &j);
    for (j.shift = 0; j.shift < 32; j.shift += RADIX_BITS) {
        uint32_t start[RADIX + 1];
        j.from = b->order, j.to = b->order_swap;
        sg_parallel_for(ctx, ORDER_CHUNKS, count_digits, &j);
        place_counts(b->digits, RADIX, RADIX, start);
        const uint32_t first = j.from[0].key >> j.shift & (RADIX - 1);
        if (start[first + 1] - start[first] == j.n) /* all alike */
            continue;
        sg_parallel_for(ctx, ORDER_CHUNKS, place_digits, &j);
        struct bin_entry *swap = b->order;
        b->order = b->order_swap, b->order_swap = swap;
        const size_t cap = b->cap_order;
        b->cap_order = b->cap_swap, b->cap_swap = cap;
    }
    return SG_OK;
}

struct tile_job {
    struct bins *b;
    size_t tiles;   /* of the whole image */
    int first, end; /* of the band */
    int low, high;  /* its rows */
};

static void count_tiles(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct tile_job *j = arg;
    uint32_t *h = j->b->histogram + chunk * j->tiles;
    memset(h + j->first, 0, (size_t) (j->end - j->first) * sizeof(*h));
    for (size_t k = order_begin(j->b->drawn, chunk); k < order_begin(j->b->drawn, chunk + 1); k++) {
        const uint32_t i = j->b->order[k].splat;
        if (k + AHEAD < j->b->drawn)
            __builtin_prefetch(&j->b->extents[j->b->order[k + AHEAD].splat]);
        EACH_TILE(j, i, tile, h[tile]++);
    }
}

static int cut_bands(sg_ctx *ctx, struct bins *b, size_t tiles, uint64_t limit)
{
    b->band_count = 0;
    for (size_t tile = 0; tile < tiles;) {
        uint64_t sum = b->tile_total[tile];
        size_t end = tile + 1;
        while (end < tiles && sum + b->tile_total[end] <= limit)
            sum += b->tile_total[end++];
        if (sum > UINT32_MAX)
            return sg_fail(ctx, SG_ERR_BUDGET,
                           "render: one tile has %llu instances, at most %u are supported",
                           (unsigned long long) sum, UINT32_MAX);
        if (sg_grow(ctx, SG_MEM_INSTANCES, &b->bands, &b->cap_bands, (size_t) b->band_count + 1,
                    (size_t) b->band_count, sizeof(*b->bands)))
            return SG_ERR_BUDGET;
        b->bands[b->band_count++] = (struct bin_band){(int) tile, (int) end};
        tile = end;
    }
    return SG_OK;
}

int sg_bins_begin(sg_ctx *ctx, struct bins *b, size_t count, int width, int height,
                  bool reference_tiles)
{
    b->grid_x = (width + SG_TILE - 1) / SG_TILE, b->grid_y = (height + SG_TILE - 1) / SG_TILE;
    b->reference_tiles = reference_tiles;
    b->count = count;
    b->band = -1;
    return sg_grow(ctx, SG_MEM_SPLATS, &b->extents, &b->cap_extents, count, 0, sizeof(*b->extents));
}

int sg_bins_make(sg_ctx *ctx, struct bins *b, const struct cpu_splat *splats,
                 uint64_t max_instances)
{
    const size_t tiles = (size_t) b->grid_x * (size_t) b->grid_y;
    b->splats = splats;
    b->placed = false;
    b->total = b->max_tile = 0;
    if (sg_grow(ctx, SG_MEM_INSTANCES, &b->histogram, &b->cap_histogram, tiles * ORDER_CHUNKS, 0,
                sizeof(uint32_t)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->tile_total, &b->cap_total, tiles, 0, sizeof(uint64_t)) ||
        sort_by_depth(ctx, b))
        return SG_ERR_BUDGET;
    struct tile_job tile_job = {.b = b, .tiles = tiles, .end = (int) tiles, .high = b->grid_y};
    sg_parallel_for(ctx, ORDER_CHUNKS, count_tiles, &tile_job);
    memset(b->tile_total, 0, tiles * sizeof(*b->tile_total));
    for (size_t c = 0; c < ORDER_CHUNKS; c++)
        for (size_t t = 0; t < tiles; t++)
            b->tile_total[t] += b->histogram[c * tiles + t];
    for (size_t t = 0; t < tiles; t++) {
        b->total += b->tile_total[t];
        b->max_tile = b->tile_total[t] > b->max_tile ? b->tile_total[t] : b->max_tile;
    }
    return cut_bands(ctx, b, tiles, max_instances < UINT32_MAX ? max_instances : UINT32_MAX);
}

static void count_slots(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct tile_job *j = arg;
    struct bins *b = j->b;
    const bool whole = b->band_count == 1;
    const size_t end = (chunk + 1) * CHUNK < b->count ? (chunk + 1) * CHUNK : b->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        uint32_t n = 0;
        if (whole && b->extents[i].tiles)
            n = (uint32_t) __builtin_popcount(b->extents[i].tiles);
        else
            EACH_TILE(j, i, tile, n++);
        b->slot_start[i] = n;
    }
}

static void emit(void *arg, size_t chunk, int thread)
{
    (void) thread;
    struct tile_job *j = arg;
    struct bins *b = j->b;
    uint32_t *cursor = b->histogram + chunk * j->tiles;
    for (size_t k = order_begin(b->drawn, chunk); k < order_begin(b->drawn, chunk + 1); k++) {
        const uint32_t i = b->order[k].splat;
        if (k + AHEAD < b->drawn) {
            __builtin_prefetch(&b->extents[b->order[k + AHEAD].splat]);
            __builtin_prefetch(&b->slot_start[b->order[k + AHEAD].splat]);
        }
        uint32_t slot = b->slot_start[i];
        EACH_TILE(j, i, tile, b->instances[cursor[tile]++] = (struct cpu_instance){i, slot++});
    }
}

int sg_bins_band(sg_ctx *ctx, struct bins *b, int band)
{
    if (b->band == band)
        return SG_OK;
    const size_t tiles = (size_t) b->grid_x * (size_t) b->grid_y;
    const struct bin_band range = b->bands[band];
    const size_t band_tiles = (size_t) (range.end - range.first);
    uint64_t total = 0;
    for (int t = range.first; t < range.end; t++)
        total += b->tile_total[t];
    struct tile_job job = {.b = b,
                           .tiles = tiles,
                           .first = range.first,
                           .end = range.end,
                           .low = range.first / b->grid_x,
                           .high = (range.end - 1) / b->grid_x + 1};
    if (b->placed) /* perhaps those of this band, if memory was short after an earlier one */
        sg_parallel_for(ctx, ORDER_CHUNKS, count_tiles, &job);
    b->band = -1;
    if (sg_grow(ctx, SG_MEM_INSTANCES, &b->slot_start, &b->cap_slots, b->count + 1, 0,
                sizeof(uint32_t)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->tile_start, &b->cap_tiles, band_tiles + 1, 0,
                sizeof(uint32_t)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->tile_end, &b->cap_tile_end, band_tiles, 0,
                sizeof(uint32_t)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->block_mask, &b->cap_block_mask, total, 0,
                sizeof(uint16_t)) ||
        sg_grow(ctx, SG_MEM_INSTANCES, &b->instances, &b->cap_instances, total + CPU_PREFETCH, 0,
                sizeof(*b->instances)))
        return SG_ERR_BUDGET;
    memset(b->instances + total, 0, CPU_PREFETCH * sizeof(*b->instances));
    sg_parallel_for(ctx, (b->count + CHUNK - 1) / CHUNK, count_slots, &job);
    uint32_t at = 0;
    for (size_t i = 0; i <= b->count; i++) {
        const uint32_t n = i < b->count ? b->slot_start[i] : 0;
        b->slot_start[i] = at;
        at += n;
    }
    place_counts(b->histogram + range.first, band_tiles, tiles, b->tile_start);
    sg_parallel_for(ctx, ORDER_CHUNKS, emit, &job);
    b->band = band;
    b->placed = true;
    return SG_OK;
}

void sg_bins_clear(struct bins *b)
{
    sg_free(b->extents);
    sg_free(b->order);
    sg_free(b->order_swap);
    sg_free(b->digits);
    sg_free(b->chunk_start);
    sg_free(b->histogram);
    sg_free(b->tile_total);
    sg_free(b->bands);
    sg_free(b->slot_start);
    sg_free(b->tile_start);
    sg_free(b->instances);
    sg_free(b->block_mask);
    sg_free(b->tile_end);
    *b = (struct bins){.band = -1};
}
