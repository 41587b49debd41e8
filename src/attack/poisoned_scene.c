/* SPDX-License-Identifier: Apache-2.0 */
/* A copy of a scene with other images, in the layout that the scene came in. */
#include "poisoned_scene.h"

#include <dirent.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include <jansson.h>

#include "core/file.h"
#include "core/numbers.h"
#include "image/image.h"
#include "scene/colmap.h"
#include "scene/photo.h"
#include "scene/transforms.h"
#include "splatguard/eval.h"
#include "splatguard/model.h"

/* COLMAP's points can be large; usually they have been read before */
#define COPY_BYTES (UINT64_C(1) << 36)
#define CLOUD "points.ply"
#define IMAGES "images/" /* of COLMAP: the model names photos in there */

/* The folder of a file. */
static int make_folder(sg_ctx *ctx, char *path)
{
    char *slash = strrchr(path, '/');
    *slash = 0;
    const int code = sg_dir_create(ctx, path);
    *slash = '/';
    return code;
}

/* Copies only what is inside the scene's folder, and follows no link out of it: loading has not
 * followed one either. */
static int copy(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_folder *from,
                const char *to, const char *name)
{
    char *source = sg_strf(ctx, "%s/%s", scene->path, name), *target = NULL, *data = NULL;
    size_t size;
    int code = source ? sg_path_below(ctx, to, name, &target) : SG_ERR_BUDGET;
    if (!code && sg_folder_leads_out(from, source))
        sg_log(ctx, SG_LOG_WARN,
               "%s: a link out of the scene's folder, which training does not read: not copied",
               source);
    else if (!code && sg_folder_has(from, source)) {
        code = sg_folder_read(ctx, from, source, COPY_BYTES, &data, &size);
        if (!code)
            code = make_folder(ctx, target);
        if (!code)
            code = sg_file_write(ctx, target, data, size);
    }
    sg_free(data);
    sg_free(source);
    sg_free(target);
    return code;
}

/* Whether the view's camera in the scene's files is not that of its photo in the copy. Those of
 * COLMAP are adapted. */
static bool needs_camera(const struct sg_scene *scene, const struct sg_view *v)
{
    return v->undistorted ||
           (scene->format == SG_FORMAT_BLENDER && v->in_pixels &&
            (v->camera.width != v->file_width || v->camera.height != v->file_height));
}

/* The camera files of a model that --colmap chose would not be found in the copy, and a scene from
 * memory has none. */
static bool needs_transforms(const struct sg_scene *scene)
{
    bool any = scene->other_model ||
               (scene->format != SG_FORMAT_BLENDER && scene->format != SG_FORMAT_COLMAP);
    for (size_t i = 0; i < scene->n_train && !any; i++)
        any = needs_camera(scene, &scene->train[i]);
    for (size_t i = 0; i < scene->n_test && !any; i++)
        any = needs_camera(scene, &scene->test[i]);
    return any;
}

/* The name of the view's photo, and its length without the ending. */
static const char *stem_of(const struct sg_scene *scene, const struct sg_view *view, size_t *length)
{
    const char *file = !strncmp(view->file, "./", 2) ? view->file + 2 : view->file;
    /* names from memory are no files: "a" and "a.png" are two */
    const char *ending = scene->format != SG_FORMAT_MEMORY ? sg_photo_ending(file) : NULL;
    *length = ending ? (size_t) (ending - file) : strlen(file);
    return file;
}

static bool saves_jpeg(const struct sg_scene *scene, const struct sg_poison_files *files)
{
    return files->save == SG_POISON_JPEG ||
           (files->save == SG_POISON_AUTO && scene->format == SG_FORMAT_COLMAP);
}

/* The path of the view's image below the folder. */
static char *image_file(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_view *view,
                        const struct sg_poison_files *files)
{
    size_t length;
    const char *file = stem_of(scene, view, &length);
    return sg_strf(ctx, "%s%.*s%s", scene->format == SG_FORMAT_COLMAP ? IMAGES : "", (int) length,
                   file, sg_written_ending(file + length, saves_jpeg(scene, files)));
}

bool sg_poisoned_scene_shares_file(const struct sg_scene *scene, const struct sg_view *one,
                                   const struct sg_view *other)
{
    size_t n, m;
    const char *a = stem_of(scene, one, &n), *b = stem_of(scene, other, &m);
    return n == m && !strncasecmp(a, b, n); /* some file systems take no notice of the case */
}

/* The path of a view's mask by the name in the copy's camera files, which the reader tries first.
 * file: of the image. */
