/* SPDX-License-Identifier: Apache-2.0 */
/* The cameras of a copy of a COLMAP scene whose photos have another size. */
#include <stdlib.h>
#include <string.h>

#include "core/file.h"
#include "core/numbers.h"
#include "scene/colmap.h"

/* The size of a camera's photos. */
struct size {
    int width, height; /* 0 = it has none */
    bool differs;      /* from one photo to another */
};

static int by_file(const void *a, const void *b)
{
    const struct sg_shot *const *x = a, *const *y = b;
    return strcmp((*x)->file, (*y)->file);
}

/* sorted: by file, room for all shots. sizes: one a camera, zeroed. */
static void measure_photos(const struct sg_scene *scene, const struct sg_shots *shots,
                           const struct sg_colmap_cameras *cameras, const struct sg_shot **sorted,
                           struct size *sizes)
{
    for (size_t i = 0; i < shots->count; i++)
        sorted[i] = &shots->items[i];
    qsort(sorted, shots->count, sizeof(*sorted), by_file);
    for (size_t i = 0; i < scene->n_train + scene->n_test; i++) {
        const struct sg_view *view =
            i < scene->n_train ? &scene->train[i] : &scene->test[i - scene->n_train];
        const int width = view->camera.width, height = view->camera.height;
        const struct sg_shot key = {.file = view->file}, *pointer = &key;
        const struct sg_shot *const *shot =
            bsearch(&pointer, sorted, shots->count, sizeof(*sorted), by_file);
        if (!shot) /* the files are others than they were */
            continue;
        struct size *size =
            &sizes[sg_colmap_find_camera(cameras, (*shot)->camera_id) - cameras->items];
        size->differs |= size->width && (size->width != width || size->height != height);
        size->width = width;
        size->height = height;
    }
}

/* Whether the camera has changed. */
static bool fit_camera(struct sg_colmap_camera *c, const struct size *size)
{
    const struct sg_lens *lens = &c->lens;
    if (!size->width || size->differs ||
        (size->width == lens->width && size->height == lens->height))
        return false;
    /* with the roundings of a reader that scales the camera */
    const double right = (double) size->width / lens->width,
                 down = (double) size->height / lens->height;
    c->model = sg_colmap_model_find("PINHOLE");
    c->params[0] = lens->fx * right;
    c->params[1] = lens->fy * down;
    c->params[2] = lens->cx * right;
    c->params[3] = lens->cy * down;
    c->lens.width = size->width;
    c->lens.height = size->height;
    return true;
}

static void put_binary(FILE *f, const struct sg_colmap_cameras *cameras)
{
    sg_put_int(f, cameras->count, 8);
    for (size_t i = 0; i < cameras->count; i++) {
        const struct sg_colmap_camera *c = &cameras->items[i];
        sg_put_int(f, c->id, 4);
        sg_put_int(f, (uint64_t) c->model, 4);
        sg_put_int(f, (uint64_t) c->lens.width, 8);
        sg_put_int(f, (uint64_t) c->lens.height, 8);
        for (int k = 0; k < sg_colmap_model_params(c->model); k++)
            sg_put_real(f, c->params[k]);
    }
}

static void put_text(FILE *f, const struct sg_colmap_cameras *cameras)
{
    const locale_t before = uselocale(sg_c_locale());
    fprintf(f, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    for (size_t i = 0; i < cameras->count; i++) {
        const struct sg_colmap_camera *c = &cameras->items[i];
        fprintf(f, "%u %s %d %d", c->id, sg_colmap_model_name(c->model), c->lens.width,
                c->lens.height);
        for (int k = 0; k < sg_colmap_model_params(c->model); k++)
            fprintf(f, " %.17g", c->params[k]);
        fprintf(f, "\n");
    }
    uselocale(before);
}

/* In place of the copy's file, if it has one. */
static int write_cameras(sg_ctx *ctx, const struct sg_colmap_cameras *cameras, const char *folder,
                         const char *model, bool text)
{
    char *name = sg_strf(ctx, "%s/cameras.%s", model, text ? "txt" : "bin"), *path = NULL;
    struct sg_file_writer w = {0};
    int code = name ? sg_path_below(ctx, folder, name, &path) : SG_ERR_BUDGET;
    if (!code && sg_file_exists(path)) {
        code = sg_file_create(ctx, &w, path);
        if (!code) {
            (text ? put_text : put_binary)(w.stream, cameras);
            code = sg_file_commit(ctx, &w);
        }
    }
    sg_free(name);
    sg_free(path);
    return code;
}

int sg_colmap_fit_cameras(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_folder *dir,
                          const char *folder)
{
    struct sg_colmap_model m;
    struct sg_shots shots = {0};
    int code = sg_colmap_read_model(ctx, dir, NULL, UINT32_MAX, &m, &shots);
    const size_t n = m.cameras.count;
    const struct sg_shot **sorted =
        code ? NULL : sg_alloc_raw(ctx, SG_MEM_MISC, shots.count, sizeof(*sorted));
    struct size *sizes = code ? NULL : sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*sizes));
    if (!code && (!sorted || !sizes))
        code = SG_ERR_BUDGET;
    if (!code)
        measure_photos(scene, &shots, &m.cameras, sorted, sizes);
    bool changed = false;
    for (size_t i = 0; i < n && !code; i++)
        changed |= fit_camera(&m.cameras.items[i], &sizes[i]);
    for (int text = 0; text < 2 && changed && !code; text++)
        code = write_cameras(ctx, &m.cameras, folder, m.folder + strlen(dir->path) + 1, text);
    sg_free(sorted);
    sg_free(sizes);
    sg_shots_clear(&shots);
    sg_colmap_clear_model(&m);
    return code;
}
