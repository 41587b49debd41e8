/* SPDX-License-Identifier: Apache-2.0 */
/* The result of the readers of scene formats: shots, that is photos by name with lens and pose,
 * before any photo is decoded. The files are untrusted; every shot in the list has been checked. */
#ifndef SG_SCENE_READER_H
#define SG_SCENE_READER_H

#include "core/folder.h"
#include "splatguard/scene.h"

#define SG_FOCAL_MIN 1e-6 /* pixels */
#define SG_LENS_MAX 1e7   /* pixels; beyond this a focal length or principal point is noise */
/* Scene units, so that squared distances stay finite in single precision products. */
#define SG_POSE_MAX 1e12

/* How a lens moves a point in direction (x, y, 1), at distance r from the axis. The coefficients
 * that a kind does not name are 0. */
enum sg_lens_kind {
    SG_LENS_POLYNOMIAL, /* r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8), p1 p2: pinholes, RADIAL,
                           OPENCV */
    SG_LENS_RATIONAL,   /* r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6), p1 p2:
                           FULL_OPENCV */
    SG_LENS_FISHEYE,    /* the polynomial of the angle atan r, p1 p2 s1 s2: ..._FISHEYE,
                           THIN_PRISM_FISHEYE */
    SG_LENS_FOV,        /* atan(2 r tan(omega / 2)) / omega */
};

struct sg_lens {
    int width, height;       /* size the numbers below are for; 0 = the photo's own */
    double fx, fy;           /* 0 = from the angle; fy also = fx without one */
    double angle_x, angle_y; /* fields of view in radians; 0 = not given */
    double cx, cy;           /* valid if has_principal, else the centre */
    bool has_principal;
    enum sg_lens_kind kind;
    double k1, k2, k3, k4, k5, k6; /* radial */
    double p1, p2, s1, s2;         /* decentred, thin prism */
    double omega;                  /* of SG_LENS_FOV: its field of view in radians */
};

/* The columns of a photo that a view uses: of `width` columns the left half is width / 2. */
enum sg_half { SG_HALF_BOTH, SG_HALF_LEFT, SG_HALF_RIGHT };

