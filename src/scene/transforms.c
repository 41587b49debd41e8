/* SPDX-License-Identifier: Apache-2.0 */
#include "scene/transforms.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/json_text.h"
#include "core/source.h"

int sg_transforms_read(sg_ctx *ctx, const struct sg_folder *dir, const char *file, char **data,
                       size_t *size)
{
    struct sg_source in;
    *data = NULL;
    int code = sg_folder_source(ctx, dir, file, SG_JSON_BYTES, &in);
    if (!code)
        code = sg_source_skip_mark(ctx, &in);
    const size_t ready = code ? 0 : sg_source_fill(&in, SG_SOURCE_WINDOW);
    if (ready && memchr(in.window, 0, ready)) /* before the whole file is in memory */
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: found a zero byte, expected JSON", file);
    if (!code)
        code = sg_source_read(ctx, &in, data, size);
    sg_source_close(&in);
    return code;
}

int sg_transforms_load(sg_ctx *ctx, const char *file, const char *data, size_t size,
                       uint64_t max_frames, struct sg_transforms *out)
{
    json_error_t error;
    struct sg_source text;
    *out = (struct sg_transforms){0};
    sg_source_of_memory(&text, file, data, size);
    int code = sg_source_skip_mark(ctx, &text);
    if (code)
        return code;
    data = text.window, size = text.ready;
    code = sg_json_reserve(ctx, data, size, &out->room);
    if (code)
        return code;
    out->root = json_loadb(data, size, JSON_REJECT_DUPLICATES, &error);
    out->frames = json_object_get(out->root, "frames");
    if (!out->root)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: line %d, column %d: JSON: %s", file, error.line,
                       error.column, error.text);
    else if (!json_is_array(out->frames) || !json_array_size(out->frames))
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no frames, expected an array \"frames\" of at least one", file);
    else if (json_array_size(out->frames) > max_frames)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: frames: found %zu, the limit is %llu", file,
                       json_array_size(out->frames), (unsigned long long) max_frames);
    if (code)
        sg_transforms_clear(out);
    return code;
}

void sg_transforms_clear(struct sg_transforms *t)
{
    json_decref(t->root);
    sg_free(t->room);
    *t = (struct sg_transforms){0};
}

/* Leaves *out unchanged if the key is absent or null. */
static int get_number(sg_ctx *ctx, const json_t *object, const char *key, const char *where,
                      double *out)
{
    const json_t *value = json_object_get(object, key);
    if (!value || json_is_null(value))
        return SG_OK;
    if (!json_is_number(value))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: \"%s\": found %s, expected a number", where, key,
                       sg_json_show(value, (char[SG_JSON_SHOWN]){0}));
    *out = json_number_value(value);
    return SG_OK;
}

int sg_json_text(sg_ctx *ctx, const json_t *object, const char *key, const char *where,
                 const char **out)
{
    const json_t *value = json_object_get(object, key);
    if (!value || json_is_null(value))
        return SG_OK;
    if (!json_is_string(value))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: \"%s\": found %s, expected a string", where, key,
                       sg_json_show(value, (char[SG_JSON_SHOWN]){0}));
    *out = json_string_value(value);
    return SG_OK;
}

static int get_side(sg_ctx *ctx, const json_t *object, const char *key, const char *where,
                    int *side)
{
    double v = 0;
    int code = get_number(ctx, object, key, where, &v);
    if (code || v == 0)
        return code;
    if (!(v >= 1 && v <= 1 << 20) || v != floor(v)) /* some writers make it 1080.0 */
        return sg_fail(ctx, SG_ERR_INPUT, "%s: \"%s\": found %g, expected a whole number of pixels",
                       where, key, v);
    *side = (int) v;
    return SG_OK;
}

/* The kind of lens that an object names, if it does. */
static int get_kind(sg_ctx *ctx, const json_t *object, const char *where, enum sg_lens_kind *kind)
{
    static const struct {
        const char *name;
        enum sg_lens_kind kind;
    } models[] = {
        {"OPENCV", SG_LENS_POLYNOMIAL},         {"PINHOLE", SG_LENS_POLYNOMIAL},
        {"SIMPLE_PINHOLE", SG_LENS_POLYNOMIAL}, {"RADIAL", SG_LENS_POLYNOMIAL},
        {"SIMPLE_RADIAL", SG_LENS_POLYNOMIAL},  {"FULL_OPENCV", SG_LENS_RATIONAL},
        {"OPENCV_FISHEYE", SG_LENS_FISHEYE},
    };
    const char *name = NULL;
    const int code = sg_json_text(ctx, object, "camera_model", where, &name);
    bool known = !name;
    for (size_t i = 0; i < sizeof(models) / sizeof(*models) && !known && !code; i++)
        if ((known = !strcmp(name, models[i].name)))
            *kind = models[i].kind;
    if (code || !known)
        return code ? code
                    : sg_fail(ctx, SG_ERR_INPUT,
                              "%s: found camera model %s, expected OPENCV, OPENCV_FISHEYE, "
                              "FULL_OPENCV, PINHOLE, SIMPLE_PINHOLE, RADIAL or SIMPLE_RADIAL: "
                              "undistort the images first",
                              where, name);
    if (json_is_true(json_object_get(object, "is_fisheye")))
        *kind = SG_LENS_FISHEYE;
    return SG_OK;
}

