/* SPDX-License-Identifier: Apache-2.0 */
/* The columns of a model: every value that exists once per Gaussian has a row in one table here.
 * Edits, checkpoints, PLY files and the memory plan loop over the table; a new column is a new row.
 *
 * Parameters (position to SH) share the array of the first of them, sg_model.params: kernels read
 * all of them together. Every other column has an array of its own. All arrays are blocks of
 * SG_LANES Gaussians, see sg_param_index. */
#ifndef SG_COLUMNS_H
#define SG_COLUMNS_H

#include <stdbool.h>

#include "anchor.h"
#include "core/context.h"
#include "splatguard/model.h"

/* Learning-rate groups. Of anchors, offsets and features learn instead of positions and colours. */
enum sg_group {
    SG_G_XYZ,
    SG_G_OPACITY,
    SG_G_SCALE,
    SG_G_ROT,
    SG_G_DC,
    SG_G_REST,
    SG_GROUPS,
    SG_G_OFFSET = SG_G_XYZ,
    SG_G_FEATURE = SG_G_DC
};

/* The origin of a row after an edit. */
enum sg_edit_kind {
    SG_EDIT_COPY,   /* a copy of a Gaussian */
    SG_EDIT_CHILD,  /* half of one that was split */
    SG_EDIT_INSERT, /* given by the caller */
    SG_EDIT_KEEP,   /* it was there before */
    SG_EDIT_KINDS
};

/* What an edit does to the values of such a row. DRAW and SHRINK are for parameters. */
enum sg_fate {
    SG_FATE_ZERO,
    SG_FATE_COPY,
    SG_FATE_ASKED, /* copied if the edit asks for it (sg_edit.statistics), else zero */
    SG_FATE_ROW,   /* taken from the caller's row */
    SG_FATE_DRAW,  /* a position drawn from the parent as from a distribution */
    SG_FATE_SHRINK /* scales: the parent's, made smaller */
};

enum sg_column_bits {
    SG_COLUMN_PARAMETER = 1, /* lies in sg_model.params, is learned and has a group */
    SG_COLUMN_SAVED = 2,     /* in checkpoints; it exists from the first step of the optimiser on */
    SG_COLUMN_LOST = 4,      /* no edit keeps it: it is made again when it is needed */
    SG_COLUMN_MIP = 8,       /* only models with the filters of Mip-Splatting have it */
    SG_COLUMN_RADII = 16,    /* only runs that count radii have it */
    SG_COLUMN_ANCHORS = 32,  /* only models of anchors have it */
    SG_COLUMN_GRACE = 64,    /* only runs whose filter spares new anchors have it */
    /* Sums and squares, which a broken Gaussian may leave without a number but never below 0;
     * measures, which are finite too. */
    SG_COLUMN_SUM = 128,
    SG_COLUMN_MEASURE = 256
};
#define SG_COLUMN_VARIANTS (SG_COLUMN_MIP | SG_COLUMN_RADII | SG_COLUMN_ANCHORS | SG_COLUMN_GRACE)

#define SG_COLUMN_PLANES_MAX SG_A_PLANES /* of a column that is saved */

#define SG_PLANES_REST (-1)       /* those of SH degrees above 0 */
#define SG_PLANES_PARAMETERS (-2) /* as many as all parameters */

struct sg_column {
    const char *name; /* of its section in a checkpoint: at most 23 characters */
    int planes;       /* values per Gaussian, or SG_PLANES_* */
    unsigned bits;    /* of enum sg_column_bits */
    enum sg_fate fate[SG_EDIT_KINDS];
    /* of a parameter: */
    int first; /* plane */
    enum sg_group group;
    /* of what a PLY file has: */
    int place;            /* from 1, parameters first; 0 = it is in no file */
    const char *property; /* its name there, and the plane's number if it has several planes */
};

/* More rows, C(NAME, ...) each, for tests. */
#ifndef SG_COLUMNS_MORE
#define SG_COLUMNS_MORE(C)
#endif

/* The table: parameters first, in the order of their planes. */
#define SG_FATES_PARAMETER                                                                         \
    {                                                                                              \
        SG_FATE_COPY, SG_FATE_COPY, SG_FATE_ROW, SG_FATE_COPY                                      \
    }
