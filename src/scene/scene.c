/* SPDX-License-Identifier: Apache-2.0 */
/* Loading a scene from a folder: which format, its reader, masks, photos. builder.c does the rest.
 */
#include "splatguard/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/photo.h"
#include "scene/reader.h"

static const struct {
    const char *name, *files;
    int turn; /* in which it is tried; 0: there is no reader */
    bool (*is)(sg_ctx *ctx, const struct sg_folder *dir);
    int (*read)(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                struct sg_shots *shots, struct sg_points *points);
} formats[] = {
    [SG_FORMAT_AUTO] = {.name = "auto"},
#define R(value, name, files, turn)                                                                \
    [SG_FORMAT_##value] = {#name, files, turn, sg_is_##name, sg_read_##name},
    SG_READERS(R)
#undef R
        [SG_FORMAT_MEMORY] = {.name = "memory"},
    [SG_FORMAT_PHOTOS] = {"photos", .read = sg_read_photos},
};
#define FORMATS (sizeof(formats) / sizeof(*formats))

const char *sg_scene_format_name(enum sg_scene_format format)
{
    return (unsigned) format < FORMATS ? formats[format].name : "unknown";
}

/* The format that is tried in a turn, or AUTO after the last one. */
static enum sg_scene_format format_of_turn(int turn)
{
    for (size_t f = 0; f < FORMATS; f++)
        if (formats[f].turn == turn)
            return (enum sg_scene_format) f;
    return SG_FORMAT_AUTO;
}

static int recognise(sg_ctx *ctx, const struct sg_folder *dir, bool photos_alone,
                     enum sg_scene_format *format)
{
    char looked_for[512] = "";
    for (int turn = 1; (*format = format_of_turn(turn)) != SG_FORMAT_AUTO; turn++) {
        const bool is = formats[*format].is(ctx, dir);
        const size_t n = strlen(looked_for);
        if (sg_failed(ctx))
            return SG_ERR_BUDGET;
        if (is)
            return SG_OK;
        snprintf(looked_for + n, sizeof(looked_for) - n, "%s%s",
                 turn == 1                                    ? ""
                 : format_of_turn(turn + 1) == SG_FORMAT_AUTO ? " and "
                                                              : ", ",
                 formats[*format].files);
    }
    bool photos = false;
    const int code = photos_alone ? sg_is_photos(ctx, dir, &photos) : SG_OK;
    *format = photos ? SG_FORMAT_PHOTOS : SG_FORMAT_AUTO;
    if (code || photos)
        return code;
    return sg_fail(
        ctx, SG_ERR_INPUT,
        "%s: found no scene, looked for %s; photos alone need cameras first, as COLMAP finds them "
        "(only an audit needs none)",
        dir->path, looked_for);
}

bool sg_scene_recognised(sg_ctx *ctx, const char *path)
{
    struct sg_folder dir;
    enum sg_scene_format format;
    const bool is =
        !sg_folder_open(ctx, path, false, &dir) && !recognise(ctx, &dir, false, &format);
    sg_folder_close(&dir);
    sg_clear_error(ctx);
    return is;
}

/* The i-th of the names that a photo's mask can have: the photo's own in the scene's files, with
 * .png added; its file's, with .png in place of the ending; and those of the file without folders.
 */
static char *mask_name(sg_ctx *ctx, const char *masks, const struct sg_shot *shot, int i)
{
    const char *base = sg_base_name(shot->path), *dot = strrchr(base, '.');
    const int stem = (int) (dot ? (size_t) (dot - base) : strlen(base)),
              folders = (int) (sg_base_name(shot->file) - shot->file);
    switch (i) {
    case 0:
        return sg_strf(ctx, "%s/%s", masks, shot->file);
    case 1:
        return sg_strf(ctx, "%s/%s.png", masks, shot->file);
    case 2:
        return sg_strf(ctx, "%s/%.*s%.*s.png", masks, folders, shot->file, stem, base);
    case 3:
        return sg_strf(ctx, "%s/%s", masks, base);
    case 4:
        return sg_strf(ctx, "%s/%s.png", masks, base);
    default:
        return sg_strf(ctx, "%s/%.*s.png", masks, stem, base);
    }
}

static int by_mask(const void *a, const void *b)
{
    return strcmp((*(const struct sg_shot *const *) a)->mask,
                  (*(const struct sg_shot *const *) b)->mask);
}

/* A mask in no sub-folder would also be found for photos of that name in several. */
static int check_masks(sg_ctx *ctx, const char *masks, const struct sg_shot **found, size_t n)
{
    qsort(found, n, sizeof(*found), by_mask);
    for (size_t i = 1; i < n; i++) {
        const char *a = found[i - 1]->file, *b = found[i]->file;
        if (!by_mask(&found[i - 1], &found[i]) && strcmp(a, b))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found one mask for the photos %s and %s, expected %s/%s.png and "
                           "%s/%s.png",
                           found[i]->mask, a, b, masks, a, masks, b);
    }
    return SG_OK;
}

