/* SPDX-License-Identifier: Apache-2.0 */
/* A training from its parameters to its model; iteration.c has what happens in between. */
#include "trainer.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "begin.h"
#include "checkpoint.h"
#include "core/clock.h"
#include "defense/filter.h"
#include "engine/scaffold/scaffold.h"
#include "exposure.h"
#include "model/anchors.h"
#include "model/mip.h"
#include "renderer.h"
#include "scene/cameras.h"
#include "scene/photo.h"
#include "scene/used.h"
#include "schedule.h"

static int check_scene(sg_ctx *ctx, const struct sg_train_params *p, const struct sg_scene *scene)
{
    int code = sg_train_check(ctx, p);
    if (!code)
        code = sg_check_cameras(ctx, scene);
    if (code)
        return code;
    if (!scene->n_train)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no training view, expected at least one",
                       scene->path);
    for (size_t i = 0; p->tolerances && i < scene->n_train; i++)
        if (!(p->tolerances[i] >= 0 && p->tolerances[i] <= 255))
            return sg_fail(ctx, SG_ERR_USAGE, "tolerances[%zu]: found %g, expected 0 to 255", i,
                           (double) p->tolerances[i]);
    for (size_t i = 0; p->defense.view_weights && i < scene->n_train; i++)
        if (!(p->defense.view_weights[i] >= 0 && p->defense.view_weights[i] <= 1e3f))
            return sg_fail(ctx, SG_ERR_USAGE,
                           "defense.view_weights[%zu]: found %g, expected 0 to 1000", i,
                           (double) p->defense.view_weights[i]);
    return SG_OK;
}

static double system_clock(void *unused)
{
    (void) unused;
    return sg_seconds();
}

static uint64_t bytes_held(const struct sg_model *m)
{
    return m ? (uint64_t) m->capacity * sizeof(float) *
                   (uint64_t) (sg_param_count(m->sh_degree) +
                               (sg_model_has_anchors(m) ? SG_A_PLANES : 0))
             : 0;
}

static int alloc_state(sg_trainer *t)
{
    const size_t bytes = t->strategy->state_bytes, n = t->scene->n_train;
    const float *given = t->params.tolerances;
    t->strategy_state = bytes ? sg_alloc(t->ctx, SG_MEM_MISC, 1, bytes) : NULL;
    t->tolerances = given ? sg_alloc(t->ctx, SG_MEM_MISC, n, sizeof(*given)) : NULL;
    if (t->tolerances)
        memcpy(t->tolerances, given, n * sizeof(*given));
    return (bytes && !t->strategy_state) || (given && !t->tolerances) ? SG_ERR_BUDGET : SG_OK;
}

static const struct sg_strategy *const strategies[] = {[SG_STRATEGY_DEFAULT] = &sg_strategy_default,
                                                       [SG_STRATEGY_MCMC] = &sg_strategy_mcmc,
                                                       [SG_STRATEGY_LIGHTGAUSSIAN] =
                                                           &sg_strategy_lightgaussian};

static const struct sg_strategy *strategy_of(const struct sg_train_params *p)
{
    return p->model == SG_MODEL_SCAFFOLD ? &sg_strategy_scaffold : strategies[p->strategy];
}

/* See tolerance_low_pass. */
static int settles_from(const sg_trainer *t)
{
    const struct sg_train_params *p = &t->params;
    bool tolerates = !t->tolerances && p->tolerance > 0;
    for (size_t i = 0; t->tolerances && i < t->scene->n_train; i++)
        tolerates |= t->tolerances[i] > 0;
    return tolerates && p->tolerance_low_pass > 0 && !t->strategy->whole && !t->smooths
               ? p->iterations - p->iterations / 10
               : INT_MAX;
}

static const struct sg_shape mip_shape = {
    .name = "mip", .column = SG_C_FILTER, .forward = sg_mip_forward, .backward = sg_mip_backward};

/* What the engine draws and counts. */
static int set_model(sg_trainer *t)
{
    const bool mip = t->params.model == SG_MODEL_MIP;
    const int code = mip ? sg_engine_set_shape(t->engine, &mip_shape)
                     : t->params.model == SG_MODEL_SCAFFOLD ? sg_scaffold_wrap(t->ctx, &t->engine)
                                                            : SG_OK;
    if (!code)
        sg_engine_set_volume(t->engine, t->params.scaffold.volume);
    return code ? code
                : sg_engine_set_statistic(t->engine, mip                 ? SG_GRADIENT_MIP
                                                     : t->params.absgrad ? SG_GRADIENT_ABSOLUTE
                                                                         : SG_GRADIENT_NORM);
}

