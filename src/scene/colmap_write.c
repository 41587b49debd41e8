/* SPDX-License-Identifier: Apache-2.0 */
/* A copy of a COLMAP scene whose photos have another size or another ending: its cameras, and the
 * names of its images. */
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

/* sorted: room for all shots. sizes: one a camera. viewed: one a shot, whether it is a view. Both
 * zeroed. */
static void measure_photos(const struct sg_scene *scene, const struct sg_shots *shots,
                           const struct sg_colmap_cameras *cameras, const struct sg_shot **sorted,
                           struct size *sizes, bool *viewed)
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
        viewed[*shot - shots->items] = true;
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

/* What is read of the model, and which of its names change. */
struct names {
    const struct sg_colmap_model *model;
    const struct sg_folder *dir; /* of the scene */
    const char *folder;          /* of the copy */
    struct sg_shots shots;
    bool *changed; /* of each shot */
    bool jpeg;
};

/* The ending of a shot's name; of one without, the end of the name. */
static const char *ending_of(const struct sg_shot *shot)
{
    const char *ending = sg_photo_ending(shot->file);
    return ending ? ending : shot->file + strlen(shot->file);
}

/* changed: first which shots are views, then whether the copy has another name of them. A name that
 * would be too long to be read stays: its photo is found by another ending. */
static bool find_changes(const struct names *n)
{
    bool any = false;
    for (size_t i = 0; i < n->shots.count; i++) {
        const struct sg_shot *shot = &n->shots.items[i];
        const char *old = ending_of(shot), *ending = sg_written_ending(old, n->jpeg);
        n->changed[i] &= strcmp(old, ending) && strlen(ending) <= strlen(old) + shot->file_room;
        any |= n->changed[i];
    }
    return any;
}

/* Copies what is before a place. */
static int pass(sg_ctx *ctx, struct sg_source *in, uint64_t to, FILE *f)
{
    while (in->at < to) {
        const size_t ready = sg_source_fill(in, 1),
                     n = ready < to - in->at ? ready : (size_t) (to - in->at);
        if (!n)
            return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu bytes, expected %llu: cannot read on",
                           in->path, (unsigned long long) in->at, (unsigned long long) to);
        fwrite(in->window, 1, n, f);
        sg_source_skip(in, n);
    }
    return SG_OK;
}

/* All bytes but the endings stay. */
static int put_images(sg_ctx *ctx, const struct names *n, struct sg_source *in, FILE *f)
{
    for (size_t i = 0; i < n->shots.count; i++) {
        const struct sg_shot *shot = &n->shots.items[i];
        if (!n->changed[i])
            continue;
        const char *old = ending_of(shot);
        const size_t stem = (size_t) (old - shot->file), length = stem + strlen(old);
        const int code = pass(ctx, in, shot->file_at, f);
        if (code)
            return code;
        const char *found = sg_source_peek(in, length);
        if (!found || memcmp(found, shot->file, length))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: byte %llu: found another name than before, expected %s: the file "
                           "was changed while it was copied",
                           in->path, (unsigned long long) in->at, shot->file);
        fwrite(found, 1, stem, f);
        fputs(sg_written_ending(old, n->jpeg), f);
        sg_source_skip(in, length);
    }
    return pass(ctx, in, in->size, f);
}

/* Writes the copy of the file that was read. */
static int write_images(sg_ctx *ctx, const struct names *n)
{
    struct sg_source in = {0};
    struct sg_file_writer w = {0};
    char *path;
    int code = sg_path_below(ctx, n->folder, n->model->images + strlen(n->dir->path) + 1, &path);
    if (!code)
        code = sg_folder_source(ctx, n->dir, n->model->images, SG_COLMAP_BYTES, &in);
    if (!code)
        code = sg_file_create(ctx, &w, path);
    if (!code)
        code = put_images(ctx, n, &in, w.stream);
    if (!code)
        code = sg_file_commit(ctx, &w);
    sg_file_abandon(&w);
    sg_source_close(&in);
    sg_free(path);
    return code;
}

int sg_colmap_fit_copy(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_folder *dir,
                       const char *folder, bool jpeg, bool *renamed)
{
    struct sg_colmap_model m;
    struct names names = {.model = &m, .dir = dir, .folder = folder, .jpeg = jpeg};
    struct sg_shots *shots = &names.shots;
    const struct sg_shot **sorted = NULL;
    struct size *sizes = NULL;
    bool changed = false;
    *renamed = false;
    int code = sg_colmap_read_model(ctx, dir, NULL, UINT32_MAX, &m, shots);
    if (code)
        goto done;
    sorted = sg_alloc_raw(ctx, SG_MEM_MISC, shots->count, sizeof(*sorted));
    names.changed = sg_alloc(ctx, SG_MEM_MISC, shots->count, sizeof(*names.changed));
    sizes = sg_alloc(ctx, SG_MEM_MISC, m.cameras.count, sizeof(*sizes));
    if (!sorted || !names.changed || !sizes) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    measure_photos(scene, shots, &m.cameras, sorted, sizes, names.changed);
    for (size_t i = 0; i < m.cameras.count; i++)
        changed |= fit_camera(&m.cameras.items[i], &sizes[i]);
    for (int text = 0; text < 2 && changed && !code; text++)
        code = write_cameras(ctx, &m.cameras, folder, m.folder + strlen(dir->path) + 1, text);
    if (!code && (*renamed = find_changes(&names)))
        code = write_images(ctx, &names);
done:
    sg_free(sorted);
    sg_free(names.changed);
    sg_free(sizes);
    sg_shots_clear(shots);
    sg_colmap_clear_model(&m);
    return code;
}
