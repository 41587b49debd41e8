/* SPDX-License-Identifier: Apache-2.0 */
#include "model_views.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/file.h"
#include "run_folder.h"

#define CFG_ARGS_BYTES 65536 /* others have a few hundred */

/* What another trainer's folder says in cfg_args. Its text is Python, of which only plain cases are
 * read. */
static void read_cfg_args(const char *run, const struct command *command, const bool *given,
                          void *config, struct scene_options *scene)
{
    char *path = NULL, *text = NULL;
    size_t room = 0;
    FILE *f = asprintf(&path, "%s/cfg_args", run) < 0 ? NULL : run_open(path, CFG_ARGS_BYTES);
    if (f && getline(&text, &room, f) > 0) {
        const char *white = strstr(text, "white_background=True"),
                   *resolution = strstr(text, "resolution=");
        const ptrdiff_t white_at = (char *) &scene->params.white_background - (char *) config;
        const ptrdiff_t resolution_at = (char *) &scene->params.resolution - (char *) config;
        int n;
        if (white && !options_given(command, given, (size_t) white_at))
            scene->params.white_background = true;
        if (resolution && sscanf(resolution, "resolution=%d", &n) == 1 && n >= -1 && n &&
            n <= 16384 && !options_given(command, given, (size_t) resolution_at))
            scene->params.resolution = n;
    }
    if (f)
        fclose(f);
    free(text);
    free(path);
}

static int adopt_run(struct model_views *v, const char *run, const struct command *command,
                     const bool *given, void *config, struct model_options *o)
{
    char *path = NULL;
    int code = 0;
    const bool follow_links = o->scene.params.follow_links;
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
    if (v->run && !options)
        say(stderr, "splatguard: %s: found no \"options\", expected an object\n", path);
    if (!options) {
        code = 2;
    } else if (options_adopt(command, "Scene", given, config, options, path))
        code = 2;
    o->scene.params.follow_links = follow_links; /* not for a stranger's run to allow */
    if (!o->scene_path)
        o->scene_path = json_string_value(json_object_get(options, "source-path"));
done:
    free(path);
    return code;
}

int model_views_open(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *o)
{
    static const char *const engines[] = {"cpu", "ref"};
    *v = (struct model_views){0};
    char *path = find_model(model, o->iteration);
    int code = path ? adopt_run(v, model, command, given, config, o) : 2;
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
    if (!code)
        code = open_context(&v->ctx, o->threads, o->max_memory, o->quiet);
    if (code)
        goto done;
    o->scene.params.format = (enum sg_scene_format) o->scene.format;
    o->scene.params.eval = o->scene.params.untrained = true;
    for (int ch = 0; ch < 3; ch++)
        o->render.background[ch] = o->scene.params.white_background ? 1 : 0;
    int error = sg_model_read_ply(v->ctx, path, UINT32_MAX, &v->model);
    if (!error)
        error = sg_model_check(v->ctx, v->model, path);
    if (!error)
        error = sg_scene_load(v->ctx, o->scene_path, &o->scene.params, &v->scene);
    if (!error)
        error = sg_renderer_create(v->ctx, engines[o->engine], cpu_variant(o->cpu), v->model,
                                   &o->render, &v->renderer);
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
