/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_RENDER_H
#define SPLATGUARD_RENDER_H

#include <stdbool.h>

#include "camera.h"
#include "context.h"
#include "model.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sg_render_params {
    float background[3]; /* 0..1. Default black. */
    /* Keep every tile of the 3-sigma square, as the reference does. Default false. */
    bool reference_tiles;
    /* The 2D filter of Mip-Splatting (Yu et al. 2024): each Gaussian is widened by this variance,
     * in squared pixels, instead of 0.3, and its opacity makes up for that. For models that were
     * trained with it, usually 0.1. 0..100, 0 = no such filter. Default 0. */
    float mip_kernel;
    /* Of models of anchors that learned the appearances of photos: the photo, from 0, whose
     * appearance renders have. SG_APPEARANCE_INDEX: view i of a list has that of photo i, as in the
     * released code of Scaffold-GS (see sg_renderer_set_index). SG_APPEARANCE_MEAN: the mean of
     * all, which is also taken where there is no such photo or index. SG_APPEARANCE_ZERO: zeros.
     * Default SG_APPEARANCE_MEAN. */
    int appearance;
    /* (Gaussian, tile) pairs held at once. Views with more are processed in bands. Default 1 << 24.
     */
    uint64_t max_instances;
};
#define SG_APPEARANCE_INDEX (-1)
#define SG_APPEARANCE_MEAN (-2)
#define SG_APPEARANCE_ZERO (-3)
#define SG_RENDER_DEFAULTS .max_instances = 1u << 24, .appearance = SG_APPEARANCE_MEAN
SG_API struct sg_render_params sg_render_params_default(void);

/* The work that a view took. */
struct sg_render_stats {
    uint64_t visible;   /* Gaussians that are not culled */
    uint64_t instances; /* (Gaussian, tile) pairs */
    uint64_t pairs;     /* (Gaussian, pixel) pairs evaluated; 0 if the engine does not count them */
    uint64_t max_tile;  /* longest tile list */
    uint32_t bands;     /* bands the image was processed in */
};

/* What counts as a hit of a Gaussian in a view. */
enum sg_hit {
    SG_HIT_PIXELS,       /* each pixel it is blended in (as in LightGaussian, Fan et al. 2024) */
    SG_HIT_VIEWS,        /* the view, if it is blended in any pixel */
    SG_HIT_WEIGHT,       /* each pixel, with the Gaussian's weight there: alpha x transmittance */
    SG_HIT_TRANSMITTANCE /* each pixel, with the transmittance in front of the Gaussian there */
};

/* How many values become one. */
enum sg_combine { SG_COMBINE_SUM, SG_COMBINE_MAX, SG_COMBINE_MEAN };

/* A renderer holds a copy of a model on an engine. Thread safety: unsafe. */
typedef struct sg_renderer sg_renderer;

/* engine: NULL = "auto", which looks for a GPU and takes the CPU without one; else see
 * SG_ENGINE_HELP. cpu: NULL = the best variant that this machine has, else "baseline", "avx2",
 * "avx512", "neon". params may be NULL. The model is copied; the caller destroys *out. Errors:
 * SG_ERR_USAGE for an engine or variant that is not there, for values out of range and for
 * max_instances outside 1..4e9, SG_ERR_BUDGET. */
SG_API int sg_renderer_create(sg_ctx *ctx, const char *engine, const char *cpu,
                              const struct sg_model *model, const struct sg_render_params *params,
                              sg_renderer **out);
SG_API void sg_renderer_destroy(sg_renderer **renderer);

/* SG_ERR_USAGE if the model does not have an appearance of params. A renderer draws the mean of
 * all then, and a model without appearances as it is. */
SG_API int sg_render_check_appearance(sg_ctx *ctx, const struct sg_model *model,
                                      const struct sg_render_params *params);

/* Says which view of a list the next renders are, for SG_APPEARANCE_INDEX. SIZE_MAX: none, as at
 * the beginning. */
SG_API void sg_renderer_set_index(sg_renderer *renderer, size_t index);
/* The next renders have the appearance of this training photo, whatever params.appearance says; the
 * mean of all if the model has no such photo. SIZE_MAX: params.appearance counts, as at the
 * beginning. */
SG_API void sg_renderer_set_photo(sg_renderer *renderer, size_t photo);

/* Renders one view. rgb: 3 planes of height x width floats, not clamped. alpha, depth: one plane
 * each, or NULL. depth is the alpha-weighted sum of z in camera space; divide it by alpha for the
 * mean. stats may be NULL. Errors: SG_ERR_USAGE for a camera with values out of range,
 * SG_ERR_BUDGET. */
SG_API int sg_render(sg_renderer *renderer, const struct sg_camera *camera, float *rgb,
                     float *alpha, float *depth, struct sg_render_stats *stats);

/* Gradients of a scalar L with respect to the parameters as stored, from dL/dimage of the view that
 * sg_render drew last with this renderer: the backward pass of a rasteriser. gradient: 3 planes of
 * height x width floats. out: a model of the renderer's count and SH degree, which receives dL/d of
 * each parameter. Errors: SG_ERR_USAGE for a model of another shape or of anchors, and before a
 * view was drawn or after the renderer of a trainer was used; SG_ERR_BUDGET. */
SG_API int sg_render_backward(sg_renderer *renderer, const float *gradient, struct sg_model *out);

#ifdef __cplusplus
}
#endif

#endif