#define SG_COLUMN_TABLE(C)                                                                         \
    C(POSITION, .name = "position", .planes = 3, .bits = SG_COLUMN_PARAMETER | SG_COLUMN_SAVED,    \
      .fate = {SG_FATE_COPY, SG_FATE_DRAW, SG_FATE_ROW, SG_FATE_COPY}, .first = SG_P_XYZ,          \
      .group = SG_G_XYZ, .place = 1, .property = "")                                               \
    C(OPACITY, .name = "opacity", .planes = 1, .bits = SG_COLUMN_PARAMETER | SG_COLUMN_SAVED,      \
      .fate = SG_FATES_PARAMETER, .first = SG_P_OPACITY, .group = SG_G_OPACITY, .place = 4,        \
      .property = "opacity")                                                                       \
    C(SCALE, .name = "scale", .planes = 3, .bits = SG_COLUMN_PARAMETER | SG_COLUMN_SAVED,          \
      .fate = {SG_FATE_COPY, SG_FATE_SHRINK, SG_FATE_ROW, SG_FATE_COPY}, .first = SG_P_SCALE,      \
      .group = SG_G_SCALE, .place = 5, .property = "scale_")                                       \
    C(ROTATION, .name = "rotation", .planes = 4, .bits = SG_COLUMN_PARAMETER | SG_COLUMN_SAVED,    \
      .fate = SG_FATES_PARAMETER, .first = SG_P_ROT, .group = SG_G_ROT, .place = 6,                \
      .property = "rot_")                                                                          \
    C(SH_DC, .name = "sh_dc", .planes = 3, .bits = SG_COLUMN_PARAMETER | SG_COLUMN_SAVED,          \
      .fate = SG_FATES_PARAMETER, .first = SG_P_SH, .group = SG_G_DC, .place = 2,                  \
      .property = "f_dc_")                                                                         \
    C(SH_REST, .name = "sh_rest", .planes = SG_PLANES_REST,                                        \
      .bits = SG_COLUMN_PARAMETER | SG_COLUMN_SAVED, .fate = SG_FATES_PARAMETER,                   \
      .first = SG_P_SH + 3, .group = SG_G_REST, .place = 3, .property = "f_rest_")                 \
    /* Adam's moments */                                                                           \
    C(MOMENT1, .name = "moment1", .planes = SG_PLANES_PARAMETERS, .bits = SG_COLUMN_SAVED,         \
      .fate = {[SG_EDIT_KEEP] = SG_FATE_COPY})                                                     \
    C(MOMENT2, .name = "moment2", .planes = SG_PLANES_PARAMETERS,                                  \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_SUM, .fate = {[SG_EDIT_KEEP] = SG_FATE_COPY})            \
    /* Statistics: the sum of view-space gradient norms (NDC), and the views visible in */         \
    C(GRAD_SUM, .name = "gradient_sum", .planes = 1, .bits = SG_COLUMN_SAVED | SG_COLUMN_SUM,      \
      .fate = {[SG_EDIT_KEEP] = SG_FATE_ASKED})                                                    \
    C(GRAD_COUNT, .name = "gradient_count", .planes = 1,                                           \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_MEASURE, .fate = {[SG_EDIT_KEEP] = SG_FATE_ASKED})       \
    /* Of the radii on the screen, in pixels: the largest */                                       \
    C(RADIUS, .name = "largest_radius", .planes = 1,                                               \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_RADII | SG_COLUMN_MEASURE,                               \
      .fate = {[SG_EDIT_KEEP] = SG_FATE_ASKED})                                                    \
    /* Standard deviation of the 3D filter; sum of absolute view-space gradients along x and y */  \
    C(FILTER, .name = "filter_3d", .planes = 1,                                                    \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_MIP | SG_COLUMN_MEASURE,                                 \
      .fate = {SG_FATE_COPY, SG_FATE_COPY, SG_FATE_ZERO, SG_FATE_COPY}, .place = 7,                \
      .property = "filter_3D")                                                                     \
    C(GRAD_ABSOLUTE, .name = "gradient_absolute", .planes = 1,                                     \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_MIP | SG_COLUMN_SUM,                                     \
      .fate = {[SG_EDIT_KEEP] = SG_FATE_ASKED})                                                    \
    /* Of anchors: values beside the parameters, Adam's moments of these, statistics of growth */  \
    C(ANCHOR, .name = "anchor", .planes = SG_A_PLANES,                                             \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_ANCHORS, .fate = SG_FATES_PARAMETER)                     \
    C(ANCHOR_MOMENT1, .name = "anchor_moment1", .planes = SG_A_PLANES,                             \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_ANCHORS, .fate = {[SG_EDIT_KEEP] = SG_FATE_COPY})        \
    C(ANCHOR_MOMENT2, .name = "anchor_moment2", .planes = SG_A_PLANES,                             \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_ANCHORS | SG_COLUMN_SUM,                                 \
      .fate = {[SG_EDIT_KEEP] = SG_FATE_COPY})                                                     \
    C(ANCHOR_STATISTICS, .name = "anchor_statistics", .planes = SG_A_STATISTICS,                   \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_ANCHORS | SG_COLUMN_SUM,                                 \
      .fate = {[SG_EDIT_KEEP] = SG_FATE_ASKED})                                                    \
    /* The iteration in which they grew; 0: they were there from the beginning */                  \
    C(BORN, .name = "anchor_born", .planes = 1,                                                    \
      .bits = SG_COLUMN_SAVED | SG_COLUMN_GRACE | SG_COLUMN_MEASURE,                               \
      .fate = {[SG_EDIT_INSERT] = SG_FATE_ROW, [SG_EDIT_KEEP] = SG_FATE_COPY})                     \
    /* Gradients of the view, and sums over earlier views (sg_update.accumulate) */                \
    C(GRADIENT, .name = "gradient", .planes = SG_PLANES_PARAMETERS, .bits = SG_COLUMN_LOST)        \
    C(ACCUMULATED, .name = "accumulated", .planes = SG_PLANES_PARAMETERS, .bits = SG_COLUMN_LOST)  \
    /* What is drawn in place of the parameters (struct sg_shape) */                               \
    C(SHAPED, .name = "shaped", .planes = SG_PLANES_PARAMETERS, .bits = SG_COLUMN_LOST)            \
    SG_COLUMNS_MORE(C)

