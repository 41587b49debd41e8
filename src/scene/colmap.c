/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP folders: finds their files, translates camera models, and finds the photos. */
#include "scene/colmap.h"

#include <limits.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CAMERA_SIDE_MAX (1 << 20)

#define K(name) (int) offsetof(struct sg_lens, name)
static const struct {
    const char *name;
    int params,
        focals; /* number of parameters; number of focal lengths, which come before cx and cy */
    enum sg_lens_kind kind;
    int rest[8]; /* the coefficients that the parameters after cx and cy set */
} models[] = {
    /* By COLMAP's numbers; those between have lenses that struct sg_lens does not describe. */
    {"SIMPLE_PINHOLE", 3, 1, SG_LENS_POLYNOMIAL, {0}},
    {"PINHOLE", 4, 2, SG_LENS_POLYNOMIAL, {0}},
    {"SIMPLE_RADIAL", 4, 1, SG_LENS_POLYNOMIAL, {K(k1)}},
    {"RADIAL", 5, 1, SG_LENS_POLYNOMIAL, {K(k1), K(k2)}},
    {"OPENCV", 8, 2, SG_LENS_POLYNOMIAL, {K(k1), K(k2), K(p1), K(p2)}},
    {"OPENCV_FISHEYE", 8, 2, SG_LENS_FISHEYE, {K(k1), K(k2), K(k3), K(k4)}},
    {"FULL_OPENCV",
     12,
     2,
     SG_LENS_RATIONAL,
     {K(k1), K(k2), K(p1), K(p2), K(k3), K(k4), K(k5), K(k6)}},
    {"FOV", 5, 2, SG_LENS_FOV, {K(omega)}},
    {"SIMPLE_RADIAL_FISHEYE", 4, 1, SG_LENS_FISHEYE, {K(k1)}},
    {"RADIAL_FISHEYE", 5, 1, SG_LENS_FISHEYE, {K(k1), K(k2)}},
    {"THIN_PRISM_FISHEYE",
     12,
     2,
     SG_LENS_FISHEYE,
     {K(k1), K(k2), K(p1), K(p2), K(k3), K(k4), K(s1), K(s2)}},
    [14] = {"SIMPLE_FISHEYE", 3, 1, SG_LENS_FISHEYE, {0}},
    [15] = {"FISHEYE", 4, 2, SG_LENS_FISHEYE, {0}},
};
enum { MODELS = sizeof(models) / sizeof(*models) };

int sg_colmap_model_params(int model)
{
    return model >= 0 && model < MODELS && models[model].name ? models[model].params : -1;
}

int sg_colmap_model_find(const char *name)
{
    for (int i = 0; i < MODELS; i++)
        if (models[i].name && !strcmp(models[i].name, name))
            return i;
    return -1;
}

int sg_colmap_refuse_model(sg_ctx *ctx, const char *where, const char *found)
{
    char names[512] = "";
    for (int i = 0; i < MODELS; i++)
        if (models[i].name) {
            const size_t n = strlen(names);
            snprintf(names + n, sizeof(names) - n, "%s%s", n ? ", " : "", models[i].name);
        }
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: found camera model %s, expected one of %s; colmap image_undistorter makes "
                   "PINHOLE of others",
                   where, found, names);
}

const char *sg_colmap_model_name(int model)
{
    return models[model].name;
}

int sg_colmap_add_camera(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *where,
                         uint32_t id, int model, uint64_t width, uint64_t height, const double *p)
{
    if (width < 1 || height < 1 || width > CAMERA_SIDE_MAX || height > CAMERA_SIDE_MAX)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a camera of %llu x %llu pixels, expected sides of 1..%d", where,
                       (unsigned long long) width, (unsigned long long) height, CAMERA_SIDE_MAX);
    const int focals = models[model].focals;
    struct sg_lens lens = {.width = (int) width,
                           .height = (int) height,
                           .fx = p[0],
                           .fy = p[focals - 1],
                           .has_principal = true,
                           .cx = p[focals],
                           .cy = p[focals + 1],
                           .kind = models[model].kind};
    for (int i = focals + 2; i < models[model].params; i++)
        *(double *) ((char *) &lens + models[model].rest[i - focals - 2]) = p[i];
    if (!(lens.fy > 0)) /* struct sg_lens takes 0 for "not given" */
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found focal length %g, expected a positive one",
                       where, lens.fy);
    int code = sg_lens_check(ctx, &lens, where);
    if (!code)
        code = sg_grow(ctx, SG_MEM_MISC, &cameras->items, &cameras->capacity, cameras->count + 1,
                       cameras->count, sizeof(*cameras->items));
    if (code)
        return code;
    struct sg_colmap_camera *camera = &cameras->items[cameras->count++];
    *camera = (struct sg_colmap_camera){.id = id, .model = model, .lens = lens};
    memcpy(camera->params, p, (size_t) models[model].params * sizeof(*p));
    return SG_OK;
}

