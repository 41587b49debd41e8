/* SPDX-License-Identifier: Apache-2.0 */
/* Loading a scene: which format, its reader, masks, photos, extent. */
#include "splatguard/scene.h"

#include <math.h>
#include <string.h>

#include "scene/reader.h"

static const struct {
    const char *name;
    bool (*is)(sg_ctx *ctx, const struct sg_folder *dir);
    int (*read)(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                struct sg_shots *shots, struct sg_points *points);
} formats[] = {
    [SG_FORMAT_AUTO] = {"auto", NULL, NULL},
    [SG_FORMAT_BLENDER] = {"blender", sg_is_blender, sg_read_blender},
    [SG_FORMAT_COLMAP] = {"colmap", sg_is_colmap, sg_read_colmap},
    [SG_FORMAT_NERFSTUDIO] = {"nerfstudio", sg_is_nerfstudio, sg_read_nerfstudio},
};

const char *sg_scene_format_name(enum sg_scene_format format)
{
    return (unsigned) format < sizeof(formats) / sizeof(*formats) ? formats[format].name
                                                                  : "unknown";
}

static int check_params(sg_ctx *ctx, const struct sg_scene_params *p)
{
    if ((unsigned) p->format > SG_FORMAT_NERFSTUDIO)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "scene parameters: found format %d, expected one of enum sg_scene_format",
                       (int) p->format);
    if ((unsigned) p->smooth > SG_SMOOTH_BILATERAL)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "scene parameters: found smooth %d, expected one of enum sg_smooth",
                       (int) p->smooth);
    if (p->resolution != -1 && (p->resolution < 1 || p->resolution > 16384))
        return sg_fail(ctx, SG_ERR_USAGE,
                       "scene parameters: found resolution %d, expected -1 or 1..16384",
                       p->resolution);
    if (!(p->downscale >= 1 && p->downscale <= 64))
        return sg_fail(ctx, SG_ERR_USAGE, "scene parameters: found downscale %g, expected 1..64",
                       p->downscale);
    if (p->test_every < 1)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "scene parameters: found test_every %d, expected 1 or more", p->test_every);
    return SG_OK;
}

/* The order is the reference's: a COLMAP model wins over transforms_train.json. */
static int recognise(sg_ctx *ctx, const struct sg_folder *dir, enum sg_scene_format *format)
{
    static const enum sg_scene_format order[] = {SG_FORMAT_COLMAP, SG_FORMAT_BLENDER,
                                                 SG_FORMAT_NERFSTUDIO};
    for (size_t i = 0; i < sizeof(order) / sizeof(*order); i++) {
        *format = order[i];
        const bool is = formats[order[i]].is(ctx, dir);
        if (sg_failed(ctx))
            return SG_ERR_BUDGET;
        if (is)
            return SG_OK;
    }
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: found no scene, looked for sparse/0/images.bin and cameras.bin (or .txt, "
                   "or in sparse/), transforms_train.json and transforms.json",
                   dir->path);
}

bool sg_scene_recognised(sg_ctx *ctx, const char *path)
{
    struct sg_folder dir;
    enum sg_scene_format format;
    const bool is = !sg_folder_open(ctx, path, false, &dir) && !recognise(ctx, &dir, &format);
    sg_folder_close(&dir);
    sg_clear_error(ctx);
    return is;
}

/* Masks are optional a photo: NAME, its base name, either with .png added, or its base name up to
 * the last dot .png. */
static int find_masks(sg_ctx *ctx, const struct sg_folder *dir,
                      const struct sg_scene_params *params, struct sg_shots *shots)
{
    int code = SG_OK;
    size_t found = 0;
    char *folder = sg_strf(ctx, "%s/%s", dir->path, params->masks ? params->masks : "masks");
    if (!folder)
        return SG_ERR_BUDGET;
    if (!sg_folder_has_folder(dir, folder)) {
        if (params->masks)
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: found no such folder, expected masks", folder);
        goto done;
    }
    for (size_t i = 0; i < shots->count; i++) {
        struct sg_shot *shot = &shots->items[i];
        const char *base = sg_base_name(shot->path), *dot = strrchr(base, '.');
        int stem = dot ? (int) (dot - base) : (int) strlen(base);
        for (int k = 0; k < 5 && !shot->mask; k++) {
            char *path = k == 0   ? sg_strf(ctx, "%s/%s", folder, shot->file)
                         : k == 1 ? sg_strf(ctx, "%s/%s.png", folder, shot->file)
                         : k == 2 ? sg_strf(ctx, "%s/%s", folder, base)
                         : k == 3 ? sg_strf(ctx, "%s/%s.png", folder, base)
                                  : sg_strf(ctx, "%s/%.*s.png", folder, stem, base);
            if (!path) {
                code = SG_ERR_BUDGET;
                goto done;
            }
            if (sg_folder_has(dir, path))
                shot->mask = path;
            else
                sg_free(path);
        }
        found += shot->mask != NULL;
    }
    if (found < shots->count)
        sg_log(ctx, SG_LOG_WARN, "%s: %zu of %zu images have no mask and are used whole", folder,
               shots->count - found, shots->count);
done:
    sg_free(folder);
    return code;
}

