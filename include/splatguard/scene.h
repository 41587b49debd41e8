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
    SG_FORMAT_MEMORY,     /* made by a builder, not read from a folder */
    SG_FORMAT_PHOTOS,     /* photos without cameras: see photos_alone */
};

/* Filters against noise. With the same results as OpenCV's: Gaussian of 5 x 5 pixels and sigma 1.5;
 * bilateral of diameter 9 with both sigmas 75 (grey levels, pixels). Wavelet: soft thresholds of
 * BayesShrink (Chang et al. 2000) on three levels of undecimated Haar wavelets, with the noise
 * estimated from each channel. */
enum sg_smooth { SG_SMOOTH_OFF, SG_SMOOTH_GAUSSIAN, SG_SMOOTH_BILATERAL, SG_SMOOTH_WAVELET };

struct sg_scene_params {
    enum sg_scene_format format; /* default SG_FORMAT_AUTO */
    const char *images;          /* image folder below the scene, COLMAP only; NULL = "images" */
    /* Folder of the COLMAP model below the scene, for one with several, e.g. "sparse/1". With
     * SG_FORMAT_AUTO it makes the scene one of COLMAP. NULL = "sparse/0" or "sparse". */
    const char *colmap;
    /* The reference's -r: 1, 2, 4 and 8 divide the size; -1 = at most 1600 wide; other values, up
     * to 16384, are the target width. Default -1. */
    int resolution;
    double downscale; /* divides the size after `resolution`, 1..64. Default 1. */
    /* Composite RGBA on white instead of black (COLMAP: alpha is ignored). Default false. */
    bool white_background;
    /* Hold test views out of training. Default false: every view is a training view, and the test
     * file of Blender scenes is not loaded. */
    bool eval;
    /* Every N-th view by sorted name is a test view (COLMAP, nerfstudio). Default 8. */
    int test_every;
    /* For folders, with eval: each test photo is a training view too, masked to its left half of
     * width / 2 columns, rounded down. Its test view is masked to the rest. This lets a
     * photo's own exposure or appearance be learned. Both views have the same name and path,
     * and both count for max_images. SG_ERR_INPUT for the layout of NeRF-Synthetic, whose training
     * and test photos have the same names. Default false. */
    bool test_halves;
    bool centred_principal; /* ignore cx and cy, as the reference does. Default false. */
    /* Folder of masks (white = use) with the names of the images; NULL = "masks" if it exists. */
    const char *masks;
    /* Follow symbolic links that lead out of the folder. Links that stay inside are always
     * followed. Default false. */
    bool follow_links;
    /* Nothing will be trained on the views: all may be test views, and no warning is given about
     * what training would lack. Default false. */
    bool untrained;
    /* Read a folder of photos that is no scene as SG_FORMAT_PHOTOS: what lies in the folder itself
     * and has the ending of a photo or begins as one. Alpha is ignored, as in COLMAP's scenes; the
     * views are named as the files. Their cameras say nothing: training and pruning refuse them,
     * and other measurements of models would mean nothing. Entries that may hide photos are warned
     * of, or refused with strict. Masks are only used if `masks` names their folder. Default false.
     */
    bool photos_alone;
    /* Refuse a scene if a photo is missing, cannot be decoded, or has another scale than its
     * camera. Otherwise such photos are skipped, or their focal lengths scaled, with a warning.
     * Default false. */
    bool strict;
    enum sg_smooth smooth; /* filters training photos after resizing. Default SG_SMOOTH_OFF. */
    uint64_t max_pixels;   /* per image. Default 1 << 28. */
    uint64_t max_images;   /* Default 1 << 16. */
    uint64_t max_points;   /* Default 1 << 27. */
};

#define SG_SCENE_DEFAULTS                                                                          \
    .format = SG_FORMAT_AUTO, .resolution = -1, .downscale = 1, .test_every = 8,                   \
    .max_pixels = 1u << 28, .max_images = 1u << 16, .max_points = 1u << 27
