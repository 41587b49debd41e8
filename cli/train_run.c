/* SPDX-License-Identifier: Apache-2.0 */
/* A training from its first step to its last file. */
#include "train_run.h"

#include <string.h>
#include <time.h>
#include <unistd.h>

#include "interrupt.h"
#include "train/schedule.h"

static double cpu_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Measures the test views; fps only on request. Where memory is short for that, the run goes on
 * without. */
static int measure(struct train_run *r, int time_fps)
{
    const struct train_config *c = r->config;
    sg_renderer *renderer = NULL;
    int error = sg_trainer_renderer(r->trainer, &renderer);
    if (!error) {
        sg_eval_clear(&r->eval);
        error = sg_evaluate(r->ctx, renderer, r->scene->test, r->scene->n_test, time_fps, &r->eval);
    }
    sg_renderer_destroy(&renderer);
    if (error) {
        const int code = report(r->ctx, error);
        if (error != SG_ERR_BUDGET)
            return code;
        say(stderr, "the test views are not measured\n");
        return 0;
    }
    r->evaluated = sg_trainer_iteration(r->trainer);
    if (!c->quiet) {
        progress_break(&r->progress);
        say(stderr, "iteration %d: PSNR %.3f, SSIM %.4f on %zu test views\n", r->evaluated,
            r->eval.psnr, r->eval.ssim, r->eval.views);
    }
    return train_log_eval(r);
}

static int save(struct train_run *r)
{
    /* The log's line at a checkpoint carries the totals that a resumed run goes on from. */
    const int logged = train_log_step(r);
    int code = run_save_model(r->ctx, r->config->run.folder, r->trainer);
    if (code)
        return code;
    code = run_save_checkpoint(r->ctx, r->config->run.folder, r->trainer);
    r->resumable = !code;
    r->saved = sg_trainer_iteration(r->trainer);
    if (code == exit_code(SG_ERR_BUDGET)) {
        say(stderr, "the model is saved, its checkpoint is not: --resume goes on from an earlier "
                    "one, if there is one\n");
        code = 0; /* the model is what was asked for */
    }
    return code ? code : logged;
}

#define STARVING 10 /* removals */

/* A fixed rho above the scene's growth eats the model up: says so once. */
static void watch_filter(struct train_run *r)
{
    const struct sg_train_step *s = &r->step;
    if (r->config->run.train.defense.rho < 0)
        return;
    const int growths =
        (s->iteration - r->window_from) / r->config->run.train.densification_interval;
    r->window_grown += s->cloned + s->split, r->window_removed += s->defense.removed;
    r->window_events += s->defense.filtered;
    if (r->window_events < STARVING || growths < STARVING / 2)
        return;
    if (r->window_removed > r->window_grown && s->gaussians < r->first_gaussians && !r->starves) {
        r->starves = true;
        progress_break(&r->progress);
        say(stderr,
            "warning: over %d removals the filter took more than grew, and there are fewer "
            "Gaussians than at first: %zu; rho is too high for this scene\n",
            r->window_events, s->gaussians);
    }
    r->window_from = s->iteration;
    r->window_grown = r->window_removed = 0;
    r->window_events = 0;
}

/* Where time is so short that a step passes over several, none. */
static bool due(const struct train_run *r, int every)
{
    const int stride = r->step.iteration - r->before;
    return every && (stride == 1 || stride < every) && sg_due(r->before, r->step.iteration, every);
}

/* A file that cannot be written, now, is no reason to lose a training. */
static void endure(struct train_run *r, int code)
{
    if (!r->trouble && code != exit_code(SG_ERR_BUDGET)) /* there may be memory for the next */
        r->trouble = code;
}