/* Masks are optional a photo. */
static int find_masks(sg_ctx *ctx, const struct sg_folder *dir,
                      const struct sg_scene_params *params, struct sg_shots *shots)
{
    int code = SG_ERR_BUDGET;
    size_t masked = 0, n = 0;
    char *folder = sg_strf(ctx, "%s/%s", dir->path, params->masks ? params->masks : "masks");
    const struct sg_shot **found = sg_alloc(ctx, SG_MEM_MISC, shots->count, sizeof(*found));
    if (!folder || !found)
        goto done;
    code = SG_OK;
    if (!sg_folder_has_folder(dir, folder)) {
        if (params->masks)
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: found no such folder, expected masks", folder);
        goto done;
    }
    for (size_t i = 0; i < shots->count; i++) {
        struct sg_shot *shot = &shots->items[i];
        const bool named = shot->mask; /* by the scene's file */
        for (int k = 0; k < 6 && !shot->mask; k++) {
            char *path = mask_name(ctx, folder, shot, k);
            if (!path) {
                code = SG_ERR_BUDGET;
                goto done;
            }
            if (sg_folder_has(dir, path))
                shot->mask = path;
            else
                sg_free(path);
        }
        masked += shot->mask != NULL;
        if (shot->mask && !named)
            found[n++] = shot;
    }
    code = check_masks(ctx, folder, found, n);
    if (!code && masked < shots->count)
        sg_log(ctx, SG_LOG_WARN, "%s: %zu of %zu images have no mask and are used whole", folder,
               shots->count - masked, shots->count);
done:
    sg_free(found);
    sg_free(folder);
    return code;
}

struct sg_scene_params sg_scene_params_default(void)
{
    return (struct sg_scene_params){SG_SCENE_DEFAULTS};
}

void sg_scene_files_destroy(struct sg_scene_files **files)
{
    if (!files || !*files)
        return;
    sg_shots_clear(&(*files)->shots);
    sg_folder_close(&(*files)->dir);
    sg_free(*files);
    *files = NULL;
}

/* What is learned of photos is filed by their names. */
static int halve_tests(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                       enum sg_scene_format format, struct sg_shots *shots)
{
    if (format == SG_FORMAT_BLENDER)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: test halves: found the layout of NeRF-Synthetic, whose training and "
                       "test photos have the same names, expected another",
                       path);
    return sg_shots_halve_tests(ctx, params, shots, path);
}

static void warn_unused(sg_ctx *ctx, const char *path, const char *option, const char *folder)
{
    if (folder)
        sg_log(ctx, SG_LOG_WARN,
               "%s: %s: found \"%s\", which has no effect: only scenes of COLMAP have such a "
               "folder",
               path, option, folder);
}

/* Folders are named below the scene's. */
static int check_folders(sg_ctx *ctx, const struct sg_folder *dir,
                         const struct sg_scene_params *params)
{
    const char *const names[][2] = {
        {"images", params->images}, {"colmap", params->colmap}, {"masks", params->masks}};
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
        if (names[i][1] && *names[i][1] == '/')
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: %s: found \"%s\", expected the name of a folder below the scene's",
                           dir->path, names[i][0], names[i][1]);
    return SG_OK;
}

static int check_images(sg_ctx *ctx, const struct sg_folder *dir, const char *images)
{
    char *folder = images ? sg_strf(ctx, "%s/%s", dir->path, images) : NULL;
    int code = images && !folder ? SG_ERR_BUDGET : SG_OK;
    if (folder && !sg_folder_has_folder(dir, folder))
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: found no such folder, expected photos", folder);
    sg_free(folder);
    return code;
}

