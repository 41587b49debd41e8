/* SPDX-License-Identifier: Apache-2.0 */
/* An iteration of the training loop of Kerbl et al. 2023, in the order of the released code. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "exposure.h"
#include "math/constants.h"
#include "scene/photo.h"
#include "schedule.h"
#include "trainer.h"

size_t sg_trainer_pick_view(sg_trainer *t, uint64_t step)
{
    const uint64_t n = t->scene->n_train, epoch = (step - 1) / n;
    if (epoch != t->epoch) {
        sg_view_order(t->params.seed, epoch, t->order, t->scene->n_train);
        t->epoch = epoch;
    }
    return t->order[(step - 1) % n];
}

void sg_trainer_read_ahead(sg_trainer *t, uint64_t step, int it, int iterations)
{
    if (t->reads_ahead && it < iterations)
        sg_photo_read_ahead(&t->scene->train[sg_trainer_pick_view(t, step + 1)]);
}

/* The next iteration, or a later one if time is short, so that the last iteration begins while
 * there is time for it. */
static int next_iteration(sg_trainer *t)
{
    const struct sg_train_params *p = &t->params;
    const int next = t->iteration + 1;
    if (!(p->max_seconds > 0))
        return next;
    /* Measured from step to step, so that the caller's regular work between them counts. The lesser
     * of two gaps, since the caller sometimes saves or measures. */
    const double now = sg_trainer_elapsed(t), gap = t->steps_here ? now - t->step_begun : 0;
    if (!t->steps_here) /* the time before the first step counts, but is no part of the schedule */
        t->first_begun = now, t->first_after = t->iteration;
    const double left = p->max_seconds - t->first_begun;
    const double share =
        left > 0 ? (now + (t->gap > 0 ? fmin(gap, t->gap) : gap) - t->first_begun) / left : 1;
    t->gap = gap;
    t->step_begun = now;
    t->steps_here = true;
    const int by_time = share < 1
                            ? t->first_after + (int) (share * (p->iterations - t->first_after))
                            : p->iterations;
    t->time_bound |= by_time > next;
    return by_time > next ? by_time : next;
}

static void background(const sg_trainer *t, int it, float *out)
{
    for (int ch = 0; ch < 3; ch++)
        out[ch] = t->params.random_background  ? sg_rng_uniform(t->params.seed, SG_RNG_BACKGROUND,
                                                                (uint64_t) it, (uint64_t) ch)
                  : t->params.white_background ? 1.0f
                                               : 0.0f;
}

/* The losses of a view in iteration `it`; returns their number. */
static size_t list_losses(const sg_trainer *t, size_t view, int it, struct sg_loss out[SG_LOSSES])
{
    const struct sg_train_params *p = &t->params;
    const struct sg_defense_params *d = &p->defense;
    const float levels = sg_trainer_tolerance(t, view);
    const double lambda = d->view_weights ? d->lambda * (double) d->view_weights[view] : d->lambda;
    const double anisotropy = lambda * d->anisotropy_scale, tv = lambda * d->tv_scale;
    size_t n = 0;
    out[n++] = (struct sg_loss){
        SG_LOSS_PHOTOMETRIC,
        1,
        {.photometric = {p->lambda_dssim, .tolerance = sg_loss_tolerance(levels),
                         .low_pass =
                             levels > 0 && it > t->settles_from ? p->tolerance_low_pass : 0}}};
    if (d->on && anisotropy != 0)
        out[n++] = (struct sg_loss){SG_LOSS_ANISOTROPY, anisotropy, {.anisotropy = d->spectrum}};
    if (d->on && tv != 0)
        out[n++] = (struct sg_loss){SG_LOSS_TOTAL_VARIATION, tv, {.total_variation = d->tv}};
    else if (levels > 0 && p->tolerance_tv > 0)
        out[n++] = (struct sg_loss){SG_LOSS_TOTAL_VARIATION,
                                    (double) p->tolerance_tv,
                                    {.total_variation = SG_TV_PENALTY_L1}};
    return n;
}

/* Computes the losses of iteration `it` against the photo. One that does not stay in memory is read
 * and handed to the engine for this call only. */
