/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP sparse models: cameras, images, points3D, each as .bin or .txt (Schoenberger and Frahm 2016). */
#ifndef SG_SCENE_COLMAP_H
#define SG_SCENE_COLMAP_H

#include "scene/reader.h"

#define SG_COLMAP_PARAMS_MAX 12

struct sg_colmap_camera {
    uint32_t id;
    struct sg_lens lens;
};

struct sg_colmap_cameras {
    struct sg_colmap_camera *items; /* rising ids once all are read */
    size_t count, capacity;
};

/* colmap.c: shared by both encodings, and all checks with it. */

/* Name and parameter count of a model number, or of a model name; NULL or -1 if there is none. */
const char *sg_colmap_model_name(int model);
int sg_colmap_model_params(int model);
int sg_colmap_model_find(const char *name);
int sg_colmap_add_camera(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *where, uint32_t id, int model,
                         uint64_t width, uint64_t height, const double *params);
int sg_colmap_add_image(sg_ctx *ctx, struct sg_shots *shots, uint64_t max, const struct sg_colmap_cameras *cameras,
                        const char *where, uint32_t camera, const double q[4], const double t[3], const char *name);
int sg_colmap_sort_cameras(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *file);

/* Parsers on memory. file is only a name for messages. */
int sg_colmap_cameras_bin(sg_ctx *ctx, const char *file, const void *data, size_t size, struct sg_colmap_cameras *out);
int sg_colmap_images_bin(sg_ctx *ctx, const char *file, const void *data, size_t size, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out);
int sg_colmap_points_bin(sg_ctx *ctx, const char *file, const void *data, size_t size, uint64_t max_points,
                         struct sg_points *out);

/* data ends with a zero byte and is changed. */
int sg_colmap_cameras_txt(sg_ctx *ctx, const char *file, char *data, size_t size, struct sg_colmap_cameras *out);
int sg_colmap_images_txt(sg_ctx *ctx, const char *file, char *data, size_t size, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out);
int sg_colmap_points_txt(sg_ctx *ctx, const char *file, char *data, size_t size, uint64_t max_points,
                         struct sg_points *out);

#endif
