/* SPDX-License-Identifier: Apache-2.0 */
/* Poison-splat (Lu et al. 2025): a decoy model is pushed towards images of large total variation;
 * the poison of a view is what the decoy shows there, within epsilon of the photo, so that all
 * views agree on it. The decoy learns as the victim does, but with constant rates, frozen
 * positions, and densification all the time. */
#include "attack.h"

#include <math.h>

#include "ascent.h"
#include "core/clock.h"
#include "decoy.h"
#include "image/total_variation.h"
#include "option/option.h"
#include "scene/photo.h"
#include "scene/used.h"
#include "splatguard/defense.h"
#include "splatguard/eval.h"

#define POSITION_LR 1.6e-4

struct sg_attack_params sg_attack_params_default(void)
{
    return (struct sg_attack_params){SG_ATTACK_DEFAULTS};
}

/* Rates do not fall. extent: of the scene. */
static struct sg_train_params decoy_params(const struct sg_attack_params *p, double extent)
{
    struct sg_train_params d = sg_train_params_default();
    struct sg_scaffold_params *s = &d.scaffold;
    d.iterations = p->iterations, d.seed = p->seed, d.lambda_dssim = p->lambda_dssim;
    d.max_instances = p->max_instances;
    d.max_gaussians = p->max_gaussians, d.at_limit = SG_AT_LIMIT_STOP;
    if (p->victim_gaussians) { /* scored as preset auto does */
        d.max_gaussians = p->victim_gaussians, d.at_limit = SG_AT_LIMIT_SCORE;
        d.defense.frequency = sg_round_digits(sg_defense_frequency(extent));
    }
    d.engine = p->engine, d.cpu = p->cpu;
    d.percent_dense = p->percent_dense;
    d.densification_interval = p->densification_interval;
    d.densify_grad_threshold = fminf(p->densify_grad_threshold, 1e9f); /* the option's largest */
    if (p->model == SG_ATTACK_3DGS)
        return d;
    d.model = SG_MODEL_SCAFFOLD;
    *s = p->scaffold;
    s->offset_lr_final = s->offset_lr_init;
    s->opacity_lr_final = s->opacity_lr_init;
    s->covariance_lr_final = s->covariance_lr_init;
    s->colour_lr_final = s->colour_lr_init;
    s->bank_lr_final = s->bank_lr_init;
    s->appearance_lr_final = s->appearance_lr_init;
    return d;
}

/* What a decoy of anchors cannot have. */
static int check_scaffold(sg_ctx *ctx, const struct sg_attack_params *p)
{
    if (p->move_positions)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "move_positions: found with the model scaffold, whose anchors do not move");
    if (p->scale_floor > 0)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "scale_floor: found %g with the model scaffold, whose scales networks make, "
                       "expected 0",
                       (double) p->scale_floor);
    if (p->victim_gaussians)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "victim_gaussians: found %llu with the model scaffold, expected 0: where "
                       "anchors meet a limit none is replaced, which is what max_gaussians does",
                       (unsigned long long) p->victim_gaussians);
    if (p->update_interval > 1)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "update_interval: found %d with the model scaffold, expected 1",
                       p->update_interval);
    const struct sg_train_params decoy = decoy_params(p, 1);
    return sg_train_check(ctx, &decoy);
}

int sg_attack_check(sg_ctx *ctx, const struct sg_attack_params *p)
{
    sg_clear_error(ctx);
    int code = sg_check_options(ctx, sg_attack_options(), p);
    if (!code && p->texture > 0 && !isfinite(p->epsilon))
        code = sg_fail(ctx, SG_ERR_USAGE,
                       "texture: found %g and an epsilon of %g, expected a finite epsilon",
                       (double) p->texture, (double) p->epsilon);
    if (!code && p->victim_gaussians && p->max_gaussians)
        code = sg_fail(ctx, SG_ERR_USAGE,
                       "max_gaussians: found %llu and victim_gaussians %llu, expected one limit",
                       (unsigned long long) p->max_gaussians,
                       (unsigned long long) p->victim_gaussians);
    if (!code && p->model == SG_ATTACK_SCAFFOLD)
        code = check_scaffold(ctx, p);
    return code ? code : sg_engine_check(ctx, p->engine, p->cpu);
}

