/* SPDX-License-Identifier: Apache-2.0 */
#include "model_views.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define CAMERAS_BYTES (64 << 20) /* of a hundred thousand cameras */

struct model_options model_options_default(void)
{
    return (struct model_options){
        .engine = "auto", .scene = sg_scene_params_default(), .render = sg_render_params_default()};
}

void adopt_scene_options(const struct sg_run_params *run, const char *group,
                         const struct command *command, const bool *given, const void *config,
                         struct sg_scene_params *scene)
{
    const size_t at = (size_t) ((const char *) scene - (const char *) config);
    for (const struct sg_option *row = sg_scene_options(); row->name; row++)
        if (!row->transient && !strcmp(row->group, group) &&
            !options_given(command, given, at + row->offset))
            sg_option_copy(row, scene, &run->scene);
}

int adopt_run_scene(sg_ctx *ctx, const char *folder, const struct command *command,
                    const bool *given, const void *config, struct sg_scene_params *scene,
                    const char **scene_path, struct sg_run_params *run)
{
    const int error = sg_run_read_scene(ctx, folder, run);
    if (error)
        return report(ctx, error);
    adopt_scene_options(run, "Scene", command, given, config, scene);
    if (!*scene_path)
        *scene_path = run->source;
    return STATUS_DONE;
}

/* The photos that views show. Renders have their appearances, where the model has them and the
 * command line asks for no other. */
static int find_photos(struct model_views *v, const struct command *command, bool asked,
                       const struct sg_render_params *render)
{
    const size_t learned = sg_model_appearances(v->model);
    bool any = false;
    const int error = asked ? sg_render_check_appearance(v->ctx, v->model, render) : SG_OK;
    if (error)
        return report_option(v->ctx, command, error);
    v->eval.photos = v->photos = malloc(v->n * sizeof(*v->photos));
    if (!v->photos)
        return no_memory();
    for (size_t i = 0; i < v->n; i++) {
        v->photos[i] = v->scene ? sg_scene_photo(v->scene, &v->views[i]) : SIZE_MAX;
        any |= v->photos[i] != SIZE_MAX;
    }
    v->eval.appearances = v->scene && learned == v->scene->n_train && !asked;
    if (any && learned && !v->eval.appearances && !asked)
        say(stderr,
            "warning: the model has the appearances of %zu photos, the scene has %zu training "
            "views: renders have the mean of all\n",
            learned, v->scene->n_train);
    return 0;
}

/* Other trainers hold halves out of scenes in the layout of NeRF-Synthetic too. */
static int load_scene(struct model_views *v, const struct model_options *o)
{
    struct sg_scene_params p = o->scene;
    int error = sg_scene_load(v->ctx, o->scene_path, &p, &v->scene);
    if (error != SG_ERR_INPUT || !p.test_halves || !v->run.folder || v->run.source)
        return error;
    p.test_halves = false;
    error = sg_scene_load(v->ctx, o->scene_path, &p, &v->scene);
    if (!error)
        say(stderr, "warning: the run has trained on the left halves of the test photos, and "
                    "they are measured too\n");
    return error;
}

void render_as_trained(struct sg_render_params *render, const struct sg_train_params *train)
{
    if (train->model == SG_MODEL_MIP && render->mip_kernel == 0)
        render->mip_kernel = train->mip.kernel;
}

void depth_to_grey(const float *depth, const float *alpha, size_t n, int channels, uint8_t *out)
{
    float near = INFINITY, far = 0;
    for (size_t i = 0; i < n; i++)
        if (alpha[i] > 0.5f) {
            near = fminf(near, depth[i] / alpha[i]);
            far = fmaxf(far, depth[i] / alpha[i]);
        }
    for (size_t i = 0; i < n; i++) {
        float grey = 0;
        if (alpha[i] > 0.5f)
            grey = 1 - (far > near ? 0.88f * (depth[i] / alpha[i] - near) / (far - near) : 0);
        memset(out + i * (size_t) channels, (int) (255 * grey + 0.5f), (size_t) channels);
    }
}

void model_views_warn(const struct model_options *o)
{
    const char *no_device = vram_unused(o->engine, o->cpu);
    if (o->max_vram && no_device)
        warn_unused("max-vram", no_device);
}

int model_views_find(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *o)
{
    *v = (struct model_views){.run = sg_run_params_default()};
    int code = open_engine_context(&v->ctx, o->threads, o->max_memory, o->max_vram, o->quiet);
    if (!code)
        code = report(v->ctx,
                      sg_run_find_model(v->ctx, model, o->iteration, v->path, sizeof(v->path)));
    if (!code && is_folder(model))
        code = adopt_run_scene(v->ctx, model, command, given, config, &o->scene, &o->scene_path,
                               &v->run);
    if (!code)
        code = check_iteration(command, model, o->iteration);
    if (!code && !o->scene_path && !o->cameras)
        code = missing(command, command == &command_render ? "--scene SCENE or --cameras FILE"
                                                           : "--scene SCENE");
    return code;
}