int sg_json_lens(sg_ctx *ctx, const json_t *object, const char *where, struct sg_lens *lens)
{
    double centre[2] = {NAN, NAN};
    const struct {
        const char *key;
        double *value;
    } numbers[] = {
        {"fl_x", &lens->fx},
        {"fl_y", &lens->fy},
        {"camera_angle_x", &lens->angle_x},
        {"camera_angle_y", &lens->angle_y},
        {"cx", &centre[0]},
        {"cy", &centre[1]},
        {"k1", &lens->k1},
        {"k2", &lens->k2},
        {"k3", &lens->k3},
        {"k4", &lens->k4},
        {"k5", &lens->k5},
        {"k6", &lens->k6},
        {"p1", &lens->p1},
        {"p2", &lens->p2},
    };
    int code = get_side(ctx, object, "w", where, &lens->width);
    if (!code)
        code = get_side(ctx, object, "h", where, &lens->height);
    for (size_t i = 0; i < sizeof(numbers) / sizeof(*numbers) && !code; i++)
        code = get_number(ctx, object, numbers[i].key, where, numbers[i].value);
    if (!code)
        code = get_kind(ctx, object, where, &lens->kind);
    if (code)
        return code;
    if (isnan(centre[0]) != isnan(centre[1]))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found one of cx and cy, expected both", where);
    if (!isnan(centre[0])) {
        lens->has_principal = true;
        lens->cx = centre[0];
        lens->cy = centre[1];
    }
    return SG_OK;
}

/* Coefficients whose meaning differs between programs, or that a lens of this kind does not have.
 */
static int check_kind(sg_ctx *ctx, const struct sg_lens *lens, const char *where)
{
    if (lens->kind == SG_LENS_POLYNOMIAL && (lens->k4 != 0 || lens->k5 != 0 || lens->k6 != 0))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found distortion k4 = %g, k5 = %g, k6 = %g, expected only k1 k2 k3 p1 "
                       "p2, or camera_model FULL_OPENCV",
                       where, lens->k4, lens->k5, lens->k6);
    if (lens->kind != SG_LENS_FISHEYE)
        return SG_OK;
    if (lens->k5 != 0 || lens->k6 != 0 || lens->p1 != 0 || lens->p2 != 0)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found distortion p1 = %g, p2 = %g, k5 = %g, k6 = %g, expected only k1 "
                       "k2 k3 k4 of a fisheye lens",
                       where, lens->p1, lens->p2, lens->k5, lens->k6);
    if (!(lens->fx > 0))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no fl_x, expected that of a fisheye lens in pixels", where);
    return SG_OK;
}

static int get_pose(sg_ctx *ctx, const json_t *frame, const char *where, struct sg_shot *shot)
{
    double m[16] = {[15] = 1};
    const json_t *rows = json_object_get(frame, "transform_matrix");
    size_t n = json_array_size(rows); /* 0 for anything but an array */
    bool ok = n == 3 || n == 4;
    for (size_t i = 0; i < n && ok; i++) {
        const json_t *row = json_array_get(rows, i);
        ok = json_array_size(row) == 4;
        for (size_t j = 0; j < 4 && ok; j++) {
            const json_t *value = json_array_get(row, j);
            ok = json_is_number(value);
            m[4 * i + j] = json_number_value(value);
        }
    }
    if (!ok)
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: \"transform_matrix\": found none or a malformed one, expected 4 rows of 4 numbers",
            where);
    return sg_pose_from_opengl(ctx, m, where, shot->R, shot->t);
}

int sg_transforms_frame(sg_ctx *ctx, const json_t *frame, const char *where,
                        const struct sg_lens *lens, uint64_t max_images, struct sg_shots *shots,
                        struct sg_shot **shot)
{
    const char *file = NULL;
    int code = sg_json_text(ctx, frame, "file_path", where, &file);
    if (!code && !file)
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no \"file_path\", expected the name of an image", where);
    if (code)
        return code;
    while (file[0] == '.' && file[1] == '/')
        file += 2;
    code = sg_shots_add(ctx, shots, max_images, where, file, shot);
    if (code)
        return code;
    (*shot)->lens = *lens;
    (*shot)->camera = sg_strdup(ctx, where);
    code = (*shot)->camera ? sg_lens_check(ctx, lens, where) : SG_ERR_BUDGET;
    if (!code)
        code = check_kind(ctx, lens, where);
    return code ? code : get_pose(ctx, frame, where, *shot);
}

int sg_find_photo(sg_ctx *ctx, const struct sg_folder *dir, const char *file, char **path)
{
    static const char *const suffixes[] = {"", ".png", ".jpg", ".jpeg", ".webp"};
    /* No suffix is added to a name that ends in a known one. A name with another dot may get one.
     */
    const bool complete = sg_photo_ending(file);
    size_t n = complete ? 1 : sizeof(suffixes) / sizeof(*suffixes);
    *path = NULL;
    for (size_t i = 0; i < n; i++) {
        *path = sg_strf(ctx, "%s/%s%s", dir->path, file, suffixes[i]);
        if (!*path)
            return SG_ERR_BUDGET;
        if (sg_folder_has(dir, *path))
            return SG_OK;
        sg_free(*path);
        *path = NULL;
    }
    if (complete) {
        char *named = sg_strf(ctx, "%s/%s", dir->path, file);
        const int code = named ? sg_find_converted(ctx, dir, named, path) : SG_ERR_BUDGET;
        sg_free(named);
        if (code || *path)
            return code;
    }
    return SG_OK;
}