/* The shots and points of the folder. */
static int read_files(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                      sg_scene_builder *builder, struct sg_scene_files *files)
{
    struct sg_points points = {0};
    enum sg_scene_format format = params->format;
    struct sg_shots *shots = &files->shots;
    int code = sg_folder_open(ctx, path, params->follow_links, &files->dir);
    if (!code)
        code = check_folders(ctx, &files->dir, params);
    if (format == SG_FORMAT_AUTO && params->colmap)
        format = SG_FORMAT_COLMAP;
    if (!code && format == SG_FORMAT_AUTO)
        code = recognise(ctx, &files->dir, params->photos_alone, &format);
    if (!code)
        code = sg_scene_builder_set_source(builder, format, path, params->colmap != NULL);
    if (code)
        return code;
    if (format != SG_FORMAT_COLMAP) {
        warn_unused(ctx, path, "images", params->images);
        warn_unused(ctx, path, "colmap", params->colmap);
    } else if ((code = check_images(ctx, &files->dir, params->images)))
        return code;
    files->params.format = format;
    code = formats[format].read(ctx, &files->dir, params, shots, &points);
    sg_scene_builder_put_points(builder, &points); /* also after a failure: it frees them */
    if (!code && !shots->count)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: found no images, expected at least one", path);
    if (!code && (format != SG_FORMAT_PHOTOS || params->masks))
        code = find_masks(ctx, &files->dir, params, shots);
    size_t rank = 0;
    for (size_t i = 0; i < shots->count; i++) /* readers sort the shots that they do not split */
        shots->items[i].split = sg_split(params, shots->items[i].split, &rank);
    files->counted = rank > 0;
    if (!code && params->test_halves)
        code = halve_tests(ctx, path, params, format, shots);
    return code;
}

int sg_scene_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                  struct sg_scene **out)
{
    sg_scene_builder *builder = NULL;
    const struct sg_scene_params defaults = sg_scene_params_default();
    *out = NULL;
    if (!params)
        params = &defaults;
    int code = sg_scene_builder_create(ctx, params, &builder);
    if (!code && params->test_halves && !params->eval) {
        sg_scene_builder_destroy(&builder);
        code =
            sg_fail(ctx, SG_ERR_USAGE,
                    "test_halves: found it without eval, expected both: eval makes the test views");
    }
    if (code)
        return code;
    struct sg_scene_files *own = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*own));
    const struct sg_scene_files *files = own;
    struct sg_lazy_photos *lazy = NULL;
    struct sg_view *views = NULL;
    size_t n = 0;
    if (!own) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    own->dir.fd = -1;
    own->params = *params;
    own->params.images = own->params.colmap = own->params.masks = NULL;
    if ((code = read_files(ctx, path, params, builder, own)))
        goto done;
    n = own->shots.count;
    /* With a limit on memory, photos can be dropped and read again. Photos alone are looked at once
     * more: few are in memory at once. */
    const bool alone = own->params.format == SG_FORMAT_PHOTOS;
    if ((sg_mem_limit(ctx) || alone) && (code = sg_scene_builder_put_files(builder, &own, &lazy)))
        goto done;
    if (alone)
        sg_lazy_photos_keep(lazy, 0);
    views = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*views));
    code = views ? sg_views_load(ctx, params, files, lazy, views) : SG_ERR_BUDGET;
    for (size_t i = 0; i < n && !code; i++)
        if (views[i].name)
            code = sg_scene_builder_put_view(builder, &views[i], files->shots.items[i].split);
    if (!code)
        code = sg_scene_builder_finish(&builder, out);
done:
    for (size_t i = 0; i < n && views; i++)
        sg_view_clear(&views[i]);
    sg_free(views);
    sg_scene_files_destroy(&own);
    sg_scene_builder_destroy(&builder);
    return code;
}

size_t sg_scene_photo(const struct sg_scene *scene, const struct sg_view *view)
{
    if (scene->n_train && view >= scene->train && view < scene->train + scene->n_train)
        return (size_t) (view - scene->train);
    if (scene->format == SG_FORMAT_MEMORY)
        return SIZE_MAX;
    for (size_t i = 0; i < scene->n_train; i++)
        if (!strcmp(scene->train[i].path, view->path))
            return i;
    return SIZE_MAX;
}

void sg_scene_destroy(struct sg_scene **scene)
{
    if (!scene || !*scene)
        return;
    struct sg_scene *s = *scene;
    for (size_t i = 0; i < s->n_train; i++)
        sg_view_clear(&s->train[i]);
    for (size_t i = 0; i < s->n_test; i++)
        sg_view_clear(&s->test[i]);
    sg_lazy_photos_destroy(&s->lazy);
    sg_free(s->train);
    sg_free(s->test);
    sg_free(s->points);
    sg_free(s->point_colors);
    sg_free(s->path);
    sg_free(s);
    *scene = NULL;
}