static char *mask_file(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_view *view,
                       bool transforms, const char *file)
{
    if (!transforms)
        file = scene->format == SG_FORMAT_COLMAP ? file + strlen(IMAGES) : view->file;
    return sg_strf(ctx, "masks/%s.png", file);
}

static int refuse_name(sg_ctx *ctx, const struct sg_view *view)
{
    return sg_fail(ctx, SG_ERR_INPUT, "%s: the name is not UTF-8, as JSON needs it", view->path);
}

struct image_name {
    char *file; /* without its ending */
    const struct sg_view *view;
};

static int by_name(const void *a, const void *b)
{
    return strcmp(((const struct image_name *) a)->file, ((const struct image_name *) b)->file);
}

static bool is_same_photo(const struct sg_view *a, const struct sg_view *b)
{
    struct stat one, other;
    return !strcmp(a->path, b->path) || (!stat(a->path, &one) && !stat(b->path, &other) &&
                                         one.st_dev == other.st_dev && one.st_ino == other.st_ino);
}

/* The texts of both are cut before their endings. COLMAP's model names both endings, and one file
 * is written. */
static bool is_same_file(const struct sg_scene *scene, const struct image_name *a,
                         const struct image_name *b)
{
    return is_same_photo(a->view, b->view) &&
           (scene->format != SG_FORMAT_COLMAP ||
            !strcmp(a->file + strlen(a->file) + 1, b->file + strlen(b->file) + 1));
}

static int check_name(sg_ctx *ctx, const char *file)
{
    const size_t length = strlen(sg_base_name(file));
    return length <= NAME_MAX
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT,
                         "%s: found a name of %zu bytes for a file, expected at most %d", file,
                         length, NAME_MAX);
}

/* Whether the names of a view's image and mask can be names of files, and be in transforms.json. */
static int check_names(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_view *view,
                       bool transforms, const char *file)
{
    char *mask = mask_file(ctx, scene, view, transforms, file);
    json_t *text = json_string(file);
    int code = mask ? check_name(ctx, file) : SG_ERR_BUDGET;
    if (!code && view->mask)
        code = check_name(ctx, mask);
    if (!code && transforms && !text)
        code = refuse_name(ctx, view);
    sg_free(mask);
    json_decref(text);
    return code;
}

int sg_poisoned_scene_check(sg_ctx *ctx, const struct sg_scene *scene,
                            const struct sg_poison_files *files)
{
    if ((unsigned) files->save > SG_POISON_JPEG)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "files.save: found %d, expected one of enum sg_poison_save",
                       (int) files->save);
    if (files->save != SG_POISON_PNG && (files->jpeg_quality < 1 || files->jpeg_quality > 100))
        return sg_fail(ctx, SG_ERR_USAGE, "files.jpeg_quality: found %d, expected 1 to 100",
                       files->jpeg_quality);
    const size_t n = scene->n_train + scene->n_test;
    const bool transforms = needs_transforms(scene);
    struct image_name *names = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*names));
    int code = names ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < n && !code; i++) {
        const struct sg_view *view =
            i < scene->n_train ? &scene->train[i] : &scene->test[i - scene->n_train];
        names[i] = (struct image_name){image_file(ctx, scene, view, files), view};
        code = names[i].file ? check_names(ctx, scene, view, transforms, names[i].file)
                             : SG_ERR_BUDGET;
        if (!code)
            *strrchr(names[i].file, '.') = 0;
    }
    if (!code)
        qsort(names, n, sizeof(*names), by_name);
    /* Both splits may have a photo, which is one file then; but transforms.json has it once. */
    for (size_t i = 1; i < n && !code; i++) {
        if (by_name(&names[i - 1], &names[i]))
            continue;
        const bool same = is_same_file(scene, &names[i - 1], &names[i]);
        if (same && transforms)
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found a photo of both splits, expected one of either in a copy "
                           "whose cameras are written anew",
                           names[i].view->path);
        else if (!same)
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found images \"%s\" and \"%s\", whose names differ only in their "
                           "endings: they would be one file in the copy of the scene",
                           scene->path, names[i - 1].view->file, names[i].view->file);
    }
    for (size_t i = 0; names && i < n; i++)
        sg_free(names[i].file);
    sg_free(names);
    return code;
}

