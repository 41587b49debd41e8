/* SPDX-License-Identifier: Apache-2.0 */
/* What the readers of scene formats hand over: shots, that is photos by name with their lens and pose, before any
 * photo is decoded. Everything here comes from files nobody vouches for; a shot in the list has been checked. */
#ifndef SG_SCENE_READER_H
#define SG_SCENE_READER_H

#include "core/folder.h"
#include "splatguard/scene.h"

/* COLMAP's OPENCV camera model, of which its simpler ones are special cases (coefficients 0). */
struct sg_lens {
    int width, height;       /* size the numbers below are for; 0 = the photo's own */
    double fx, fy;           /* 0 = from the angle; fy also = fx without one */
    double angle_x, angle_y; /* fields of view in radians; 0 = not given */
    double cx, cy;           /* valid if has_principal, else the centre */
    bool has_principal;
    double k1, k2, p1, p2;
};

struct sg_shot {
    char *file; /* as the scene file names the photo */
    char *name; /* base name up to the first dot */
    char *path; /* where the photo is; NULL until resolved */
    char *mask; /* where its mask is, or NULL */
    struct sg_lens lens;
    double R[9], t[3]; /* world to camera, as struct sg_camera */
    bool drop_alpha;   /* instead of compositing it */
    bool test, unused; /* unused: in neither half of the scene's own split */
};

struct sg_shots {
    struct sg_shot *items;
    size_t count, capacity;
};

struct sg_points {
    float *xyz;
    uint8_t *rgb;
    size_t count;
};

/* shots.c */

/* Adds a zeroed shot with a copy of file and its view name. "where" (file and place) starts error messages. Absolute
 * paths and ".." are refused: a scene may not name files outside its folder. */
int sg_shots_add(sg_ctx *ctx, struct sg_shots *shots, uint64_t max, const char *where, const char *file,
                 struct sg_shot **out);
void sg_shots_clear(struct sg_shots *shots);
void sg_shots_drop(struct sg_shots *shots);              /* removes the shots without a path */
void sg_shots_sort(struct sg_shots *shots);              /* by view name, byte order */
bool sg_path_is_inside(const char *path);                /* relative and without ".." */
/* View names from index first on become distinct: all are made of whole paths where two base names are the same. */
int sg_shots_check_names(sg_ctx *ctx, const struct sg_shots *shots, size_t first, const char *where);
const char *sg_base_name(const char *path);
/* The same path with another suffix of photos (.JPG, .jpg, .jpeg, .png, .PNG, .webp), or one added where it has none,
 * if there is such a file: photos that were converted keep their place. *out: NULL if there is none. */
int sg_find_converted(sg_ctx *ctx, const struct sg_folder *dir, const char *path, char **out);
/* Every coefficient finite, focal lengths or angles usable. */
int sg_lens_check(sg_ctx *ctx, const struct sg_lens *lens, const char *where);
/* From a camera-to-world matrix with OpenGL axes (y up, z backward), row-major 4x4. */
int sg_pose_from_opengl(sg_ctx *ctx, const double m[16], const char *where, double R[9], double t[3]);
/* From a unit quaternion w x y z and a translation, world to camera. */
int sg_pose_from_quaternion(sg_ctx *ctx, const double q[4], const double v[3], const char *where, double R[9],
                            double t[3]);

/* One file a format. dir is the scene folder, and every file is opened through it. Points stay empty where the scene has none. */
int sg_read_blender(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                    struct sg_shots *shots, struct sg_points *points);
int sg_read_colmap(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                   struct sg_shots *shots, struct sg_points *points);
int sg_read_nerfstudio(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                       struct sg_shots *shots, struct sg_points *points);
bool sg_is_blender(sg_ctx *ctx, const struct sg_folder *dir);
bool sg_is_colmap(sg_ctx *ctx, const struct sg_folder *dir);
bool sg_is_nerfstudio(sg_ctx *ctx, const struct sg_folder *dir);

/* The folder is a scene, by the files that the formats begin with. Records no error. */
bool sg_scene_recognised(sg_ctx *ctx, const char *path);

/* "dir/name" is a regular file. */
bool sg_has_file(sg_ctx *ctx, const struct sg_folder *dir, const char *name);

/* The points of the PLY at path, in the folder. */
int sg_read_points(sg_ctx *ctx, const struct sg_folder *dir, const char *path, uint64_t max_points,
                   struct sg_points *points);

/* Parsers alone, on memory: file is only a name for messages. No photo is looked for. *points_file: the named PLY or
 * NULL, the caller's; *listed: the file brought its own split. */
int sg_blender_parse(sg_ctx *ctx, const char *file, const char *data, size_t size, uint64_t max_images, bool test,
                     struct sg_shots *shots);
int sg_nerfstudio_parse(sg_ctx *ctx, const char *file, const char *data, size_t size,
                        const struct sg_scene_params *params, struct sg_shots *shots, char **points_file, bool *listed);

/* views.c: decodes, undistorts and resamples the photo of every shot, in parallel. views: one a shot, zeroed. */
int sg_views_load(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                  const struct sg_shots *shots, struct sg_view *views);
void sg_view_clear(struct sg_view *view);

/* undistort.c: the photo a pinhole with the lens' focal lengths and principal point would have taken, same size.
 * src, dst: height x width x 3. valid: height x width, 255 where the source has the pixel, else 0 and black.
 * *lost counts those. mask (may be NULL) is moved along in place. The lens is for this size. */
int sg_undistort(sg_ctx *ctx, const struct sg_lens *lens, int width, int height, const uint8_t *src, uint8_t *dst,
                 uint8_t *valid, uint8_t *mask, size_t *lost);

#endif
