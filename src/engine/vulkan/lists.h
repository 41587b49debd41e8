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
    uint32_t grid_x, grid_y, count;
    bool reference_tiles;
    const struct gpu_buffer *splats;
    struct gpu_buffer rects, keys, flags;  /* by Gaussian, from the projection */
    struct gpu_buffer results;             /* VK_RESULTS words */
    struct gpu_buffer work;                /* VK_WORKS items */
    struct gpu_buffer order[2], depths[2]; /* drawn ones by depth; which of the two: see sorted */
    int sorted;
    struct gpu_band *bands;
    int band_count;
    size_t cap_bands;
    /* Instances that there is room for. More of them stop the device. */
    uint64_t capacity;
    bool known;             /* the next view's number of instances is waited for */
    bool starved;           /* there was no memory for so many: the next view counts anew */
    struct gpu_buffer most; /* two words: the largest number of instances of views learned from */
    /* of the present band */
    int band; /* -1: none */
    struct gpu_buffer counts, places, slot_start, tile_start, chunks, chunk_start;
    struct gpu_buffer tiles[2], values[2], emitted, instances;
    /* scratch */
    struct gpu_buffer sums, digits, totals;
};

/* Exclusive sums of words of `from` to `to`, and one more: of all. They may be the same buffer.
 * count: where the number of words is; most: there are never more. sums: scratch. */
int sg_gpu_scan(struct gpu *g, struct gpu_buffer *sums, const struct gpu_buffer *from,
                const struct gpu_buffer *to, VkDeviceAddress count, uint64_t most);

/* Begins a view: room for what the projection writes. */
int sg_gpu_lists_begin(struct gpu *g, struct gpu_lists *l, size_t count, int width, int height,
                       bool reference_tiles);
/* Sorts by depth. Waits for the number of instances in the first view, after one whose image was
 * cut, and where l->known says so: makes room for them, `each` bytes an instance, or cuts the image
 * into bands of at most max_instances (or one tile) and tells the longest list of a tile. Else
 * their number stays on the device. */
int sg_gpu_lists_make(struct gpu *g, struct gpu_lists *l, const struct gpu_buffer *splats,
                      uint64_t max_instances, uint64_t each, uint64_t *longest);
/* Records what fills the lists of one band. */
int sg_gpu_lists_band(struct gpu *g, struct gpu_lists *l, int band);
/* Records that the model has learned from this view. */
int sg_gpu_lists_learned(struct gpu *g, struct gpu_lists *l);
void sg_gpu_lists_clear(struct gpu *g, struct gpu_lists *l);

/* Units of the backward pass of the present band: at most so many. */
uint64_t sg_gpu_lists_units(const struct gpu_lists *l);

#endif
