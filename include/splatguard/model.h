/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_MODEL_H
#define SPLATGUARD_MODEL_H

#include <stddef.h>
#include <stdint.h>

#include "context.h"
#include "scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Parameter planes of one Gaussian, as stored (before activation). */
enum sg_param {
    SG_P_XYZ = 0,     /* 3: position, scene units */
    SG_P_OPACITY = 3, /* 1: logit */
    SG_P_SCALE = 4,   /* 3: natural log of the standard deviation */
    SG_P_ROT = 7,     /* 4: quaternion w x y z, not necessarily normalised */
    SG_P_SH =
        11, /* 3 (d+1)^2: coefficient k of channel c is plane SG_P_SH + 3k + c; k = 0 is f_dc */
    SG_PARAMS_MAX = 59
};

#define SG_LANES 16 /* Gaussians per block of the store */

/* Number of parameter planes at SH degree 0..3: 14, 23, 38, 59. */
static inline int sg_param_count(int sh_degree)
{
    return SG_P_SH + 3 * (sh_degree + 1) * (sh_degree + 1);
}

/* The Gaussian store: a structure of arrays in blocks of SG_LANES Gaussians. Plane p of Gaussian i
 * is params[sg_param_index(planes, i, p)]. Unused lanes of the last block are zero. Thread safety:
 * none; the owner synchronises. */
struct sg_model {
    size_t count;         /* Gaussians */
    size_t capacity;      /* allocated, a multiple of SG_LANES */
    int sh_degree;        /* degree stored, 0..3 */
    int active_sh_degree; /* degree used for rendering, 0..sh_degree */
    float *params;        /* capacity x planes floats, 64-byte aligned */
    /* What variants of 3DGS keep for each Gaussian beside its parameters, as PLY files have it; or
     * NULL. The library's own. */
    struct sg_columns *columns;
};

static inline size_t sg_param_index(int planes, size_t i, int p)
{
    return (i / SG_LANES * (size_t) planes + (size_t) p) * SG_LANES + i % SG_LANES;
}

static inline float *sg_model_at(const struct sg_model *m, size_t i, int p)
{
    return &m->params[sg_param_index(sg_param_count(m->sh_degree), i, p)];
}

/* An all-zero model of `count` Gaussians; the caller owns *out. One of 0 can be made, but neither
 * trained nor written: see sg_model_check. Errors: SG_ERR_USAGE, SG_ERR_BUDGET. */
SG_API int sg_model_create(sg_ctx *ctx, size_t count, int sh_degree, struct sg_model **out);
SG_API void sg_model_destroy(struct sg_model **model);

/* Gaussians that a model can be drawn as: its count, or for one of anchors 10 times that. */
SG_API uint64_t sg_model_gaussians(const struct sg_model *model);
/* Of models of anchors: the photos whose appearances it has learned; 0 for others. */
SG_API size_t sg_model_appearances(const struct sg_model *model);

/* Parameters as plain arrays, one row per Gaussian, values as stored (before activation):
 * "position" 3, "scale" 3, "rotation" 4, "opacity" 1, "sh_dc" 3 floats per row; "sh_rest" 3 (d+1)^2
 * - 3, with coefficient k of channel c at 3 (k - 1) + c.
 *
 * Names of the fields: index from 0; NULL after the last. */
SG_API const char *sg_model_field_name(int index);
/* Floats per row at SH degree 0..3; -1 for an unknown field or degree. */
SG_API int sg_model_field_width(const char *field, int sh_degree);
/* Copies a field of all Gaussians out of a model, or into one. row_stride: floats from row to row,
 * 0 = packed. Values are not checked: see sg_model_check. Errors: SG_ERR_USAGE for an unknown field
 * or a stride shorter than a row. Thread safety: as the model and the context. */
SG_API int sg_model_get_array(sg_ctx *ctx, const struct sg_model *model, const char *field,
                              float *out, size_t row_stride);
SG_API int sg_model_set_array(sg_ctx *ctx, struct sg_model *model, const char *field,
                              const float *values, size_t row_stride);

/* Initial Gaussians at points (Kerbl et al. 2023, section 5.1): isotropic, scale = RMS distance to
 * the 3 nearest other points (found exactly, but for points placed to make the search slow),
 * opacity 0.1, active degree 0. xyz: n x 3; rgb: n x 3. Errors: SG_ERR_INPUT for fewer than 4
 * points and positions that are not finite, SG_ERR_USAGE for the degree, SG_ERR_BUDGET. The caller
 * owns *out. */
