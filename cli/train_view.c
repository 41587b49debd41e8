/* SPDX-License-Identifier: Apache-2.0 */
#include "train_view.h"

#include <math.h>
#include <stdlib.h>

#include "commands.h"
#include "interrupt.h"
#include "model_views.h"
#include "view_pictures.h"
#include "view_scores.h"

#define SAID_EVERY 0.25           /* seconds between states */
#define SCORES_MEMORY (256 << 20) /* most of the copy that is drawn in the colours of scores */
#define INSTANCES (1 << 20)       /* and of what it has in tiles at once */
#define SHARE 3                   /* for each second of pictures this many of training, at least */

struct train_view {
    view_server *server;
    struct view_pictures pictures;
    struct view_scores scores;
    sg_ctx *scores_ctx; /* of their memory */
    int scored;         /* the iteration that they are of */
    sg_run *run;
    const struct sg_run_params *params;
    double said;      /* when the page was told the state */
    double free_from; /* when the next picture may be drawn */
};

int train_view_open(int port, struct train_view **out)
{
    struct train_view *v = *out = calloc(1, sizeof(*v));
    if (!v)
        return no_memory();
    /* A ledger of its own: the page takes nothing that the run was promised. */
    int code = exit_code(sg_ctx_create(
        &v->pictures.own, &(struct sg_ctx_params){.threads = 1, .max_memory = VIEW_MEMORY}));
    if (!code)
        code = exit_code(sg_ctx_create(
            &v->scores_ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = SCORES_MEMORY}));
    if (!code)
        code = view_server_open(v->pictures.own, port, &v->server);
    if (!code) {
        printf("%s\n", view_server_address(v->server));
        code = flush_output(STATUS_DONE);
    }
    if (code)
        train_view_close(out);
    return code;
}

/* Tells the page. step: NULL before the first. */
static void say_state(struct train_view *v, const struct progress *p,
                      const struct sg_train_step *step, bool paused)
{
    struct sg_run_status s;
    sg_run_status(v->run, &s);
    const double now = clock_seconds(), done = step ? s.iteration - p->first : 0,
                 left = done > 0 ? (s.iterations - s.iteration) * (now - p->start) / done : NAN;
    json_t *state = json_pack(
        "{s:i,s:i,s:I,s:I,s:o,s:o,s:I,s:I,s:o,s:b,s:I,s:b}", "iteration", s.iteration, "iterations",
        s.iterations, "gaussians", (json_int_t) (step ? step->gaussians : 0), "max_gaussians",
        (json_int_t) s.limits.max_gaussians, "loss", number_json(step ? p->loss : NAN), "psnr",
        number_json(step ? p->psnr : NAN), "memory", (json_int_t) resident_bytes(0), "max_memory",
        (json_int_t) v->params->max_memory, "seconds_left", number_json(left), "defense",
        s.defended, "removed", (json_int_t) s.filter_removed, "paused", paused);
    char *text = state ? json_dumps(state, JSON_COMPACT) : NULL;
    if (text)
        view_server_set_state(v->server, text);
    free(text);
    json_decref(state);
    v->said = now;
}

int train_view_begin(struct train_view *v, sg_ctx *ctx, sg_run *run,
                     const struct sg_run_params *params)
{
    v->run = run, v->params = params;
    const struct sg_train_params *t = &params->train;
    struct sg_run_status s;
    sg_run_status(run, &s);
    v->pictures.ctx = ctx, v->pictures.scene = sg_run_scene(run), v->pictures.model = true;
    v->pictures.appearances = t->scaffold.appearance;
    v->pictures.scores = t->model != SG_MODEL_SCAFFOLD;
    v->pictures.next = v->pictures.scores && s.defended && t->strategy != SG_STRATEGY_MCMC;
    say_state(v, NULL, NULL, false);
    return view_publish_scene(&v->pictures, v->server, params->folder, true);
}

/* Scores of the model as it is now. The run's memory is used between two iterations only. */
static int score(struct train_view *v, int iteration)
{
    struct sg_filter_pass next = {0};
    struct sg_model *model = NULL;
    int error = sg_run_model(v->run, &model);
    if (!error)
        error = view_scores_copy(&v->scores, v->scores_ctx, model);
    if (!error)
        error = sg_run_scores(v->run, v->scores.score, v->scores.hits, v->scores.stays, &next);
    if (!error)
        v->scored = iteration;
    sg_model_destroy(&model);
    return error;
}

/* What draws the model in the colours of scores, or NULL. */
static sg_renderer *scores_renderer(struct train_view *v, enum view_kind kind)
{
    const struct sg_train_params *t = &v->params->train;
    struct sg_render_params render = sg_render_params_default();
    struct sg_run_status s;
    int error = SG_OK;
    sg_run_status(v->run, &s);
    render_as_trained(&render, t);
    render.max_instances = INSTANCES;
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = v->params->scene.white_background ? 1 : 0;
    if (!v->pictures.scores || (kind == VIEW_NEXT && !v->pictures.next))
        return NULL;
    if (!v->scores.model || v->scored != s.iteration)
        error = score(v, s.iteration);
    if (!error)
        /* A GPU has no room beside the run's. */
        error = view_scores_paint(&v->scores, kind, "cpu", cpu_variant(t->cpu), &render);
    if (error)
        view_scores_clear(&v->scores);
    return v->scores.renderer;
}

/* One picture, if one is wanted within so many seconds. */
static void draw(struct train_view *v, double wait)
{
    struct view_ask ask;
    sg_renderer *renderer = NULL;
    if (!view_server_next(v->server, wait, &ask))
        return;
    const double start = clock_seconds();
    if (ask.kind < VIEW_SCORE) /* nobody looks at scores any more */
        view_scores_clear(&v->scores);
    if (ask.kind < VIEW_SCORE && ask.kind != VIEW_PHOTO && sg_run_renderer(v->run, &renderer))
        renderer = NULL;
    view_draw(&v->pictures, v->server, &ask,
              ask.kind < VIEW_SCORE ? renderer : scores_renderer(v, ask.kind));
    sg_renderer_destroy(&renderer);
    const double end = clock_seconds();
    v->free_from = end + SHARE * (end - start);
}

bool train_view_step(struct train_view *v, struct progress *progress,
                     const struct sg_train_step *step)
{
    const double begin = clock_seconds();
    if (begin - v->said > SAID_EVERY)
        say_state(v, progress, step, false);
    if (begin > v->free_from)
        draw(v, 0);
    if (view_server_wish(v->server) == VIEW_PAUSE) {
        while (view_server_wish(v->server) == VIEW_PAUSE && !interrupted()) {
            say_state(v, progress, step, true);
            draw(v, 0.1);
        }
        progress->start += clock_seconds() - begin;
        say_state(v, progress, step, false);
    }
    return view_server_wish(v->server) == VIEW_STOP;
}

void train_view_close(struct train_view **view)
{
    struct train_view *v = view ? *view : NULL;
    if (!v)
        return;
    view_server_close(&v->server);
    view_pictures_clear(&v->pictures);
    view_scores_clear(&v->scores);
    sg_ctx_destroy(&v->scores_ctx);
    sg_ctx_destroy(&v->pictures.own);
    free(v);
    *view = NULL;
}
