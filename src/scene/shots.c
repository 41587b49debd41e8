/* SPDX-License-Identifier: Apache-2.0 */
/* The list of shots, and the checks every format needs: names, poses, lenses. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/file.h"
#include "model/ply.h"
#include "model/points.h"
#include "scene/reader.h"

const char *sg_photo_ending(const char *file)
{
    static const char *const endings[] = {".png", ".jpg", ".jpeg", ".webp"};
    const char *dot = strrchr(sg_base_name(file), '.');
    for (size_t i = 0; dot && i < sizeof(endings) / sizeof(endings[0]); i++)
        if (!strcasecmp(dot, endings[i]))
            return dot;
    return NULL;
}

const char *sg_written_ending(const char *ending, bool jpeg)
{
    if (!jpeg)
        return ".png";
    return !strcasecmp(ending, ".jpg") || !strcasecmp(ending, ".jpeg") ? ending : ".jpg";
}

int sg_find_converted(sg_ctx *ctx, const struct sg_folder *dir, const char *path, char **out)
{
    static const char *const suffixes[] = {".JPG", ".jpg", ".jpeg", ".png", ".PNG", ".webp"};
    const size_t n = sizeof(suffixes) / sizeof(suffixes[0]);
    const char *ending = sg_photo_ending(path); /* "frame.1" and "frame.2" are two photos */
    const size_t stem = ending ? (size_t) (ending - path) : strlen(path);
    *out = NULL;
    for (size_t i = 0; i < n; i++) {
        char *other = sg_strf(ctx, "%.*s%s", (int) stem, path, suffixes[i]);
        if (!other)
            return SG_ERR_BUDGET;
        if (sg_folder_has(dir, other)) {
            *out = other;
            return SG_OK;
        }
        sg_free(other);
    }
    return SG_OK;
}

int sg_shots_add(sg_ctx *ctx, struct sg_shots *shots, uint64_t max, const char *where,
                 const char *file, struct sg_shot **out)
{
    const char *base = sg_base_name(file);
    int length = (int) strcspn(base, ".");
    if (!length)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found image name \"%s\", expected the name of a file", where, file);
    if (!sg_path_is_inside(file))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found image name \"%s\", expected a path inside the scene", where,
                       file);
    if (shots->count >= max)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found more than %llu images, which is the limit",
                       where, (unsigned long long) max);
    if (sg_grow(ctx, SG_MEM_MISC, &shots->items, &shots->capacity, shots->count + 1, shots->count,
                sizeof(*shots->items)))
        return SG_ERR_BUDGET;
    struct sg_shot *shot = &shots->items[shots->count];
    *shot = (struct sg_shot){0};
    shots->count++; /* counted at once, so that sg_shots_clear frees what was made */
    shot->file = sg_strdup(ctx, file);
    shot->name = sg_strf(ctx, "%.*s", length, base);
    if (!shot->file || !shot->name)
        return SG_ERR_BUDGET;
    *out = shot;
    return SG_OK;
}

static void clear_shot(struct sg_shot *shot)
{
    sg_free(shot->file);
    sg_free(shot->name);
    sg_free(shot->path);
    sg_free(shot->camera);
    sg_free(shot->mask);
}

void sg_shots_clear(struct sg_shots *shots)
{
    for (size_t i = 0; i < shots->count; i++)
        clear_shot(&shots->items[i]);
    sg_free(shots->items);
    *shots = (struct sg_shots){0};
}

static void drop(struct sg_shots *shots)
{
    size_t kept = 0;
    for (size_t i = 0; i < shots->count; i++)
        if (shots->items[i].path)
            shots->items[kept++] = shots->items[i];
        else
            clear_shot(&shots->items[i]);
    shots->count = kept;
}

int sg_shots_drop_missing(sg_ctx *ctx, const struct sg_scene_params *params, struct sg_shots *shots,
                          const char *where)
{
    size_t missing = 0, wanted = 0, first = 0;
    for (size_t i = 0; i < shots->count; i++) {
        const struct sg_shot *shot = &shots->items[i];
        if (!shot->unused && !shot->path && !missing++)
            first = i;
        wanted += !shot->unused;
    }
    if (missing && (missing == wanted || params->strict))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %zu of %zu photos, the first that is missing is %s, also with "
                       "other endings%s%s",
                       where, wanted - missing, wanted, shots->items[first].file,
                       params->images ? ", in " : "", params->images ? params->images : "");
    if (missing)
        sg_log(ctx, SG_LOG_WARN,
               "%s: %zu of %zu photos are missing and are skipped, the first is %s%s", where,
               missing, wanted, shots->items[first].file,
               params->eval ? "; where every Nth photo is a test view, they do not count" : "");
    drop(shots);
    return SG_OK;
}