/* The array of a run's cameras.json, or NULL where it is no usual file. */
static json_t *read_cameras(const char *folder)
{
    char path[PATH_MAX];
    struct stat st;
    if (snprintf(path, sizeof(path), "%s/cameras.json", folder) >= (int) sizeof(path) ||
        stat(path, &st) || !S_ISREG(st.st_mode) || st.st_size > CAMERAS_BYTES)
        return NULL;
    return json_load_file(path, 0, NULL);
}

/* Whether entries first to end of a cameras.json have the name. */
static bool has_name(const json_t *cameras, size_t first, size_t end, const char *name)
{
    for (size_t i = first; i < end; i++) {
        const char *other =
            json_string_value(json_object_get(json_array_get(cameras, i), "img_name"));
        if (other && !strcmp(other, name))
            return true;
    }
    return false;
}

/* Which photos are test views follows from all that are there. A run knows which it has learned
 * from: its cameras.json has its test views first. */
static void warn_of_learned(const struct model_views *v)
{
    sg_run_summary *summary = NULL;
    json_t *cameras = read_cameras(v->run.folder);
    const size_t n = json_array_size(cameras);
    size_t learned = 0, first = 0;
    /* Test photos may go before a run is resumed, training photos may not. */
    const double known = sg_run_summary_read(v->ctx, v->run.folder, &summary)
                             ? NAN
                             : sg_run_summary_number(summary, "train_views");
    const size_t tests = known >= 0 && known <= (double) n ? n - (size_t) known : n;
    for (size_t i = 0; i < v->n; i++)
        if (has_name(cameras, tests, n, v->views[i].name) &&
            !has_name(cameras, 0, tests, v->views[i].name) && !learned++)
            first = i;
    sg_run_summary_destroy(&summary);
    json_decref(cameras);
    if (learned)
        say(stderr,
            "warning: the run has learned from %zu of the %zu test views, the first is %s: the "
            "photos or the choice of test views are not those of its training\n",
            learned, v->n, v->views[first].name);
}

int model_views_load(struct model_views *v, const struct command *command, const bool *given,
                     const void *config, struct model_options *o)
{
    const bool is_run = v->run.folder;
    int code = STATUS_DONE;
    /* Training views are those of the run. */
    o->scene.eval = o->split == 0 || !is_run || v->run.scene.eval || o->scene.test_halves;
    o->scene.untrained = true;
    for (int ch = 0; ch < 3; ch++)
        o->render.background[ch] = o->scene.white_background ? 1 : 0;
    render_as_trained(&o->render, &v->run.train);
    int error = sg_model_read_drawable(v->ctx, v->path, UINT32_MAX, &v->model);
    if (!error)
        error = sg_model_check(v->ctx, v->model, v->path);
    if (!error && o->cameras)
        error = sg_cameras_read_json(v->ctx, o->cameras, &o->scene, &v->cameras, &v->n_cameras);
    else if (!error)
        error = load_scene(v, o);
    if (!error && o->engine)
        error = sg_renderer_create(v->ctx, o->engine, cpu_variant(o->cpu), v->model, &o->render,
                                   &v->renderer);
    if (error) {
        code = report_option(v->ctx, command, error);
        if (!o->cameras && o->scene_path == v->run.source)
            say_moved(o->scene_path);
        return code;
    }
    if (o->cameras)
        v->views = v->cameras, v->n = v->n_cameras;
    else {
        /* Scenes of Blender keep their test views apart. */
        if (o->split == 0 && v->scene->format != SG_FORMAT_BLENDER && is_run && !v->run.scene.eval)
            say(stderr,
                "warning: the run was trained without --eval: it has seen the test views\n");
        v->views = o->split == 0 ? v->scene->test : v->scene->train;
        v->n = o->split == 0 ? v->scene->n_test : v->scene->n_train;
        if (o->split == 0 && v->scene->format != SG_FORMAT_BLENDER && is_run && v->run.scene.eval &&
            !o->scene.test_halves)
            warn_of_learned(v);
        if (!v->n) {
            say(stderr, "splatguard: %s: found no %s views\n", o->scene_path,
                o->split == 0 ? "test" : "train");
            code = STATUS_INPUT;
        }
    }
    const size_t appearance =
        (size_t) ((const char *) &o->render.appearance - (const char *) config);
    if (!code)
        code = find_photos(v, command, options_given(command, given, appearance), &o->render);
    return code;
}

int model_views_open(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *o)
{
    const int code = model_views_find(v, model, command, given, config, o);
    return code ? code : model_views_load(v, command, given, config, o);
}

void model_views_choose(struct model_views *v, size_t i)
{
    sg_renderer_set_index(v->renderer, i);
    if (v->eval.appearances)
        sg_renderer_set_photo(v->renderer, v->photos[i]);
}

void model_views_close(struct model_views *v)
{
    free(v->photos);
    free(v->exposures);
    sg_renderer_destroy(&v->renderer);
    if (v->ctx) {
        sg_model_destroy(&v->model);
        sg_scene_destroy(&v->scene);
        sg_cameras_destroy(&v->cameras, &v->n_cameras);
    }
    sg_ctx_destroy(&v->ctx);
    sg_run_params_clear(&v->run);
}
