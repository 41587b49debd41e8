/* SPDX-License-Identifier: Apache-2.0 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "interrupt.h"
#include "model_views.h"

#define FRAMES_MAX 10000

enum { PATH_VIEWS, PATH_ELLIPSE, PATH_INTERPOLATE };

struct render_config {
    struct model_options m;
    const char *output;
    bool pfm, depth, photo;
    int path, frames;
};

static const struct sg_option render_options[] = {
    TEXT_ROW("output", offsetof(struct render_config, output), "DIR", "Folder for the images.",
             .letter = 'o', .group = "Output"),
    FLAG_ROW("float", offsetof(struct render_config, pfm),
             "Write PFM (32-bit float, not clamped) instead of PNG.", .group = "Output"),
    FLAG_ROW("depth", offsetof(struct render_config, depth),
             "Write NAME_depth too: mean depth in scene units (PFM), or nearest white to farthest "
             "dark grey (PNG).",
             .group = "Output"),
    FLAG_ROW("photo", offsetof(struct render_config, photo),
             "Write NAME_photo.png too: the photo of the view, in the size of the render.",
             .group = "Output"),
    CHOICE_ROW(
        "path", offsetof(struct render_config, path), "views|ellipse|interpolate", "PATH",
        "Cameras: the views; frames of a flight on an ellipse around what they show; or from "
        "view to view.",
        .group = "Output"),
    TEXT_ROW("cameras", offsetof(struct render_config, m.cameras), "FILE",
             "Cameras of a cameras.json, such as a run has, instead of a scene's: needs no photos.",
             .group = MODEL_GROUP),
    NUMBER_ROW("frames", SG_OPTION_INT, offsetof(struct render_config, frames), 1, FRAMES_MAX, "N",
               "Frames of the flight.", .group = "Output"),
    MODEL_ROWS(struct render_config),
    {0},
};

static const struct option_part render_parts[] = MODEL_PARTS(struct render_config);

static void defaults(void *config)
{
    *(struct render_config *) config =
        (struct render_config){.m = model_options_default(), .frames = 120};
}

struct buffers {
    float *rgb, *alpha, *depth;
    uint8_t *bytes;
};

static int copy_photo(struct model_views *v, const struct sg_view *view, const char *path)
{
    const uint8_t *rgb;
    int error = sg_view_pixels(v->ctx, view, &rgb);
    if (!error) {
        error = sg_picture_write_png(v->ctx, path, rgb, view->camera.width, view->camera.height, 3);
        sg_view_release(view);
    }
    return error;
}

static int render_view(const struct render_config *c, struct model_views *v,
                       const struct sg_view *view, const struct buffers *b)
{
    const int w = view->camera.width, h = view->camera.height;
    const size_t n = (size_t) w * (size_t) h;
    if (!c->path)
        model_views_choose(v, (size_t) (view - v->views));
    int error = sg_render(v->renderer, &view->camera, b->rgb, b->alpha, b->depth, NULL);
    const char *ending = c->pfm ? "pfm" : "png";
    char *path = NULL, *depth_path = NULL, *photo_path = NULL;
    if (asprintf(&path, "%s/%s.%s", c->output, view->name, ending) < 0)
        path = NULL;
    if (asprintf(&depth_path, "%s/%s_depth.%s", c->output, view->name, ending) < 0)
        depth_path = NULL;
    if (asprintf(&photo_path, "%s/%s_photo.png", c->output, view->name) < 0)
        photo_path = NULL;
    if (!error && !(path && depth_path && photo_path))
        error = SG_ERR_BUDGET;
    if (!error && c->pfm)
        error = sg_picture_write_pfm(v->ctx, path, b->rgb, w, h, 3);
    else if (!error) {
        sg_quantise(b->rgb, w, h, b->bytes);
        error = sg_picture_write_png(v->ctx, path, b->bytes, w, h, 3);
    }
    if (!error && c->depth && c->pfm) {
        for (size_t i = 0; i < n; i++) /* the weighted sum becomes the mean */
            b->depth[i] = b->alpha[i] > 0 ? b->depth[i] / b->alpha[i] : 0;
        error = sg_picture_write_pfm(v->ctx, depth_path, b->depth, w, h, 1);
    } else if (!error && c->depth) {
        depth_to_grey(b->depth, b->alpha, n, 1, b->bytes);
        error = sg_picture_write_png(v->ctx, depth_path, b->bytes, w, h, 1);
    }
    if (!error && c->photo)
        error = copy_photo(v, view, photo_path);
    free(path);
    free(depth_path);
    free(photo_path);
    return error;
}

