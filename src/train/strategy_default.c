/* SPDX-License-Identifier: Apache-2.0 */
/* The default strategy: adaptive density control in the order of the released code of Kerbl et al.
 * 2023, and the defense's filter between its growth and its opacity resets. */
#include "densify.h"
#include "filtering.h"
#include "math/constants.h"
#include "schedule.h"
#include "strategy.h"
#include "trainer.h"

static int densify(sg_trainer *t, int it, const struct sg_render_params *render,
                   struct sg_train_step *step)
{
    const struct sg_train_params *p = &t->params;
    struct sg_densify_result r;
    const double start = sg_trainer_seconds_not_counting(t);
    const size_t n = sg_engine_count(t->engine);
    const bool stops = p->at_limit >= SG_AT_LIMIT_STOP;
    const int code = sg_densify(
        t->engine,
        &(struct sg_densify_params){.gradient = sg_trainer_growth_threshold(t),
                                    .absolute = p->model == SG_MODEL_MIP,
                                    .split_scale = (float) ((double) p->percent_dense * t->extent),
                                    .prune_scale = it > p->opacity_reset_interval
                                                       ? (float) (SG_PRUNE_EXTENT * t->extent)
                                                       : 0,
                                    .max_gaussians = t->budget.gaussians,
                                    .overshoot = t->budget.overshoots,
                                    .score = stops ? NULL : sg_filtering_at_limit,
                                    .arg = &(struct sg_limit_call){t, render, it},
                                    .replace = SG_REPLACED,
                                    .seed = p->seed,
                                    .stream = (uint64_t) it},
        &r);
    step->cloned = r.cloned, step->split = r.split, step->pruned = r.pruned;
    t->gaussians_bound |= r.replaced || r.limited;
    if (!code)
        sg_log(t->ctx, SG_LOG_DEBUG,
               "iteration %d: of %zu Gaussians %zu cloned, %zu split, %zu pruned", it, n, r.cloned,
               r.split, r.pruned);
    sg_filtering_grown(t, t->strategy_state, it, (double) (r.cloned + r.split) / (double) n);
    t->densify_seconds += sg_trainer_seconds_not_counting(t) - start;
    return code;
}

struct events {
    bool densifies, filters, resets;
};

/* Opacities need time to recover from a reset before rates fall. */
static struct events events_of(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    const bool densifies = sg_densifies(p, before, it);
    return (struct events){.densifies = densifies,
                           .filters = sg_filtering_due(t, t->strategy_state, before, it, densifies),
                           .resets = sg_resets_opacity(p, before, it) &&
                                     it < t->settles_from - p->iterations / 10};
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
        code = sg_filtering_run(t, t->strategy_state, it, render, &out->defense);
    if (!code && e.resets)
        code = sg_engine_reset_opacity(t->engine, SG_RESET_OPACITY);
    return code;
}

const struct sg_strategy sg_strategy_default = {
    .name = "default",
    .state_bytes = sizeof(struct sg_filtering),
    .sound = sg_filtering_sound,
    .filter_next = sg_filtering_next,
    .plan = plan,
    .after_step = after_step,
};