/* The path of the view's image as JSON, to be freed. */
static int quote_file(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_view *view,
                      const struct sg_poison_files *files, char **quoted)
{
    *quoted = NULL;
    char *file = image_file(ctx, scene, view, files);
    if (!file)
        return SG_ERR_BUDGET;
    json_t *name = json_string(file);
    *quoted = name ? json_dumps(name, JSON_ENCODE_ANY) : NULL;
    sg_free(file);
    json_decref(name);
    return *quoted ? SG_OK : refuse_name(ctx, view);
}

/* The views, or those of them that the list has, as the copy names them. */
static int put_names(sg_ctx *ctx, FILE *f, const char *key, const struct sg_scene *scene,
                     const struct sg_poison_files *files, const struct sg_view *views, size_t n,
                     const json_t *list)
{
    const char *between = "";
    fprintf(f, "  \"%s\": [", key);
    for (size_t i = 0; i < n; i++) {
        char *quoted;
        if (list && !json_object_get(list, views[i].file))
            continue;
        const int code = quote_file(ctx, scene, &views[i], files, &quoted);
        if (code)
            return code;
        fprintf(f, "%s\n    %s", between, quoted);
        free(quoted);
        between = ",";
    }
    fprintf(f, "],\n");
    return SG_OK;
}

/* The split of the scene, so that what was held out of it is held out of its copy. A scene of which
 * all views were loaded to train on keeps the lists of its file. */
static int put_split(sg_ctx *ctx, FILE *f, const struct sg_scene *scene,
                     const struct sg_poison_files *files)
{
    struct sg_folder from;
    struct sg_split_lists lists;
    int code = SG_OK;
    if (scene->n_test) {
        code =
            put_names(ctx, f, "train_filenames", scene, files, scene->train, scene->n_train, NULL);
        return code ? code
                    : put_names(ctx, f, "test_filenames", scene, files, scene->test, scene->n_test,
                                NULL);
    }
    if (scene->format != SG_FORMAT_NERFSTUDIO)
        return SG_OK;
    if ((code = sg_folder_open(ctx, scene->path, scene->follow_links, &from)))
        return code;
    code = sg_nerfstudio_lists(ctx, &from, &lists);
    if (!code && lists.train)
        code = put_names(ctx, f, "train_filenames", scene, files, scene->train, scene->n_train,
                         lists.train);
    if (!code && lists.test)
        code = put_names(ctx, f, "test_filenames", scene, files, scene->train, scene->n_train,
                         lists.test);
    sg_split_lists_clear(&lists);
    sg_folder_close(&from);
    return code;
}

static int put_frames(sg_ctx *ctx, FILE *f, const struct sg_scene *scene,
                      const struct sg_poison_files *files, const struct sg_view *views, size_t n,
                      bool *first)
{
    for (size_t i = 0; i < n; i++) {
        const struct sg_camera *c = &views[i].camera;
        char *quoted;
        const int code = quote_file(ctx, scene, &views[i], files, &quoted);
        if (code)
            return code;
        fprintf(f,
                "%s\n    {\"file_path\": %s, \"w\": %d, \"h\": %d,\n     \"fl_x\": %.17g, "
                "\"fl_y\": %.17g, \"cx\": %.17g, \"cy\": %.17g,\n     \"transform_matrix\": [",
                *first ? "" : ",", quoted, c->width, c->height, c->fx, c->fy, c->cx, c->cy);
        free(quoted);
        *first = false;
        /* camera-to-world with OpenGL axes: y up, z backward */
        for (int r = 0; r < 3; r++)
            fprintf(f, "[%.17g, %.17g, %.17g, %.17g], ", c->R[r], -c->R[3 + r], -c->R[6 + r],
                    -(c->R[r] * c->t[0] + c->R[3 + r] * c->t[1] + c->R[6 + r] * c->t[2]));
        fprintf(f, "[0, 0, 0, 1]]}");
    }
    return SG_OK;
}

static int write_transforms(sg_ctx *ctx, const struct sg_scene *scene,
                            const struct sg_poison_files *files, const char *folder)
{
    struct sg_file_writer w = {0};
    char *path = sg_strf(ctx, "%s/transforms.json", folder),
         *cloud = sg_strf(ctx, "%s/" CLOUD, folder);
    int code = path && cloud ? SG_OK : SG_ERR_BUDGET;
    if (!code && scene->n_points)
        code = sg_points_write_ply(ctx, cloud, scene->points, scene->point_colors, scene->n_points);
    if (!code)
        code = sg_file_create(ctx, &w, path);
    if (!code) {
        const locale_t before = uselocale(sg_c_locale());
        bool first = true;
        fprintf(w.stream, "{\n  \"camera_model\": \"PINHOLE\",\n%s",
                scene->n_points ? "  \"ply_file_path\": \"" CLOUD "\",\n" : "");
        code = put_split(ctx, w.stream, scene, files);
        fprintf(w.stream, "  \"frames\": [");
        if (!code)
            code = put_frames(ctx, w.stream, scene, files, scene->train, scene->n_train, &first);
        if (!code)
            code = put_frames(ctx, w.stream, scene, files, scene->test, scene->n_test, &first);
        fprintf(w.stream, "\n  ]\n}\n");
        uselocale(before);
        if (!code)
            code = sg_file_commit(ctx, &w);
    }
    sg_file_abandon(&w);
    sg_free(path);
    sg_free(cloud);
    return code;
}

