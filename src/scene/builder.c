/* SPDX-License-Identifier: Apache-2.0 */
/* Every scene is made here, from a folder or from memory: views and points are added, then split
 * and measured. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "option/option.h"
#include "scene/cameras.h"
#include "scene/photo.h"
#include "scene/reader.h"

#define NAME_MAX_BYTES 255
#define GREY 127
#define KEPT_SHARE 4 /* lazy photos may keep a quarter of the context's memory limit */

struct item {
    struct sg_view view;
    enum sg_view_split split;
    bool test; /* result of the split; set by sg_scene_builder_finish */
};

struct sg_scene_builder {
    sg_ctx *ctx;
    struct sg_scene_params params;
    struct sg_scene *scene; /* has the points already */
    struct item *items;
    size_t count, capacity;
    uint64_t keep;             /* bytes of lazy photos */
    size_t room_xyz, room_rgb; /* points that the scene's arrays have room for */
};

int sg_scene_builder_create(sg_ctx *ctx, const struct sg_scene_params *params,
                            sg_scene_builder **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    const struct sg_scene_params p = params ? *params : sg_scene_params_default();
    int code = sg_check_options(ctx, sg_scene_options(), &p);
    if (code)
        return code;
    sg_scene_builder *b = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*b));
    if (!b)
        return SG_ERR_BUDGET;
    b->ctx = ctx;
    b->params = p;
    b->keep = sg_mem_limit(ctx) ? sg_mem_limit(ctx) / KEPT_SHARE : UINT64_MAX;
    b->scene = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*b->scene));
    code = b->scene ? sg_scene_builder_set_source(b, SG_FORMAT_MEMORY, "scene from memory", false)
                    : SG_ERR_BUDGET;
    if (code) {
        sg_scene_builder_destroy(&b);
        return code;
    }
    b->scene->white_background = p.white_background;
    b->scene->follow_links = p.follow_links;
    *out = b;
    return SG_OK;
}

void sg_scene_builder_destroy(sg_scene_builder **builder)
{
    if (!builder || !*builder)
        return;
    sg_scene_builder *b = *builder;
    for (size_t i = 0; i < b->count; i++)
        sg_view_clear(&b->items[i].view);
    sg_free(b->items);
    sg_scene_destroy(&b->scene);
    sg_free(b);
    *builder = NULL;
}

int sg_scene_builder_set_source(sg_scene_builder *b, enum sg_scene_format format, const char *path,
                                bool other_model)
{
    char *copy = sg_strdup(b->ctx, path);
    if (!copy)
        return SG_ERR_BUDGET;
    sg_free(b->scene->path);
    b->scene->path = copy;
    b->scene->format = format;
    b->scene->other_model = other_model;
    return SG_OK;
}

int sg_scene_builder_set_name(sg_scene_builder *b, const char *name)
{
    sg_clear_error(b->ctx);
    return sg_scene_builder_set_source(b, SG_FORMAT_MEMORY, name, false);
}

uint64_t sg_view_hash(const struct sg_view *v)
{
    const size_t pixels = (size_t) v->camera.width * (size_t) v->camera.height;
    XXH3_state_t hash;
    XXH3_64bits_reset(&hash);
    XXH3_64bits_update(&hash, v->rgb, 3 * pixels);
    if (v->mask)
        XXH3_64bits_update(&hash, v->mask, pixels);
    const uint64_t digest = XXH3_64bits_digest(&hash);
    return digest ? digest : 1; /* 0 = not known */
}

int sg_scene_builder_put_view(sg_scene_builder *b, struct sg_view *view, enum sg_view_split split)
{
    const int code = sg_grow(b->ctx, SG_MEM_MISC, &b->items, &b->capacity, b->count + 1, b->count,
                             sizeof(*b->items));
    if (code)
        sg_view_clear(view);
    else
        b->items[b->count++] = (struct item){.view = *view, .split = split};
    *view = (struct sg_view){0};
    return code;
}

int sg_scene_builder_put_files(sg_scene_builder *b, struct sg_scene_files **files,
                               struct sg_lazy_photos **lazy)
{
    const int code = sg_lazy_photos_create(b->ctx, UINT64_MAX, files, &b->scene->lazy);
    *lazy = b->scene->lazy;
    return code;
}

