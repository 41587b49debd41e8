/* SPDX-License-Identifier: Apache-2.0 */
/* Tile lists on the device: which splats each tile draws, front to back. */
#ifndef SG_VULKAN_LISTS_H
#define SG_VULKAN_LISTS_H

#include "gpu.h"
#include "splatguard/render.h"

/* A run of tiles in row-major order whose lists are held at once. */
struct gpu_band {
    uint32_t first, end;
    uint64_t instances;
};

struct gpu_lists {
    /* of a view */
    uint32_t grid_x, grid_y, count, drawn;
    bool reference_tiles;
    const struct gpu_buffer *splats;
    struct gpu_buffer rects, keys, flags;  /* by Gaussian, from the projection */
    struct gpu_buffer results;             /* VK_RESULTS words */
    struct gpu_buffer order[2], depths[2]; /* drawn ones by depth; which of the two: see sorted */
    int sorted;
    struct gpu_band *bands;
    int band_count;
    size_t cap_bands;
    /* of the present band */
    int band; /* -1: none */
    struct gpu_buffer counts, places, slot_start, tile_start, chunks, chunk_start;
    struct gpu_buffer tiles[2], values[2], emitted, instances;
    /* scratch */
    struct gpu_buffer sums, digits, totals;
};

/* Begins a view: room for what the projection writes. */
int sg_gpu_lists_begin(struct gpu *g, struct gpu_lists *l, size_t count, int width, int height,
                       bool reference_tiles);
/* Waits for the projection, sorts by depth and cuts the image into bands of at most max_instances
 * (or one tile). */
int sg_gpu_lists_make(struct gpu *g, struct gpu_lists *l, const struct gpu_buffer *splats,
                      uint64_t max_instances, struct sg_render_stats *stats);
/* Records what fills the lists of one band. */
int sg_gpu_lists_band(struct gpu *g, struct gpu_lists *l, int band);
void sg_gpu_lists_clear(struct gpu *g, struct gpu_lists *l);

/* Units of the backward pass of the present band: at most so many. */
uint64_t sg_gpu_lists_units(const struct gpu_lists *l);

#endif