enum sg_column_id {
#define C(id, ...) SG_C_##id,
    SG_COLUMN_TABLE(C)
#undef C
        SG_COLUMNS,
    SG_C_PARAMETERS = SG_C_POSITION /* the array of all parameters */
};

extern const struct sg_column sg_columns[SG_COLUMNS];

static inline bool sg_column_is_parameter(int c)
{
    return sg_columns[c].bits & SG_COLUMN_PARAMETER;
}

/* It has one of these bits, and those of SG_COLUMN_VARIANTS that it needs are among them. */
static inline bool sg_column_of(int c, unsigned bits)
{
    const unsigned own = sg_columns[c].bits, needed = own & SG_COLUMN_VARIANTS;
    return (own & bits & ~needed) && (bits & needed) == needed;
}

/* It has an array of its own, or is the first of those that share one. */
static inline bool sg_column_has_array(int c)
{
    return c == SG_C_PARAMETERS || !sg_column_is_parameter(c);
}

/* It has an array that a copy of a Gaussian has too: views are drawn by it, and training cannot
 * make it again. */
static inline bool sg_column_is_needed(int c)
{
    return sg_column_has_array(c) && sg_columns[c].fate[SG_EDIT_COPY] == SG_FATE_COPY;
}

/* The plane behind those of a parameter, where there are `planes` in all. */
static inline int sg_column_end(int c, int planes)
{
    return sg_column_is_parameter(c + 1) ? sg_columns[c + 1].first : planes;
}

/* Planes of a column, and of the array that it lies in. */
int sg_column_planes(int c, int sh_degree);
int sg_column_array_planes(int c, int sh_degree);

/* Arrays of columns beside the parameters, for `capacity` Gaussians each; NULL: there is none. All
 * belong to it. */
struct sg_columns {
    size_t capacity;
    float *at[SG_COLUMNS];
    struct sg_networks *networks; /* of anchors; or NULL */
};
/* All that have one of these bits (sg_column_of), zeroed. SG_ERR_BUDGET. */
int sg_columns_create(sg_ctx *ctx, size_t count, int sh_degree, unsigned bits,
                      struct sg_columns *out);
void sg_columns_clear(struct sg_columns *columns);

/* Gives a model the columns beside its parameters that PLY files have: those that `like` has, or
 * all where it is NULL. They are zeros; model->columns stays NULL where there is none. */
int sg_model_add_columns(sg_ctx *ctx, struct sg_model *model, const struct sg_model *like);
/* A model of `count` Gaussians, all zeros, with the columns of another and at most its degrees. */
int sg_model_create_like(sg_ctx *ctx, const struct sg_model *like, size_t count, int sh_degree,
                         struct sg_model **out);
/* What making a model for a file gave: where the memory limit refused it, the message names the
 * file and what it asked for. bytes: of a Gaussian. Returns the code. */
int sg_model_refused(sg_ctx *ctx, int code, const char *path, uint64_t count, size_t bytes);
/* Gaussian i of a model becomes number k of one that is like it, or has a lower SH degree. */
void sg_model_copy_row(const struct sg_model *from, size_t i, struct sg_model *to, size_t k);
/* Whether a parameter is not finite, and which is the first. */
bool sg_model_find_nonfinite(const struct sg_model *m, size_t *gaussian, int *plane);

#endif