void sg_scene_builder_put_points(sg_scene_builder *b, struct sg_points *points)
{
    b->scene->points = points->xyz;
    b->scene->point_colors = points->rgb;
    b->scene->n_points = b->room_xyz = b->room_rgb = points->count;
    *points = (struct sg_points){0};
}

/* ---- what callers hand over ---- */

static int check_name(const sg_scene_builder *b, const char *name)
{
    if (!name || !*name)
        return sg_fail(b->ctx, SG_ERR_USAGE, "view %zu: name: found none, expected one", b->count);
    const size_t length = strlen(name);
    if (length > NAME_MAX_BYTES)
        return sg_fail(b->ctx, SG_ERR_USAGE, "view %zu: name: found %zu bytes, expected at most %d",
                       b->count, length, NAME_MAX_BYTES);
    for (const unsigned char *c = (const unsigned char *) name; *c; c++)
        if (*c < ' ' || *c == 127 || *c == '/')
            return sg_fail(b->ctx, SG_ERR_USAGE,
                           "view %zu: name: found byte 0x%02x, expected neither \"/\" nor control "
                           "characters",
                           b->count, *c);
    return SG_OK;
}

static int check_camera(const sg_scene_builder *b, const char *name, const struct sg_camera *c)
{
    char where[NAME_MAX_BYTES + 64];
    snprintf(where, sizeof(where), "view %zu \"%s\"", b->count, name);
    const int code = sg_camera_check(b->ctx, c, SG_ERR_USAGE, where);
    if (code || (uint64_t) c->width * (uint64_t) c->height <= b->params.max_pixels)
        return code;
    return sg_fail(b->ctx, SG_ERR_USAGE,
                   "%s: camera.width, camera.height: found %d x %d, expected at most %llu pixels "
                   "(max_pixels)",
                   where, c->width, c->height, (unsigned long long) b->params.max_pixels);
}

static int check_stride(const sg_scene_builder *b, const char *name, const char *field,
                        size_t stride, size_t row)
{
    if (!stride || stride >= row)
        return SG_OK;
    return sg_fail(b->ctx, SG_ERR_USAGE,
                   "view %zu \"%s\": %s: found %zu bytes, expected 0 or at least %zu, a row",
                   b->count, name, field, stride, row);
}

static int check_view(const sg_scene_builder *b, const struct sg_view_desc *d)
{
    int code = check_name(b, d->name);
    if (!code)
        code = check_camera(b, d->name, &d->camera);
    const size_t width = (size_t) d->camera.width;
    if (!code && !d->rgb == !d->read)
        code = sg_fail(b->ctx, SG_ERR_USAGE,
                       "view %zu \"%s\": rgb: found %s, expected either rgb or read", b->count,
                       d->name, d->rgb ? "both pixels and read" : "NULL");
    if (!code)
        code = check_stride(b, d->name, "rgb_stride", d->rgb_stride, 3 * width);
    if (!code)
        code = check_stride(b, d->name, "mask_stride", d->mask_stride, width);
    if (!code && (unsigned) d->split > SG_SPLIT_TEST)
        code = sg_fail(b->ctx, SG_ERR_USAGE,
                       "view %zu \"%s\": split: found %d, expected one of enum sg_view_split",
                       b->count, d->name, (int) d->split);
    return code;
}

/* A packed copy of `height` rows; NULL where there is no memory. */
static uint8_t *copy_rows(sg_ctx *ctx, const uint8_t *rows, size_t stride, size_t row, int height)
{
    uint8_t *to = sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) height, row);
    for (size_t y = 0; to && y < (size_t) height; y++)
        memcpy(to + y * row, rows + y * (stride ? stride : row), row);
    return to;
}