/* Renders have the photos' names, and a scene may lead to photos anywhere. */
static int refuse_photos(const struct model_views *v, const char *output)
{
    const struct sg_scene *s = v->scene;
    for (size_t i = 0; s && i < s->n_train + s->n_test; i++) {
        const struct sg_view *view = scene_view(s, i);
        char *real = realpath(view->path, NULL), *slash = real ? strrchr(real, '/') : NULL;
        if (slash)
            slash[slash == real] = 0;
        const bool same = real && is_same(real, output);
        free(real);
        if (same) {
            say(stderr, "splatguard: %s: found the photo %s there, expected another folder\n",
                output, view->path);
            return STATUS_INPUT;
        }
    }
    return 0;
}

static int by_text(const void *a, const void *b)
{
    return strcmp(*(char *const *) a, *(char *const *) b);
}

/* View "a" with its photo has the file of view "a_photo". */
static int refuse_twins(const struct render_config *c, const struct model_views *v)
{
    const char *const endings[] = {"", c->depth ? "_depth" : NULL, c->photo ? "_photo" : NULL};
    char **names = calloc(3 * v->n + 1, sizeof(*names));
    size_t n = 0;
    int code = names ? 0 : no_memory();
    for (size_t i = 0; i < v->n && !code; i++)
        for (int k = 0; k < 3 && !code; k++)
            if (endings[k] && asprintf(&names[n], "%s%s", v->views[i].name, endings[k]) < 0)
                code = no_memory();
            else if (endings[k])
                n++;
    if (!code)
        qsort(names, n, sizeof(*names), by_text);
    for (size_t i = 1; i < n && !code; i++)
        if (!strcmp(names[i - 1], names[i])) {
            say(stderr,
                "splatguard: %s: found two pictures of that name, expected one: render "
                "without --depth or --photo\n",
                names[i]);
            code = STATUS_INPUT;
        }
    for (size_t i = 0; i < n; i++)
        free(names[i]);
    free(names);
    return code;
}

/* An existing file with the name of a view must be a render. This is checked before the first file
 * is written. PFM files have no mark; for them the folder's mark counts. */
static int refuse_others(const struct render_config *c, const struct model_views *v)
{
    const struct {
        const char *ending;
        bool written;
    } kinds[] = {{"", !c->pfm}, {"_depth", c->depth && !c->pfm}, {"_photo", c->photo}};
    int code = 0;
    for (size_t i = 0; i < v->n && !code; i++)
        for (int k = 0; k < 3 && !code; k++) {
            char *path = NULL;
            if (!kinds[k].written)
                continue;
            if (asprintf(&path, "%s/%s%s.png", c->output, v->views[i].name, kinds[k].ending) < 0)
                return no_memory();
            code = report(v->ctx, sg_output_check_replaced(v->ctx, path));
            free(path);
        }
    return code;
}

#define FRAME_NAME 32

/* The frames of the flight take the place of the views. */
struct flight {
    struct sg_view *frames;
    char (*names)[FRAME_NAME];
};

static int fly(const struct render_config *c, struct model_views *v, struct flight *f)
{
    const size_t n = (size_t) c->frames;
    const enum sg_path_kind kind = c->path == PATH_ELLIPSE ? SG_PATH_ELLIPSE : SG_PATH_INTERPOLATE;
    struct sg_camera *cameras = calloc(v->n, sizeof(*cameras)), *path = calloc(n, sizeof(*path));
    f->frames = calloc(n, sizeof(*f->frames));
    f->names = calloc(n, sizeof(*f->names));
    int code = cameras && path && f->frames && f->names ? 0 : no_memory();
    if (!code) {
        for (size_t i = 0; i < v->n; i++)
            cameras[i] = v->views[i].camera;
        code = report(v->ctx, sg_camera_path(v->ctx, kind, cameras, v->n, n, path));
    }
    for (size_t i = 0; i < n && !code; i++) {
        snprintf(f->names[i], FRAME_NAME, "frame_%04zu", i);
        f->frames[i] = (struct sg_view){.name = f->names[i], .camera = path[i]};
    }
    free(cameras);
    free(path);
    v->views = f->frames, v->n = n;
    return code;
}

/* Frames of a longer flight would be taken for some of this one. */
static int refuse_longer(const struct render_config *c)
{
    char *path = NULL;
    if (asprintf(&path, "%s/frame_%04d.%s", c->output, c->frames, c->pfm ? "pfm" : "png") < 0)
        return no_memory();
    const bool longer = !access(path, F_OK);
    if (longer)
        say(stderr,
            "splatguard: %s: found a frame of a longer flight, expected at most %d frames or "
            "another folder\n",
            path, c->frames);
    free(path);
    return longer ? STATUS_INPUT : 0;
}

