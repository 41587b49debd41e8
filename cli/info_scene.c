/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard info SCENE: what loading made of the files of a scene. */
#include "info_scene.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* Photos of one size. */
struct size_group {
    int width, height, file_width, file_height;
    size_t photos;
};

struct summary {
    struct size_group *sizes; /* by falling number of photos */
    size_t n_sizes, masked, undistorted, lossy;
    uint64_t pixels, bytes; /* of all photos; bytes: with masks */
    double low[3], high[3]; /* of the points */
};

static int by_size(const void *a, const void *b)
{
    const struct size_group *x = a, *y = b;
    const int differences[] = {x->width - y->width, x->height - y->height,
                               x->file_width - y->file_width, x->file_height - y->file_height};
    for (size_t i = 0; i < 4; i++)
        if (differences[i])
            return differences[i];
    return 0;
}

static int by_photos(const void *a, const void *b)
{
    const struct size_group *x = a, *y = b;
    return x->photos == y->photos ? by_size(a, b) : x->photos < y->photos ? 1 : -1;
}

/* sizes: one for each view, owned by the caller. */
static void summarise(const struct sg_scene *scene, struct size_group *sizes, struct summary *out)
{
    const size_t n = scene->n_train + scene->n_test;
    *out = (struct summary){.sizes = sizes};
    for (size_t i = 0; i < n; i++) {
        const struct sg_view *v = scene_view(scene, i);
        const uint64_t pixels = (uint64_t) v->camera.width * (uint64_t) v->camera.height;
        sizes[i] = (struct size_group){v->camera.width, v->camera.height, v->file_width,
                                       v->file_height, 1};
        out->pixels += pixels;
        out->bytes += pixels * (v->mask ? 4 : 3);
        out->masked += v->mask != NULL;
        out->undistorted += v->undistorted;
        out->lossy += !v->lossless;
    }
    qsort(sizes, n, sizeof(*sizes), by_size);
    for (size_t i = 0; i < n; i++)
        if (out->n_sizes && !by_size(&sizes[out->n_sizes - 1], &sizes[i]))
            sizes[out->n_sizes - 1].photos++;
        else
            sizes[out->n_sizes++] = sizes[i];
    qsort(sizes, out->n_sizes, sizeof(*sizes), by_photos);
    for (size_t i = 0; i < scene->n_points; i++)
        for (int k = 0; k < 3; k++) {
            const double x = (double) scene->points[i * 3 + (size_t) k];
            out->low[k] = i && out->low[k] < x ? out->low[k] : x;
            out->high[k] = i && out->high[k] > x ? out->high[k] : x;
        }
}

static int print_json(const struct sg_scene *scene, const struct summary *s)
{
    json_t *sizes = json_array();
    for (size_t i = 0; i < s->n_sizes; i++) {
        const struct size_group *g = &s->sizes[i];
        json_array_append_new(sizes,
                              json_pack("{s:i,s:i,s:i,s:i,s:I}", "width", g->width, "height",
                                        g->height, "file_width", g->file_width, "file_height",
                                        g->file_height, "photos", (json_int_t) g->photos));
    }
    return json_print(
        json_pack("{s:o,s:s,s:I,s:I,s:o,s:I,s:I,s:I,s:I,s:I,s:I,s:o,s:o,s:o,s:o}", "scene",
                  text_json(scene->path), "format", sg_scene_format_name(scene->format),
                  "train_views", (json_int_t) scene->n_train, "test_views",
                  (json_int_t) scene->n_test, "sizes", sizes, "pixels", (json_int_t) s->pixels,
                  "bytes", (json_int_t) s->bytes, "masked", (json_int_t) s->masked, "undistorted",
                  (json_int_t) s->undistorted, "lossy", (json_int_t) s->lossy, "points",
                  (json_int_t) scene->n_points, "points_min",
                  scene->n_points ? numbers_json(s->low, 3) : json_null(), "points_max",
                  scene->n_points ? numbers_json(s->high, 3) : json_null(), "center",
                  numbers_json(scene->center, 3), "extent", number_json(scene->extent)),
        0);
}

#define MOST_SIZES 4 /* that the text lists */

static void print_sizes(const struct summary *s)
{
    size_t others = 0;
    for (size_t i = 0; i < s->n_sizes; i++) {
        const struct size_group *g = &s->sizes[i];
        if (i >= MOST_SIZES) {
            others += g->photos;
            continue;
        }
        printf("  %-10s %zu of %dx%d", i ? "" : "photos", g->photos, g->file_width, g->file_height);
        if (g->width != g->file_width || g->height != g->file_height)
            printf(", used at %dx%d", g->width, g->height);
        printf("\n");
    }
    if (others)
        printf("             %zu of %zu other sizes\n", others, s->n_sizes - MOST_SIZES);
    printf("             %.1f million pixels, %.1f MB in memory\n", (double) s->pixels / 1e6,
           (double) s->bytes / 1e6);
}

static void print_text(const struct sg_scene *scene, const struct summary *s)
{
    say(stdout, "%s\n", scene->path);
    printf("  layout     %s\n", sg_scene_format_name(scene->format));
    printf("  views      %zu to train on, %zu for tests (--eval)\n", scene->n_train, scene->n_test);
    print_sizes(s);
    if (s->undistorted)
        printf("  lenses     distortion was removed from %zu photos\n", s->undistorted);
    if (s->masked)
        printf("  masks      %zu photos are used in part%s\n", s->masked,
               s->undistorted ? " (also without the borders that undistortion leaves)" : "");
    if (scene->n_points)
        printf("  points     %zu, x %.4g .. %.4g, y %.4g .. %.4g, z %.4g .. %.4g\n",
               scene->n_points, s->low[0], s->high[0], s->low[1], s->high[1], s->low[2],
               s->high[2]);
    else
        printf("  points     none: training begins at random positions\n");
    printf("  cameras    around %.4g, %.4g, %.4g; extent %.4g\n", scene->center[0],
           scene->center[1], scene->center[2], scene->extent);
}

int info_scene(sg_ctx *ctx, const char *path, struct sg_scene_params params, bool json)
{
    struct sg_scene *scene = NULL;
    params.eval = true;
    int error = sg_scene_load(ctx, path, &params, &scene);
    if (error == SG_ERR_INPUT) { /* training without test views may take it all the same */
        char *why = strdup(sg_last_error(ctx));
        params.eval = false;
        hold_log(true); /* most of it has been said */
        error = why ? sg_scene_load(ctx, path, &params, &scene) : SG_ERR_BUDGET;
        hold_log(false);
        if (!error)
            say(stderr, "warning: refused with --eval: %s\n", why);
        free(why);
    }
    int status = report(ctx, error);
    if (status)
        return status;
    struct summary s;
    struct size_group *sizes = calloc(scene->n_train + scene->n_test, sizeof(*sizes));
    if (!sizes)
        status = no_memory();
    else {
        summarise(scene, sizes, &s);
        if (json)
            status = print_json(scene, &s);
        else
            print_text(scene, &s);
    }
    free(sizes);
    sg_scene_destroy(&scene);
    return status;
}