static int by_id(const void *a, const void *b)
{
    const struct sg_colmap_camera *x = a, *y = b;
    return (x->id > y->id) - (x->id < y->id);
}

int sg_colmap_sort_cameras(sg_ctx *ctx, struct sg_colmap_cameras *cameras, const char *file)
{
    if (!cameras->count)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no camera, expected at least one", file);
    qsort(cameras->items, cameras->count, sizeof(*cameras->items), by_id);
    for (size_t i = 1; i < cameras->count; i++)
        if (cameras->items[i].id == cameras->items[i - 1].id)
            return sg_fail(ctx, SG_ERR_INPUT, "%s: found camera id %u twice, expected distinct ids",
                           file, cameras->items[i].id);
    return SG_OK;
}

struct sg_colmap_camera *sg_colmap_find_camera(const struct sg_colmap_cameras *cameras, uint32_t id)
{
    const struct sg_colmap_camera key = {.id = id};
    return cameras->count ? bsearch(&key, cameras->items, cameras->count, sizeof(key), by_id)
                          : NULL;
}

int sg_colmap_add_image(sg_ctx *ctx, struct sg_shots *shots, uint64_t max,
                        const struct sg_colmap_cameras *cameras, const char *where, uint32_t camera,
                        const double q[4], const double t[3], const struct sg_colmap_name *name)
{
    const struct sg_colmap_camera *found = sg_colmap_find_camera(cameras, camera);
    if (!found)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: image \"%s\": found camera id %u, expected one of the %zu cameras",
                       where, name->text, camera, cameras->count);
    struct sg_shot *shot;
    int code = sg_shots_add(ctx, shots, max, where, name->text, &shot);
    if (code)
        return code;
    shot->lens = found->lens;
    shot->camera_id = camera;
    shot->file_at = name->at, shot->file_room = name->room;
    shot->camera = sg_strf(ctx, "%s: camera id %u", where, camera);
    if (!shot->camera)
        return SG_ERR_BUDGET;
    shot->drop_alpha = true;
    return sg_pose_from_quaternion(ctx, q, t, where, shot->R, shot->t);
}

static bool has_part(const struct sg_folder *dir, const char *folder, const char *name)
{
    char path[PATH_MAX]; /* a longer path could not be opened */
    return snprintf(path, sizeof(path), "%s/%s", folder, name) < (int) sizeof(path) &&
           sg_folder_has(dir, path);
}

/* The path of the model in the sub-folder `name` of the scene, or NULL. *text: its encoding. */
static char *model_in(sg_ctx *ctx, const struct sg_folder *dir, const char *name, bool *text)
{
    char *folder = sg_strf(ctx, "%s/%s", dir->path, name);
    if (!folder)
        return NULL;
    *text = false;
    if (has_part(dir, folder, "images.bin") && has_part(dir, folder, "cameras.bin"))
        return folder;
    *text = true;
    if (has_part(dir, folder, "images.txt") && has_part(dir, folder, "cameras.txt"))
        return folder;
    sg_free(folder);
    return NULL;
}

/* As model_in: the model of sparse/0, or else of sparse. */
static char *find_model(sg_ctx *ctx, const struct sg_folder *dir, bool *text)
{
    char *folder = model_in(ctx, dir, "sparse/0", text);
    return folder || sg_failed(ctx) ? folder : model_in(ctx, dir, "sparse", text);
}

bool sg_is_colmap(sg_ctx *ctx, const struct sg_folder *dir)
{
    bool text;
    char *folder = find_model(ctx, dir, &text);
    sg_free(folder);
    return folder != NULL;
}

/* COLMAP numbers the models of photos that it could not connect; the first need not be the largest.
 */
static int warn_of_another(sg_ctx *ctx, const struct sg_folder *dir)
{
    bool text;
    char *other = model_in(ctx, dir, "sparse/1", &text);
    if (other)
        sg_log(ctx, SG_LOG_WARN,
               "%s: found another COLMAP model beside sparse/0, of which nothing is used; "
               "--colmap sparse/1 reads it",
               other);
    sg_free(other);
    return sg_failed(ctx) ? SG_ERR_BUDGET : SG_OK;
}

/* Opens FOLDER/NAME; *path is set for messages and is the caller's. */
static int open_part(sg_ctx *ctx, const struct sg_folder *dir, const char *folder, const char *name,
                     char **path, struct sg_source *in)
{
    *path = sg_strf(ctx, "%s/%s", folder, name);
    return *path ? sg_folder_source(ctx, dir, *path, SG_COLMAP_BYTES, in) : SG_ERR_BUDGET;
}

