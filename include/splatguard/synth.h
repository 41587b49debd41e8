/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_SYNTH_H
#define SPLATGUARD_SYNTH_H

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A ray-traced still life with exact cameras and surface points. */
struct sg_synth_params {
    int width, height; /* pixels, 16..4096. Default 400 x 400. */
    int train_views;   /* 4..4096. Default 60. */
    int test_views;    /* Blender layout, 1..4096; in the COLMAP layout every 8th view is one.
                          Default 12. */
    int points;        /* surface points in the COLMAP layout, 4..10 million. Default 20000. */
    int samples;       /* anti-aliasing samples per pixel and axis, 1..8. Default 3. */
    uint64_t seed;     /* Default 0. The same parameters give the same bytes. */
};

#define SG_SYNTH_DEFAULTS                                                                          \
    .width = 400, .height = 400, .train_views = 60, .test_views = 12, .points = 20000, .samples = 3
SG_API struct sg_synth_params sg_synth_params_default(void);

/* Writes DIR/blender and DIR/colmap. DIR is new or empty. params may be NULL. Errors:
 * SG_ERR_USAGE for values out of range and an empty path, SG_ERR_INPUT if the folder is not empty
 * or cannot be written to, SG_ERR_BUDGET. */
SG_API int sg_synth_write(sg_ctx *ctx, const char *dir, const struct sg_synth_params *params);

#ifdef __cplusplus
}
#endif

#endif