/* What options need or exclude of each other. */
static int check_options(const struct render_config *c, const bool *given)
{
    if (!c->output)
        return missing(&command_render, "-o DIR");
    if (c->path && c->photo) {
        say(stderr, "splatguard render: --photo: found --path too, whose frames have no photos\n");
        return STATUS_USAGE;
    }
    const char *of_photos = options_given_of(
        &command_render, given, &render_parts[0],
        "resolution|downscale|white-background|centred-principal"); /* those of cameras */
    if (options_given(&command_render, given, offsetof(struct render_config, m.split)))
        of_photos = "split";
    of_photos = c->photo ? "photo" : c->m.scene_path ? "scene" : of_photos;
    if (c->m.cameras && of_photos) {
        say(stderr,
            "splatguard render: --%s: found --cameras too, which has neither photos nor splits\n",
            of_photos);
        return STATUS_USAGE;
    }
    if (!c->path && options_given(&command_render, given, offsetof(struct render_config, frames))) {
        say(stderr,
            "splatguard render: --frames: found no --path, expected ellipse or interpolate\n");
        return STATUS_USAGE;
    }
    return 0;
}

static int render_views(const struct render_config *c, struct model_views *v)
{
    size_t pixels = 0;
    for (size_t i = 0; i < v->n; i++) {
        const size_t n = (size_t) v->views[i].camera.width * (size_t) v->views[i].camera.height;
        pixels = n > pixels ? n : pixels;
    }
    struct buffers b = {.rgb = sg_mem_alloc(v->ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float)),
                        .bytes = sg_mem_alloc(v->ctx, SG_MEM_FRAME, pixels, 3)};
    if (c->depth) {
        b.alpha = sg_mem_alloc(v->ctx, SG_MEM_FRAME, pixels, sizeof(float));
        b.depth = sg_mem_alloc(v->ctx, SG_MEM_FRAME, pixels, sizeof(float));
    }
    int error = b.rgb && b.bytes && (!c->depth || (b.alpha && b.depth)) ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < v->n && !error; i++)
        error = interrupted() ? SG_ERR_INTERRUPTED : render_view(c, v, &v->views[i], &b);
    const int code = error ? report(v->ctx, error) : 0;
    if (!code && !c->m.quiet)
        say(stderr, "%zu %s%s rendered to %s\n", v->n, c->path ? "frame" : "view",
            v->n == 1 ? "" : "s", c->output);
    sg_mem_free(b.rgb);
    sg_mem_free(b.bytes);
    sg_mem_free(b.alpha);
    sg_mem_free(b.depth);
    return code;
}

static int run_render(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    (void) count;
    struct render_config copy = *(const struct render_config *) config, *c = &copy;
    struct model_views v;
    struct flight flight = {0};
    sg_output *output = NULL;
    int code = check_options(c, given);
    if (code)
        return code;
    model_views_warn(&c->m);
    interrupt_catch();
    code = model_views_find(&v, positional[0], &command_render, given, c, &c->m);
    const char *from = c->m.cameras ? c->m.cameras : c->m.scene_path;
    if (!code)
        code = report(v.ctx, sg_output_claim(v.ctx, c->output, "render", true,
                                             (const char *[]){positional[0], from, NULL}, &output));
    if (!code)
        code = model_views_load(&v, &command_render, given, c, &c->m);
    if (code && v.run.folder && !c->m.cameras && from && access(from, F_OK))
        say(stderr, "--cameras %s/cameras.json needs no scene\n", positional[0]);
    if (!code)
        code = refuse_photos(&v, c->output);
    if (!code && c->path)
        code = fly(c, &v, &flight);
    if (!code && c->path)
        code = refuse_longer(c);
    if (!code)
        code = refuse_twins(c, &v);
    if (!code)
        code = refuse_others(c, &v);
    if (!code)
        code = render_views(c, &v);
    free(flight.frames);
    free(flight.names);
    sg_output_release(&output);
    model_views_close(&v);
    return code;
}

const struct command command_render = {
    .name = "render",
    .arguments = "RUN|MODEL --scene SCENE -o DIR [options]",
    .summary = "Renders the views of a scene to images.",
    .description =
        "Renders a model from the cameras of SCENE, one image a view under the view's name, or the "
        "frames of a flight (--path), frame_0000 and on.",
    .groups = "Output|" MODEL_GROUPS,
    .options = render_options,
    .parts = render_parts,
    .config_size = sizeof(struct render_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_render,
};