int sg_scene_builder_add_view(sg_scene_builder *b, const struct sg_view_desc *d)
{
    sg_ctx *ctx = b->ctx;
    sg_clear_error(ctx);
    if (b->count >= b->params.max_images)
        return sg_fail(ctx, SG_ERR_USAGE, "view %zu: found more than %llu views (max_images)",
                       b->count, (unsigned long long) b->params.max_images);
    int code = check_view(b, d);
    if (code)
        return code;
    const int width = d->camera.width, height = d->camera.height;
    struct sg_view view = {
        .camera = d->camera, .file_width = width, .file_height = height, .lossless = d->lossless};
    view.name = sg_strdup(ctx, d->name);
    view.file = sg_strdup(ctx, d->name);
    view.path = sg_strdup(ctx, d->name);
    if (d->rgb)
        view.rgb = copy_rows(ctx, d->rgb, d->rgb_stride, 3 * (size_t) width, height);
    if (d->mask)
        view.mask = copy_rows(ctx, d->mask, d->mask_stride, (size_t) width, height);
    if (!view.name || !view.file || !view.path || (d->rgb && !view.rgb) ||
        (d->mask && !view.mask)) {
        sg_view_clear(&view);
        return SG_ERR_BUDGET;
    }
    for (size_t i = 0; view.mask && i < (size_t) width * (size_t) height; i++)
        view.mask[i] = view.mask[i] ? 255 : 0;
    if (d->rgb)
        view.hash = sg_view_hash(&view);
    else if (!b->scene->lazy)
        code = sg_lazy_photos_create(ctx, b->keep, NULL, &b->scene->lazy);
    if (d->read && !code)
        code = sg_lazy_photo_create(ctx, b->scene->lazy, d, &view);
    if (code) {
        sg_view_clear(&view);
        return code;
    }
    return sg_scene_builder_put_view(b, &view, d->split);
}

void sg_scene_builder_keep_photos(sg_scene_builder *b, uint64_t bytes)
{
    b->keep = bytes;
}

int sg_scene_builder_add_points(sg_scene_builder *b, const float *xyz, const uint8_t *rgb, size_t n)
{
    struct sg_scene *s = b->scene;
    sg_clear_error(b->ctx);
    const uint64_t most =
        b->params.max_points < SIZE_MAX / 16 ? b->params.max_points : SIZE_MAX / 16;
    if (n && !xyz)
        return sg_fail(b->ctx, SG_ERR_USAGE, "points: xyz: found NULL, expected positions");
    if (n > most || s->n_points > most - n)
        return sg_fail(b->ctx, SG_ERR_USAGE,
                       "points: found %zu, expected at most %llu (max_points)", n,
                       (unsigned long long) (most - s->n_points));
    for (size_t i = 0; i < 3 * n; i++)
        if (!isfinite(xyz[i]))
            return sg_fail(b->ctx, SG_ERR_USAGE,
                           "points: xyz[%zu]: found %g, expected a finite number", i,
                           (double) xyz[i]);
    if (sg_grow(b->ctx, SG_MEM_MISC, &s->points, &b->room_xyz, s->n_points + n, s->n_points,
                3 * sizeof(float)) ||
        sg_grow(b->ctx, SG_MEM_MISC, &s->point_colors, &b->room_rgb, s->n_points + n, s->n_points,
                3))
        return SG_ERR_BUDGET;
    if (n) {
        memcpy(s->points + 3 * s->n_points, xyz, 3 * n * sizeof(float));
        if (rgb)
            memcpy(s->point_colors + 3 * s->n_points, rgb, 3 * n);
        else
            memset(s->point_colors + 3 * s->n_points, GREY, 3 * n);
    }
    s->n_points += n;
    return SG_OK;
}

/* ---- the scene ---- */

static void measure(struct sg_scene *scene)
{
    double c[3], farthest = 0;
    for (size_t i = 0; i < scene->n_train; i++) {
        sg_camera_centre(&scene->train[i].camera, c);
        for (int k = 0; k < 3; k++)
            scene->center[k] += c[k] / (double) scene->n_train;
    }
    for (size_t i = 0; i < scene->n_train; i++) {
        double d2 = 0;
        sg_camera_centre(&scene->train[i].camera, c);
        for (int k = 0; k < 3; k++)
            d2 += (c[k] - scene->center[k]) * (c[k] - scene->center[k]);
        farthest = fmax(farthest, sqrt(d2));
    }
    scene->extent = 1.1 * farthest;
}