static int by_name(const void *a, const void *b)
{
    const struct sg_shot *x = a, *y = b;
    int order = strcmp(x->name, y->name);
    return order ? order : strcmp(x->file, y->file);
}

void sg_shots_sort(struct sg_shots *shots)
{
    if (shots->count)
        qsort(shots->items, shots->count, sizeof(*shots->items), by_name);
}

static int by_pointed_name(const void *a, const void *b)
{
    return by_name(*(const struct sg_shot *const *) a, *(const struct sg_shot *const *) b);
}

/* Rigs of cameras name photos by folder (left/001.jpg, right/001.jpg): the path without the ending
 * of a photo, "/" as "_". A copy of the scene with other endings has the same names. */
static int rename_by_path(sg_ctx *ctx, struct sg_shot *shot)
{
    const char *ending = sg_photo_ending(shot->file);
    const size_t stem = ending ? (size_t) (ending - shot->file) : strlen(shot->file);
    char *name = sg_strf(ctx, "%.*s", (int) stem, shot->file);
    if (!name)
        return SG_ERR_BUDGET;
    for (char *c = name; *c; c++)
        *c = *c == '/' ? '_' : *c;
    sg_free(shot->name);
    shot->name = name;
    return SG_OK;
}

int sg_shots_check_names(sg_ctx *ctx, const struct sg_shots *shots, size_t first, const char *where)
{
    size_t n = shots->count - first;
    struct sg_shot **sorted = sg_alloc(ctx, SG_MEM_MISC, n ? n : 1, sizeof(*sorted));
    if (!sorted)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++)
        sorted[i] = &shots->items[first + i];
    qsort(sorted, n, sizeof(*sorted), by_pointed_name);
    int code = SG_OK;
    bool twice = false;
    for (size_t i = 1; i < n; i++)
        twice |= !strcmp(sorted[i - 1]->name, sorted[i]->name);
    for (size_t i = 0; i < n && twice && !code; i++)
        code = rename_by_path(ctx, sorted[i]);
    if (twice && !code)
        qsort(sorted, n, sizeof(*sorted), by_pointed_name);
    for (size_t i = 1; i < n && !code; i++)
        if (!strcmp(sorted[i - 1]->name, sorted[i]->name))
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: images \"%s\" and \"%s\": found the same name \"%s\" twice, "
                           "expected distinct names",
                           where, sorted[i - 1]->file, sorted[i]->file, sorted[i]->name);
    sg_free(sorted);
    return code;
}

static int by_pointed_path(const void *a, const void *b)
{
    const struct sg_shot *x = *(const struct sg_shot *const *) a,
                         *y = *(const struct sg_shot *const *) b;
    const int order = strcmp(x->path, y->path);
    return order ? order : x->moved != y->moved ? x->moved - y->moved : strcmp(x->file, y->file);
}

int sg_shots_check_paths(sg_ctx *ctx, const struct sg_shots *shots, const char *where)
{
    struct sg_shot **found =
        sg_alloc(ctx, SG_MEM_MISC, shots->count ? shots->count : 1, sizeof(*found));
    size_t n = 0;
    int code = found ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < shots->count && !code; i++)
        if (shots->items[i].path)
            found[n++] = &shots->items[i];
    if (!code)
        qsort(found, n, sizeof(*found), by_pointed_path);
    for (size_t i = 1, owner = 0; i < n && !code; i++)
        if (strcmp(found[owner]->path, found[i]->path))
            owner = i;
        else if (!found[owner]->moved) {
            sg_free(found[i]->path);
            found[i]->path = NULL;
        } else
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found the photo %s alone for the images \"%s\" and \"%s\", "
                           "expected one for each, in the folders of their names",
                           where, found[i]->path, found[i - 1]->file, found[i]->file);
    sg_free(found);
    return code;
}

static bool within(double x, double limit) /* false for NaN */
{
    return fabs(x) <= limit;
}