SG_API struct sg_scene_params sg_scene_params_default(void);

/* One view: a photo, its undistorted pinhole camera and its optional mask. */
struct sg_view {
    /* The base name up to the first dot, as in the reference. If two are equal, all views have
     * their path without its ending instead, with "_" for "/". */
    char *name;
    char *file;       /* the photo as the scene's own files name it */
    char *path;       /* the file it was decoded from */
    bool undistorted; /* the distortion of the lens was removed from rgb */
    bool lossless;    /* its file keeps every value: PNG, lossless WebP; false: not, or not known */
    struct sg_camera camera;     /* for the size of rgb */
    int file_width, file_height; /* size before any downscale, for cameras.json */
    /* height x width x 3, row-major, sRGB bytes as in the file, composited. NULL for a photo that
     * is read when it is needed, as all photos of a folder are that is loaded in a context with a
     * memory limit: see sg_view_pixels. */
    uint8_t *rgb;
    uint8_t *mask;  /* height x width, 0 = ignored, 255 = used; NULL = all used */
    uint64_t hash;  /* of rgb and mask as they were added; 0 = not known */
    bool in_pixels; /* private: the scene's files give its camera in pixels, not as an angle */
    struct sg_lazy_photo *lazy; /* private */
};

/* Thread safety: read-only after loading. */
struct sg_scene {
    enum sg_scene_format format; /* as recognised */
    char *path; /* of the folder or archive; for a scene from memory a name for messages */
    /* Training views in the order of their names (COLMAP, nerfstudio), of the file (Blender), or of
     * adding (memory); test views. */
    struct sg_view *train, *test;
    size_t n_train, n_test;
    size_t n_points;       /* 0 if the scene has none */
    float *points;         /* n_points x 3 positions */
    uint8_t *point_colors; /* n_points x 3 */
    bool white_background;
    bool follow_links;           /* as given to sg_scene_load */
    double center[3];            /* mean of the centres of the training cameras */
    double extent;               /* 1.1 x the largest distance of such a centre from `center` */
    bool other_model;            /* private: of COLMAP's, not the one that is read by default */
    struct sg_lazy_photos *lazy; /* private */
};

/* Loads cameras, points and images (decoded in parallel, undistorted, resampled). params may be
 * NULL. With a memory limit of the context, photos that do not fit are read again from their files
 * whenever they are used; the scene keeps its folder open for that. path may also name a zip
 * archive of such a folder (where zlib was at build): its files are unpacked as they are read,
 * never to disk. On success the caller owns *out. Errors: SG_ERR_USAGE for values out of range,
 * SG_ERR_INPUT, SG_ERR_BUDGET. */
SG_API int sg_scene_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                         struct sg_scene **out);
SG_API void sg_scene_destroy(struct sg_scene **scene);

/* The pixels of a view, laid out as `rgb`, for as long as sg_view_release has not been called as
 * often as this. Errors, after which *rgb is NULL and nothing is to be released: SG_ERR_INPUT if
 * the photo cannot be read or has other pixels than when the view was added; SG_ERR_BUDGET. Thread
 * safety: as the context. */
SG_API int sg_view_pixels(sg_ctx *ctx, const struct sg_view *view, const uint8_t **rgb);
SG_API void sg_view_release(const struct sg_view *view);

/* The index of the training view that shows the photo of `view`, which is a view of the scene: its
 * own index, or with test_halves that of a test view's left half. SIZE_MAX: none. */
SG_API size_t sg_scene_photo(const struct sg_scene *scene, const struct sg_view *view);

/* "colmap", "blender", ...: static. */
SG_API const char *sg_scene_format_name(enum sg_scene_format format);

/* A scene is built from memory in four steps: create a builder, add views, add points, finish.
 * Thread safety: as the context. */
typedef struct sg_scene_builder sg_scene_builder;