struct sg_shot {
    char *file;         /* as the scene file names the photo */
    char *name;         /* base name up to the first dot */
    char *path;         /* where the photo is; NULL until resolved */
    bool moved;         /* the photo is not in the folder that the scene file names */
    char *mask;         /* where its mask is, or NULL */
    bool mask_any;      /* all of the mask but 0 is used, else what is above one half */
    char *camera;       /* which one it was taken with, for messages */
    uint32_t camera_id; /* of COLMAP */
    uint64_t file_at;   /* of COLMAP: where its file of images has the name, in bytes */
    size_t file_room;   /* of COLMAP: bytes by which the name can be longer there */
    struct sg_lens lens;
    double R[9], t[3]; /* world to camera, as struct sg_camera */
    bool drop_alpha;   /* instead of compositing it */
    enum sg_view_split split;
    enum sg_half half;
    bool unused; /* in neither half of the scene's own split */
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

/* Adds a zeroed shot with a copy of file and its view name. "where" (file and place) starts error
 * messages. Absolute paths and ".." are refused: a scene may not name files outside its folder. */
int sg_shots_add(sg_ctx *ctx, struct sg_shots *shots, uint64_t max, const char *where,
                 const char *file, struct sg_shot **out);
void sg_shots_clear(struct sg_shots *shots);
void sg_shots_sort(struct sg_shots *shots); /* by view name, byte order */
/* View names from index first on become distinct: all are made of whole paths where two base names
 * are the same. */
int sg_shots_check_names(sg_ctx *ctx, const struct sg_shots *shots, size_t first,
                         const char *where);
/* No two shots have the same photo: one of another folder is missing where an image has that place
 * itself, and refused where several images would have it. */
int sg_shots_check_paths(sg_ctx *ctx, const struct sg_shots *shots, const char *where);
/* The ending of a file's name, with its dot, where it is that of a photo; else NULL. */
const char *sg_photo_ending(const char *file);
/* What the name of a photo has in place of its ending, which may be "", once the photo is written
 * as JPEG or PNG. */
const char *sg_written_ending(const char *ending, bool jpeg);
/* The same path with another suffix of photos (.JPG, .jpg, .jpeg, .png, .PNG, .webp), or one added
 * where it has none, if there is such a file: photos that were converted keep their place. *out:
 * NULL if there is none. */
int sg_find_converted(sg_ctx *ctx, const struct sg_folder *dir, const char *path, char **out);
/* Drops the shots without a path, with one warning for all. SG_ERR_INPUT if none is left, or with
 * strict. */
int sg_shots_drop_missing(sg_ctx *ctx, const struct sg_scene_params *params, struct sg_shots *shots,
                          const char *where);
/* Test shots become right halves, each followed by its left half as a training shot. All shots are
 * split. where: as above. */
int sg_shots_halve_tests(sg_ctx *ctx, const struct sg_scene_params *params, struct sg_shots *shots,
                         const char *where);
/* Every coefficient finite, focal lengths or angles usable. */
int sg_lens_check(sg_ctx *ctx, const struct sg_lens *lens, const char *where);
/* The largest distance between an element of m' m and of the identity. NaN where m has one. */
double sg_rotation_error(const double m[9], double *determinant);
/* The most in a camera: a pose in a file is off by at most 1e-2, and its inverse by 3.1e-2. */
#define SG_ROTATION_ERROR 5e-2
/* Whether views can be drawn with a camera; else `error`, for which where starts the message. */
int sg_camera_check(sg_ctx *ctx, const struct sg_camera *camera, int error, const char *where);
/* From a camera-to-world matrix with OpenGL axes (y up, z backward), row-major 4x4. */
int sg_pose_from_opengl(sg_ctx *ctx, const double m[16], const char *where, double R[9],
                        double t[3]);
/* From a unit quaternion w x y z and a translation, world to camera. */
int sg_pose_from_quaternion(sg_ctx *ctx, const double q[4], const double v[3], const char *where,
                            double R[9], double t[3]);

/* The formats that have a reader, in the order of enum sg_scene_format: value, name, the files that
 * a scene is recognised by, and the turn in which each is tried, from 1: as in the reference, a
 * COLMAP model wins over transforms_train.json. */
#define SG_READERS(R)                                                                              \
    R(BLENDER, blender, "transforms_train.json", 2)                                                \
    R(COLMAP, colmap, "sparse/0/images.bin and cameras.bin (or .txt, or in sparse/)", 1)           \
    R(NERFSTUDIO, nerfstudio, "transforms.json", 3)

/* One file a format: is the folder such a scene, and what does it hold? dir is the scene folder,
 * and every file is opened through it. Points stay empty where the scene has none. */
#define R(value, name, files, turn)                                                                \
    bool sg_is_##name(sg_ctx *ctx, const struct sg_folder *dir);                                   \
    int sg_read_##name(sg_ctx *ctx, const struct sg_folder *dir,                                   \
                       const struct sg_scene_params *params, struct sg_shots *shots,               \
                       struct sg_points *points);
SG_READERS(R)
#undef R

/* Photos alone, where they will do. */
int sg_is_photos(sg_ctx *ctx, const struct sg_folder *dir, bool *is);
int sg_read_photos(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                   struct sg_shots *shots, struct sg_points *points);

/* The folder is a scene, by the files that the formats begin with. Records no error. */
bool sg_scene_recognised(sg_ctx *ctx, const char *path);

/* "dir/name" is a regular file. */
bool sg_has_file(const struct sg_folder *dir, const char *name);

/* The points of the PLY at path, in the folder. */
int sg_read_points(sg_ctx *ctx, const struct sg_folder *dir, const char *path, uint64_t max_points,
                   struct sg_points *points);

/* Parsers alone, on memory: file is only a name for messages. No photo is looked for. *points_file:
 * the named PLY or NULL, the caller's. */
int sg_blender_parse(sg_ctx *ctx, const char *file, const char *data, size_t size,
                     uint64_t max_images, bool test, struct sg_shots *shots);
