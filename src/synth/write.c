/* SPDX-License-Identifier: Apache-2.0 */
/* Views of the project's own scene, as folders that any trainer reads. */
#include "splatguard/synth.h"

#include <dirent.h>
#include <errno.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "core/file.h"
#include "core/rng.h"
#include "image/image.h"
#include "option/option.h"
#include "files.h"

#define ANGLE_X 0.6911112070083618 /* of the NeRF synthetic cameras */
#define DISTANCE 4.0
#define TEST_EVERY 8 /* of the COLMAP layout: view 0, 8, 16... in the order of names */
#define PICK_TRIES 256
#define PICK_BLOCK 256

enum draw {
    DRAW_SCENE,
    DRAW_CAMERAS,
    DRAW_POINTS
}; /* streams of random numbers; the scene has the first */

struct synth {
    sg_ctx *ctx;
    const char *dir;
    struct sg_synth_params p;
    struct synth_scene scene;
    struct synth_camera *cameras; /* train views, then test views */
    int n_cameras, colmap_test;   /* test views of the COLMAP layout */
    int *order, *place; /* camera of each COLMAP view, and back; place -1: not in that layout */
    struct synth_point *points;
    atomic_int code;
};

static int check_empty(sg_ctx *ctx, const char *dir)
{
    if (!*dir) /* its files would be in the root */
        return sg_fail(ctx, SG_ERR_USAGE, "found an empty path, expected that of a folder");
    DIR *d = opendir(dir);
    if (!d)
        return errno == ENOENT
                   ? SG_OK
                   : sg_fail(ctx, SG_ERR_INPUT, "%s: %s, expected a new or empty folder", dir,
                             strerror(errno));
    const struct dirent *entry;
    int code = SG_OK;
    while (!code && (entry = readdir(d)))
        if (entry->d_name[0] != '.') /* some systems put hidden files everywhere */
            code =
                sg_fail(ctx, SG_ERR_INPUT, "%s: found \"%s\" in it, expected a new or empty folder",
                        dir, entry->d_name);
    closedir(d);
    return code;
}

/* Base 2 mirrored at the point: every beginning of the sequence is even (van der Corput 1935). */
static double mirrored(unsigned i)
{
    double x = 0, digit = 0.5;
    for (; i; i >>= 1, digit *= 0.5)
        x += digit * (i & 1);
    return x;
}

/* Even over the upper hemisphere but for the rim, where the table top is a line, and the pole. Any
 * number of views of the sequence is evenly spread: the layouts take different numbers of test
 * views. */
static void place_cameras(struct synth *s)
{
    for (int i = 0; i < s->n_cameras; i++) {
        const bool test = i >= s->p.train_views;
        const unsigned k = (unsigned) (test ? i - s->p.train_views : i);
        const uint64_t draw = 2 * (uint64_t) i;
        const double du =
            (double) sg_rng_uniform(s->p.seed, SG_RNG_SYNTH, DRAW_CAMERAS, draw) - 0.5;
        const double dv =
            (double) sg_rng_uniform(s->p.seed, SG_RNG_SYNTH, DRAW_CAMERAS, draw + 1) - 0.5;
        const double height =
            test ? 0.16 + 0.64 * mirrored(k + 1) : 0.05 + 0.90 * (mirrored(k + 1) + 0.01 * du);
        const double azimuth = 2.39996322972865332 * k + (test ? 1.1 : -1.4) + 0.08 * dv;
        const double flat = sqrt(1 - height * height);
        s->cameras[i] = sg_synth_camera_at(
            scale(vec(flat * cos(azimuth), flat * sin(azimuth), height), DISTANCE), vec(0, 0, 0),
            s->p.width, s->p.height, ANGLE_X);
    }
}

static void order_views(struct synth *s)
{
    for (int i = 0; i < s->n_cameras; i++)
        s->place[i] = -1;
    int train = 0, test = s->p.train_views;
    for (int k = 0; k < s->p.train_views + s->colmap_test; k++) {
        s->order[k] = k % TEST_EVERY ? train++ : test++;
        s->place[s->order[k]] = k;
    }
}