enum sg_view_split {
    SG_SPLIT_AUTO, /* with params.eval every test_every-th of these views by sorted name is a test
                      view; otherwise all are training views */
    SG_SPLIT_TRAIN,
    SG_SPLIT_TEST
};

/* A view for sg_scene_builder_add_view, which copies all texts and arrays. Start from zeros. */
struct sg_view_desc {
    /* 1..255 bytes without "/" and control characters; distinct within the training views and
     * within the test views. */
    const char *name;
    struct sg_camera camera;
    const uint8_t *rgb;  /* camera.height rows of camera.width x 3 sRGB bytes */
    size_t rgb_stride;   /* bytes from row to row; 0 = 3 x camera.width. Default 0. */
    const uint8_t *mask; /* camera.height rows of camera.width bytes, 0 = ignored, else used; NULL =
                            all used. Default NULL. */
    size_t mask_stride;  /* bytes from row to row; 0 = camera.width. Default 0. */
    enum sg_view_split split; /* Default SG_SPLIT_AUTO. */
    /* No lossy compression changed the photo: see the looks in docs/defense.md. Default false. */
    bool lossless;
    /* Instead of rgb, which is then NULL: writes camera.height x camera.width x 3 bytes without
     * gaps. Returns 0, or another number if it cannot, which ends the call of the library with
     * SG_ERR_INPUT. It is called once in sg_scene_builder_add_view and again when pixels are needed
     * that have been dropped, with the same result each time. It can be called on any thread, but
     * only during calls of the library and on one thread at a time for the views of a scene, and
     * must not use the context. Must stay callable until the scene is destroyed. Default NULL. */
    int (*read)(void *priv, uint8_t *rgb);
    void *read_priv;
};

/* params may be NULL. Only these are used: eval, test_every, untrained, white_background (of
 * renders), max_pixels, max_images and max_points. The caller owns *out. Errors: SG_ERR_USAGE,
 * SG_ERR_BUDGET. */
SG_API int sg_scene_builder_create(sg_ctx *ctx, const struct sg_scene_params *params,
                                   sg_scene_builder **out);
/* What messages and pages call the scene, such as where its photos are; copied. Default "scene from
 * memory". Errors: SG_ERR_BUDGET. */
SG_API int sg_scene_builder_set_name(sg_scene_builder *builder, const char *name);
/* An error leaves the builder unchanged. Errors: SG_ERR_USAGE, naming the view and the field, for
 * values out of range; SG_ERR_INPUT if the photo cannot be read; SG_ERR_BUDGET. */
SG_API int sg_scene_builder_add_view(sg_scene_builder *builder, const struct sg_view_desc *view);
/* For views with `read`: the bytes of photos, as the context counts them, that stay in memory after
 * their use; the others are dropped and read again. A training that needs the memory drops more. To
 * be called before such views are added. Default: all of them, or with a memory limit of the
 * context a quarter of it. */
SG_API void sg_scene_builder_keep_photos(sg_scene_builder *builder, uint64_t bytes);
/* Adds n points. xyz: n x 3, finite; rgb: n x 3, or NULL for grey. Both are copied. Errors: as
 * above. */
SG_API int sg_scene_builder_add_points(sg_scene_builder *builder, const float *xyz,
                                       const uint8_t *rgb, size_t n);
/* Splits the views, measures the extent, and makes the scene, which the caller owns. *builder is
 * destroyed and set to NULL; an error leaves it unchanged. Errors: SG_ERR_INPUT if there is no view
 * to train on or a name occurs twice in a split; SG_ERR_BUDGET. */
SG_API int sg_scene_builder_finish(sg_scene_builder **builder, struct sg_scene **out);
/* NULL-safe; sets *builder to NULL. */
SG_API void sg_scene_builder_destroy(sg_scene_builder **builder);

#ifdef __cplusplus
}
#endif

#endif
