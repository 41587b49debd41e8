/* SPDX-License-Identifier: Apache-2.0 */
/* Tile lists: which splats each tile draws, front to back. */
#ifndef SG_CPU_BIN_H
#define SG_CPU_BIN_H

#include "kernels.h"

struct bin_entry {
    uint32_t key, splat;
};

/* A run of tiles in row-major order whose lists are held at once. */
struct bin_band {
    int first, end;
};

struct bins {
    /* of a view */
    int grid_x, grid_y;
    bool reference_tiles;
    size_t count;
    const struct cpu_splat *splats;
    struct cpu_extent *extents;
    struct bin_entry *order, *order_swap; /* drawn splats by depth, then index */
    uint32_t *digits;                     /* counts of the sort, per chunk of the order and digit */
    size_t *chunk_start;                  /* drawn splats before each chunk of splats */
    size_t drawn;
    uint64_t visible, total, max_tile;
    uint32_t *histogram; /* per chunk of the order and tile */
    bool placed;         /* emitting a band has turned its counts into positions */
    uint64_t *tile_total;
    struct bin_band *bands;
    int band_count;
    /* of the present band */
    int band;             /* -1: none */
    uint32_t *slot_start; /* count + 1: first slot of each Gaussian, in index order */
    uint32_t *tile_start; /* tiles of the band + 1 */
    struct cpu_instance *instances;
    uint16_t *block_mask; /* see cpu_raster_args; for the band's instances and tiles */
    uint32_t *tile_end;
    /* capacities */
    size_t cap_extents, cap_order, cap_swap, cap_digits, cap_chunks, cap_histogram, cap_total,
        cap_bands, cap_slots, cap_tiles, cap_instances, cap_block_mask, cap_tile_end;
};

/* Begins a view: room for the extents that projection writes. */
int sg_bins_begin(sg_ctx *ctx, struct bins *b, size_t count, int width, int height,
                  bool reference_tiles);

/* Sorts the projected splats by depth and cuts the image into bands of at most max_instances (or
 * one tile). The splats must stay until the view is done. */
int sg_bins_make(sg_ctx *ctx, struct bins *b, const struct cpu_splat *splats,
                 uint64_t max_instances);

/* Fills the lists of one band. */
int sg_bins_band(sg_ctx *ctx, struct bins *b, int band);

void sg_bins_clear(struct bins *b);

#endif