static int make_folders(struct synth *s)
{
    static const char *const folders[] = {"blender/train", "blender/test", "colmap/images",
                                          "colmap/sparse/0"};
    int code = SG_OK;
    for (size_t i = 0; i < sizeof(folders) / sizeof(*folders) && !code; i++) {
        char *path = sg_strf(s->ctx, "%s/%s", s->dir, folders[i]);
        code = path ? sg_dir_create(s->ctx, path) : SG_ERR_BUDGET;
        sg_free(path);
    }
    return code;
}

/* Removes only what make_folders made and this process wrote, so that the caller can try again: the
 * folder was empty before. */
static void remove_begun(const struct synth *s)
{
    static const char *const folders[] = {"blender/train",   "blender/test",  "colmap/images",
                                          "colmap/sparse/0", "colmap/sparse", "blender",
                                          "colmap"};
    for (size_t i = 0; i < sizeof(folders) / sizeof(*folders); i++) {
        char *path = sg_strf(s->ctx, "%s/%s", s->dir, folders[i]);
        DIR *d = path ? opendir(path) : NULL;
        for (const struct dirent *entry; d && (entry = readdir(d));)
            unlinkat(dirfd(d), entry->d_name, 0);
        if (d)
            closedir(d);
        if (path)
            rmdir(path);
        sg_free(path);
    }
}

static int write_blender_picture(struct synth *s, int view, const uint8_t *rgba)
{
    const bool test = view >= s->p.train_views;
    const int number = test ? view - s->p.train_views : view;
    if (test && number >= s->p.test_views)
        return SG_OK; /* only the COLMAP layout needs it */
    char *path = sg_strf(s->ctx, "%s/blender/%s/r_%d.png", s->dir, test ? "test" : "train", number);
    const int code =
        path ? sg_image_write_png(s->ctx, path, rgba, s->p.width, s->p.height, 4) : SG_ERR_BUDGET;
    sg_free(path);
    return code;
}

static int write_colmap_picture(struct synth *s, int view, uint8_t *rgba)
{
    if (s->place[view] < 0)
        return SG_OK;
    const struct sg_image image = {
        .width = s->p.width, .height = s->p.height, .channels = 4, .pixels = rgba};
    uint8_t *rgb =
        sg_alloc_raw(s->ctx, SG_MEM_IMAGES, (size_t) s->p.width * (size_t) s->p.height, 3);
    char *path = sg_strf(s->ctx, "%s/colmap/images/" SYNTH_COLMAP_NAME, s->dir, s->place[view]);
    int code = SG_ERR_BUDGET;
    if (rgb && path) {
        sg_image_flatten(&image, SG_ALPHA_ON_BLACK, rgb);
        code = sg_image_write_png(s->ctx, path, rgb, s->p.width, s->p.height, 3);
    }
    sg_free(path);
    sg_free(rgb);
    return code;
}

static void make_view(void *arg, size_t i, int thread)
{
    (void) thread;
    struct synth *s = arg;
    if (atomic_load(&s->code))
        return; /* another view failed */
    const int view = (int) i;
    uint8_t *rgba =
        sg_alloc_raw(s->ctx, SG_MEM_IMAGES, (size_t) s->p.width * (size_t) s->p.height, 4);
    int code = rgba ? sg_synth_render(s->ctx, &s->scene, &s->cameras[view], s->p.samples, rgba)
                    : SG_ERR_BUDGET;
    if (!code)
        code = write_blender_picture(s, view, rgba);
    if (!code)
        code = write_colmap_picture(s, view, rgba);
    if (code)
        atomic_store(&s->code, code);
    sg_free(rgba);
}

