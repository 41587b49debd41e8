/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_SCENE_H
#define SPLATGUARD_SCENE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sg_scene_format {
    SG_FORMAT_AUTO,       /* recognised by the folder's content */
    SG_FORMAT_BLENDER,    /* transforms_train.json, transforms_test.json */
    SG_FORMAT_COLMAP,     /* sparse/0 or sparse, images/ */
    SG_FORMAT_NERFSTUDIO, /* transforms.json */
};

/* Filters against noise, with the results of OpenCV's: Gaussian of 5 x 5 pixels and sigma 1.5;
 * bilateral of diameter 9 with both sigmas 75 (grey levels, pixels). */
enum sg_smooth { SG_SMOOTH_OFF, SG_SMOOTH_GAUSSIAN, SG_SMOOTH_BILATERAL };

struct sg_scene_params {
    enum sg_scene_format format; /* default SG_FORMAT_AUTO */
    const char *images;          /* image folder below the scene, COLMAP only; NULL = "images" */
    int resolution;   /* the reference's -r: 1, 2, 4, 8 divide the size; -1 = at most 1600 wide;
                         other, to 16384 =   target width. Default -1. */
    double downscale; /* divides the size after the resolution rule, 1..64. Default 1. */
    bool white_background;  /* RGBA is composited on white instead of black (COLMAP: alpha is
                               ignored). Default  false. */
    bool eval;              /* hold test views out of training. Default false: every view trains
                               (Blender: its test file is then not loaded). */
    int test_every;         /* every N-th view by sorted name is a test view (COLMAP, nerfstudio).
                               Default 8. */
    bool centred_principal; /* ignore cx, cy as the reference does. Default false. */
    const char *
        masks; /* folder of masks (white = use) with the images' names; NULL = "masks" if present */
    bool follow_links; /* symbolic links in the folder may lead out of it; links that stay inside
                          are always followed. Default false. */
    bool untrained;    /* nothing will be trained on the views: all of them may be test views, and
                          there is no    warning about what training would lack. Default false. */
    bool strict; /* refuse a scene of which a photo is missing or at another scale than its camera;
                    else such photos are skipped, or their focal lengths scaled, with a warning.
                    Default false. */
    enum sg_smooth
        smooth;          /* filter of the training photos, after resizing. Default SG_SMOOTH_OFF */
    uint64_t max_pixels; /* per image. Default 1 << 28. */
    uint64_t max_images; /* Default 1 << 16. */
    uint64_t max_points; /* Default 1 << 27. */
};

#define SG_SCENE_DEFAULTS                                                                          \
    .format = SG_FORMAT_AUTO, .resolution = -1, .downscale = 1, .test_every = 8,                   \
    .max_pixels = 1u << 28, .max_images = 1u << 16, .max_points = 1u << 27
SG_API struct sg_scene_params sg_scene_params_default(void);

/* One view: a photo, its undistorted pinhole camera and its optional mask. */
struct sg_view {
    char *name; /* base name up to the FIRST dot, as the reference; where two are the same, of all
                   the path without its ending, "/" as "_" */
    char *file; /* the photo as the scene's own files name it */
    char *path; /* file it was decoded from */
    bool undistorted;        /* rgb is not as photographed: the lens' distortion was taken out */
    struct sg_camera camera; /* for the size of rgb */
    int file_width, file_height; /* size before any downscale, for cameras.json */
    uint8_t *rgb;  /* height x width x 3, row-major, sRGB bytes as in the file, composited */
    uint8_t *mask; /* height x width, 0 = ignored in the loss, 255 = used; NULL = all used */
};

/* Thread safety: read-only after loading. */
struct sg_scene {
    enum sg_scene_format format; /* as recognised */
    char *path;
    struct sg_view *train,
        *test; /* train: name order for COLMAP and nerfstudio, file order for Blender */
    size_t n_train, n_test;
    size_t n_points;       /* 0 if the scene has none */
    float *points;         /* n_points x 3 positions */
    uint8_t *point_colors; /* n_points x 3 */
    bool white_background;
    bool follow_links; /* as it was loaded */
    double center[3];  /* mean of the train camera centres */
    double extent;     /* 1.1 x largest distance of a train camera centre from their mean */
};

/* Loads cameras, points and images (decoded in parallel, undistorted, resampled). params may be
 * NULL. On success the caller owns *out. Errors: SG_ERR_USAGE for values out of range,
 * SG_ERR_INPUT, SG_ERR_BUDGET. */
SG_API int sg_scene_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                         struct sg_scene **out);
SG_API void sg_scene_destroy(struct sg_scene **scene);

SG_API const char *sg_scene_format_name(enum sg_scene_format format);

#ifdef __cplusplus
}
#endif

#endif