SG_API int sg_model_init_points(sg_ctx *ctx, const float *xyz, const uint8_t *rgb, size_t n,
                                int sh_degree, struct sg_model **out);

/* Initial Gaussians at n >= 4 grey points drawn uniformly from the cube about the origin with this
 * half side, as the reference does for NeRF-Synthetic, with 1.3. Errors and ownership as above. */
SG_API int sg_model_init_random(sg_ctx *ctx, size_t n, float half_side, uint64_t seed,
                                int sh_degree, struct sg_model **out);

/* Reads a 3DGS PLY: binary or ASCII, any property order, SH degree 0..3 (all of it active). The
 * file is read in pieces that take less than a megabyte beside the model. Values that are not
 * finite are kept: see sg_model_check. The caller owns *out. Errors: SG_ERR_INPUT, also for more
 * than max_gaussians; SG_ERR_BUDGET. */
SG_API int sg_model_read_ply(sg_ctx *ctx, const char *path, uint64_t max_gaussians,
                             struct sg_model **out);

/* Writes the layout of the reference, binary little endian: 62 properties at SH degree 3, fewer
 * f_rest below. A model of anchors is written as Scaffold-GS does, with its networks beside it, in
 * networks.safetensors. A file appears whole or not at all. Errors: SG_ERR_INPUT where it cannot be
 * written, the model has no Gaussians, or the folder has the networks of another model of anchors;
 * SG_ERR_BUDGET. */
SG_API int sg_model_write_ply(sg_ctx *ctx, const struct sg_model *model, const char *path);

/* Reads and writes a point cloud PLY (x y z, optional red green blue). xyz, rgb: n x 3. Points
 * without colours are read as 127. The caller owns the arrays and frees them with
 * sg_points_destroy. Errors: as for models. */
SG_API int sg_points_read_ply(sg_ctx *ctx, const char *path, uint64_t max_points, float **xyz,
                              uint8_t **rgb, size_t *n);
SG_API int sg_points_write_ply(sg_ctx *ctx, const char *path, const float *xyz, const uint8_t *rgb,
                               size_t n);
SG_API void sg_points_destroy(float **xyz, uint8_t **rgb); /* NULL-safe; sets both to NULL */

/* cameras.json as the reference writes it: test cameras first, then train. A principal point that
 * is not the centre is written too, as cx and cy, which the reference does not have. The file
 * appears whole or not at all. Errors: SG_ERR_INPUT where it cannot be written, SG_ERR_BUDGET. */
SG_API int sg_cameras_write_json(sg_ctx *ctx, const struct sg_scene *scene, const char *path);
/* The cameras of such a file, for renders without a scene: views in the order of their names,
 * without photos (rgb, file and path are NULL). A name that repeats becomes NAME_I in all of its
 * cameras, I being their number in the file, from 0. params: resolution, downscale,
 * centred_principal, max_pixels and max_images; NULL = the defaults. The caller owns *out, until
 * sg_cameras_destroy. Errors: SG_ERR_USAGE for values out of range; SG_ERR_INPUT, also for names
 * with a "/", and those that repeat even so; SG_ERR_BUDGET. */
SG_API int sg_cameras_read_json(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                                struct sg_view **out, size_t *n);
SG_API void sg_cameras_destroy(struct sg_view **views, size_t *n); /* sets both to 0 */

/* SG_ERR_INPUT if there is no Gaussian, or, naming Gaussian and property, if a parameter is not
 * finite. Such a model can be inspected but not used. The message begins with `name`. */
SG_API int sg_model_check(sg_ctx *ctx, const struct sg_model *model, const char *name);

/* What `splatguard info` prints about a model. Percentiles are of the activated values, over
 * Gaussians without a NaN or infinity; NaN if there is none. */
struct sg_model_info {
    size_t count;
    int sh_degree;
    double min[3], max[3];      /* bounds of the finite positions; min > max if there is none */
    double scale_percentile[5]; /* largest standard deviation per Gaussian: 1, 25, 50, 75, 99 % */
    double opacity_percentile[5];
    size_t nonfinite;        /* Gaussians with a NaN or infinity in any plane */
    size_t first_nonfinite;  /* the first of them, counted from 0 */
    char first_property[24]; /* its first property in a PLY that is not finite; "" if none */
    size_t zero_rotation;    /* quaternions of length 0 */
    size_t transparent;      /* opacity < 1/255: never drawn */
};
/* Measures a model, also one that is not finite or has no Gaussian. Errors: SG_ERR_BUDGET. */
SG_API int sg_model_inspect(sg_ctx *ctx, const struct sg_model *model, struct sg_model_info *out);

#ifdef __cplusplus
}
#endif

#endif
