/* SPDX-License-Identifier: Apache-2.0 */
/* The model and optimiser state of an engine that computes in host memory, and the stages that only
 * move it. */
#ifndef SG_HOST_MODEL_H
#define SG_HOST_MODEL_H

#include "engine/engine.h"
#include "math/constants.h"

struct sg_host_model {
    size_t count, capacity; /* Gaussians; capacity is a multiple of SG_LANES */
    int sh_degree, planes;
    /* By column; NULL: there is none yet. All parameters are in at[SG_C_PARAMETERS]. A model that
     * is only drawn has nothing else. */
    float *at[SG_COLUMNS];
};

static inline size_t sg_blocks(size_t gaussians)
{
    return (gaussians + SG_LANES - 1) / SG_LANES;
}

/* The memory tag of a column's array. */
static inline enum sg_mem_tag sg_column_tag(int column)
{
    return column == SG_C_PARAMETERS || column == SG_C_SHAPED ? SG_MEM_MODEL : SG_MEM_OPTIMISER;
}

int sg_host_upload(sg_ctx *ctx, struct sg_host_model *h, const struct sg_model *m,
                   const struct sg_columns *columns);
/* Room for some blocks of parameters, of which `keep` stay. Where there was less, all other columns
 * are dropped. After SG_ERR_BUDGET the model is valid; it is empty where nothing stays. */
int sg_host_grow(sg_ctx *ctx, struct sg_host_model *h, size_t blocks, size_t keep);
void sg_host_adopt(struct sg_host_model *h, struct sg_model *m, struct sg_columns *columns);
/* Makes room for a column, zeroed, unless there is some. */
int sg_host_alloc(sg_ctx *ctx, struct sg_host_model *h, int column);
/* For all that a checkpoint saves. */
int sg_host_alloc_saved(sg_ctx *ctx, struct sg_host_model *h);
int sg_host_download(const struct sg_host_model *h, struct sg_model *m, struct sg_columns *columns);
void sg_host_statistics(sg_ctx *ctx, const struct sg_host_model *h,
                        const struct sg_statistics *out);
/* Where the rows of an edited model come from. */
struct sg_moves {
    const struct sg_edit *edit;
    size_t count; /* rows: items */
    /* of every item, first those kept, then those appended: its index before the edit, or the old
     * count plus its row among the edit's */
    uint32_t *source;
    uint32_t *order; /* of every row after the edit: its item */
};
/* h: before the edit; of its parameters the positions are read. `out` is to be cleared, also after
 * an error. */
int sg_host_plan_edit(sg_ctx *ctx, const struct sg_host_model *h, const struct sg_edit *edit,
                      struct sg_moves *out);
void sg_moves_clear(struct sg_moves *moves);
enum sg_edit_kind sg_moves_kind(const struct sg_moves *moves, size_t item);
/* Makes a child of a copy of its parent. p: the planes up to the rotation, SG_LANES apart; entry:
 * among the appended. */
void sg_host_make_child(float *p, const struct sg_edit *edit, size_t entry);
/* What inserted rows have for the array of a column; NULL: nothing. */
const float *sg_host_rows_of(const struct sg_model *rows, int column);

/* Whether an edit gives planes of this fate zeros. */
static inline bool sg_edit_zeroes(const struct sg_edit *edit, enum sg_fate fate)
{
    return fate == SG_FATE_ZERO || (fate == SG_FATE_ASKED && !edit->statistics);
}

/* Where memory runs out: see sg_engine_edit. */
int sg_host_edit(sg_ctx *ctx, struct sg_host_model *h, const struct sg_edit *edit);
void sg_host_floor_scale(struct sg_host_model *h, float smallest);
/* shape: through which it is drawn, or NULL. */
void sg_host_reset_opacity(struct sg_host_model *h, float limit, const struct sg_shape *shape);
int sg_host_filter(sg_ctx *ctx, struct sg_host_model *h, const struct sg_camera *const *cameras,
                   size_t n, const struct sg_mip_filter *filter);
/* Numbers of the cameras for math/mip.h. Returns the largest focal length. */
float sg_host_filter_cameras(const struct sg_camera *const *cameras, size_t n,
                             double (*out)[SG_MIP_CAMERA]);
void sg_host_relocate(struct sg_host_model *h, const struct sg_relocation *r);
void sg_host_explore(sg_ctx *ctx, struct sg_host_model *h, const struct sg_exploration *x);
/* Raises the largest radii to those in this view. mip_kernel: see sg_render_params. */
int sg_host_count_radii(sg_ctx *ctx, struct sg_host_model *h, const struct sg_camera *camera,
                        float mip_kernel);
/* The optional stage, forth and back: fills the shaped column; turns the gradient of what is drawn
 * into that of the parameters. */
int sg_host_shape(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape);
int sg_host_shape_backward(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape);
void sg_host_clear(struct sg_host_model *h);

/* Bytes that a Gaussian needs in training, at the worst moment of an edit or a checkpoint.
 * gradient: the engine stores gradients of the parameters. */
uint64_t sg_host_footprint(const struct sg_work *work, bool gradient);

/* What is projected. */
static inline const float *sg_host_effective(const struct sg_host_model *h)
{
    return h->at[h->at[SG_C_SHAPED] ? SG_C_SHAPED : SG_C_PARAMETERS];
}

#endif