static struct sg_identity identity_of(const struct sg_attack_params *p,
                                      const struct sg_train_params *decoy)
{
    const double numbers[] = {
        (double) p->epsilon,
        p->inner,
        (double) p->step,
        p->tv,
        (double) p->spectral_weight,
        (double) p->scale_floor,
        (double) p->texture,
        (double) p->victim_tolerance,
        (double) p->victim_gaussians,
        p->update_interval,
        p->move_positions,
        (double) p->lambda_dssim,
        (double) p->feature_lr,
        (double) p->opacity_lr,
        (double) p->scaling_lr,
        (double) p->rotation_lr,
        (double) p->percent_dense,
        p->densification_interval,
        (double) p->densify_grad_threshold,
    };
    const uint64_t own = sg_hash_numbers(numbers, sizeof(numbers) / sizeof(numbers[0]));
    return (struct sg_identity){.kind = SG_RUN_ATTACK, .parameters = sg_hash_anchors(decoy, own)};
}

static int allocate(sg_attack *a, const struct sg_scene *scene)
{
    sg_ctx *ctx = a->ctx;
    const size_t pixels = sg_views_largest(scene->train, scene->n_train);
    int height = 0;
    for (size_t i = 0; i < scene->n_train; i++)
        if (scene->train[i].camera.height > height)
            height = scene->train[i].camera.height;
    a->image = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float));
    a->photo = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float));
    a->scratch = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float));
    a->rows = sg_alloc_raw(ctx, SG_MEM_FRAME, (size_t) height, 3 * sizeof(double));
    if (a->params.spectral_weight > 0 &&
        !(a->extra = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float))))
        return SG_ERR_BUDGET;
    if (a->params.texture > 0 &&
        !(a->bound = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, sizeof(float))))
        return SG_ERR_BUDGET;
    return a->image && a->photo && a->scratch && a->rows ? SG_OK : SG_ERR_BUDGET;
}

static int open_attack(sg_ctx *ctx, const struct sg_scene *scene, struct sg_trainer_start start,
                       const struct sg_attack_params *params, sg_attack **out)
{
    *out = NULL;
    const struct sg_attack_params p = params ? *params : sg_attack_params_default();
    int code = sg_attack_check(ctx, &p);
    if (code)
        return code;
    if (!scene->n_train)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no training views, expected at least one to poison", scene->path);
    sg_attack *a = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*a));
    if (!a)
        return SG_ERR_BUDGET;
    a->params = p;
    a->ctx = ctx;
    const struct sg_train_params decoy = decoy_params(&p, scene->extent);
    const struct sg_identity identity = identity_of(&p, &decoy);
    start.identity = &identity;
    start.sums = p.update_interval > 1;
    start.spectral = p.spectral_weight > 0;
    start.strategy =
        p.model == SG_ATTACK_SCAFFOLD ? &sg_strategy_decoy_anchors : &sg_strategy_decoy;
    code = allocate(a, scene); /* first: the trainer plans with what is left */
    if (!code)
        code = sg_trainer_open(ctx, scene, &start, &decoy, &a->trainer);
    if (code) {
        sg_attack_destroy(&a);
        return code;
    }
    *out = a;
    return SG_OK;
}

int sg_attack_create(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *proxy,
                     const struct sg_attack_params *params, sg_attack **out)
{
    return open_attack(ctx, scene, (struct sg_trainer_start){.initial = proxy}, params, out);
}

int sg_attack_resume(sg_ctx *ctx, const struct sg_scene *scene, const char *path,
                     const struct sg_attack_params *params, sg_attack **out)
{
    return open_attack(ctx, scene, (struct sg_trainer_start){.checkpoint = path}, params, out);
}