/* Removes cameras of another layout: an earlier set in the same folder must not be read instead of
 * this one. */
static int remove_cameras(sg_ctx *ctx, const char *folder, const char *const *names)
{
    for (; *names; names++) {
        char *path;
        const int code = sg_path_below(ctx, folder, *names, &path);
        if (!code)
            unlink(path);
        sg_free(path);
        if (code)
            return code;
    }
    return SG_OK;
}

/* Removes photos of an earlier set with other endings. */
static int remove_namesakes(sg_ctx *ctx, const char *path)
{
    static const char *const endings[] = {".png", ".jpg", ".jpeg", ".webp",
                                          ".PNG", ".JPG", ".JPEG", ".WEBP"};
    const size_t stem = (size_t) (strrchr(path, '.') - path);
    for (size_t i = 0; i < sizeof(endings) / sizeof(*endings); i++) {
        char *other = sg_strf(ctx, "%.*s%s", (int) stem, path, endings[i]);
        if (!other)
            return SG_ERR_BUDGET;
        if (strcmp(other, path))
            unlink(other);
        sg_free(other);
    }
    return SG_OK;
}

/* Refuses the scene's own folder, whose files would be lost. */
static int refuse_scene(sg_ctx *ctx, const struct sg_scene *scene, const char *folder)
{
    struct stat own, other;
    if (scene->format != SG_FORMAT_MEMORY && !stat(scene->path, &own) && !stat(folder, &other) &&
        own.st_dev == other.st_dev && own.st_ino == other.st_ino)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "%s: found the scene's own folder, expected another one for its copy",
                       folder);
    return SG_OK;
}

struct sg_poison_files sg_poison_files_default(void)
{
    return (struct sg_poison_files){SG_POISON_FILE_DEFAULTS};
}

/* *has: the folder or archive has both files of a Blender scene. */
static int find_test_file(sg_ctx *ctx, const char *path, bool follow_links, bool *has)
{
    struct sg_folder dir;
    const int code = sg_folder_open(ctx, path, follow_links, &dir);
    *has = !code && sg_is_blender(ctx, &dir) && sg_has_file(&dir, "transforms_test.json");
    sg_folder_close(&dir);
    return code;
}

int sg_poisoned_scene_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                           struct sg_scene **out)
{
    struct sg_scene_params p = params ? *params : sg_scene_params_default();
    const bool eval = p.eval;
    p.test_halves = false;
    bool blender;
    *out = NULL;
    sg_clear_error(ctx);
    int code = find_test_file(ctx, path, p.follow_links, &blender);
    if (code)
        return code;
    p.eval = eval || blender;
    code = sg_scene_load(ctx, path, &p, out);
    if (code == SG_ERR_INPUT && blender) { /* it is no fault if the test photos are missing */
        char why[512];
        snprintf(why, sizeof(why), "%s", sg_last_error(ctx));
        p.eval = false;
        code = sg_scene_load(ctx, path, &p, out);
        if (!code)
            sg_log(ctx, SG_LOG_WARN, "%s; the scene is read without its test views", why);
    }
    if (!code && p.eval && !eval && (*out)->format != SG_FORMAT_BLENDER) {
        p.eval = false; /* the folder has another layout too, which is read instead */
        sg_scene_destroy(out);
        code = sg_scene_load(ctx, path, &p, out);
    }
    return code;
}

/* What the layouts have beside photos, which says where a scene is. */
static const char *const blender[] = {"transforms_train.json", "transforms_test.json",
                                      "transforms_val.json", "points3d.ply", NULL};
static const char *const colmap[] = {
    "sparse/0/cameras.bin",  "sparse/0/points3D.bin", "sparse/0/cameras.txt",
    "sparse/0/points3D.txt", "sparse/0/points3D.ply", "sparse/cameras.bin",
    "sparse/points3D.bin",   "sparse/cameras.txt",    "sparse/points3D.txt",
    "sparse/points3D.ply",   "poses_bounds.npy",      NULL};