struct sg_render_params sg_trainer_render(const sg_trainer *t)
{
    return (struct sg_render_params){.max_instances = t->budget.instances,
                                     .reference_tiles = t->params.reference_tiles,
                                     .mip_kernel =
                                         t->params.model == SG_MODEL_MIP ? t->params.mip.kernel : 0,
                                     .appearance = SG_APPEARANCE_MEAN};
}

/* The share is 1 before a look, and where tolerances hide nothing. */
float sg_trainer_growth_threshold(const sg_trainer *t)
{
    const struct sg_train_params *p = &t->params;
    const double share =
        p->tolerance_growth > 0 && t->beyond < 1 ? (double) p->tolerance_growth * t->beyond : 1;
    return (float) ((double) p->densify_grad_threshold * fmin(fmax(share, 0.6), 1));
}

size_t sg_trainer_appearances(const sg_trainer *t)
{
    return t->params.scaffold.appearance ? t->scene->n_train : 0;
}

int sg_trainer_renew_filter(sg_trainer *t)
{
    if (t->params.model != SG_MODEL_MIP)
        return SG_OK;
    const struct sg_camera **cameras = sg_training_cameras(t->ctx, t->scene);
    const struct sg_mip_filter filter = {t->params.mip.variance, t->params.mip.margin};
    const int code =
        cameras ? sg_engine_filter(t->engine, cameras, t->scene->n_train, &filter) : SG_ERR_BUDGET;
    sg_free(cameras);
    return code;
}

/* Plans the memory and makes the engine. */
static int open_engine(sg_trainer *t, const struct sg_trainer_start *start)
{
    const struct sg_train_params *p = &t->params;
    int code = sg_budget_plan(t->ctx, t->scene, p, t->sh_degree, bytes_held(start->initial),
                              start->sums, &t->budget);
    if (!code) {
        sg_lazy_photos_keep(t->scene->lazy, t->budget.photos);
        code = sg_engine_create(t->ctx, p->engine, p->cpu, &t->engine);
    }
    if (!code)
        code = sg_budget_plan_device(t->ctx, t->scene, p, t->sh_degree, start->sums,
                                     start->spectral, &t->budget);
    if (code)
        sg_engine_destroy(&t->engine);
    return sg_engine_give_way(t->ctx, p->engine, p->cpu, code) ? open_engine(t, start) : code;
}

/* The degree of SH that is learnt and the one that is stored. saved: what start->checkpoint has. */
static void set_degrees(sg_trainer *t, const struct sg_trainer_start *start,
                        const struct sg_checkpoint *saved)
{
    struct sg_train_params *p = &t->params;
    const int most = start->checkpoint      ? saved->header.sh_degree
                     : start->initial       ? start->initial->sh_degree
                     : t->strategy->initial ? 0 /* of what is made */
                                            : p->sh_degree;
    p->sh_degree = p->sh_degree < most ? p->sh_degree : most;
    /* A new run stores no coefficients that it does not learn: others would draw them. */
    t->sh_degree = start->checkpoint ? most : p->sh_degree;
}

/* Makes the first model, or restores that of the checkpoint. */
static int begin(sg_trainer *t, const struct sg_trainer_start *start, struct sg_checkpoint *saved)
{
    int code =
        start->checkpoint ? sg_checkpoint_read(t, saved) : sg_trainer_init_model(t, start->initial);
    if (!code && t->exposures)
        code = sg_engine_set_exposures(t->engine, t->exposures, t->scene->n_train);
    if (code || start->checkpoint)
        return code;
    if (t->strategy->begin)
        code = t->strategy->begin(t);
    return code ? code : sg_trainer_renew_filter(t);
}

/* Hands the engine the photos that stay in memory. The others are read when they are used. */
static int hold_photos(sg_trainer *t)
{
    const struct sg_scene *scene = t->scene;
    int code = SG_OK;
    t->order = sg_alloc(t->ctx, SG_MEM_MISC, scene->n_train, sizeof(*t->order));
    t->photos = sg_alloc(t->ctx, SG_MEM_MISC, scene->n_train, sizeof(*t->photos));
    t->smoothed = sg_alloc(t->ctx, SG_MEM_MISC, scene->n_train, sizeof(*t->smoothed));
    if (!t->order || !t->photos || !t->smoothed)
        return SG_ERR_BUDGET;
    if (t->budget.read_ahead) {
        sg_lazy_photos_start_reader(scene->lazy);
        t->reads_ahead = true;
    }
    for (size_t i = 0; i < scene->n_train && !code; i++)
        if (t->budget.photos_stay || !scene->train[i].lazy)
            code = sg_trainer_hold_photo(t, i, true);
    return code;
}