static int by_name(const void *a, const void *b)
{
    const struct item *x = *(struct item *const *) a, *y = *(struct item *const *) b;
    const int order = strcmp(x->view.name, y->view.name);
    return order ? order : (x > y) - (x < y);
}

enum sg_view_split sg_split(const struct sg_scene_params *p, enum sg_view_split split, size_t *rank)
{
    if (split != SG_SPLIT_AUTO)
        return split;
    return p->eval && (*rank)++ % (size_t) p->test_every == 0 ? SG_SPLIT_TEST : SG_SPLIT_TRAIN;
}

/* Which views are test views. sorted: room for all views. */
static int split_views(sg_scene_builder *b, struct item **sorted)
{
    const struct item *last[2] = {NULL, NULL};
    size_t rank = 0;
    for (size_t i = 0; i < b->count; i++)
        sorted[i] = &b->items[i];
    qsort(sorted, b->count, sizeof(*sorted), by_name);
    for (size_t i = 0; i < b->count; i++) {
        struct item *item = sorted[i];
        item->test = sg_split(&b->params, item->split, &rank) == SG_SPLIT_TEST;
        const struct item *before = last[item->test];
        if (before && !strcmp(item->view.name, before->view.name))
            return sg_fail(b->ctx, SG_ERR_INPUT,
                           "%s: view %td: name: found \"%s\", which view %td has too, expected "
                           "distinct names",
                           b->scene->path, item - b->items, item->view.name, before - b->items);
        last[item->test] = item;
    }
    return SG_OK;
}

static void say_what(sg_ctx *ctx, const struct sg_scene *scene, bool untrained)
{
    if (scene->format == SG_FORMAT_PHOTOS) {
        sg_log(ctx, SG_LOG_INFO, "%s: %zu photo%s without cameras", scene->path, scene->n_train,
               scene->n_train == 1 ? "" : "s");
        return;
    }
    if (!untrained && scene->extent < 1e-6)
        sg_log(ctx, SG_LOG_WARN,
               "%s: found all training cameras in one place: positions will hardly learn",
               scene->path);
    sg_log(ctx, SG_LOG_INFO, "%s: %s scene, %zu train and %zu test views, %zu points, extent %.4g",
           scene->path, sg_scene_format_name(scene->format), scene->n_train, scene->n_test,
           scene->n_points, scene->extent);
}

int sg_scene_builder_finish(sg_scene_builder **builder, struct sg_scene **out)
{
    sg_scene_builder *b = *builder;
    sg_ctx *ctx = b->ctx;
    struct sg_scene *scene = b->scene;
    sg_clear_error(ctx);
    *out = NULL;
    if (!b->count)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no views, expected at least one", scene->path);
    struct item **sorted = sg_alloc_raw(ctx, SG_MEM_MISC, b->count, sizeof(*sorted));
    int code = sorted ? split_views(b, sorted) : SG_ERR_BUDGET;
    sg_free(sorted);
    if (code)
        return code;
    size_t n_test = 0;
    for (size_t i = 0; i < b->count; i++)
        n_test += b->items[i].test;
    const size_t n_train = b->count - n_test;
    if (!n_train && !b->params.untrained)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no view to train on (%zu test views), expected at least one",
                       scene->path, n_test);
    struct sg_view *train = n_train ? sg_alloc(ctx, SG_MEM_MISC, n_train, sizeof(*train)) : NULL;
    struct sg_view *test = n_test ? sg_alloc(ctx, SG_MEM_MISC, n_test, sizeof(*test)) : NULL;
    if ((n_train && !train) || (n_test && !test)) {
        sg_free(train);
        sg_free(test);
        return SG_ERR_BUDGET;
    }
    scene->train = train, scene->test = test;
    for (size_t i = 0; i < b->count; i++) {
        if (b->items[i].test)
            scene->test[scene->n_test++] = b->items[i].view;
        else
            scene->train[scene->n_train++] = b->items[i].view;
    }
    b->count = 0;
    b->scene = NULL;
    measure(scene);
    say_what(ctx, scene, b->params.untrained);
    sg_scene_builder_destroy(builder);
    *out = scene;
    return SG_OK;
}