/* <images>/<name>, or <images>/<base name> for photos that were moved out of their sub-folders. */
static int find_photos(sg_ctx *ctx, const struct sg_folder *dir, const char *images,
                       struct sg_shots *shots)
{
    int code = SG_OK;
    for (size_t i = 0; i < shots->count && !code; i++) {
        struct sg_shot *shot = &shots->items[i];
        const char *base = sg_base_name(shot->file),
                   *names[] = {shot->file, base == shot->file ? NULL : base};
        for (int k = 0; k < 2 && names[k] && !shot->path && !code; k++) {
            char *path = sg_strf(ctx, "%s/%s/%s", dir->path, images, names[k]);
            if (!path)
                return SG_ERR_BUDGET;
            if (sg_folder_has(dir, path)) {
                shot->path = path, shot->moved = k > 0;
                break;
            }
            if (!k)
                code = sg_find_converted(ctx, dir, path, &shot->path);
            sg_free(path);
        }
    }
    return code;
}

static int read_points(sg_ctx *ctx, const struct sg_folder *dir, const char *folder,
                       uint64_t max_points, struct sg_points *points)
{
    char *path = NULL;
    struct sg_source in = {0};
    int code = SG_OK;
    if (has_part(dir, folder, "points3D.ply")) { /* first, as the reference */
        path = sg_strf(ctx, "%s/points3D.ply", folder);
        code = path ? sg_read_points(ctx, dir, path, max_points, points) : SG_ERR_BUDGET;
    } else if (has_part(dir, folder, "points3D.bin")) {
        code = open_part(ctx, dir, folder, "points3D.bin", &path, &in);
        if (!code)
            code = sg_colmap_points_bin(ctx, &in, max_points, points);
    } else if (has_part(dir, folder, "points3D.txt")) {
        code = open_part(ctx, dir, folder, "points3D.txt", &path, &in);
        if (!code)
            code = sg_colmap_points_txt(ctx, &in, max_points, points);
    }
    sg_source_close(&in);
    sg_free(path);
    return code;
}

static int read_cameras(sg_ctx *ctx, const struct sg_folder *dir, struct sg_colmap_model *m)
{
    char *path;
    struct sg_source in = {0};
    int code = open_part(ctx, dir, m->folder, m->text ? "cameras.txt" : "cameras.bin", &path, &in);
    if (!code)
        code = m->text ? sg_colmap_cameras_txt(ctx, &in, &m->cameras)
                       : sg_colmap_cameras_bin(ctx, &in, &m->cameras);
    sg_source_close(&in);
    sg_free(path);
    return code;
}

static int read_images(sg_ctx *ctx, const struct sg_folder *dir, struct sg_colmap_model *m,
                       uint64_t max_images, struct sg_shots *shots)
{
    struct sg_source in = {0};
    int code =
        open_part(ctx, dir, m->folder, m->text ? "images.txt" : "images.bin", &m->images, &in);
    if (!code)
        code = m->text ? sg_colmap_images_txt(ctx, &in, max_images, &m->cameras, shots)
                       : sg_colmap_images_bin(ctx, &in, max_images, &m->cameras, shots);
    sg_source_close(&in);
    return code;
}

int sg_colmap_read_model(sg_ctx *ctx, const struct sg_folder *dir, const char *name,
                         uint64_t max_images, struct sg_colmap_model *m, struct sg_shots *shots)
{
    *m = (struct sg_colmap_model){0};
    m->folder = name ? model_in(ctx, dir, name, &m->text) : find_model(ctx, dir, &m->text);
    if (!m->folder)
        return sg_failed(ctx)
                   ? SG_ERR_BUDGET
                   : sg_fail(ctx, SG_ERR_INPUT,
                             "%s: found no COLMAP model, expected images and cameras (.bin or "
                             ".txt) in %s",
                             dir->path, name ? name : "sparse/0 or sparse");
    const int code = read_cameras(ctx, dir, m);
    return code ? code : read_images(ctx, dir, m, max_images, shots);
}

void sg_colmap_clear_model(struct sg_colmap_model *m)
{
    sg_free(m->folder);
    sg_free(m->images);
    sg_free(m->cameras.items);
    *m = (struct sg_colmap_model){0};
}

int sg_read_colmap(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                   struct sg_shots *shots, struct sg_points *points)
{
    struct sg_colmap_model m;
    int code = sg_colmap_read_model(ctx, dir, params->colmap, params->max_images, &m, shots);
    if (!code && !params->colmap)
        code = warn_of_another(ctx, dir);
    if (!code)
        code = sg_shots_check_names(ctx, shots, 0, m.images);
    if (!code)
        code = find_photos(ctx, dir, params->images ? params->images : "images", shots);
    if (!code)
        code = sg_shots_check_paths(ctx, shots, m.images);
    if (!code)
        code = sg_shots_drop_missing(ctx, params, shots, m.images);
    if (!code)
        code = read_points(ctx, dir, m.folder, params->max_points, points);
    if (!code)
        sg_shots_sort(shots);
    sg_colmap_clear_model(&m);
    return code;
}
