/* SPDX-License-Identifier: Apache-2.0 */
#include "model_views.h"

#include <stdlib.h>

int model_views_open(struct model_views *v, const char *model, const struct model_options *options)
{
    struct model_options o = *options;
    json_t *keep = NULL;
    static const char *const backends[] = {"cpu", "ref"};
    *v = (struct model_views){0};
    char *path = find_model(model);
    int code = path ? run_scene_options(model, &o.scene, &keep) : 2;
    if (!code && !o.scene_path) {
        fprintf(stderr, "splatguard: --scene SCENE is missing\n");
        code = 1;
    }
    if (!code)
        code = open_context(&v->ctx, o.threads, o.quiet);
    if (code)
        goto done;
    o.scene.params.format = (enum sg_scene_format) o.scene.format;
    o.scene.params.eval = true;
    for (int ch = 0; ch < 3; ch++)
        o.render.background[ch] = o.scene.params.white_background ? 1 : 0;
    int error = sg_model_read_ply(v->ctx, path, UINT32_MAX, &v->model);
    if (!error)
        error = sg_scene_load(v->ctx, o.scene_path, &o.scene.params, &v->scene);
    if (!error)
        error = sg_renderer_create(v->ctx, backends[o.backend], cpu_variant(o.cpu), v->model, &o.render, &v->renderer);
    if (error)
        code = report(v->ctx, error);
    else {
        v->views = o.split == 0 ? v->scene->test : v->scene->train;
        v->n = o.split == 0 ? v->scene->n_test : v->scene->n_train;
        if (!v->n) {
            fprintf(stderr, "splatguard: %s: found no %s views\n", o.scene_path, o.split == 0 ? "test" : "train");
            code = 2;
        }
    }
done:
    free(path);
    json_decref(keep);
    return code;
}

void model_views_close(struct model_views *v)
{
    sg_renderer_destroy(&v->renderer);
    if (v->ctx) {
        sg_model_destroy(v->ctx, &v->model);
        sg_scene_destroy(v->ctx, &v->scene);
    }
    sg_ctx_destroy(&v->ctx);
}
