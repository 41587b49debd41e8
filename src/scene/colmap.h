/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP sparse models: cameras, images, points3D, each as .bin or .txt (Schoenberger and Frahm
 * 2016). */
#ifndef SG_SCENE_COLMAP_H
#define SG_SCENE_COLMAP_H

#include "core/source.h"
#include "scene/reader.h"

#define SG_COLMAP_PARAMS_MAX 12

struct sg_colmap_camera {
    uint32_t id;
    struct sg_lens lens;
};

struct sg_colmap_cameras {
    struct sg_colmap_camera *items; /* sorted by id once all are read */
    size_t count, capacity;
};

/* colmap.c: shared by both encodings, and all checks with it. */

/* Parameter count of a model number, and the number of a model name; -1 if there is none. */
int sg_colmap_model_params(int model);
int sg_colmap_model_find(const char *name);
int sg_colmap_add_camera(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *where,
                         uint32_t id, int model, uint64_t width, uint64_t height,
                         const double *params);
int sg_colmap_add_image(sg_ctx *ctx, struct sg_shots *shots, uint64_t max,
                        const struct sg_colmap_cameras *cameras, const char *where, uint32_t camera,
                        const double q[4], const double t[3], const char *name);
int sg_colmap_sort_cameras(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *file);

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

#endif