static int compare(sg_trainer *t, size_t index, int it, const struct sg_loss *losses, size_t n)
{
    const bool stays = t->photos[index];
    int code = stays ? SG_OK : sg_trainer_hold_photo(t, index, false);
    if (code)
        return code;
    sg_trainer_read_ahead(t, t->steps + 1, it, t->params.iterations);
    code = sg_engine_losses(
        t->engine,
        &(struct sg_target){.photo = t->photos[index], .exposure = t->exposures ? index + 1 : 0},
        losses, n);
    if (!stays) {
        const int dropped = sg_engine_photo_drop(t->engine, t->photos[index]);
        code = code ? code : dropped;
        sg_trainer_let_go(t, index);
    }
    return code;
}

/* The learning rates of iteration `it`. */
static void set_rates(const sg_trainer *t, int before, int it, double lr[SG_GROUPS])
{
    const struct sg_train_params *p = &t->params;
    lr[SG_G_XYZ] = sg_position_lr(p, it) * t->extent;
    lr[SG_G_OPACITY] = (double) p->opacity_lr;
    lr[SG_G_SCALE] = (double) p->scaling_lr;
    lr[SG_G_ROT] = (double) p->rotation_lr;
    lr[SG_G_DC] = (double) p->feature_lr;
    lr[SG_G_REST] = (double) p->feature_lr / 20;
    if (t->strategy->rates)
        t->strategy->rates(t, before, it, lr);
    if (it <= t->settles_from)
        return;
    /* They fall to a fiftieth, so that in the end noise cancels over many views. */
    const double done = (double) (it - t->settles_from) / (p->iterations - t->settles_from);
    for (int g = 0; g < SG_GROUPS; g++)
        lr[g] *= pow(0.02, done);
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
    const int code = sg_engine_optimise(t->engine, &u);
    if (!code)
        memcpy(t->adam_steps, steps, sizeof(steps));
    return code;
}

/* Whether a look falls into the iterations after `before`, up to `it`. Where the schedule
 * resets opacity it is one earlier: after a reset there is little to see. Nothing learns from a
 * look in the last one. */
static bool is_look(const struct sg_train_params *p, int before, int it)
{
    const int grows = p->densify_until_iter < p->iterations ? p->densify_until_iter : p->iterations,
              first = p->tolerance_look < 0 ? grows / 10 : p->tolerance_look;
    for (int k = 1; k <= 9 && first > 0 && it < p->iterations; k += 2) {
        int64_t look = (int64_t) k * first;
        look -= look <= p->iterations && sg_resets_opacity(p, (int) look - 1, (int) look);
        if (before < look && it >= look && (k == 1 || look <= p->densify_until_iter))
            return true;
    }
    return false;
}

/* Where a step to `it` would have a look after a reset of opacity that it comes before, the look's
 * iteration, so that the step ends with the look. */
static int end_before_reset(const struct sg_train_params *p, int before, int it)
{
    int end = it;
    if (is_look(p, before, it) && sg_resets_opacity(p, before, it))
        for (end = before + 1; !is_look(p, before, end);)
            end++;
    return end;
}

/* What the engine has measured of a step. */
static void take_values(const sg_trainer *t, const struct sg_step *result,
                        struct sg_train_step *step)
{
    const struct sg_photometric_value value = result->photometric;
    step->render = result->stats;
    if (t->params.defense.on) {
        step->defense.anisotropy = result->loss[SG_LOSS_ANISOTROPY];
        step->defense.total_variation = result->loss[SG_LOSS_TOTAL_VARIATION];
    }
    step->loss = value.total, step->l1 = value.l1, step->ssim = value.ssim;
    step->psnr = sg_photometric_psnr(&value);
}

