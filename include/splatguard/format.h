/* SPDX-License-Identifier: Apache-2.0 */
/* Model files of other programs. Formats but PLY round: docs/formats.md has how much. */
#ifndef SPLATGUARD_FORMAT_H
#define SPLATGUARD_FORMAT_H

#include <stdbool.h>

#include "context.h"
#include "model.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sg_model_format {
    SG_MODEL_AUTO,           /* reading: by content; writing: by the ending of the name */
    SG_MODEL_PLY,            /* .ply: the layout of the reference, see sg_model_write_ply */
    SG_MODEL_COMPRESSED_PLY, /* .compressed.ply: of SuperSplat, 16 bytes a Gaussian and SH */
    SG_MODEL_SPLAT,          /* .splat: 32 bytes a Gaussian, without SH of degree 1 and above */
    SG_MODEL_SPZ,            /* .spz: of Niantic, versions 2 to 4; where zlib, for 4 zstd, was */
    SG_MODEL_KSPLAT,         /* .ksplat: of GaussianSplats3D; is read only */
    SG_MODEL_SOG,            /* .sog: of PlayCanvas, version 2; where zlib was at build */
    SG_MODEL_GLB,            /* .glb: glTF with KHR_gaussian_splatting; is written only */
    SG_MODEL_FORMATS
};

/* "ply", "compressed-ply", "splat", "spz", "ksplat", "sog", "glb"; "auto". */
SG_API const char *sg_model_format_name(enum sg_model_format format);
/* By the ending of a file's name, in any case of letters; SG_MODEL_AUTO for another ending. */
SG_API enum sg_model_format sg_model_format_of(const char *path);

/* Reads a model in any format that can be read. It is recognised by its content; .splat, which has
 * no mark, by its ending. Memory: that of the model, and less than a megabyte; for compressed PLY
 * 72 bytes per 256 Gaussians too, for .sog two of its images and a packed one, for .spz of version
 * 4 one of its arrays, also packed. The caller owns *out. Errors: as of sg_model_read_ply. */
SG_API int sg_model_read(sg_ctx *ctx, const char *path, uint64_t max_gaussians,
                         struct sg_model **out);

/* The same, and anchors of Scaffold-GS (SG_MODEL_SCAFFOLD) as a training writes them: a PLY file,
 * and networks.safetensors beside it. A renderer draws such a model. sg_model_write_ply,
 * sg_model_gaussians, sg_model_appearances, sg_model_bake and sg_model_destroy take it too, and so
 * does sg_attack_create with SG_ATTACK_SCAFFOLD. Other functions are for models of Gaussians. */
SG_API int sg_model_read_drawable(sg_ctx *ctx, const char *path, uint64_t max_gaussians,
                                  struct sg_model **out);

/* Gaussians of SH degree 0 from a model of anchors: one for each that any of the n views draws,
 * with the means, weighted by opacity, of what the views draw. What depends on the direction of
 * view is lost. photos: of each view, the training photo whose appearance it has, SIZE_MAX for
 * none; or NULL. appearance: of views without one, as in struct sg_render_params. The caller owns
 * *out. Errors: SG_ERR_USAGE for a model without anchors, SG_ERR_INPUT where no view draws a
 * Gaussian or one that is drawn is not finite, SG_ERR_BUDGET, SG_ERR_INTERRUPTED. */
SG_API int sg_model_bake(sg_ctx *ctx, const struct sg_model *model, const struct sg_view *views,
                         size_t n, const size_t *photos, int appearance, struct sg_model **out);

struct sg_model_file {
    enum sg_model_format format; /* Default SG_MODEL_AUTO. */
    int spz_version;             /* 2, 3 with finer rotations, 4 with zstd. Default 3. */
};
#define SG_MODEL_FILE_DEFAULTS .spz_version = 3
SG_API struct sg_model_file sg_model_file_default(void);

/* Writes a model; the file appears whole or not at all. file may be NULL. Errors: SG_ERR_USAGE for
 * an ending that names no format, one that is not written and a wrong version; SG_ERR_INPUT if the
 * file cannot be written, the model has no Gaussians, or the format cannot hold a value: NaN and
 * infinities in all but PLY, positions beyond 8388607 in .spz; SG_ERR_BUDGET. .sog and
 * compressed PLY have the Gaussians in another order, along a space-filling curve (Morton 1966),
 * since they keep what neighbours share; .sog is the same for any number of threads. */
SG_API int sg_model_write(sg_ctx *ctx, const struct sg_model *model, const char *path,
                          const struct sg_model_file *file);

/* Which Gaussians to keep, and what of them. */
struct sg_model_selection {
    int sh_degree;      /* at most this degree is kept, 0..3. Default 3. */
    bool crop;          /* keep what has its centre in the box low..high. Default false. */
    double low[3];      /* scene units */
    double high[3];     /* at least low */
    double min_opacity; /* keep an opacity of at least this, 0..1. Default 0. */
};
#define SG_MODEL_SELECTION_DEFAULTS .sh_degree = 3
SG_API struct sg_model_selection sg_model_selection_default(void);

/* A copy of the Gaussians that are selected, in their order. selection may be NULL: all. The caller
 * owns *out. Errors: SG_ERR_USAGE for values out of range, SG_ERR_INPUT if none is left,
 * SG_ERR_BUDGET. */
SG_API int sg_model_select(sg_ctx *ctx, const struct sg_model *model,
                           const struct sg_model_selection *selection, struct sg_model **out);

#ifdef __cplusplus
}
#endif

#endif