int sg_lens_check(sg_ctx *ctx, const struct sg_lens *lens, const char *where)
{
    bool focal_x = lens->fx > 0 || (lens->angle_x > 0 && lens->angle_x < 3.14159);
    bool focal_y = lens->fy >= 0 && lens->angle_y >= 0 && lens->angle_y < 3.14159;
    if (!focal_x || !focal_y || !within(lens->fx, SG_LENS_MAX) || !within(lens->fy, SG_LENS_MAX))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found focal lengths %g, %g pixels and fields of view %g, %g radians, "
                       "expected ones above 0, of at most %g pixels or below 3.14159 radians",
                       where, lens->fx, lens->fy, lens->angle_x, lens->angle_y, SG_LENS_MAX);
    if (lens->has_principal && (!within(lens->cx, SG_LENS_MAX) || !within(lens->cy, SG_LENS_MAX)))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found principal point (%g, %g), expected pixels of at most %g", where,
                       lens->cx, lens->cy, SG_LENS_MAX);
    const double k[] = {lens->k1, lens->k2, lens->k3, lens->k4, lens->k5,   lens->k6,
                        lens->p1, lens->p2, lens->s1, lens->s2, lens->omega};
    for (size_t i = 0; i < sizeof(k) / sizeof(*k); i++)
        if (!isfinite(k[i]))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found a distortion of %g, expected finite coefficients", where,
                           k[i]);
    if (lens->kind == SG_LENS_FOV && !(lens->omega >= 0 && lens->omega < 3.1))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found distortion omega = %g, expected an angle of 0 to 3.1 radians",
                       where, lens->omega);
    return SG_OK;
}

double sg_rotation_error(const double m[9], double *determinant)
{
    double worst = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double dot = m[i] * m[j] + m[3 + i] * m[3 + j] + m[6 + i] * m[6 + j],
                         off = fabs(dot - (i == j));
            worst = off <= worst ? worst : off; /* takes NaN */
        }
    *determinant = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
                   m[2] * (m[3] * m[7] - m[4] * m[6]);
    return worst;
}

int sg_camera_check(sg_ctx *ctx, const struct sg_camera *c, int error, const char *where)
{
    const struct {
        const char *field;
        double value, low, high;
    } numbers[] = {
        {"width", c->width, 1, SG_SIDE_MAX},          {"height", c->height, 1, SG_SIDE_MAX},
        {"fx", c->fx, SG_FOCAL_MIN, SG_LENS_MAX},     {"fy", c->fy, SG_FOCAL_MIN, SG_LENS_MAX},
        {"cx", c->cx, -SG_LENS_MAX, SG_LENS_MAX},     {"cy", c->cy, -SG_LENS_MAX, SG_LENS_MAX},
        {"t[0]", c->t[0], -SG_POSE_MAX, SG_POSE_MAX}, {"t[1]", c->t[1], -SG_POSE_MAX, SG_POSE_MAX},
        {"t[2]", c->t[2], -SG_POSE_MAX, SG_POSE_MAX},
    };
    for (size_t i = 0; i < sizeof(numbers) / sizeof(*numbers); i++)
        if (!(numbers[i].value >= numbers[i].low && numbers[i].value <= numbers[i].high))
            return sg_fail(ctx, error, "%s: camera.%s: found %g, expected %g to %g", where,
                           numbers[i].field, numbers[i].value, numbers[i].low, numbers[i].high);
    double determinant;
    const double off = sg_rotation_error(c->R, &determinant);
    if (off < SG_ROTATION_ERROR && determinant > 0)
        return SG_OK;
    return sg_fail(ctx, error,
                   "%s: camera.R: found a matrix R that is off a rotation by %g (determinant %g), "
                   "expected one within %g",
                   where, off, determinant, SG_ROTATION_ERROR);
}

int sg_pose_from_opengl(sg_ctx *ctx, const double m[16], const char *where, double R[9],
                        double t[3])
{
    for (int i = 0; i < 16; i++)
        if (!within(m[i], SG_POSE_MAX))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found %g in the pose, expected numbers of at most %g", where, m[i],
                           SG_POSE_MAX);
    if (!within(m[12], 1e-6) || !within(m[13], 1e-6) || !within(m[14], 1e-6) ||
        !within(m[15] - 1, 1e-6))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %g %g %g %g as last row of the pose, expected 0 0 0 1", where,
                       m[12], m[13], m[14], m[15]);
    /* Some exporters leave the scale of the scene in the rotation. It changes no projection, so it
     * is removed. */
    double a[9], squares = 0;
    for (int i = 0; i < 9; i++) {
        a[i] = m[i / 3 * 4 + i % 3] *
               (i % 3 ? -1 : 1); /* OpenGL to COLMAP axes: y and z change sign */
        squares += a[i] * a[i];
    }
    double scale = sqrt(squares / 3), det;
    for (int i = 0; i < 9; i++)
        a[i] /= scale;
    const double worst = sg_rotation_error(a, &det);
    if (!(scale > 1e-12) || !(worst < 1e-2) || !(det > 0))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a pose that cannot be inverted to a camera (scale %g, "
                       "determinant %g), expected a rotation and a position",
                       where, scale, det);
    for (int i = 0; i < 3;
         i++) /* inverse by cofactors; the transpose would not undo rounding in the file */
        for (int j = 0; j < 3; j++) {
            int r0 = (j + 1) % 3, r1 = (j + 2) % 3, c0 = (i + 1) % 3, c1 = (i + 2) % 3;
            R[3 * i + j] =
                (a[3 * r0 + c0] * a[3 * r1 + c1] - a[3 * r0 + c1] * a[3 * r1 + c0]) / det;
        }
    for (int i = 0; i < 3; i++)
        t[i] = -(R[3 * i] * m[3] + R[3 * i + 1] * m[7] + R[3 * i + 2] * m[11]);
    return SG_OK;
}