static int iterate(sg_trainer *t, struct sg_train_step *out)
{
    const struct sg_train_params *p = &t->params;
    int code;
    const int before = t->iteration, it = end_before_reset(p, before, next_iteration(t));
    struct sg_train_step step = {.iteration = it, .view = sg_trainer_pick_view(t, t->steps + 1)};
    const struct sg_view *view = &t->scene->train[step.view];
    struct sg_render_params render = sg_trainer_render(t);
    struct sg_loss losses[SG_LOSSES];
    const size_t n_losses = list_losses(t, step.view, it, losses);
    struct sg_step result;
    background(t, it, render.background);
    render.appearance = (int) step.view;

    if ((code = sg_engine_draw(t->engine, &view->camera, sg_active_degree(p, t->start_degree, it),
                               &render, false)) ||
        (code = compare(t, step.view, it, losses, n_losses)) ||
        (code = sg_engine_raster_backward(t->engine)))
        return code;

    /* A step of several iterations that ends among those that settle has what was due before. */
    const bool changes = before < t->settles_from;
    const struct sg_strategy_plan plan =
        changes ? t->strategy->plan(t, before, it) : (struct sg_strategy_plan){0};
    /* As in the released code, the last iteration takes no step. Nor does it leave anything else
     * behind, so that a longer run can do it again: see sg_checkpoint_read. */
    const bool last = it >= p->iterations;
    if (plan.radii && !last && (code = sg_engine_count_radii(t->engine)))
        return code;
    double lr[SG_GROUPS];
    set_rates(t, before, it, lr);
    const struct sg_update update = {.statistics = plan.statistics && !last,
                                     .mean_opacity = plan.mean_opacity,
                                     .mean_scale = plan.mean_scale};
    if (t->exposures && !last) {
        const struct sg_exposure_update x = sg_exposures_update(p, it, t->steps + 1);
        if ((code = sg_engine_learn_exposures(t->engine, &x)))
            return code;
    }
    if ((code = sg_trainer_update(t, plan.rests || last ? NULL : lr, plan.rests_opacity, update)) ||
        (changes && t->strategy->after_step &&
         (code = t->strategy->after_step(t, &plan, before, it, &render, &step))) ||
        (sg_renews_filter(p, t->settles_from, before, it) && (code = sg_trainer_renew_filter(t))))
        return code;

    t->iteration = it;
    t->steps++;
    t->idle += last;
    if (out) {
        if ((code = sg_engine_read_arrived(t->engine, false, &result)))
            return code;
        take_values(t, &result, &step);
    }
    step.gaussians = sg_trainer_gaussians(t);
    if (is_look(p, before, it) && !t->smooths &&
        (code = sg_trainer_measure_noise(t, it, &step.noise)))
        return code;
    if (step.noise.smooths && (code = sg_trainer_smooth(t)))
        return code;
    if (out)
        *out = step;
    return SG_OK;
}

bool sg_trainer_changes(const sg_trainer *t)
{
    if (t->params.max_seconds > 0 || t->iteration >= t->settles_from)
        return false;
    const struct sg_strategy_plan plan = t->strategy->plan(t, t->iteration, t->iteration + 1);
    return plan.rests || plan.rests_opacity;
}

int sg_trainer_advance(sg_trainer *t, struct sg_train_step *out)
{
    sg_clear_error(t->ctx);
    const uint64_t all = (uint64_t) t->params.iterations;
    int code = sg_progress(t->ctx, SG_STAGE_TRAIN, (uint64_t) t->iteration, all);
    if (code)
        return code;
    sg_progress_hold(t->ctx); /* nobody can go on from half an iteration */
    code = iterate(t, out);
    return sg_progress_release(t->ctx, code, SG_STAGE_TRAIN, (uint64_t) t->iteration, all);
}

int sg_trainer_step(sg_trainer *t, struct sg_train_step *out)
{
    const int code = sg_trainer_advance(t, out);
    return code || !out ? code : sg_trainer_values(t, out);
}

int sg_trainer_values(sg_trainer *t, struct sg_train_step *step)
{
    struct sg_step result;
    const int code = sg_engine_read_arrived(t->engine, true, &result);
    if (!code)
        take_values(t, &result, step);
    return code;
}

uint64_t sg_trainer_view(const sg_trainer *t)
{
    return sg_engine_views(t->engine);
}

int sg_trainer_arrived(sg_trainer *t, uint64_t view, bool wait, struct sg_train_step *step,
                       uint64_t *most, bool *known)
{
    struct sg_step result;
    const int code = sg_engine_read_view(t->engine, view, wait, &result, known);
    take_values(t, &result, step);
    *most = result.most;
    return code;
}

int sg_trainer_most_instances(sg_trainer *t, uint64_t *out)
{
    return sg_engine_most_instances(t->engine, out);
}
