/* SPDX-License-Identifier: Apache-2.0 */
/* cameras.json: written of a scene, and read as views without photos. The file is untrusted. */
#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "core/file.h"
#include "core/json_text.h"
#include "image/image.h"
#include "option/option.h"
#include "scene/cameras.h"
#include "scene/reader.h"
#include "splatguard/model.h"

#define CAMERAS_BYTES (256 << 20) /* a camera takes some 400 */
#define NAME_BYTES 200            /* a file's name has at most 255, endings included */

/* Camera to world, focal lengths for the size of the photo's file. NULL without memory. */
static json_t *camera_json(const struct sg_view *v, int id)
{
    const struct sg_camera *c = &v->camera;
    json_t *rotation = json_array(), *position = json_array();
    bool whole = true;
    double centre[3];
    sg_camera_centre(c, centre);
    for (int i = 0; i < 3; i++) {
        whole &= !json_array_append_new(rotation,
                                        json_pack("[f,f,f]", c->R[i], c->R[3 + i], c->R[6 + i]));
        whole &= !json_array_append_new(position, json_real(centre[i]));
    }
    if (!whole) {
        json_decref(rotation);
        json_decref(position);
        return NULL;
    }
    const double sx = (double) v->file_width / c->width, sy = (double) v->file_height / c->height;
    json_t *camera =
        json_pack("{s:i,s:o,s:i,s:i,s:o,s:o,s:f,s:f}", "id", id, "img_name",
                  sg_text_to_json(v->name), "width", v->file_width, "height", v->file_height,
                  "position", position, "rotation", rotation, "fy", c->fy * sy, "fx", c->fx * sx);
    if (camera && (c->cx != c->width / 2.0 || c->cy != c->height / 2.0) &&
        (json_object_set_new(camera, "cx", json_real(c->cx * sx)) ||
         json_object_set_new(camera, "cy", json_real(c->cy * sy)))) {
        json_decref(camera);
        return NULL;
    }
    return camera;
}

int sg_cameras_write_json(sg_ctx *ctx, const struct sg_scene *scene, const char *path)
{
    sg_clear_error(ctx);
    json_t *list = json_array();
    for (size_t i = 0; i < scene->n_test + scene->n_train; i++)
        json_array_append_new(
            list,
            camera_json(i < scene->n_test ? &scene->test[i] : &scene->train[i - scene->n_test],
                        (int) i));
    char *text = json_dumps(list, JSON_COMPACT);
    int code = SG_ERR_BUDGET;
    if (text && json_array_size(list) == scene->n_test + scene->n_train) {
        code = sg_file_write(ctx, path, text, strlen(text));
    } else
        sg_fail(ctx, code, "%s: out of memory", path);
    free(text);
    json_decref(list);
    return code;
}

static int expected(sg_ctx *ctx, const char *where, const char *key, const json_t *found,
                    const char *what)
{
    char shown[SG_JSON_SHOWN];
    return sg_fail(ctx, SG_ERR_INPUT, "%s: %s: found %s, expected %s", where, key,
                   sg_json_show(found, shown), what);
}

static int read_three(sg_ctx *ctx, const char *where, const char *key, const json_t *list,
                      double out[3])
{
    bool sound = json_array_size(list) == 3;
    for (size_t i = 0; i < 3 && sound; i++) {
        out[i] = json_number_value(json_array_get(list, i));
        sound = json_is_number(json_array_get(list, i));
    }
    return sound ? SG_OK : expected(ctx, where, key, list, "3 numbers");
}

/* The pose is camera to world with COLMAP's axes: a rotation by rows, and the centre. */
static int read_pose(sg_ctx *ctx, const char *where, const json_t *camera, struct sg_shot *shot)
{
    const json_t *rows = json_object_get(camera, "rotation");
    double m[16] = {[15] = 1}, row[3], centre[3];
    int code =
        json_array_size(rows) == 3 ? SG_OK : expected(ctx, where, "rotation", rows, "3 rows");
    for (size_t i = 0; i < 3 && !code; i++) {
        code = read_three(ctx, where, "rotation", json_array_get(rows, i), row);
        for (size_t k = 0; k < 3 && !code; k++)
            m[4 * i + k] = k ? -row[k] : row[k]; /* to OpenGL's axes */
    }
    if (!code)
        code = read_three(ctx, where, "position", json_object_get(camera, "position"), centre);
    for (size_t i = 0; i < 3 && !code; i++)
        m[4 * i + 3] = centre[i];
    return code ? code : sg_pose_from_opengl(ctx, m, where, shot->R, shot->t);
}

/* Sizes and focal lengths. Runs of splatguard have the principal point too where it is not the
 * centre. */
static int read_lens(sg_ctx *ctx, const char *where, const json_t *camera, struct sg_lens *lens)
{
    const struct {
        const char *key;
        double *to;
    } numbers[] = {{"fx", &lens->fx}, {"fy", &lens->fy}, {"cx", &lens->cx}, {"cy", &lens->cy}};
    const char *const sides[] = {"width", "height"};
    char range[32];
    snprintf(range, sizeof(range), "1 to %d pixels", SG_IMAGE_SIDE_MAX);
    for (int i = 0; i < 2; i++) {
        const json_t *side = json_object_get(camera, sides[i]);
        const double n = json_number_value(side);
        if (!(n >= 1 && n <= SG_IMAGE_SIDE_MAX))
            return expected(ctx, where, sides[i], side, range);
        *(i ? &lens->height : &lens->width) = (int) n;
    }
    lens->has_principal = json_object_get(camera, "cx");
    for (int i = 0; i < (lens->has_principal ? 4 : 2); i++) {
        const json_t *number = json_object_get(camera, numbers[i].key);
        if (!json_is_number(number) || (i < 2 && !(json_number_value(number) > 0)))
            return expected(ctx, where, numbers[i].key, number,
                            i < 2 ? "a number of pixels above 0" : "a number of pixels");
        *numbers[i].to = json_number_value(number);
    }
    return sg_lens_check(ctx, lens, where);
}

