/* SPDX-License-Identifier: Apache-2.0 */
/* The training loop of Kerbl et al. 2023 in the order of the released code. */
#include "trainer.h"

#include <math.h>
#include <string.h>

#include "checkpoint.h"
#include "core/clock.h"
#include "defense/filter.h"
#include "densify.h"
#include "math/constants.h"
#include "renderer.h"
#include "schedule.h"

struct range {
    const char *name;
    double value, low, high;
};

static int check_ranges(sg_ctx *ctx, const struct range *r, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!(r[i].value >= r[i].low && r[i].value <= r[i].high))
            return sg_fail(ctx, SG_ERR_USAGE, "%s: found %g, expected %g to %g", r[i].name, r[i].value, r[i].low,
                           r[i].high);
    return SG_OK;
}

static int check_defense(sg_ctx *ctx, const struct sg_defense_params *d)
{
    const struct sg_spectrum_params *band = &d->spectrum.band;
    const struct range ranges[] = {
        {"rho", d->rho, -0.9, 0.5},
        {"filter-frequency", d->frequency, 1e-9, 1e9},
        {"filter-exponent", d->exponent, 0, 100},
        {"filter-views", d->views, 1, 1e7},
        {"filter-interval", d->interval, 1, 1e7},
        {"filter-from", d->from, -1, 1e9},
        {"filter-until", d->until, -1, 1e9},
        {"lambda", d->lambda, 0, 1e6},
        {"anisotropy-scale", d->anisotropy_scale, 0, 1e6},
        {"tv-scale", d->tv_scale, 0, 1e6},
        {"band-low", band->low, 0, 1},
        {"band-high", band->high, band->low, 1},
        {"bins", band->bins, 2, SG_SPECTRUM_BINS_MAX},
    };
    const int code = check_ranges(ctx, ranges, sizeof(ranges) / sizeof(ranges[0]));
    if (!code && band->bins % 2)
        return sg_fail(ctx, SG_ERR_USAGE, "bins: found %d, expected an even number from 2 to %d", band->bins,
                       SG_SPECTRUM_BINS_MAX);
    return code;
}

int sg_train_check(sg_ctx *ctx, const struct sg_train_params *p)
{
    sg_clear_error(ctx);
    const struct range ranges[] = {
        {"iterations", p->iterations, 1, 1e7},
        {"sh-degree", p->sh_degree, 0, 3},
        {"sh-interval", p->sh_interval, 1, 1e7},
        {"lambda-dssim", (double) p->lambda_dssim, 0, 1},
        {"position-lr-init", (double) p->position_lr_init, 1e-12, 1e3},
        {"position-lr-final", (double) p->position_lr_final, 1e-12, 1e3},
        {"position-lr-max-steps", p->position_lr_max_steps, 1, 1e9},
        {"feature-lr", (double) p->feature_lr, 0, 1e3},
        {"opacity-lr", (double) p->opacity_lr, 0, 1e3},
        {"scaling-lr", (double) p->scaling_lr, 0, 1e3},
        {"rotation-lr", (double) p->rotation_lr, 0, 1e3},
        {"percent-dense", (double) p->percent_dense, 0, 1e3},
        {"densification-interval", p->densification_interval, 1, 1e7},
        {"densify-from-iter", p->densify_from_iter, 0, 1e9},
        {"densify-until-iter", p->densify_until_iter, 0, 1e9},
        {"densify-grad-threshold", (double) p->densify_grad_threshold, 0, 1e9},
        {"opacity-reset-interval", p->opacity_reset_interval, 1, 1e9},
        {"init-points", (double) p->init_points, 4, 1e8},
        {"max-instances", (double) p->max_instances, 1, 4e9},
        {"max-time", p->max_seconds, 0, 1e9},
        {"seconds before", p->seconds_before, 0, 1e9},
    };
    const int code = check_ranges(ctx, ranges, sizeof(ranges) / sizeof(ranges[0]));
    if (!code && p->max_gaussians && p->max_gaussians < 4)
        return sg_fail(ctx, SG_ERR_USAGE, "max-gaussians: found %llu, expected 0 (no limit) or at least 4",
                       (unsigned long long) p->max_gaussians);
    return code ? code : check_defense(ctx, &p->defense);
}

static int check_scene(sg_ctx *ctx, const struct sg_train_params *p, const struct sg_scene *scene)
{
    int code = sg_train_check(ctx, p);
    if (code)
        return code;
    if (!scene->n_train)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no training view, expected at least one", scene->path);
    for (size_t i = 0; p->defense.shares && i < scene->n_train && !code; i++)
        code = check_ranges(ctx, &(struct range){"share of a view", (double) p->defense.shares[i], 0, 1e3}, 1);
    return code;
}

