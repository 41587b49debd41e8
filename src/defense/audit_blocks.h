/* SPDX-License-Identifier: Apache-2.0 */
/* Sums over the blocks of an image, from which the audit's features are made. */
#ifndef SG_DEFENSE_AUDIT_BLOCKS_H
#define SG_DEFENSE_AUDIT_BLOCKS_H

#include "core/context.h"
#include "splatguard/audit.h"

#define SG_AUDIT_BLOCK 16 /* pixels of the photo on a block's side */
/* values are quarters of grey levels, so that means of four pixels are kept */
#define SG_AUDIT_UNIT 4
#define SG_AUDIT_BINS 9 /* of second differences */

/* Over the used pixels of a block that have two neighbours in one direction. The step is the
 * difference to the next neighbour, the curvature the difference of both steps. */
struct audit_sums {
    uint32_t pixels, total, extremes,
        oscillation;             /* |step|; at local extremes: both |steps|, the lesser of them */
    uint64_t squares, curvature; /* step^2, |curvature| */
    int64_t next, second;        /* step * the step before it, * the one before that */
};

struct audit_block {
    struct audit_sums down, across;
    uint32_t bins[SG_AUDIT_BINS]; /* pixels by |curvature|, both directions */
    uint32_t used;
    int64_t level; /* sum of the values of the used pixels */
};

/* The newest used pixel of a line and what came before it. */
struct audit_line {
    int16_t here, step, step_before;
    uint32_t seen, block;
};

/* One channel of a photo, at its own size or shrunk, and room for its sums. */
struct audit_plane {
    const uint8_t *mask; /* NULL = all used */
    size_t w, h, block;  /* block: pixels of this plane on a block's side */
    int16_t *values;
    struct audit_line *columns;
    struct audit_block *blocks;
};

size_t sg_audit_blocks_across(const struct audit_plane *p);
size_t sg_audit_block_count(const struct audit_plane *p);

/* Fills the blocks' sums from the values. */
void sg_audit_sum(const struct audit_plane *p);

/* To half the size: means of four pixels, used where all four are; `mask` is room for the smaller
 * mask. Blocks stay the same parts of the photo. */
void sg_audit_halve(struct audit_plane *p, uint8_t *mask);

/* A photo and its halves and quarters, of which one may be poisoned alone. */
#define SG_AUDIT_AREAS 9

#define SG_AUDIT_RANGE 16 /* statistics of sg_audit_range for an area */

/* The statistics, see audit_texture.c and audit_range.c: of luma at three sizes and two colour
 * differences at two sizes, in this order, one call each; then of the ranges of the channels. */
struct audit_texture {
    size_t across, down; /* tiles */
    bool *kept;          /* tiles in which luma varies, set by the first call */
    float *column;       /* room for a value of each tile */
    size_t done;         /* statistics so far */
    double values[SG_AUDIT_AREAS][SG_AUDIT_TEXTURE];
};

void sg_audit_texture(struct audit_texture *t, const struct audit_plane *p, bool luma);
void sg_audit_range(struct audit_texture *t, const uint8_t *rgb, const uint8_t *mask, size_t w,
                    size_t h);

bool sg_audit_has_quarter(size_t area, bool right, bool lower);

/* Tiles that are kept in an area; the first area is the photo. */
size_t sg_audit_tiles(const struct audit_texture *t, size_t area);

#endif