int sg_trainer_open(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_trainer_start *start,
                    const struct sg_train_params *params, sg_trainer **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    struct sg_checkpoint saved = {0};
    sg_trainer *t = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*t));
    if (!t)
        return SG_ERR_BUDGET;
    t->ctx = ctx;
    t->scene = scene;
    t->params = params ? *params : sg_train_params_default();
    /* One camera has no extent; 1 keeps the learning rates finite and moving. */
    t->extent = scene->extent > 0 ? scene->extent : 1;
    t->epoch = UINT64_MAX;
    int code = check_scene(ctx, &t->params, scene);
    if (code)
        goto done;
    t->strategy = start->strategy ? start->strategy : strategy_of(&t->params);
    t->photos_hash = sg_photos_hash(scene);
    t->beyond = 1;
    t->params.clock = t->params.clock ? t->params.clock : system_clock;
    t->identity =
        start->identity ? *start->identity : sg_train_identity(&t->params, scene->n_train);
    t->started = t->params.clock(t->params.clock_arg);
    t->spent = t->params.seconds_before;
    if (start->checkpoint && (code = sg_checkpoint_open(t, start->checkpoint, &saved)))
        goto done;
    set_degrees(t, start, &saved);
    if ((code = open_engine(t, start)) || (code = alloc_state(t)) ||
        (t->params.exposure && (code = sg_exposures_create(ctx, scene->n_train, &t->exposures))) ||
        (code = set_model(t)) || (code = begin(t, start, &saved)) || (code = hold_photos(t)))
        goto done;
    t->settles_from = settles_from(t);
done:
    sg_checkpoint_close(&saved);
    if (code)
        sg_trainer_destroy(&t);
    *out = t;
    return code;
}

/* Fails if no training view has a used pixel. */
static int open_to_train(sg_ctx *ctx, const struct sg_scene *scene,
                         const struct sg_trainer_start *start, const struct sg_train_params *params,
                         sg_trainer **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    const int code = sg_check_used(ctx, scene);
    return code ? code : sg_trainer_open(ctx, scene, start, params, out);
}

int sg_trainer_create(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *initial,
                      const struct sg_train_params *params, sg_trainer **out)
{
    return open_to_train(ctx, scene, &(struct sg_trainer_start){.initial = initial}, params, out);
}

int sg_trainer_resume(sg_ctx *ctx, const struct sg_scene *scene, const char *path,
                      const struct sg_train_params *params, sg_trainer **out)
{
    return open_to_train(ctx, scene, &(struct sg_trainer_start){.checkpoint = path}, params, out);
}

void sg_trainer_destroy(sg_trainer **trainer)
{
    if (!trainer || !*trainer)
        return;
    sg_trainer *t = *trainer;
    if (t->reads_ahead)
        sg_lazy_photos_stop_reader(t->scene->lazy);
    sg_engine_destroy(&t->engine);
    for (size_t i = 0; t->photos && t->smoothed && i < t->scene->n_train; i++)
        if (t->photos[i])
            sg_trainer_let_go(t, i);
    sg_free(t->strategy_state);
    sg_free(t->tolerances);
    sg_free(t->exposures);
    sg_free(t->photos);
    sg_free(t->smoothed);
    sg_free(t->order);
    sg_free(t);
    *trainer = NULL;
}

double sg_trainer_elapsed(const sg_trainer *t)
{
    return t->spent + t->params.clock(t->params.clock_arg) - t->started;
}

double sg_trainer_seconds_not_counting(const sg_trainer *t)
{
    return sg_seconds() - sg_engine_times(t->engine).count;
}

int sg_trainer_exposures(sg_trainer *t, const float **out)
{
    sg_clear_error(t->ctx);
    const int code = sg_engine_read_exposures(t->engine);
    *out = code ? NULL : t->exposures;
    return code;
}

int sg_trainer_iteration(const sg_trainer *t)
{
    return t->iteration;
}

