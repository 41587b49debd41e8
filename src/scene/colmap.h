/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP sparse models: cameras, images, points3D, each as .bin or .txt (Schoenberger and Frahm
 * 2016). */
#ifndef SG_SCENE_COLMAP_H
#define SG_SCENE_COLMAP_H

#include "core/source.h"
#include "scene/reader.h"

#define SG_COLMAP_PARAMS_MAX 12
/* Of a file: large scenes have gigabytes of 2D observations; memory has its own limit. */
#define SG_COLMAP_BYTES (UINT64_C(1) << 34)

struct sg_colmap_camera {
    uint32_t id;
    int model;
    double params[SG_COLMAP_PARAMS_MAX]; /* as many as the model has */
    struct sg_lens lens;                 /* what they mean */
};

struct sg_colmap_cameras {
    struct sg_colmap_camera *items; /* sorted by id once all are read */
    size_t count, capacity;
};

/* The name of an image, and its place in the file of images as in struct sg_shot. */
struct sg_colmap_name {
    const char *text;
    uint64_t at;
    size_t room;
};

/* Cameras and images; the latter are shots. */
struct sg_colmap_model {
    char *folder; /* where it is */
    bool text;    /* its encoding */
    char *images; /* the file of the images */
    struct sg_colmap_cameras cameras;
};

/* colmap.c: shared by both encodings, and all checks with it. */

/* Parameter count of a model number, and the number of a model name; -1 if there is none. */
int sg_colmap_model_params(int model);
int sg_colmap_model_find(const char *name);
const char *sg_colmap_model_name(int model); /* there is one */
/* SG_ERR_INPUT, with the names of the models that are read. */
int sg_colmap_refuse_model(sg_ctx *ctx, const char *where, const char *found);
int sg_colmap_add_camera(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *where,
                         uint32_t id, int model, uint64_t width, uint64_t height,
                         const double *params);
int sg_colmap_add_image(sg_ctx *ctx, struct sg_shots *shots, uint64_t max,
                        const struct sg_colmap_cameras *cameras, const char *where, uint32_t camera,
                        const double q[4], const double t[3], const struct sg_colmap_name *name);
int sg_colmap_sort_cameras(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *file);
/* Sorted ones; NULL if none has the id. */
struct sg_colmap_camera *sg_colmap_find_camera(const struct sg_colmap_cameras *cameras,
                                               uint32_t id);
/* Reads the model in the sub-folder `name` of the scene, NULL = sparse/0 or else sparse. To be
 * cleared, also after an error. */
int sg_colmap_read_model(sg_ctx *ctx, const struct sg_folder *dir, const char *name,
                         uint64_t max_images, struct sg_colmap_model *out, struct sg_shots *shots);
void sg_colmap_clear_model(struct sg_colmap_model *model);

/* Parsers, reading to the end of a file. */
int sg_colmap_cameras_bin(sg_ctx *ctx, struct sg_source *in, struct sg_colmap_cameras *out);
int sg_colmap_images_bin(sg_ctx *ctx, struct sg_source *in, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out);
int sg_colmap_points_bin(sg_ctx *ctx, struct sg_source *in, uint64_t max_points,
                         struct sg_points *out);
int sg_colmap_cameras_txt(sg_ctx *ctx, struct sg_source *in, struct sg_colmap_cameras *out);
int sg_colmap_images_txt(sg_ctx *ctx, struct sg_source *in, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out);
int sg_colmap_points_txt(sg_ctx *ctx, struct sg_source *in, uint64_t max_points,
                         struct sg_points *out);

/* colmap_write.c: a copy of the scene is in `folder`, whose photos have the sizes of the scene's
 * views, and the endings of sg_written_ending. Writes the cameras of the copy anew where these
 * sizes are not theirs, as pinholes: no lens of the scene is distorted. A camera whose photos have
 * several sizes stays as it is. *renamed: whether names of views change; then the copy gets the
 * file of images that is read, with the names of the copy's photos. */
int sg_colmap_fit_copy(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_folder *dir,
                       const char *folder, bool jpeg, bool *renamed);

#endif