/* Of COLMAP too, and copied last: without them a folder is no scene. */
static const char *const images[] = {"sparse/0/images.bin", "sparse/0/images.txt",
                                     "sparse/images.bin", "sparse/images.txt", NULL};
static const char *const own[] = {"transforms.json", NULL};

static const char *const *const layouts[] = {images, blender, colmap, own};

/* Whether copies of scenes have files of that name, the photos and masks by their endings. */
static bool is_written(const char *name)
{
    bool written = sg_photo_ending(name) || !strcmp(name, CLOUD);
    for (size_t i = 0; i < sizeof(layouts) / sizeof(*layouts) && !written; i++)
        for (const char *const *file = layouts[i]; *file && !written; file++)
            written = !strcmp(name, sg_base_name(*file));
    return written;
}

/* Removes what a killed process left unfinished in the folder of the file. Nothing through a link,
 * which is an error when the file is written. */
static int remove_unfinished(sg_ctx *ctx, const char *folder, const char *file)
{
    char *path;
    const int code = sg_path_below(ctx, folder, file, &path);
    if (!code)
        *strrchr(path, '/') = 0;
    DIR *d = code ? NULL : opendir(path);
    if (d) {
        sg_remove_temporary(d, is_written);
        closedir(d);
    }
    sg_free(path);
    if (code == SG_ERR_INPUT)
        sg_clear_error(ctx);
    return code == SG_ERR_INPUT ? SG_OK : code;
}

static bool is_beside(const char *file, const char *other)
{
    const size_t n = (size_t) (sg_base_name(file) - file);
    return other && n == (size_t) (sg_base_name(other) - other) && !strncmp(file, other, n);
}

/* The same where photos and masks are. */
static int remove_unfinished_photos(sg_ctx *ctx, const struct sg_scene *scene,
                                    const struct sg_poison_files *files, const char *folder)
{
    const bool transforms = needs_transforms(scene);
    char *before = NULL; /* photos of one folder mostly follow each other */
    int code = SG_OK;
    for (size_t i = 0; i < scene->n_train + scene->n_test && !code; i++) {
        const struct sg_view *view =
            i < scene->n_train ? &scene->train[i] : &scene->test[i - scene->n_train];
        char *file = image_file(ctx, scene, view, files);
        char *mask = file ? mask_file(ctx, scene, view, transforms, file) : NULL;
        code = mask ? SG_OK : SG_ERR_BUDGET;
        if (!code && !is_beside(file, before)) {
            code = remove_unfinished(ctx, folder, file);
            code = code ? code : remove_unfinished(ctx, folder, mask);
        }
        sg_free(mask);
        sg_free(before);
        before = file;
    }
    sg_free(before);
    return code;
}

int sg_poisoned_scene_begin(sg_ctx *ctx, const struct sg_scene *scene,
                            const struct sg_poison_files *files, const char *folder)
{
    static const char *const places[] = {"transforms.json", "sparse/0/images.bin",
                                         "sparse/images.bin"};
    sg_clear_error(ctx);
    int code = sg_poisoned_scene_check(ctx, scene, files);
    if (!code)
        code = sg_dir_create(ctx, folder);
    if (!code)
        code = refuse_scene(ctx, scene, folder);
    for (size_t i = 0; i < sizeof(layouts) / sizeof(*layouts) && !code; i++)
        code = remove_cameras(ctx, folder, layouts[i]);
    for (size_t i = 0; i < sizeof(places) / sizeof(*places) && !code; i++)
        code = remove_unfinished(ctx, folder, places[i]);
    return code ? code : remove_unfinished_photos(ctx, scene, files, folder);
}

/* Warns of a file that is not copied because another one has been written in its place. */
static int leave_out(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_folder *from,
                     const char *to, const char *name)
{
    char *source = sg_strf(ctx, "%s/%s", scene->path, name), *target = NULL;
    const int code = source ? sg_path_below(ctx, to, name, &target) : SG_ERR_BUDGET;
    if (!code && sg_folder_has(from, source) && !sg_file_exists(target))
        sg_log(ctx, SG_LOG_WARN, "%s: not copied: it would name photos that the copy does not have",
               source);
    sg_free(source);
    sg_free(target);
    return code;
}

/* Where the images have other names, the copy has the file that was read with these. The others
 * would name photos that the copy does not have, and are left out: readers take the same file as
 * this program, the binary one before the text. */
