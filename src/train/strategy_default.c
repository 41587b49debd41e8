/* SPDX-License-Identifier: Apache-2.0 */
/* The default strategy: adaptive density control in the order of the released code of Kerbl et al.
 * 2023, and the defense's filter between its growth and its opacity resets. */
#include <math.h>

#include "core/rng.h"
#include "defense/filter.h"
#include "densify.h"
#include "math/constants.h"
#include "schedule.h"
#include "strategy.h"
#include "trainer.h"

struct state {
    double growth;         /* share of the Gaussians that grow at a densification, smoothed */
    uint64_t growths;      /* densifications in the filter's window since its newest removal */
    uint64_t filter_first; /* Gaussians before its first removal; 0 = none yet */
};

_Static_assert(sizeof(struct state) == SG_DEFAULT_STATE_BYTES, "the size of the state");

static bool sound(const void *state, int iteration)
{
    const struct state *s = state;
    return s->growth >= 0 && s->growth <= 1 && s->growths <= (uint64_t) iteration;
}

#define GROWTH_PACE 0.25 /* weight of the newest densification in the smoothed growth */

/* Removing a share of the growth cannot shrink the model, and the minimum share stops at half of
 * its first size, so neither can empty it. The minimum fades, since only early removals leave time
 * to grow again what is missed. */
static double filter_share(const sg_trainer *t, int it)
{
    const struct state *s = t->strategy_state;
    const struct sg_train_params *p = &t->params;
    const struct sg_defense_params *d = &p->defense;
    const double from = sg_filters_from(p), until = p->densify_until_iter;
    if (d->rho >= 0)
        return d->rho;
    if (it >= until || !s->growths)
        return 0;
    const double n = (double) sg_engine_count(t->engine);
    const double first = s->filter_first ? (double) s->filter_first : n,
                 spare = n > 0 ? 1 - first / 2 / n : 0;
    const double least = d->rho_least * (until - it) / (until - from);
    return fmax(fmin(-d->rho * s->growth * (double) s->growths, 0.5), fmin(least, spare));
}

/* Largest share that is replaced at a densification where a budget binds. */
#define REPLACED 0.03f

struct score_call {
    sg_trainer *t;
    const struct sg_render_params *render;
    int it;
};

/* Random scores. */
static int draw_scores(const struct score_call *c, struct sg_scores *out)
{
    const int code = sg_scores_create(c->t->ctx, sg_engine_count(c->t->engine), out);
    for (size_t i = 0; i < out->count && !code; i++) {
        out->score[i] =
            (double) sg_rng_uniform(c->t->params.seed, SG_RNG_REPLACE, (uint64_t) c->it, i);
        out->log_smallest[i] = 0;
    }
    return code;
}

static int score_model(void *arg, struct sg_scores *out)
{
    const struct score_call *c = arg;
    if (c->t->params.at_limit == SG_AT_LIMIT_RANDOM)
        return draw_scores(c, out);
    return sg_score(c->t->engine, c->t->scene, &c->t->params.defense, c->render, c->t->params.seed,
                    c->it, out);
}

static int densify(sg_trainer *t, int it, const struct sg_render_params *render,
                   struct sg_train_step *step)
{
    const struct sg_train_params *p = &t->params;
    struct state *s = t->strategy_state;
    struct sg_densify_result r;
    const double start = sg_trainer_seconds_not_counting(t);
    const size_t n = sg_engine_count(t->engine);
    /* A limit that follows from memory is never exceeded. */
    const bool overshoots = p->at_limit == SG_AT_LIMIT_UNIVERSAL && !t->budget.by_memory,
               stops = p->at_limit >= SG_AT_LIMIT_STOP;
    const int code = sg_densify(
        t->engine,
        &(struct sg_densify_params){.gradient = p->densify_grad_threshold,
                                    .absolute = p->model == SG_MODEL_MIP,
                                    .split_scale = (float) ((double) p->percent_dense * t->extent),
                                    .prune_scale = it > p->opacity_reset_interval
                                                       ? (float) (SG_PRUNE_EXTENT * t->extent)
                                                       : 0,
                                    .max_gaussians = t->budget.gaussians,
                                    .overshoot = overshoots,
                                    .score = stops ? NULL : score_model,
                                    .arg = &(struct score_call){t, render, it},
                                    .replace = REPLACED,
                                    .seed = p->seed,
                                    .stream = (uint64_t) it},
        &r);
    step->cloned = r.cloned, step->split = r.split, step->pruned = r.pruned;
    t->gaussians_bound |= r.replaced || r.limited;
    if (!code)
        sg_log(t->ctx, SG_LOG_DEBUG,
               "iteration %d: of %zu Gaussians %zu cloned, %zu split, %zu pruned", it, n, r.cloned,
               r.split, r.pruned);
    const double grown = (double) (r.cloned + r.split) / (double) n;
    s->growth += (grown - s->growth) * (s->growth > 0 ? GROWTH_PACE : 1);
    s->growths += it > sg_filters_from(p);
    t->densify_seconds += sg_trainer_seconds_not_counting(t) - start;
    return code;
}

static int filter(sg_trainer *t, int it, const struct sg_render_params *render,
                  struct sg_defense_step *step)
{
    const struct sg_train_params *p = &t->params;
    struct state *s = t->strategy_state;
    const double start = sg_trainer_seconds_not_counting(t);
    if (!s->filter_first)
        s->filter_first = sg_engine_count(t->engine);
    const int code =
        sg_filter(t->engine, t->scene, &p->defense, render, filter_share(t, it), p->seed, it, step);
    if (!code)
        sg_log(t->ctx, SG_LOG_DEBUG, "iteration %d: of %zu Gaussians the filter removed %zu", it,
               step->scored, step->removed);
    t->prune_seconds += sg_trainer_seconds_not_counting(t) - start;
    s->growths = 0;
    return code;
}

struct events {
    bool densifies, filters, resets;
};

/* Opacities need time to recover from a reset before only colours learn. */
static struct events events_of(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    const bool densifies = sg_densifies(p, before, it);
    return (struct events){.densifies = densifies,
                           .filters = sg_filters(p, before, it) &&
                                      (densifies || p->defense.rho >= 0 || filter_share(t, it) > 0),
                           .resets = sg_resets_opacity(p, before, it) &&
                                     it < t->colours_from - p->iterations / 10};
}

/* The released code rebuilds every tensor when it densifies and the opacity tensor when it resets:
 * gradients are lost, and Adam does not move them in that iteration. */
static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    const struct events e = events_of(t, before, it);
    return (struct sg_strategy_plan){.rests = e.densifies || e.filters,
                                     .rests_opacity = e.resets,
                                     .statistics = it < t->params.densify_until_iter,
                                     .radii = it < t->params.densify_until_iter &&
                                              sg_counts_radii(&t->params)};
}

static int after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out)
{
    (void) planned;
    const struct events e = events_of(t, before, it); /* before a densification changes the share */
    int code = SG_OK;
    if (e.densifies)
        code = densify(t, it, render, out);
    if (!code && e.densifies)
        code = sg_trainer_renew_filter(t);
    if (!code && e.filters)
        code = filter(t, it, render, &out->defense);
    if (!code && e.resets)
        code = sg_engine_reset_opacity(t->engine, SG_RESET_OPACITY);
    return code;
}

const struct sg_strategy sg_strategy_default = {
    .name = "default",
    .state_bytes = sizeof(struct state),
    .sound = sound,
    .plan = plan,
    .after_step = after_step,
};