/* Everything that is due after an iteration; the end has its own. */
static void after_step(struct train_run *r)
{
    const struct sg_train_step *s = &r->step;
    const struct train_config *c = r->config;
    const bool last = s->iteration == c->run.train.iterations;
    progress_step(&r->progress, s);
    if (s->gaussians > r->totals.max_gaussians)
        r->totals.max_gaussians = s->gaussians;
    if (s->render.instances > r->totals.max_instances)
        r->totals.max_instances = s->render.instances;
    r->cloned += s->cloned, r->split += s->split, r->pruned += s->pruned;
    if (s->defense.filtered) {
        r->totals.filter_events++, r->totals.filter_removed += s->defense.removed;
        endure(r, train_log_filter(r));
    }
    watch_filter(r);
    if (sg_due(r->before, s->iteration, c->run.log_every) || last || s->iteration == 1)
        endure(r, train_log_step(r));
    if (due(r, c->run.save_every) && !last)
        endure(r, save(r));
    if (c->run.scene.eval && due(r, c->run.eval_every) && !last)
        endure(r, measure(r, 0));
}

static int loop(struct train_run *r)
{
    while (sg_trainer_iteration(r->trainer) < r->config->run.train.iterations && !interrupted()) {
        const double start = sg_seconds(), cpu = cpu_now();
        r->before = sg_trainer_iteration(r->trainer);
        const int error = sg_trainer_step(r->trainer, &r->step);
        r->totals.seconds += sg_seconds() - start;
        r->totals.cpu_seconds += cpu_now() - cpu;
        if (error) {
            /* The model so far is worth keeping; the checkpoint stays, for this iteration is half
             * done. */
            progress_break(&r->progress);
            int code = report(r->ctx, error);
            const int done = sg_trainer_iteration(r->trainer);
            const size_t gaussians =
                sg_trainer_gaussians(r->trainer); /* it may have grown before it failed */
            if (gaussians > r->totals.max_gaussians)
                r->totals.max_gaussians = gaussians;
            const int lost =
                done > r->saved ? run_save_model(r->ctx, r->config->run.folder, r->trainer) : 0;
            r->saved = lost ? r->saved : done;
            if (r->saved)
                say(stderr, "the model of iteration %d is saved in %s\n", r->saved,
                    r->config->run.folder);
            if (r->saved &&
                error == SG_ERR_BUDGET) /* a smaller model than asked for, but a model */
                code = lost == exit_code(SG_ERR_BUDGET) ? 0 : lost;
            r->error = error;
            if (train_summary_write(r) && !code)
                code = 2;
            return code;
        }
        after_step(r);
    }
    return 0;
}

/* Ends the run: what there is, is saved, interrupted or not. */
static int finish(struct train_run *r)
{
    const bool cut = sg_trainer_iteration(r->trainer) < r->config->run.train.iterations;
    if (cut)
        progress_break(&r->progress);
    /* Without a step there is nothing new, and perhaps less: a tighter limit thins out. */
    const bool stepped = sg_trainer_iteration(r->trainer) > r->saved || !r->config->resume;
    int code = stepped ? save(r) : 0;
    r->resumable |= !stepped;
    if (!code && r->config->run.scene.eval && !cut)
        code = measure(r, 1);
    if (!code)
        code = train_summary_write(r);
    struct sg_train_limits limits;
    sg_trainer_limits(r->trainer, &limits);
    if (!code && limits.time_bound)
        say(stderr, "time was short: %llu of %d iterations were done, on the schedule of all\n",
            (unsigned long long) limits.steps, sg_trainer_iteration(r->trainer));
    if (!code && cut) {
        say(stderr, "interrupted at iteration %d; saved\n", sg_trainer_iteration(r->trainer));
        if (r->resumable)
            say_resume(r->config->proxy_of ? "attack" : "train",
                       r->config->proxy_of ? r->config->proxy_of : r->config->run.folder);
        code = 130;
    }
    return code;
}

/* Whether the run's summary is that of its end. */
static bool is_summed_up(const char *run, int iteration)
{
    char *path = run_path(run, "summary.json");
    json_t *s = path && !access(path, F_OK) ? run_read_json(path, "summary.json of a run") : NULL;
    const bool whole = json_integer_value(json_object_get(s, "iterations")) == iteration &&
                       json_is_false(json_object_get(s, "interrupted"));
    json_decref(s);
    free(path);
    return whole;
}