void sg_trainer_limits(const sg_trainer *t, struct sg_train_limits *out)
{
    *out = (struct sg_train_limits){.max_gaussians = t->budget.gaussians,
                                    .by_memory = t->budget.by_memory,
                                    .gaussians_bound = t->gaussians_bound,
                                    .time_bound = t->time_bound,
                                    .steps = t->steps};
}

size_t sg_trainer_gaussians(const sg_trainer *t)
{
    return sg_engine_count(t->engine) * sg_engine_each(t->engine);
}

void sg_trainer_times(const sg_trainer *t, struct sg_train_times *out)
{
    const struct sg_engine_times e = sg_engine_times(t->engine);
    *out = (struct sg_train_times){.project = e.project,
                                   .bin = e.bin,
                                   .raster = e.raster,
                                   .loss = e.loss[SG_LOSS_PHOTOMETRIC],
                                   .raster_backward = e.raster_backward,
                                   .update = e.project_backward + e.optimise + e.shape,
                                   .densify = t->densify_seconds,
                                   .anisotropy = e.loss[SG_LOSS_ANISOTROPY],
                                   .total_variation = e.loss[SG_LOSS_TOTAL_VARIATION],
                                   .count = e.count,
                                   .prune = t->prune_seconds};
}

const char *sg_trainer_variant(const sg_trainer *t)
{
    return sg_engine_variant(t->engine);
}

int sg_trainer_renderer(sg_trainer *t, sg_renderer **out)
{
    sg_clear_error(t->ctx);
    struct sg_render_params render = sg_trainer_render(t);
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = t->params.white_background ? 1 : 0;
    return sg_renderer_borrow(
        t->engine, sg_active_degree(&t->params, t->start_degree, t->iteration), &render, out);
}

int sg_trainer_scores(sg_trainer *t, double *score, double *hits, uint8_t *stays,
                      struct sg_filter_pass *next)
{
    const struct sg_defense_params *d = &t->params.defense;
    const struct sg_render_params render = sg_trainer_render(t);
    struct sg_scores s;
    sg_clear_error(t->ctx);
    if (sg_engine_each(t->engine) > 1)
        return sg_fail(t->ctx, SG_ERR_USAGE,
                       "scores: found a model of anchors, expected one of Gaussians");
    *next = (struct sg_filter_pass){.iteration = t->iteration};
    if (t->strategy->filter_next)
        next->share = t->strategy->filter_next(t, &next->iteration);
    sg_engine_stop_clocks(t->engine, true);
    int code = sg_score(t->engine, t->scene, d, &render, t->params.seed, next->iteration, &s);
    if (!code)
        code = sg_filter_choose(t->engine, d, &s, next->share, next->iteration, stays);
    sg_engine_stop_clocks(t->engine, false);
    for (size_t i = 0; i < s.count && !code; i++) {
        score[i] = s.score[i];
        hits[i] = s.score[i] > -INFINITY
                      ? exp(s.score[i] - sg_filter_log_weight(d, s.log_smallest[i]))
                      : 0;
    }
    sg_scores_clear(&s);
    return code;
}

/* Room for what the model has beside its parameters. */
static int add_columns(const sg_trainer *t, struct sg_model *m)
{
    if (t->params.model == SG_MODEL_SCAFFOLD)
        return sg_anchors_add(t->ctx, m, sg_trainer_appearances(t));
    float any;
    struct sg_columns filter = {0};
    filter.at[SG_C_FILTER] = &any;
    return t->params.model == SG_MODEL_MIP
               ? sg_model_add_columns(t->ctx, m, &(struct sg_model){.columns = &filter})
               : SG_OK;
}

int sg_trainer_model(sg_trainer *t, struct sg_model **out)
{
    sg_clear_error(t->ctx);
    int code = sg_model_create(t->ctx, sg_engine_count(t->engine), t->sh_degree, out);
    if (code)
        return code;
    if ((code = sg_model_add_columns(t->ctx, *out, NULL)) || (code = add_columns(t, *out)) ||
        (code = sg_engine_download(t->engine, *out, (*out)->columns)) ||
        (!t->params.keep_filter && (code = sg_mip_fold(t->ctx, *out, "model"))))
        sg_model_destroy(out);
    else
        (*out)->active_sh_degree = sg_active_degree(&t->params, t->start_degree, t->iteration);
    if (!code && sg_model_has_anchors(*out))
        sg_networks_forget((*out)->columns->networks);
    return code;
}