void sg_attack_destroy(sg_attack **attack)
{
    if (!attack || !*attack)
        return;
    sg_attack *a = *attack;
    sg_trainer_destroy(&a->trainer);
    sg_free(a->image);
    sg_free(a->photo);
    sg_free(a->scratch);
    sg_free(a->rows);
    sg_free(a->extra);
    sg_free(a->bound);
    sg_plans_clear(&a->plans);
    sg_free(a);
    *attack = NULL;
}

/* How the decoy is drawn: on black. */
static struct sg_render_params params_of(const sg_attack *a, size_t index)
{
    return (struct sg_render_params){.max_instances = a->trainer->budget.instances,
                                     .appearance = (int) index};
}

/* The decoy's render of a view into a->image, the photo into a->photo, its bound into a->bound.
 * With a finite epsilon the render is clamped to [0, 1], not yet to epsilon around the photo. */
static int render(sg_attack *a, size_t index)
{
    const sg_trainer *t = a->trainer;
    const struct sg_view *view = &t->scene->train[index];
    const size_t n = (size_t) view->camera.width * (size_t) view->camera.height;
    const struct sg_render_params params = params_of(a, index);
    int code;
    if ((code = sg_engine_draw(t->engine, &view->camera, t->start_degree, &params, false)) ||
        (code = sg_engine_read_image(t->engine, a->image, NULL, NULL)))
        return code;
    const uint8_t *rgb;
    if ((code = sg_photo_pixels(t->ctx, view, &rgb)))
        return code;
    for (size_t ch = 0; ch < 3; ch++)
        for (size_t i = 0; i < n; i++)
            a->photo[ch * n + i] = (float) rgb[3 * i + ch] / 255.0f;
    for (size_t i = 0; i < 3 * n && isfinite(a->params.epsilon); i++)
        a->image[i] = a->image[i] > 0 ? a->image[i] < 1 ? a->image[i] : 1 : 0;
    if (a->bound)
        code = sg_texture_bound(t->ctx, rgb, view->camera.width, view->camera.height,
                                a->params.epsilon, a->params.texture, a->bound);
    sg_view_release(view);
    return code;
}

/* The inner maximisation: a->image becomes the target. */
static int ascend(sg_attack *a, int width, int height)
{
    const struct sg_attack_params *p = &a->params;
    sg_ctx *ctx = a->trainer->ctx;
    struct ascent ascent = {.epsilon = p->epsilon,
                            .step = p->step,
                            .steps = p->inner,
                            .form = p->tv,
                            .bound = a->bound,
                            .spectral_weight = p->spectral_weight,
                            .extra = a->extra};
    const int code = p->spectral_weight > 0 ? sg_plans_find(ctx, &a->plans, NULL, NULL, width,
                                                            height, &ascent.spectral)
                                            : SG_OK;
    if (code)
        return code;
    return sg_ascend(a->trainer->engine, &ascent, a->photo, width, height, a->image, a->scratch);
}

/* Both on the device, which keeps the target. */
static int draw_and_ascend(sg_attack *a, size_t index, struct sg_attack_step *step)
{
    const sg_trainer *t = a->trainer;
    const struct sg_attack_params *p = &a->params;
    const struct sg_render_params params = params_of(a, index);
    const struct sg_view_ascent ascent = {.photo = t->photos[index],
                                          .epsilon = p->epsilon,
                                          .step = p->step,
                                          .steps = p->inner,
                                          .form = p->tv,
                                          .spectral_weight = p->spectral_weight};
    int code =
        sg_engine_draw(t->engine, &t->scene->train[index].camera, t->start_degree, &params, false);
    if (!code)
        code = sg_engine_ascend_view(t->engine, &ascent);
    const double seconds = sg_engine_times(t->engine).ascend;
    step->inner_seconds = seconds - a->ascend_seconds;
    a->ascend_seconds = seconds;
    return code;
}