static void camera_center(const struct sg_camera *c, double center[3])
{
    for (int i = 0; i < 3; i++)
        center[i] = -(c->R[i] * c->t[0] + c->R[3 + i] * c->t[1] + c->R[6 + i] * c->t[2]);
}

static void measure(struct sg_scene *scene)
{
    double c[3], farthest = 0;
    for (size_t i = 0; i < scene->n_train; i++) {
        camera_center(&scene->train[i].camera, c);
        for (int k = 0; k < 3; k++)
            scene->center[k] += c[k] / (double) scene->n_train;
    }
    for (size_t i = 0; i < scene->n_train; i++) {
        double d2 = 0;
        camera_center(&scene->train[i].camera, c);
        for (int k = 0; k < 3; k++)
            d2 += (c[k] - scene->center[k]) * (c[k] - scene->center[k]);
        farthest = fmax(farthest, sqrt(d2));
    }
    scene->extent = 1.1 * farthest;
}

/* Deals the views, loaded in the shots' order, to train and test. */
static int deal(sg_ctx *ctx, struct sg_scene *scene, const struct sg_scene_params *params,
                const struct sg_shots *shots, struct sg_view *views)
{
    size_t n_test = 0;
    for (size_t i = 0; i < shots->count; i++)
        n_test += shots->items[i].test;
    const size_t n_train = shots->count - n_test;
    if (!n_train && !params->untrained)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no view to train on (%zu test views), expected at least one",
                       scene->path, n_test);
    scene->train = n_train ? sg_alloc(ctx, SG_MEM_MISC, n_train, sizeof(*views)) : NULL;
    scene->test = n_test ? sg_alloc(ctx, SG_MEM_MISC, n_test, sizeof(*views)) : NULL;
    if ((n_train && !scene->train) || (n_test && !scene->test))
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < shots->count; i++) {
        if (shots->items[i].test)
            scene->test[scene->n_test++] = views[i];
        else
            scene->train[scene->n_train++] = views[i];
        views[i] = (struct sg_view){0};
    }
    return SG_OK;
}

struct sg_scene_params sg_scene_params_default(void)
{
    return (struct sg_scene_params){SG_SCENE_DEFAULTS};
}

int sg_scene_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                  struct sg_scene **out)
{
    struct sg_shots shots = {0};
    struct sg_points points = {0};
    struct sg_view *views = NULL;
    struct sg_scene *scene = NULL;
    struct sg_folder dir = {.fd = -1};
    const struct sg_scene_params defaults = sg_scene_params_default();
    sg_clear_error(ctx);
    *out = NULL;
    if (!params)
        params = &defaults;
    int code = check_params(ctx, params);
    if (code)
        return code;
    code = sg_folder_open(ctx, path, params->follow_links, &dir);
    if (code)
        goto done;
    scene = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*scene));
    if (!scene || !(scene->path = sg_strdup(ctx, path))) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    scene->format = params->format;
    scene->white_background = params->white_background;
    scene->follow_links = params->follow_links;
    if (scene->format == SG_FORMAT_AUTO)
        code = recognise(ctx, &dir, &scene->format);
    if (!code)
        code = formats[scene->format].read(ctx, &dir, params, &shots, &points);
    scene->points = points.xyz; /* also after a failure: the scene frees them */
    scene->point_colors = points.rgb;
    scene->n_points = points.count;
    if (!code && !shots.count)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: found no images, expected at least one", path);
    if (!code)
        code = find_masks(ctx, &dir, params, &shots);
    if (code)
        goto done;
    views = sg_alloc(ctx, SG_MEM_MISC, shots.count, sizeof(*views));
    code = views ? sg_views_load(ctx, &dir, params, &shots, views) : SG_ERR_BUDGET;
    if (!code)
        code = deal(ctx, scene, params, &shots, views);
    if (code)
        goto done;
    measure(scene);
    if (scene->extent < 1e-6 && !params->untrained)
        sg_log(ctx, SG_LOG_WARN,
               "%s: found all training cameras in one place: positions will hardly learn", path);
    if (!scene->n_points && !params->untrained && scene->format != SG_FORMAT_BLENDER)
        sg_log(ctx, SG_LOG_WARN,
               "%s: found no points: training starts from random ones in a cube of 2.6 units about "
               "the origin",
               path);
    sg_log(ctx, SG_LOG_INFO, "%s: %s scene, %zu train and %zu test views, %zu points, extent %.4g",
           path, sg_scene_format_name(scene->format), scene->n_train, scene->n_test,
           scene->n_points, scene->extent);
    *out = scene;
    scene = NULL;
done:
    for (size_t i = 0; i < shots.count && views; i++)
        sg_view_clear(&views[i]);
    sg_free(views);
    sg_shots_clear(&shots);
    sg_folder_close(&dir);
    sg_scene_destroy(&scene);
    return code;
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
    sg_free(s->train);
    sg_free(s->test);
    sg_free(s->points);
    sg_free(s->point_colors);
    sg_free(s->path);
    sg_free(s);
    *scene = NULL;
}