/* The k-th of `limit` items taken evenly out of n. */
static size_t evenly(size_t n, size_t k, size_t limit)
{
    return (size_t) ((uint64_t) n * k / limit);
}

static void say_thinned(sg_ctx *ctx, size_t n, size_t limit)
{
    sg_log(ctx, SG_LOG_WARN, "%zu initial Gaussians are more than fit: training starts from %zu of them", n, limit);
}

/* How many Gaussians a run begins with that is given none. */
static size_t initial_count(const struct sg_scene *scene, const struct sg_train_params *p)
{
    return scene->n_points ? scene->n_points : p->init_points;
}

/* Of at most `limit` Gaussians, 0 = any number: thinned out before they cost more than their points. */
static int initial_model(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_train_params *p, uint64_t limit,
                         struct sg_model **out)
{
    const size_t n = initial_count(scene, p);
    if (limit && n > limit)
        say_thinned(ctx, n, limit);
    if (!scene->n_points)
        return sg_model_init_random(ctx, limit && n > limit ? limit : n, p->seed, p->sh_degree, out);
    if (!limit || n <= limit)
        return sg_model_init_points(ctx, scene->points, scene->point_colors, n, p->sh_degree, out);
    float *points = sg_alloc_raw(ctx, SG_MEM_MISC, limit, 3 * sizeof(*points));
    uint8_t *colors = sg_alloc_raw(ctx, SG_MEM_MISC, limit, 3);
    int code = points && colors ? SG_OK : SG_ERR_BUDGET;
    for (size_t k = 0; k < limit && !code; k++) {
        memcpy(points + 3 * k, scene->points + 3 * evenly(n, k, limit), 3 * sizeof(*points));
        memcpy(colors + 3 * k, scene->point_colors + 3 * evenly(n, k, limit), 3);
    }
    if (!code)
        code = sg_model_init_points(ctx, points, colors, limit, p->sh_degree, out);
    sg_free(ctx, points);
    sg_free(ctx, colors);
    return code;
}

static double system_clock(void *unused)
{
    (void) unused;
    return sg_seconds();
}

/* As many of a model as fit, evenly. */
static int thinned_copy(sg_ctx *ctx, const struct sg_model *m, uint64_t limit, struct sg_model **out)
{
    const int planes = sg_param_count(m->sh_degree);
    const int code = sg_model_create(ctx, limit, m->sh_degree, out);
    if (code)
        return code;
    say_thinned(ctx, m->count, limit);
    (*out)->active_sh_degree = m->active_sh_degree;
    for (size_t k = 0; k < limit; k++)
        for (int p = 0; p < planes; p++)
            *sg_model_at(*out, k, p) = *sg_model_at(m, evenly(m->count, k, limit), p);
    return SG_OK;
}

/* What the process itself takes, and so what is left of --max-memory, is a little more or less each time. */
#define UNCERTAIN 0.03

/* A model that a checkpoint brings, where the limits have become tighter. */
static int thin_out(sg_trainer *t)
{
    const size_t n = t->backend->ops->count(t->backend), limit = t->budget.gaussians;
    if (!limit || n <= limit)
        return SG_OK;
    if (t->budget.by_memory && (double) n <= (1 + UNCERTAIN) * (double) limit) {
        t->budget.gaussians = n;
        return SG_OK;
    }
    uint8_t *keep = sg_alloc(t->ctx, SG_MEM_MISC, n, 1);
    if (!keep)
        return SG_ERR_BUDGET;
    for (size_t k = 0; k < limit; k++)
        keep[evenly(n, k, limit)] = 1;
    const int code =
        t->backend->ops->edit(t->backend, &(struct sg_edit){.keep = keep, .kept = limit, .statistics = true});
    sg_free(t->ctx, keep);
    sg_log(t->ctx, SG_LOG_WARN,
           "the checkpoint's %zu Gaussians are more than fit now: training goes on with %zu of them", n, limit);
    t->gaussians_bound = true;
    return code;
}