static void pick_block(void *arg, size_t block, int thread)
{
    (void) thread;
    struct synth *s = arg;
    const int first = (int) block * PICK_BLOCK;
    for (int i = first; i < first + PICK_BLOCK && i < s->p.points; i++) {
        const struct synth_camera *c = &s->cameras[i % s->p.train_views];
        struct synth_point *p = &s->points[i];
        uint64_t draw = (uint64_t) i * 2 * PICK_TRIES;
        bool found = false;
        for (int k = 0; k < PICK_TRIES && !found; k++, draw += 2) {
            p->x = c->width * (double) sg_rng_uniform(s->p.seed, SG_RNG_SYNTH, DRAW_POINTS, draw);
            p->y =
                c->height * (double) sg_rng_uniform(s->p.seed, SG_RNG_SYNTH, DRAW_POINTS, draw + 1);
            found = sg_synth_pick(&s->scene, c, p->x, p->y, &p->p, p->rgb);
        }
        if (!found) { /* a very flat or tall picture, whose middle shows the scene */
            p->x = 0.5 * c->width;
            p->y = 0.5 * c->height;
            sg_synth_pick(&s->scene, c, p->x, p->y, &p->p, p->rgb);
        }
    }
}

/* These files make the folders readable as scenes, so they come last, each layout's main file at
 * the end. */
static int write_models(struct synth *s)
{
    char *blender = sg_strf(s->ctx, "%s/blender", s->dir),
         *sparse = sg_strf(s->ctx, "%s/colmap/sparse/0", s->dir);
    const struct synth_colmap model = {
        s->cameras,       s->order,  s->place,   s->p.train_views + s->colmap_test,
        s->p.train_views, s->points, s->p.points};
    int code = blender && sparse ? sg_synth_write_colmap(s->ctx, sparse, &model) : SG_ERR_BUDGET;
    if (!code)
        code = sg_synth_write_transforms(s->ctx, blender, "test", s->cameras + s->p.train_views,
                                         s->p.test_views, ANGLE_X);
    if (!code)
        code = sg_synth_write_transforms(s->ctx, blender, "train", s->cameras, s->p.train_views,
                                         ANGLE_X);
    sg_free(sparse);
    sg_free(blender);
    return code;
}

struct sg_synth_params sg_synth_params_default(void)
{
    return (struct sg_synth_params){SG_SYNTH_DEFAULTS};
}

int sg_synth_write(sg_ctx *ctx, const char *dir, const struct sg_synth_params *params)
{
    sg_clear_error(ctx);
    const struct sg_synth_params defaults = sg_synth_params_default(),
                                 *p = params ? params : &defaults;
    int code = sg_check_options(ctx, sg_synth_options(), p);
    if (code)
        return code;
    bool begun = false;
    struct synth *s = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*s));
    if (!s)
        return SG_ERR_BUDGET;
    s->ctx = ctx;
    s->dir = dir;
    s->p = *p;
    s->colmap_test = (p->train_views + TEST_EVERY - 2) / (TEST_EVERY - 1);
    s->n_cameras =
        p->train_views + (p->test_views > s->colmap_test ? p->test_views : s->colmap_test);
    const size_t n = (size_t) s->n_cameras;
    if (!(s->cameras = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*s->cameras))) ||
        !(s->order = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*s->order))) ||
        !(s->place = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*s->place))) ||
        !(s->points = sg_alloc(ctx, SG_MEM_MISC, (size_t) p->points, sizeof(*s->points)))) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    if ((code = check_empty(ctx, dir)))
        goto done;
    begun = true;
    if ((code = make_folders(s)))
        goto done;
    sg_synth_scene_build(&s->scene, p->seed);
    place_cameras(s);
    order_views(s);
    code = sg_parallel_stage(ctx, SG_STAGE_SYNTH, n, make_view, s);
    if (!code)
        code = atomic_load(&s->code);
    if (!code)
        code = sg_parallel_stage(ctx, SG_STAGE_SYNTH,
                                 ((size_t) p->points + PICK_BLOCK - 1) / PICK_BLOCK, pick_block, s);
    if (!code)
        code = write_models(s);
done:
    if (code && begun)
        remove_begun(s);
    sg_free(s->points);
    sg_free(s->place);
    sg_free(s->order);
    sg_free(s->cameras);
    sg_free(s);
    return code;
}