int sg_pose_from_quaternion(sg_ctx *ctx, const double q[4], const double v[3], const char *where,
                            double R[9], double t[3])
{
    double n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(n > 1e-9) || !within(n, 1e9))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found quaternion %g %g %g %g, expected one of length 1", where, q[0],
                       q[1], q[2], q[3]);
    if (!within(v[0], SG_POSE_MAX) || !within(v[1], SG_POSE_MAX) || !within(v[2], SG_POSE_MAX))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found translation %g %g %g, expected numbers of at most %g", where,
                       v[0], v[1], v[2], SG_POSE_MAX);
    double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
    const double r[9] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y),
    };
    memcpy(R, r, sizeof(r));
    memcpy(t, v, 3 * sizeof(*t));
    return SG_OK;
}

bool sg_has_file(const struct sg_folder *dir, const char *name)
{
    char path[PATH_MAX]; /* a longer path could not be opened */
    return snprintf(path, sizeof(path), "%s/%s", dir->path, name) < (int) sizeof(path) &&
           sg_folder_has(dir, path);
}

int sg_read_points(sg_ctx *ctx, const struct sg_folder *dir, const char *path, uint64_t max_points,
                   struct sg_points *points)
{
    struct sg_source in;
    int code = sg_folder_source(ctx, dir, path, PLY_MAX_BYTES, &in);
    if (!code)
        code =
            sg_points_read_source(ctx, &in, max_points, &points->xyz, &points->rgb, &points->count);
    sg_source_close(&in);
    return code;
}

/* A copy of the shot, which sg_shots_clear frees, also after an error. */
static int copy_shot(sg_ctx *ctx, const struct sg_shot *from, struct sg_shot *to)
{
    *to = *from;
    to->file = sg_strdup(ctx, from->file);
    to->name = sg_strdup(ctx, from->name);
    to->path = sg_strdup(ctx, from->path);
    to->mask = from->mask ? sg_strdup(ctx, from->mask) : NULL;
    to->camera = from->camera ? sg_strdup(ctx, from->camera) : NULL;
    return to->file && to->name && to->path && !to->mask == !from->mask &&
                   !to->camera == !from->camera
               ? SG_OK
               : SG_ERR_BUDGET;
}

int sg_shots_halve_tests(sg_ctx *ctx, const struct sg_scene_params *params, struct sg_shots *shots,
                         const char *where)
{
    struct sg_shots all = {0};
    size_t tests = 0;
    for (size_t i = 0; i < shots->count; i++)
        tests += shots->items[i].split == SG_SPLIT_TEST;
    if (shots->count + tests > params->max_images)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %zu images and %zu left halves of them, expected at most %llu",
                       where, shots->count, tests, (unsigned long long) params->max_images);
    if (!tests)
        return SG_OK;
    all.capacity = shots->count + tests;
    all.items = sg_alloc(ctx, SG_MEM_MISC, all.capacity, sizeof(*all.items));
    if (!all.items)
        return SG_ERR_BUDGET;
    int code = SG_OK;
    for (size_t i = 0; i < shots->count; i++) {
        struct sg_shot *shot = &all.items[all.count++];
        *shot = shots->items[i];
        shots->items[i] = (struct sg_shot){0}; /* the copy owns its texts */
        if (shot->split != SG_SPLIT_TEST)
            continue;
        struct sg_shot *left = &all.items[all.count++];
        if (!code)
            code = copy_shot(ctx, shot, left);
        shot->half = SG_HALF_RIGHT;
        left->half = SG_HALF_LEFT, left->split = SG_SPLIT_TRAIN;
    }
    sg_shots_clear(shots);
    *shots = all;
    return code;
}