static int begin(sg_trainer *t, const struct sg_model *initial)
{
    const uint64_t limit = t->budget.gaussians;
    struct sg_model *made = NULL;
    const size_t n = initial ? initial->count : initial_count(t->scene, &t->params);
    int code = SG_OK;
    t->gaussians_bound = limit && n > limit;
    if (!initial)
        code = initial_model(t->ctx, t->scene, &t->params, limit, &made);
    else if (t->gaussians_bound)
        code = thinned_copy(t->ctx, initial, limit, &made);
    if (!code) {
        t->start_degree = (made ? made : initial)->active_sh_degree;
        code = made ? t->backend->ops->adopt(t->backend, made, &(struct sg_optimiser){0})
                    : t->backend->ops->upload(t->backend, initial, NULL);
    }
    sg_model_destroy(t->ctx, &made);
    return code;
}

static uint64_t bytes_held(const struct sg_model *m)
{
    return m ? sg_held(m) + sg_held(m->params) : 0;
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
    t->params = params ? *params : *sg_train_params();
    /* One camera has no extent; 1 keeps the learning rates finite and moving. */
    t->extent = scene->extent > 0 ? scene->extent : 1;
    t->epoch = UINT64_MAX;
    int code = check_scene(ctx, &t->params, scene);
    if (code)
        goto fail;
    t->params.clock = t->params.clock ? t->params.clock : system_clock;
    t->started = t->params.clock(t->params.clock_arg);
    t->spent = t->params.seconds_before;
    if (start->checkpoint && (code = sg_checkpoint_open(t, start->checkpoint, &saved)))
        goto fail;
    t->sh_degree = start->checkpoint ? saved.header.sh_degree
                   : start->initial  ? start->initial->sh_degree
                                     : t->params.sh_degree;
    t->params.sh_degree = t->params.sh_degree < t->sh_degree ? t->params.sh_degree : t->sh_degree;
    if ((code = sg_budget_plan(ctx, scene, &t->params, t->sh_degree, bytes_held(start->initial), start->sums,
                               &t->budget)) ||
        (code = sg_backend_create(ctx, t->params.backend ? t->params.backend : "cpu", t->params.cpu, &t->backend)) ||
        (code = start->checkpoint ? sg_checkpoint_read(t, &saved) : begin(t, start->initial)) || (code = thin_out(t)))
        goto fail;
    t->order = sg_alloc(ctx, SG_MEM_MISC, scene->n_train, sizeof(*t->order));
    if (!t->order) {
        code = SG_ERR_BUDGET;
        goto fail;
    }
    sg_checkpoint_close(&saved);
    *out = t;
    return SG_OK;
fail:
    sg_checkpoint_close(&saved);
    sg_trainer_destroy(&t);
    return code;
}

int sg_trainer_create(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *initial,
                      const struct sg_train_params *params, sg_trainer **out)
{
    return sg_trainer_open(ctx, scene, &(struct sg_trainer_start){.initial = initial}, params, out);
}

int sg_trainer_resume(sg_ctx *ctx, const struct sg_scene *scene, const char *path, const struct sg_train_params *params,
                      sg_trainer **out)
{
    return sg_trainer_open(ctx, scene, &(struct sg_trainer_start){.checkpoint = path}, params, out);
}

void sg_trainer_destroy(sg_trainer **trainer)
{
    if (!trainer || !*trainer)
        return;
    sg_trainer *t = *trainer;
    sg_backend_destroy(&t->backend);
    sg_free(t->ctx, t->order);
    sg_free(t->ctx, t);
    *trainer = NULL;
}

size_t sg_trainer_pick_view(sg_trainer *t, uint64_t step)
{
    const uint64_t n = t->scene->n_train, epoch = (step - 1) / n;
    if (epoch != t->epoch) {
        sg_view_order(t->params.seed, epoch, t->order, t->scene->n_train);
        t->epoch = epoch;
    }
    return t->order[(step - 1) % n];
}

static void background(const sg_trainer *t, int it, float *out)
{
    for (int ch = 0; ch < 3; ch++)
        out[ch] = t->params.random_background
                      ? sg_rng_uniform(t->params.seed, SG_RNG_BACKGROUND, (uint64_t) it, (uint64_t) ch)
                  : t->params.white_background ? 1.0f
                                               : 0.0f;
}

int sg_trainer_update(sg_trainer *t, const double *lr, bool hold_opacity, struct sg_update u)
{
    int steps[SG_GROUPS];
    memcpy(steps, t->adam_steps, sizeof(steps));
    u.adam = lr;
    for (int g = 0; lr && g < SG_GROUPS; g++) {
        if (g == SG_G_OPACITY && hold_opacity)
            continue;
        steps[g]++;
        u.rate[g] = (float) (lr[g] / (1 - pow((double) SG_ADAM_BETA1, steps[g])));
        u.root[g] = (float) (1 / sqrt(1 - pow((double) SG_ADAM_BETA2, steps[g])));
    }
    const int code = t->backend->ops->update(t->backend, &u);
    if (!code)
        memcpy(t->adam_steps, steps, sizeof(steps));
    return code;
}