/* In host memory: a->image becomes the target. */
static int render_and_ascend(sg_attack *a, size_t index, struct sg_attack_step *step)
{
    sg_trainer *t = a->trainer;
    const struct sg_camera *c = &t->scene->train[index].camera;
    int code = render(a, index);
    if (code)
        return code;
    sg_trainer_read_ahead(t, (uint64_t) step->iteration, step->iteration, a->params.iterations);
    const double start = sg_seconds();
    if ((code = ascend(a, c->width, c->height)))
        return code;
    step->inner_seconds = sg_seconds() - start;
    step->tv = sg_tv_planes(a->ctx, a->image, c->width, c->height, a->params.tv, a->rows) /
               (3.0 * c->width * c->height);
    return SG_OK;
}

/* What the engine has measured of a step. */
static void take_values(const struct sg_step *result, struct sg_attack_step *step)
{
    const struct sg_photometric_value value = result->photometric;
    step->loss = value.total, step->l1 = value.l1, step->ssim = value.ssim;
    step->psnr = sg_photometric_psnr(&value);
    step->tv = isnan(result->variation) ? step->tv : result->variation;
}

int sg_attack_values(sg_attack *a, struct sg_attack_step *step)
{
    struct sg_step result;
    const int code = sg_engine_read_arrived(a->trainer->engine, true, &result);
    if (!code)
        take_values(&result, step);
    return code;
}

uint64_t sg_attack_view(const sg_attack *a)
{
    return sg_engine_views(a->trainer->engine);
}

int sg_attack_arrived(sg_attack *a, uint64_t view, bool wait, struct sg_attack_step *step,
                      bool *known)
{
    struct sg_step result;
    const int code = sg_engine_read_view(a->trainer->engine, view, wait, &result, known);
    take_values(&result, step);
    return code;
}

int sg_attack_step(sg_attack *a, struct sg_attack_step *out)
{
    const int code = sg_attack_advance(a, out);
    return code || !out ? code : sg_attack_values(a, out);
}

/* The decoy learns its target of the view, in iteration `it`. */
static int learn(sg_attack *a, size_t view, int it)
{
    const struct sg_attack_params *p = &a->params;
    sg_trainer *t = a->trainer;
    int code;
    const struct sg_target target = {.planes = a->on_device ? NULL : a->image,
                                     .ascended = a->on_device};
    const struct sg_loss loss = {
        SG_LOSS_PHOTOMETRIC,
        1,
        {.photometric = {p->lambda_dssim, .tolerance = sg_loss_tolerance(p->victim_tolerance)}}};
    if ((code = sg_engine_losses(t->engine, &target, &loss, 1)) ||
        (code = sg_engine_raster_backward(t->engine)))
        return code;

    const struct sg_strategy_plan plan = t->strategy->plan(t, t->iteration, it);
    const bool moves = !plan.rests && it % p->update_interval == 0;
    const struct sg_update update = {.statistics = plan.statistics,
                                     .accumulate = p->update_interval > 1};
    const struct sg_render_params render = params_of(a, view);
    struct sg_train_step edits = {0};
    double lr[SG_GROUPS] = {
        [SG_G_XYZ] = p->move_positions ? POSITION_LR * t->extent : 0,
        [SG_G_OPACITY] = (double) p->opacity_lr,
        [SG_G_SCALE] = (double) p->scaling_lr,
        [SG_G_ROT] = (double) p->rotation_lr,
        [SG_G_DC] = (double) p->feature_lr,
        [SG_G_REST] = (double) p->feature_lr / 20,
    };
    if (t->strategy->rates)
        t->strategy->rates(t, t->iteration, it, lr);
    if ((code = sg_trainer_update(t, moves ? lr : NULL, false, update)) ||
        (code = t->strategy->after_step(t, &plan, t->iteration, it, &render, &edits)))
        return code;
    /* As often as the decoy grows. In between, learning shrinks a scale only a little. */
    if (p->scale_floor > 0 && (plan.rests || it == p->iterations) &&
        (code = sg_engine_floor_scale(t->engine, p->scale_floor)))
        return code;
    t->iteration = it;
    t->steps++;
    return SG_OK;
}