static int copy_model(sg_ctx *ctx, const struct sg_scene *scene,
                      const struct sg_poison_files *files, const struct sg_folder *from,
                      const char *folder)
{
    bool renamed;
    int code = sg_colmap_fit_copy(ctx, scene, from, folder, saves_jpeg(scene, files), &renamed);
    for (size_t i = 0; images[i] && !code; i++)
        code = (renamed ? leave_out : copy)(ctx, scene, from, folder, images[i]);
    return code;
}

int sg_poisoned_scene_finish(sg_ctx *ctx, const struct sg_scene *scene,
                             const struct sg_poison_files *files, const char *folder)
{
    struct sg_folder from;
    sg_clear_error(ctx);
    if (needs_transforms(scene))
        return write_transforms(ctx, scene, files, folder);
    const char *const *names = scene->format == SG_FORMAT_BLENDER ? blender : colmap;
    int code = sg_folder_open(ctx, scene->path, scene->follow_links, &from);
    if (code)
        return code;
    for (size_t i = 0; names[i] && !code; i++)
        code = copy(ctx, scene, &from, folder, names[i]);
    if (!code && scene->format == SG_FORMAT_COLMAP)
        code = copy_model(ctx, scene, files, &from, folder);
    if (code) { /* what is not finished is no scene */
        remove_cameras(ctx, folder, images);
        remove_cameras(ctx, folder, names);
    }
    sg_folder_close(&from);
    return code;
}

static int measure(sg_ctx *ctx, const struct sg_view *view, const char *path,
                   struct sg_poison_report *report)
{
    const int w = view->camera.width, h = view->camera.height;
    struct sg_image image = {0};
    int code = sg_image_read(ctx, path, UINT64_C(1) << 28, &image);
    if (code)
        return code;
    const uint8_t *rgb;
    if ((code = sg_photo_pixels(ctx, view, &rgb)))
        goto done;
    int largest = 0;
    for (size_t i = 0; i < 3 * (size_t) w * (size_t) h; i++) {
        const int d = abs(image.pixels[i] - rgb[i]);
        largest = d > largest ? d : largest;
    }
    report->linf = largest;
    report->psnr = fmin(sg_psnr_u8(rgb, image.pixels, w, h), 100);
    report->tv_before = sg_total_variation(rgb, w, h, SG_ATTACK_TV_ANISO);
    report->tv_after = sg_total_variation(image.pixels, w, h, SG_ATTACK_TV_ANISO);
    sg_view_release(view);
done:
    sg_image_clear(&image);
    return code;
}

static int write_mask(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_view *view,
                      const char *folder, const char *file)
{
    char *name = mask_file(ctx, scene, view, needs_transforms(scene), file), *path = NULL;
    int code = name ? sg_path_below(ctx, folder, name, &path) : SG_ERR_BUDGET;
    if (!code && !view->mask)
        unlink(path); /* of another set */
    else if (!code && !(code = make_folder(ctx, path)))
        code =
            sg_image_write_png(ctx, path, view->mask, view->camera.width, view->camera.height, 1);
    sg_free(name);
    sg_free(path);
    return code;
}

int sg_poisoned_scene_image(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_view *view,
                            const struct sg_poison_files *files, const char *folder,
                            const uint8_t *rgb, struct sg_poison_report *report)
{
    const int w = view->camera.width, h = view->camera.height;
    sg_clear_error(ctx);
    char *file = image_file(ctx, scene, view, files), *path = NULL;
    int code = file ? sg_path_below(ctx, folder, file, &path) : SG_ERR_BUDGET;
    if (!code)
        code = make_folder(ctx, path);
    if (!code)
        code = remove_namesakes(ctx, path);
    if (!code && !strcmp(file + strlen(file) - 4, ".png"))
        code = sg_image_write_png(ctx, path, rgb, w, h, 3);
    else if (!code)
        code = sg_image_write_jpeg(ctx, path, rgb, w, h, files->jpeg_quality, files->full_chroma);
    if (!code)
        code = write_mask(ctx, scene, view, folder, file);
    if (report)
        *report = (struct sg_poison_report){0};
    if (!code && report && !(code = measure(ctx, view, path, report))) {
        report->file = file;
        file = NULL;
    }
    sg_free(file);
    sg_free(path);
    return code;
}

void sg_poison_report_clear(struct sg_poison_report *report)
{
    sg_free(report->file);
    *report = (struct sg_poison_report){0};
}