/* Pictures get the name, and none is hidden. */
static int read_name(sg_ctx *ctx, const char *where, const json_t *camera, struct sg_view *view)
{
    const json_t *value = json_object_get(camera, "img_name");
    const char *name = json_string_value(value);
    if (!name || !*name || *name == '.' || strchr(name, '/'))
        return expected(ctx, where, "img_name", value,
                        "a name of a file without folders or a dot at its beginning");
    if (strlen(name) > NAME_BYTES)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: img_name: found a name of %zu bytes, expected at most %d", where,
                       strlen(name), NAME_BYTES);
    view->name = sg_strdup(ctx, name);
    return view->name ? SG_OK : SG_ERR_BUDGET;
}

static int read_camera(sg_ctx *ctx, const char *where, const json_t *camera,
                       const struct sg_scene_params *params, struct sg_view *view)
{
    struct sg_shot shot = {.path = (char *) where};
    int code = json_is_object(camera) ? SG_OK : expected(ctx, where, "camera", camera, "an object");
    if (!code)
        code = read_name(ctx, where, camera, view);
    if (!code)
        code = read_lens(ctx, where, camera, &shot.lens);
    if (!code)
        code = read_pose(ctx, where, camera, &shot);
    view->file_width = shot.lens.width, view->file_height = shot.lens.height;
    return code ? code : sg_view_place(ctx, params, &shot, view);
}

static int by_name(const void *a, const void *b)
{
    return strcmp(((const struct sg_view *) a)->name, ((const struct sg_view *) b)->name);
}

static int by_pointed_name(const void *a, const void *b)
{
    return by_name(*(struct sg_view *const *) a, *(struct sg_view *const *) b);
}

/* A training and a test photo may have one name, as those of NeRF-Synthetic do: such cameras get
 * their number in the file behind it. */
static int number_twins(sg_ctx *ctx, struct sg_view *views, size_t count)
{
    struct sg_view **sorted = sg_alloc_raw(ctx, SG_MEM_MISC, count, sizeof(*sorted));
    if (!sorted)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < count; i++)
        sorted[i] = &views[i];
    qsort(sorted, count, sizeof(*sorted), by_pointed_name);
    int code = SG_OK;
    for (size_t i = 0, end; i < count && !code; i = end) {
        for (end = i + 1; end < count && !by_name(sorted[i], sorted[end]);)
            end++;
        for (size_t k = i; k < end && end - i > 1 && !code; k++) {
            char *old = sorted[k]->name;
            sorted[k]->name = sg_strf(ctx, "%s_%zu", old, (size_t) (sorted[k] - views));
            code = sorted[k]->name ? SG_OK : SG_ERR_BUDGET;
            sg_free(old);
        }
    }
    sg_free(sorted);
    return code;
}

static int read_list(sg_ctx *ctx, const char *path, const json_t *list,
                     const struct sg_scene_params *params, struct sg_view **out, size_t *n)
{
    const size_t count = json_array_size(list);
    char where[4096 + 32];
    if (!count || count > params->max_images)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %zu cameras, expected 1 to %llu", path, count,
                       (unsigned long long) params->max_images);
    struct sg_view *views = *out = sg_alloc(ctx, SG_MEM_MISC, count, sizeof(*views));
    int code = views ? SG_OK : SG_ERR_BUDGET;
    *n = views ? count : 0;
    for (size_t i = 0; i < count && !code; i++) {
        snprintf(where, sizeof(where), "%.4096s: camera %zu", path, i);
        code = read_camera(ctx, where, json_array_get(list, i), params, &views[i]);
    }
    if (!code)
        code = number_twins(ctx, views, count);
    if (code)
        return code;
    qsort(views, count, sizeof(*views), by_name);
    for (size_t i = 1; i < count; i++)
        if (!by_name(&views[i - 1], &views[i]))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: found two cameras of \"%s\", expected one", path,
                           views[i].name);
    return SG_OK;
}

int sg_cameras_read_json(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                         struct sg_view **out, size_t *n)
{
    const struct sg_scene_params defaults = sg_scene_params_default(),
                                 *p = params ? params : &defaults;
    json_error_t error = {0};
    json_t *list = NULL;
    void *room = NULL;
    char *text = NULL;
    size_t size = 0;
    *out = NULL, *n = 0;
    sg_clear_error(ctx);
    int code = sg_check_options(ctx, sg_scene_options(), p);
    if (!code)
        code = sg_file_read(ctx, path, CAMERAS_BYTES, &text, &size);
    if (!code)
        code = sg_json_reserve(ctx, text, size, &room);
    if (!code && !(list = json_loadb(text, size, JSON_REJECT_DUPLICATES, &error)))
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: %s; expected a list of cameras", path,
                       error.line, error.text);
    if (!code)
        code = read_list(ctx, path, list, p, out, n);
    json_decref(list);
    sg_free(room);
    sg_free(text);
    if (code)
        sg_cameras_destroy(out, n);
    return code;
}

void sg_cameras_destroy(struct sg_view **views, size_t *n)
{
    for (size_t i = 0; i < *n; i++)
        sg_view_clear(&(*views)[i]);
    sg_free(*views);
    *views = NULL, *n = 0;
}