int sg_attack_advance(sg_attack *a, struct sg_attack_step *out)
{
    const struct sg_attack_params *p = &a->params;
    sg_trainer *t = a->trainer;
    sg_clear_error(t->ctx);
    const uint64_t done = (uint64_t) t->iteration, all = (uint64_t) p->iterations;
    const int it = t->iteration + 1;
    struct sg_attack_step step = {.iteration = it, .view = sg_trainer_pick_view(t, it)};
    const struct sg_camera *camera = &t->scene->train[step.view].camera;
    int code = sg_progress(t->ctx, SG_STAGE_ATTACK, done, all);
    if (code)
        return code;
    a->on_device =
        sg_engine_ascends_views(t->engine) && t->photos[step.view] && !a->bound && p->inner > 0;
    code = (a->on_device ? draw_and_ascend : render_and_ascend)(a, step.view, &step);
    if (code)
        return code;
    step.inner_bytes = (uint64_t) p->inner * (uint64_t) camera->width * (uint64_t) camera->height *
                       3 * 3 * sizeof(float);
    sg_progress_hold(t->ctx); /* nobody can go on from half an iteration */
    code = learn(a, step.view, it);
    step.gaussians = sg_trainer_gaussians(t);
    if (!code && out) {
        struct sg_step result;
        code = sg_engine_read_arrived(t->engine, false, &result);
        if (!a->on_device)
            result.variation = NAN; /* that of this step is known */
        if (!code)
            take_values(&result, &step);
        *out = step;
    }
    return sg_progress_release(t->ctx, code, SG_STAGE_ATTACK, done, all);
}

int sg_attack_iteration(const sg_attack *a)
{
    return a->trainer->iteration;
}

/* Against a tolerance: the poison goes from the decoy's render to the ascended image, and beyond it
 * by the tolerance. A victim's render stays within the tolerance of its photo, which is then what
 * this decoy shows. */
static int overshoot(sg_attack *a, int width, int height)
{
    const float tolerance = a->params.victim_tolerance / 255;
    const int code = ascend(a, width, height);
    for (size_t i = 0; i < 3 * (size_t) width * (size_t) height && !code; i++)
        a->image[i] += a->image[i] > a->photo[i]   ? tolerance
                       : a->image[i] < a->photo[i] ? -tolerance
                                                   : 0;
    return code;
}

int sg_attack_poison(sg_attack *a, size_t index, uint8_t *rgb)
{
    sg_trainer *t = a->trainer;
    sg_clear_error(t->ctx);
    if (index >= t->scene->n_train)
        return sg_fail(t->ctx, SG_ERR_USAGE, "poison: found view %zu, expected one of %zu", index,
                       t->scene->n_train);
    const struct sg_camera *c = &t->scene->train[index].camera;
    int code = render(a, index);
    if (!code && a->params.victim_tolerance > 0)
        code = overshoot(a, c->width, c->height);
    if (code)
        return code;
    const size_t pixels = (size_t) c->width * (size_t) c->height;
    for (size_t i = 0; i < 3 * pixels; i++) {
        const float e = a->bound ? a->bound[i % pixels] : a->params.epsilon;
        a->image[i] =
            fminf(fmaxf(fminf(fmaxf(a->image[i], a->photo[i] - e), a->photo[i] + e), 0), 1);
    }
    sg_quantise(a->image, c->width, c->height, rgb);
    return SG_OK;
}

int sg_attack_decoy(sg_attack *a, struct sg_model **out)
{
    const int code = sg_trainer_model(a->trainer, out);
    if (!code)
        (*out)->active_sh_degree = a->trainer->start_degree;
    return code;
}

int sg_attack_save(sg_attack *a, const char *path)
{
    sg_clear_error(a->trainer->ctx);
    if (a->trainer->iteration % a->params.update_interval &&
        a->trainer->iteration != a->params.iterations)
        return sg_fail(a->trainer->ctx, SG_ERR_USAGE,
                       "attack: found iteration %d, expected a multiple of %d",
                       a->trainer->iteration, a->params.update_interval);
    return sg_trainer_save(a->trainer, path);
}
