/* SPDX-License-Identifier: Apache-2.0 */
#include "model_views.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/file.h"
#include "run/config.h"
#include "run_folder.h"

#define CFG_ARGS_BYTES 65536 /* others have a few hundred */

/* What another trainer's folder says in cfg_args. Its text is Python, of which only plain cases are
 * read. */
static void read_cfg_args(const char *run, const struct command *command, const bool *given,
                          void *config, struct sg_scene_params *scene)
{
    char *path = NULL, *text = NULL;
    size_t room = 0;
    FILE *f = asprintf(&path, "%s/cfg_args", run) < 0 ? NULL : run_open(path, CFG_ARGS_BYTES);
    if (f && getline(&text, &room, f) > 0) {
        const char *white = strstr(text, "white_background=True"),
                   *resolution = strstr(text, "resolution=");
        const ptrdiff_t white_at = (char *) &scene->white_background - (char *) config;
        const ptrdiff_t resolution_at = (char *) &scene->resolution - (char *) config;
        int n;
        if (white && !options_given(command, given, (size_t) white_at))
            scene->white_background = true;
        if (resolution && sscanf(resolution, "resolution=%d", &n) == 1 && n >= -1 && n &&
            n <= 16384 && !options_given(command, given, (size_t) resolution_at))
            scene->resolution = n;
    }
    if (f)
        fclose(f);
    free(text);
    free(path);
}

struct model_options model_options_default(void)
{
    return (struct model_options){
        .engine = "cpu", .scene = sg_scene_params_default(), .render = sg_render_params_default()};
}

static int adopt_run(struct model_views *v, const char *run, const struct command *command,
                     const bool *given, void *config, struct model_options *o)
{
    char *path = NULL;
    int code = 0;
    if (!sg_dir_exists(run))
        return 0;
    if (asprintf(&path, "%s/config.json", run) < 0)
        return no_memory();
    if (access(path, F_OK)) {
        read_cfg_args(run, command, given, config, &o->scene);
        goto done;
    }
    v->run = run_read_json(path, "config.json of a run");
    const json_t *options = json_object_get(v->run, "options");
    struct sg_run_params own = sg_run_params_default();
    code = v->run ? report(v->ctx,
                           sg_config_from_json(v->ctx, sg_run_config, &own, options, false, path))
                  : STATUS_INPUT;
    const size_t at = (size_t) ((char *) &o->scene - (char *) config);
    for (const struct sg_option *row = sg_scene_options(); row->name && !code; row++)
        if (!row->transient && !strcmp(row->group, "Scene") &&
            !options_given(command, given, at + row->offset))
            sg_option_copy(row, &o->scene, &own.scene);
    if (!o->scene_path)
        o->scene_path = json_string_value(json_object_get(options, "source-path"));
done:
    free(path);
    return code;
}

int model_views_open(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *o)
{
    *v = (struct model_views){0};
    char *path = find_model(model, o->iteration);
    int code = path ? open_context(&v->ctx, o->threads, o->max_memory, o->quiet) : 2;
    if (!code)
        code = adopt_run(v, model, command, given, config, o);
    if (!code && o->iteration && !sg_dir_exists(model)) {
        say(stderr,
            "splatguard %s: --iteration: found with the model %s, expected a run's folder\n",
            command->name, model);
        code = STATUS_USAGE;
    }
    if (!code && !o->scene_path) {
        say(stderr, "splatguard %s: missing --scene SCENE\n", command->name);
        code = 1;
    }
    if (code)
        goto done;
    o->scene.eval = o->scene.untrained = true;
    for (int ch = 0; ch < 3; ch++)
        o->render.background[ch] = o->scene.white_background ? 1 : 0;
    int error = sg_model_read_ply(v->ctx, path, UINT32_MAX, &v->model);
    if (!error)
        error = sg_model_check(v->ctx, v->model, path);
    if (!error)
        error = sg_scene_load(v->ctx, o->scene_path, &o->scene, &v->scene);
    if (!error)
        error = sg_renderer_create(v->ctx, o->engine, cpu_variant(o->cpu), v->model, &o->render,
                                   &v->renderer);
    if (error)
        code = report(v->ctx, error);
    else {
        /* Scenes of Blender keep their test views apart. */
        if (o->split == 0 && v->scene->format != SG_FORMAT_BLENDER &&
            json_is_false(json_object_get(json_object_get(v->run, "options"), "eval")))
            say(stderr,
                "warning: the run was trained without --eval: it has seen the test views\n");
        v->views = o->split == 0 ? v->scene->test : v->scene->train;
        v->n = o->split == 0 ? v->scene->n_test : v->scene->n_train;
        if (!v->n) {
            say(stderr, "splatguard: %s: found no %s views\n", o->scene_path,
                o->split == 0 ? "test" : "train");
            code = 2;
        }
    }
done:
    free(path);
    return code;
}

void model_views_close(struct model_views *v)
{
    sg_renderer_destroy(&v->renderer);
    if (v->ctx) {
        sg_model_destroy(&v->model);
        sg_scene_destroy(&v->scene);
    }
    sg_ctx_destroy(&v->ctx);
    json_decref(v->run);
}