double sg_trainer_elapsed(const sg_trainer *t)
{
    return t->spent + t->params.clock(t->params.clock_arg) - t->started;
}

/* One more, or as many as the time that will have passed asks for; so the last one begins while there is time for it.
 */
static int next_iteration(sg_trainer *t)
{
    const struct sg_train_params *p = &t->params;
    const int next = t->iteration + 1;
    if (!(p->max_seconds > 0))
        return next;
    /* From one step to the next, so that what the caller always does between them counts; the lesser of two, since now
     * and then it does more: saves, measures. */
    const double now = sg_trainer_elapsed(t), gap = t->steps_here ? now - t->step_begun : 0;
    const double share = (now + (t->gap > 0 ? fmin(gap, t->gap) : gap)) / p->max_seconds;
    t->gap = gap;
    t->step_begun = now;
    t->steps_here = true;
    const int by_time = share < 1 ? (int) (share * p->iterations) : p->iterations;
    t->time_bound |= by_time > next;
    return by_time > next ? by_time : next;
}

/* A share of what grows leaves growth positive: no model dies out of it, whatever its scene. */
#define GROWTH_PACE 0.25

static double filter_share(const sg_trainer *t, int it)
{
    const struct sg_train_params *p = &t->params;
    if (p->defense.rho >= 0)
        return p->defense.rho;
    return it < p->densify_until_iter ? fmin(-p->defense.rho * t->growth * t->growths, 0.5) : 0;
}

/* Most that gives way at a densification where a budget binds. */
#define REPLACED 0.03f

struct score_call {
    sg_trainer *t;
    const struct sg_render_params *render;
    int it;
};

static int score_model(void *arg, struct sg_scores *out)
{
    const struct score_call *c = arg;
    return sg_score(c->t->backend, c->t->scene, &c->t->params.defense, c->render, c->t->params.seed, c->it, out);
}

/* A clock that stands still while hits are counted, which is a stage of its own. */
static double seconds_not_counting(const sg_trainer *t)
{
    return sg_seconds() - t->backend->times.count;
}

static int densify(sg_trainer *t, int it, const struct sg_render_params *render, struct sg_train_step *step)
{
    const struct sg_train_params *p = &t->params;
    struct sg_densify_result r;
    const double start = seconds_not_counting(t);
    const size_t n = t->backend->ops->count(t->backend);
    const int code =
        sg_densify(t->backend,
                   &(struct sg_densify_params){
                       .gradient = p->densify_grad_threshold,
                       .split_scale = (float) ((double) p->percent_dense * t->extent),
                       .prune_scale = it > p->opacity_reset_interval ? (float) (SG_PRUNE_EXTENT * t->extent) : 0,
                       .max_gaussians = t->budget.gaussians,
                       .score = score_model,
                       .arg = &(struct score_call){t, render, it},
                       .replace = REPLACED,
                       .seed = p->seed,
                       .stream = (uint64_t) it},
                   &r);
    step->cloned = r.cloned, step->split = r.split, step->pruned = r.pruned;
    t->gaussians_bound |= r.replaced || r.limited;
    const double grown = (double) (r.cloned + r.split) / (double) n;
    t->growth += (grown - t->growth) * (t->growth > 0 ? GROWTH_PACE : 1);
    t->growths += it > sg_filters_from(p);
    t->backend->times.densify += seconds_not_counting(t) - start;
    return code;
}

static int filter(sg_trainer *t, int it, const struct sg_render_params *render, struct sg_defense_step *step)
{
    const struct sg_train_params *p = &t->params;
    const double start = seconds_not_counting(t);
    const int code = sg_filter(t->backend, t->scene, &p->defense, render, filter_share(t, it), p->seed, it, step);
    t->backend->times.prune += seconds_not_counting(t) - start;
    t->growths = 0;
    return code;
}

static int regularise(sg_trainer *t, size_t view, struct sg_defense_step *step)
{
    const struct sg_defense_params *d = &t->params.defense;
    const double lambda = d->shares ? d->lambda * (double) d->shares[view] : d->lambda;
    const struct sg_regulariser_params p = {.anisotropy = lambda * d->anisotropy_scale,
                                            .total_variation = lambda * d->tv_scale,
                                            .tv = d->tv,
                                            .spectrum = d->spectrum,
                                            .mask = t->scene->train[view].mask};
    struct sg_regulariser_value value = {0};
    const int code = t->backend->ops->regularise(t->backend, &p, &value);
    step->anisotropy = value.anisotropy, step->total_variation = value.total_variation;
    t->backend->times.anisotropy += value.anisotropy_seconds;
    t->backend->times.total_variation += value.total_variation_seconds;
    return code;
}

