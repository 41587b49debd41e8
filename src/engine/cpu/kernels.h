/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels that exist once per instruction set, and the records they share with the driver. */
#ifndef SG_CPU_KERNELS_H
#define SG_CPU_KERNELS_H

#include "engine/ops.h"
#include "engine/scaffold/neural.h"
#include "spectral/fft.h"

/* One projected Gaussian: a cache line; undefined where the extent says that it is not visible.
 * With the conic as a sum of squares (math/tiles.h), log2 of opacity x Gaussian is peak - (across
 * dx - shear dy)^2 - (down dy)^2: above the peak by no rounding. */
struct cpu_splat {
    float x, y;
    float slope, reach, taper, ymax, yright; /* struct ellipse */
    float spare;
    float across, shear, down, peak; /* peak: log2 opacity */
    float r, g, b, z;
};

/* The tiles a splat touches: bit (y - y0) (x1 - x0) + x - x0 of `tiles` for the rectangle [x0, x1)
 * x [y0, y1). Rectangles of more than CPU_MASK_TILES tiles have no bits: their rows are worked out
 * each time they are needed. x1 = x0: draws nothing; x1 = 0: is not visible, as the reference
 * counts views. */
struct cpu_extent {
    uint16_t x0, y0, x1, y1;
    uint32_t tiles;
};
#define CPU_MASK_TILES 31

/* One entry of a tile's list. */
struct cpu_instance {
    uint32_t splat, slot; /* slot: where the backward pass leaves its gradient */
};

#define CPU_PREFETCH 16 /* instances; as many zero instances follow the last */
/* Sum w, w dx, w dy, w dx^2, w dx dy, w dy^2, r, g, b; then, where absolute gradients are counted,
 * the sums of |dL/dx| and |dL/dy|. */
#define CPU_SLOT_FLOATS 12
#define CPU_SLOT_USED 9
#define CPU_SLOT_ABSOLUTE 11

struct cpu_project_args {
    const float *params;
    size_t count;
    int planes, degree;
    const struct sg_camera *camera;
    float mip_kernel; /* of struct sg_render_params */
    int grid_x, grid_y;
    bool reference_tiles;
    struct cpu_splat *splats;
    struct cpu_extent *extents;
};

struct cpu_raster_args {
    int width, height, grid_x;
    const struct cpu_splat *splats;
    const struct cpu_instance *instances;
    const uint32_t *tile_start; /* first instance of a tile; tile_start[tile + 1] ends it; indexed
                                   from first_tile */
    int first_tile;
    /* per instance: 4x4 blocks of the tile it can touch; written by forward, read by backward */
    uint16_t *block_mask;
    /* per tile, from first_tile: end of the instances that any pixel was still open to */
    uint32_t *tile_end;
    float background[3];
    float *rgb;            /* 3 planes, written by forward, read by backward */
    float *alpha, *depth;  /* planes or NULL */
    const float *gradient; /* 3 planes */
    float *slots;          /* raster_count: one float per instance */
    enum sg_hit hit;       /* raster_count: the kind of hit to sum; views are counted as pixels */
};

struct cpu_learn_args {
    const struct sg_camera *camera;
    float mip_kernel;    /* of struct sg_render_params */
    const float *shaped; /* what was projected: params, or the output of a shape */
    float *params, *m, *v;
    float *grad_sum, *grad_count;
    float *grad_absolute; /* of kernels with the mip filter: NULL, or the sums beside the norm */
    size_t count;
    int planes, degree;
    const struct cpu_splat *splats;
    const struct cpu_extent *extents;
    bool absolute;              /* the slots have absolute gradients, which are the statistic */
    const float *slots;         /* gradients summed over this band */
    const uint32_t *slot_start; /* count + 1 */
    float *accumulated;         /* NULL, or gradients of earlier views, as params */
    /* of the parameters, as params; project_backward_optimise: NULL = not stored */
    float *gradients;
    const struct sg_update *update;
};

struct cpu_loss_args {
    int width, height;
    const float *rgb;
    const struct sg_target_pixels *target;
    const struct sg_photometric *params;
    float *gradient; /* 3 planes */
    double *sums;    /* |d|, d^2, S per channel and row */
};

#define CPU_LOSS_STEP 16 /* rows at a time */
#define CPU_LOSS_STRIDE(width) (((width) + 15) / 16 * 16)
#define CPU_LOSS_SCRATCH_ROWS (4 * CPU_LOSS_STEP + 50)
#define CPU_LOSS_SCRATCH(width) (CPU_LOSS_SCRATCH_ROWS * CPU_LOSS_STRIDE(width)) /* floats */

/* The one list of all kernels: name, result and arguments, in this order. */
#define CPU_KERNELS(K)                                                                             \
    K(project, void, (const struct cpu_project_args *, size_t first_block, size_t end_block))      \
    K(project_mip, void, (const struct cpu_project_args *, size_t first_block, size_t end_block))  \
    /* Return the number of (Gaussian, pixel) pairs evaluated. */                                  \
    K(raster, uint64_t, (const struct cpu_raster_args *, int tile))                                \
    K(raster_backward, uint64_t, (const struct cpu_raster_args *, int tile))                       \
    /* The same, with absolute gradients in the slots. */                                          \
    K(raster_backward_absolute, uint64_t, (const struct cpu_raster_args *, int tile))              \
    K(raster_count, uint64_t, (const struct cpu_raster_args *, int tile))                          \
    K(optimise, void, (const struct cpu_learn_args *, size_t first_block, size_t end_block))       \
    /* Without a step of Adam in the update: project_backward. */                                  \
    K(project_backward_optimise, void,                                                             \
      (const struct cpu_learn_args *, size_t first_block, size_t end_block))                       \
    K(project_backward_optimise_mip, void,                                                         \
      (const struct cpu_learn_args *, size_t first_block, size_t end_block))                       \
    /* Rows first to end - 1 of a channel: sums and gradient. scratch: CPU_LOSS_SCRATCH(width)     \
     * floats. */                                                                                  \
    K(loss, void, (const struct cpu_loss_args *, int channel, int first, int end, float *scratch)) \
    /* One of the 3 x height rows. */                                                              \
    K(ascend, void, (const struct sg_ascend *, size_t row))                                        \
    /* What a view draws of a block of anchors, and back: see sg_ref_neural. */                    \
    K(neural, void,                                                                                \
      (const struct sg_neural_args *, const struct sg_anchor_block *,                              \
       float(*drawn)[SG_DRAWN_PLANES][SG_LANES]))                                                  \
    K(neural_backward, void,                                                                       \
      (const struct sg_neural_args *, const struct sg_anchor_block *,                              \
       float(*gradient)[SG_DRAWN_PLANES][SG_LANES], struct sg_anchor_gradient *,                   \
       struct sg_weight_sums *) )                                                                  \
    /* Values of any Gaussians side by side: see sg_ref_pick. */                                   \
    K(pick, void,                                                                                  \
      (const float *column, int planes, int first, int count, const uint32_t *item,                \
       float(*out)[SG_LANES]))

struct cpu_kernels {
    const char *name;
#define K(kernel, result, arguments) result(*kernel) arguments;
    CPU_KERNELS(K)
#undef K
    struct sg_fft_kernels fft;
};

extern const struct cpu_kernels sg_cpu_kernels_baseline, sg_cpu_kernels_avx2, sg_cpu_kernels_avx512,
    sg_cpu_kernels_neon;

#endif