static int restore(struct train_run *r, const char *variant)
{
    char *path = run_path(r->config->run.folder, "checkpoint.bin");
    if (!path)
        return no_memory();
    if (access(path, F_OK)) {
        say(stderr,
            "splatguard: %s: found no checkpoint, so nothing to go on from; start anew with "
            "--force\n",
            r->config->run.folder);
        free(path);
        return 2;
    }
    run_clean(r->config->run.folder);
    r->train.seconds_before = sg_seconds() - r->begun; /* reading photos */
    const int error = sg_trainer_resume(r->ctx, r->scene, path, &r->train, &r->trainer);
    free(path);
    if (error)
        return report(r->ctx, error);
    if (variant && strcmp(variant, sg_trainer_variant(r->trainer)))
        say(stderr,
            "warning: the run was made with %s and goes on with %s: results can differ in the last "
            "digits\n",
            variant, sg_trainer_variant(r->trainer));
    r->saved = sg_trainer_iteration(r->trainer); /* a model comes before its checkpoint */
    r->finished = r->saved >= r->config->run.train.iterations &&
                  is_summed_up(r->config->run.folder, r->saved);
    if (r->finished) { /* a tighter limit would only thin it out */
        say(stderr, "%s: all %d iterations are done; --iterations asks for more\n",
            r->config->run.folder, r->saved);
        return 0;
    }
    if (interrupted()) {
        say(stderr, "interrupted before the first step; %s is as it was\n", r->config->run.folder);
        return 130;
    }
    /* Iterations may have been raised. */
    return run_write_config(r->config, variant ? variant : sg_trainer_variant(r->trainer));
}

/* From points or a model. */
static int create(struct train_run *r)
{
    const struct train_config *c = r->config;
    struct sg_model *initial = NULL;
    int code = 0,
        error = c->run.init ? sg_model_read_ply(r->ctx, c->run.init, UINT32_MAX, &initial) : 0;
    if (!error && initial)
        error = sg_model_check(r->ctx, initial, c->run.init);
    r->train.seconds_before = sg_seconds() - r->begun; /* reading photos and model */
    if (!error)
        error = sg_trainer_create(r->ctx, r->scene, initial, &r->train, &r->trainer);
    sg_model_destroy(&initial);
    if (!error)
        error = sg_trainer_model(r->trainer, &initial);
    if (error)
        code = report(r->ctx, error);
    else if (interrupted()) { /* an earlier run is still there */
        say(stderr, "interrupted before anything was written\n");
        code = 130;
    } else {
        r->created = true;
        code = run_create(r->ctx, c, r->scene, initial, sg_trainer_variant(r->trainer));
    }
    sg_model_destroy(&initial);
    return code;
}

int train_start(struct train_run *r, const char *variant)
{
    const int code = r->config->resume ? restore(r, variant) : create(r);
    if (code || r->finished)
        return code;
    r->totals.max_gaussians = sg_trainer_gaussians(r->trainer);
    return train_log_open(r);
}

int train_whole(struct train_run *r)
{
    if (!r->first_gaussians)
        r->first_gaussians = sg_trainer_gaussians(r->trainer);
    r->window_from = sg_trainer_iteration(r->trainer);
    int code = loop(r);
    if (!code && !r->error)
        code = finish(r);
    const bool starved = code == exit_code(SG_ERR_BUDGET);
    if ((code == 2 || starved) && !r->error && r->saved) {
        say(stderr, "the model of iteration %d is saved in %s\n", r->saved, r->config->run.folder);
        if (starved) { /* a model, if not the last */
            r->error = SG_ERR_BUDGET;
            code = train_summary_write(r);
            code = code || !interrupted() ? code : 130;
        }
    }
    return code ? code : r->trouble;
}