int sg_trainer_step(sg_trainer *t, struct sg_train_step *out)
{
    sg_clear_error(t->ctx);
    const struct sg_train_params *p = &t->params;
    const struct sg_backend_ops *ops = t->backend->ops;
    const int before = t->iteration, it = next_iteration(t);
    struct sg_train_step step = {.iteration = it, .view = sg_trainer_pick_view(t, t->steps + 1)};
    const struct sg_view *view = &t->scene->train[step.view];
    struct sg_render_params render = {.max_instances = t->budget.instances, .reference_tiles = p->reference_tiles};
    const struct sg_defense_params *d = &p->defense;
    const struct sg_loss_params loss = {.lambda_dssim = p->lambda_dssim, .target = view->rgb, .mask = view->mask};
    struct sg_loss_value value;
    int code;
    background(t, it, render.background);

    if ((code = ops->project(t->backend, &view->camera, sg_active_degree(p, t->start_degree, it), &render)) ||
        (code = ops->rasterize(t->backend, false, &step.render)) || (code = ops->loss(t->backend, &loss, &value)) ||
        (d->on && (code = regularise(t, step.view, &step.defense))) || (code = ops->rasterize_backward(t->backend)))
        return code;

    /* The released code rebuilds every tensor when it densifies and the opacity tensor when it resets: gradients are
     * lost and Adam stands still for them in that iteration. The last iteration takes no step either. */
    const bool densifies = sg_densifies(p, before, it);
    const bool filters = sg_filters(p, before, it) && (densifies || d->rho >= 0 || filter_share(t, it) > 0);
    const bool resets = sg_resets_opacity(p, before, it);
    const double lr[SG_GROUPS] = {
        [SG_G_XYZ] = sg_position_lr(p, it) * t->extent,
        [SG_G_OPACITY] = (double) p->opacity_lr,
        [SG_G_SCALE] = (double) p->scaling_lr,
        [SG_G_ROT] = (double) p->rotation_lr,
        [SG_G_DC] = (double) p->feature_lr,
        [SG_G_REST] = (double) p->feature_lr / 20,
    };
    const bool moves = !densifies && !filters && it < p->iterations;
    const struct sg_update update = {.statistics = it < p->densify_until_iter};
    if ((code = sg_trainer_update(t, moves ? lr : NULL, resets, update)))
        return code;
    if (densifies && (code = densify(t, it, &render, &step)))
        return code;
    if (filters && (code = filter(t, it, &render, &step.defense)))
        return code;
    if (resets && (code = ops->reset_opacity(t->backend, SG_RESET_OPACITY)))
        return code;

    t->iteration = it;
    t->steps++;
    step.loss = value.total, step.l1 = value.l1, step.ssim = value.ssim;
    step.psnr = -10 * log10(value.mse > 1e-10 ? value.mse : 1e-10);
    step.gaussians = ops->count(t->backend);
    if (out)
        *out = step;
    return SG_OK;
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
    return t->backend->ops->count(t->backend);
}

void sg_trainer_times(const sg_trainer *t, struct sg_train_times *out)
{
    *out = t->backend->times;
}

const char *sg_trainer_variant(const sg_trainer *t)
{
    return t->backend->ops->variant(t->backend);
}

int sg_trainer_renderer(sg_trainer *t, sg_renderer **out)
{
    sg_clear_error(t->ctx);
    struct sg_render_params render = {.max_instances = t->budget.instances,
                                      .reference_tiles = t->params.reference_tiles};
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = t->params.white_background ? 1 : 0;
    return sg_renderer_borrow(t->backend, sg_active_degree(&t->params, t->start_degree, t->iteration), &render, out);
}

int sg_trainer_model(sg_trainer *t, struct sg_model **out)
{
    sg_clear_error(t->ctx);
    int code = sg_model_create(t->ctx, sg_trainer_gaussians(t), t->sh_degree, out);
    if (code)
        return code;
    if ((code = t->backend->ops->download(t->backend, *out, NULL)))
        sg_model_destroy(t->ctx, out);
    else
        (*out)->active_sh_degree = sg_active_degree(&t->params, t->start_degree, t->iteration);
    return code;
}