int sg_nerfstudio_parse(sg_ctx *ctx, const char *file, const char *data, size_t size,
                        const struct sg_scene_params *params, struct sg_shots *shots,
                        char **points_file);

/* Where the photos of a scene are, and how they are read. */
struct sg_scene_files {
    struct sg_folder dir;
    struct sg_scene_params params; /* without texts */
    struct sg_shots shots;
    /* Every N-th photo by name is a test photo. In copies of the scene one that is skipped here is
     * missing, and others would become test photos: none is skipped. */
    bool counted;
};
/* NULL-safe; sets *files to NULL. */
void sg_scene_files_destroy(struct sg_scene_files **files);

/* views.c: decodes, undistorts and resamples the photo of every shot, in parallel. views: one a
 * shot, zeroed; it stays so where the photo or its mask cannot be decoded, unless params are
 * strict or photos are counted. lazy: takes the pixels; may be NULL. */
int sg_views_load(sg_ctx *ctx, const struct sg_scene_params *params,
                  const struct sg_scene_files *files, struct sg_lazy_photos *lazy,
                  struct sg_view *views);
/* One of them. view: zeroed. *broken: set, with an error, if the photo or its mask cannot be
 * decoded. Thread safe. */
int sg_view_load(sg_ctx *ctx, const struct sg_scene_files *files, const struct sg_shot *shot,
                 struct sg_view *view, bool *broken);
void sg_view_clear(struct sg_view *view);
/* The camera of a view whose shot has no photo: shot->path is for messages, the lens has its size
 * and no distortion. */
int sg_view_place(sg_ctx *ctx, const struct sg_scene_params *params, const struct sg_shot *shot,
                  struct sg_view *view);
/* Of the pixels and the mask. */
uint64_t sg_view_hash(const struct sg_view *view);

/* builder.c */

/* SG_SPLIT_TRAIN or SG_SPLIT_TEST. To be asked for one view after the other, by sorted name; *rank
 * begins at 0. */
enum sg_view_split sg_split(const struct sg_scene_params *params, enum sg_view_split split,
                            size_t *rank);
/* Takes what the view owns, also where it fails. */
int sg_scene_builder_put_view(sg_scene_builder *builder, struct sg_view *view,
                              enum sg_view_split split);
/* Takes the arrays; there are no other points. */
void sg_scene_builder_put_points(sg_scene_builder *builder, struct sg_points *points);
/* Photos are to be read again from these files, which the scene takes, also where this fails. */
int sg_scene_builder_put_files(sg_scene_builder *builder, struct sg_scene_files **files,
                               struct sg_lazy_photos **lazy);
/* Where the views come from, for messages and for the copies of the scene. other_model: as in
 * struct sg_scene. */
int sg_scene_builder_set_source(sg_scene_builder *builder, enum sg_scene_format format,
                                const char *path, bool other_model);

/* lens.c */

bool sg_lens_is_distorted(const struct sg_lens *lens);
/* The position of direction (x, y, 1) in the photo, in focal lengths from the principal point. */
void sg_lens_distort(const struct sg_lens *lens, double x, double y, double *xd, double *yd);
/* Square of the radius, up to r2_max, up to which the radial part grows: beyond, it folds back and
 * would show parts of the photo twice. Infinite if it grows all the way. */
double sg_lens_fold(const struct sg_lens *lens, double r2_max);
/* Whether the surroundings of a direction are not mirrored, as decentred coefficients can do. */
bool sg_lens_keeps_sides(const struct sg_lens *lens, double x, double y);

/* undistort.c: the photo a pinhole with the lens' focal lengths and principal point would have
 * taken, same size. src, dst: height x width x 3. valid: height x width, 255 where the source has
 * the pixel, else 0 and black. *lost counts those. mask (may be NULL) is undistorted in place. The
 * lens is for this size. */
int sg_undistort(sg_ctx *ctx, const struct sg_lens *lens, int width, int height, const uint8_t *src,
                 uint8_t *dst, uint8_t *valid, uint8_t *mask, size_t *lost);

#endif
