/* SPDX-License-Identifier: Apache-2.0 */
/* A run from its parameters to its last file. */
#include "train.h"

#include <limits.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "config.h"
#include "core/clock.h"
#include "core/file.h"
#include "scene/used.h"
#include "splatguard/format.h"
#include "train/schedule.h"
#include "train/trainer.h"

static double cpu_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Whether the caller wants to stop. */
static bool ask(sg_run *r, const struct sg_train_step *step)
{
    if (r->params.step && r->params.step(r->params.step_priv, step))
        r->stopped = true;
    return r->stopped;
}

/* By the context's progress function: the run stops. */
static bool was_cancelled(sg_run *r, int code)
{
    if (code != SG_ERR_INTERRUPTED)
        return false;
    sg_clear_error(r->ctx);
    return r->stopped = true;
}

/* A file that cannot be written does not end the training. The first such error is returned at the
 * end. */
static void note_error(sg_run *r, int code)
{
    if (!code)
        return;
    sg_log(r->ctx, SG_LOG_WARN, "%s", sg_last_error(r->ctx));
    if (!r->write_error && code != SG_ERR_BUDGET) { /* there may be memory for the next */
        r->write_error = code;
        r->write_message = sg_strdup(r->ctx, sg_last_error(r->ctx));
    }
    sg_clear_error(r->ctx);
}

int sg_run_done(const sg_run *r)
{
    const int it = sg_trainer_iteration(r->trainer);
    return r->saved > it || (r->ended_by && r->saved) ? r->saved : it;
}

/* Measures the test views; fps only at the end. Where exposures are learned, also with those of the
 * test photos, or, where these are not known, after matching colours. */
static int measure_views(sg_run *r, sg_renderer *renderer, bool time_fps)
{
    const struct sg_scene *scene = r->scene;
    struct sg_eval_params how = {.fps = time_fps};
    size_t *photos = NULL;
    int code = SG_OK;
    if (r->params.scene.test_halves) {
        how.appearances = true;
        how.photos = photos = sg_alloc_raw(r->ctx, SG_MEM_MISC, scene->n_test, sizeof(*photos));
        code = photos ? sg_trainer_exposures(r->trainer, &how.exposures) : SG_ERR_BUDGET;
        for (size_t i = 0; i < scene->n_test && !code; i++)
            photos[i] = sg_scene_photo(scene, &scene->test[i]);
    } else
        how.match_colours = r->train.exposure;
    r->corrected_by = sg_eval_corrected_by(&how);
    if (!code)
        code = sg_evaluate(r->ctx, renderer, scene->test, scene->n_test, &how, &r->eval);
    sg_free(photos);
    return code;
}

/* Measures the model as that of an iteration. If memory is short for it, the run continues without.
 */
static int measure(sg_run *r, int iteration, bool time_fps)
{
    sg_renderer *renderer = NULL;
    sg_clear_error(r->ctx);
    int code = sg_trainer_renderer(r->trainer, &renderer);
    sg_eval_clear(&r->eval);
    if (!code)
        code = measure_views(r, renderer, time_fps);
    sg_renderer_destroy(&renderer);
    if (code == SG_ERR_BUDGET) {
        sg_log(r->ctx, SG_LOG_WARN, "%s; the test views are not measured", sg_last_error(r->ctx));
        sg_clear_error(r->ctx);
        return SG_OK;
    }
    if (code)
        return code;
    r->evaluated = iteration;
    sg_log(r->ctx, SG_LOG_INFO, "iteration %d: PSNR %.3f, SSIM %.4f on %zu test views",
           r->evaluated, r->eval.psnr, r->eval.ssim, r->eval.views);
    note_error(r, sg_run_log_eval(r));
    return SG_OK;
}

/* Before the end: the training goes on after an error, and stops where this is cancelled. */
static void measure_between(sg_run *r, int iteration)
{
    const int code = measure(r, iteration, false);
    if (!was_cancelled(r, code))
        note_error(r, code);
}

static int save(sg_run *r)
{
    /* The log's line at a checkpoint carries the totals that a resumed run starts from. */
    note_error(r, sg_run_log_step(r));
    note_error(r, sg_run_settle_log(r, true));
    const int it = sg_trainer_iteration(r->trainer);
    int code = r->model_saved == it
                   ? SG_OK
                   : sg_run_save_model(r->ctx, r->params.folder, r->scene, r->trainer, it);
    if (code)
        return code;
    code = sg_run_save_checkpoint(r->ctx, r->params.folder, r->trainer);
    r->resumable = !code;
    r->saved = it;
    r->checkpoint = code ? r->checkpoint : r->saved;
    if (code == SG_ERR_BUDGET) {
        sg_log(r->ctx, SG_LOG_WARN,
               "%s; the model is saved, its checkpoint is not: a resumed run continues from an "
               "earlier one, if there is one",
               sg_last_error(r->ctx));
        sg_clear_error(r->ctx);
        code = SG_OK; /* the model is saved, which is what counts */
    }
    return code;
}

#define STARVING 10 /* removals */

/* Warns once if a fixed rho removes more than the scene grows. */
static void watch_filter(sg_run *r)
{
    const struct sg_train_step *s = &r->step;
    if (r->train.defense.rho < 0)
        return;
    const int growths = (s->iteration - r->window_from) / r->train.densification_interval;
    r->window_grown += s->cloned + s->split, r->window_removed += s->defense.removed;
    r->window_events += s->defense.filtered;
    if (r->window_events < STARVING || growths < STARVING / 2)
        return;
    if (r->window_removed > r->window_grown && s->gaussians < r->first_gaussians && !r->starves) {
        r->starves = true;
        sg_log(
            r->ctx, SG_LOG_WARN,
            "over %d removals the filter took more than grew, and there are fewer Gaussians than "
            "at first: %zu; rho is too high for this scene",
            r->window_events, s->gaussians);
    }
    r->window_from = s->iteration;
    r->window_grown = r->window_removed = 0;
    r->window_events = 0;
}

/* False where time is so short that one step passes several due iterations. */
static bool due(const sg_run *r, int every)
{
    const int stride = r->step.iteration - r->before;
    return every && (stride == 1 || stride < every) && sg_due(r->before, r->step.iteration, every);
}

static bool is_logged(const sg_run *r)
{
    const int it = r->step.iteration;
    return it == 1 || it == r->params.train.iterations ||
           sg_due(r->before, it, r->params.log_every);
}

/* Whether a file gets numbers of this iteration, and nothing goes on before it has. */
static bool is_looked_at(const sg_run *r)
{
    const struct sg_run_params *p = &r->params;
    return r->step.iteration == p->train.iterations || due(r, p->save_every) ||
           (p->scene.eval && due(r, p->eval_every));
}

/* What a look has changed. */
static void say_tolerance(const sg_run *r)
{
    const struct sg_noise *n = &r->step.noise;
    const double before = round(10 * n->before), level = round(10 * n->level); /* as is printed */
    if (before > 0 && level > 0 && level != before && !n->smooths)
        sg_log(
            r->ctx, SG_LOG_INFO,
            "iteration %d: tolerance %s from %.1f to %.1f grey levels, as %zu of %zu photos show",
            r->step.iteration, level > before ? "raised" : "lowered", before / 10, level / 10,
            n->deciding, n->compared);
    if (n->smooths)
        sg_log(r->ctx, SG_LOG_INFO,
               "iteration %d: photos and model agree too little for a tolerance; photos with one "
               "are smoothed from here on, against noise of %.1f grey levels",
               r->step.iteration, n->level);
    if (n->added)
        sg_log(r->ctx, SG_LOG_INFO,
               "iteration %d: %zu more photos show the same bound and get the tolerance",
               r->step.iteration, n->added);
}

/* What is due in an iteration that adds or removes Gaussians or resets opacities. As in the
 * released code it is the model before these changes that is saved and measured: what is new has
 * not learned yet. The checkpoint is that after the iteration. */
static void before_step(sg_run *r)
{
    const struct sg_run_params *p = &r->params;
    const int before = sg_trainer_iteration(r->trainer), it = before + 1;
    const bool saves = p->save_every && sg_due(before, it, p->save_every),
               measures = p->scene.eval && p->eval_every && sg_due(before, it, p->eval_every);
    if (!(saves || measures) || !sg_trainer_changes(r->trainer))
        return;
    if (saves) {
        const int code = sg_run_save_model(r->ctx, p->folder, r->scene, r->trainer, it);
        r->model_saved = code ? r->model_saved : it;
        note_error(r, code);
    }
    if (measures)
        measure_between(r, it);
}

/* Everything that is due after an iteration; the end has its own. */
static void after_step(sg_run *r)
{
    const struct sg_train_step *s = &r->step;
    const struct sg_run_params *p = &r->params;
    const bool last = s->iteration == p->train.iterations;
    if (s->gaussians > r->totals.max_gaussians)
        r->totals.max_gaussians = s->gaussians;
    if (s->render.instances > r->totals.max_instances)
        r->totals.max_instances = s->render.instances;
    r->cloned += s->cloned, r->split += s->split, r->pruned += s->pruned;
    if (s->defense.filtered) {
        r->totals.filter_events++, r->totals.filter_removed += s->defense.removed;
        note_error(r, sg_run_log_filter(r));
    }
    if (s->noise.compared) {
        say_tolerance(r);
        note_error(r, sg_run_log_noise(r));
    }
    watch_filter(r);
    if (is_logged(r))
        note_error(r, sg_run_log_step(r));
    note_error(r, sg_run_settle_log(r, false));
    if (due(r, p->save_every) && !last)
        note_error(r, save(r));
    if (p->scene.eval && due(r, p->eval_every) && !last && r->evaluated != s->iteration)
        measure_between(r, s->iteration);
}

/* A checkpoint comes before the measurement due with it, within which a process may have ended. */
static void measure_missed(sg_run *r)
{
    const struct sg_run_params *p = &r->params;
    const int it = sg_trainer_iteration(r->trainer);
    if (!r->resume || r->stopped || it >= p->train.iterations || it == r->evaluated)
        return;
    if (!p->scene.eval || !p->eval_every || !sg_due(it - 1, it, p->eval_every))
        return;
    measure_between(r, it);
}

/* The training cannot continue. Saves the model so far. The checkpoint stays as it is, since this
 * iteration is half done. */
static int end_early(sg_run *r, int error)
{
    char *why = sg_strdup(r->ctx, sg_last_error(r->ctx));
    const int done = sg_trainer_iteration(r->trainer);
    sg_run_settle_log(r, true);                                /* as far as it is known */
    const size_t gaussians = sg_trainer_gaussians(r->trainer); /* may have grown before it failed */
    if (gaussians > r->totals.max_gaussians)
        r->totals.max_gaussians = gaussians;
    sg_clear_error(r->ctx);
    const int lost = done > r->saved
                         ? sg_run_save_model(r->ctx, r->params.folder, r->scene, r->trainer, done)
                         : SG_OK;
    char *loss = lost ? sg_strdup(r->ctx, sg_last_error(r->ctx)) : NULL;
    if (lost)
        sg_log(r->ctx, SG_LOG_WARN, "%s", sg_last_error(r->ctx));
    sg_clear_error(r->ctx);
    r->saved = done > r->saved && !lost ? done : r->saved;
    r->ended_by = error;
    int code = sg_run_write_summary(r);
    if (r->saved && error == SG_ERR_BUDGET) { /* the model is smaller than asked for, but valid */
        sg_log(r->ctx, SG_LOG_WARN, "%s", why ? why : "out of memory");
        error = lost == SG_ERR_BUDGET ? SG_OK : lost;
        sg_free(why);
        why = loss, loss = NULL;
    }
    if (error) {
        sg_clear_error(r->ctx);
        code = sg_fail(r->ctx, error, "%s", why ? why : "out of memory");
    }
    sg_free(why);
    sg_free(loss);
    return code;
}

static int loop(sg_run *r)
{
    while (sg_trainer_iteration(r->trainer) < r->params.train.iterations && !r->stopped) {
        before_step(r);
        if (r->stopped)
            break;
        const double start = sg_seconds(), cpu = cpu_now();
        r->before = sg_trainer_iteration(r->trainer);
        int error = sg_trainer_advance(r->trainer, &r->step);
        if (sg_trainer_iteration(r->trainer) > r->before && was_cancelled(r, error))
            error = SG_OK; /* this iteration was done first */
        if (!error && is_looked_at(r))
            error = sg_run_take_values(r);
        r->totals.seconds += sg_seconds() - start;
        r->totals.cpu_seconds += cpu_now() - cpu;
        if (was_cancelled(r, error))
            continue;
        if (error)
            return end_early(r, error);
        after_step(r);
        ask(r, &r->step);
    }
    return SG_OK;
}

/* Ends the run, stopped or complete: saves everything. */
static int finish(sg_run *r)
{
    const bool cut = sg_trainer_iteration(r->trainer) < r->params.train.iterations;
    sg_clear_error(r->ctx); /* of what `step` looked at, which did not end the run */
    /* Without a step there is nothing new to save, and a tighter limit may have thinned the model
     * out. */
    const bool stepped = sg_trainer_iteration(r->trainer) > r->from || !r->resume;
    int code = stepped ? save(r) : SG_OK;
    r->resumable |= !stepped;
    if (!code && r->params.scene.eval && !cut)
        code = measure(r, sg_trainer_iteration(r->trainer), true);
    if (!code)
        code = sg_run_write_summary(r);
    if (!code && cut)
        code = sg_fail(r->ctx, SG_ERR_INTERRUPTED, "interrupted at iteration %d; saved",
                       sg_run_done(r));
    return code;
}

int sg_run_train(sg_run *r)
{
    sg_clear_error(r->ctx);
    if (r->finished)
        return SG_OK;
    if (!r->first_gaussians)
        r->first_gaussians = sg_trainer_gaussians(r->trainer);
    r->from = r->window_from = sg_trainer_iteration(r->trainer);
    measure_missed(r);
    int code = loop(r);
    if (!code && !r->ended_by)
        code = finish(r);
    if (code == SG_ERR_BUDGET && !r->ended_by &&
        r->saved) { /* a model of an earlier iteration is saved */
        sg_log(r->ctx, SG_LOG_WARN, "%s", sg_last_error(r->ctx));
        sg_clear_error(r->ctx);
        r->ended_by = SG_ERR_BUDGET;
        code = sg_run_write_summary(r);
        if (!code && r->stopped)
            code =
                sg_fail(r->ctx, SG_ERR_INTERRUPTED, "interrupted at iteration %d; saved", r->saved);
    }
    if (!code && r->write_error)
        code = sg_fail(r->ctx, r->write_error, "%s",
                       r->write_message ? r->write_message : "a file could not be written");
    if (code == SG_ERR_INTERNAL && r->checkpoint)
        code =
            sg_run_name_checkpoint(r->ctx, code, r->params.folder, "checkpoint.bin", r->checkpoint);
    const int closed = sg_run_log_close(&r->log);
    code = code ? code : closed;
    r->failed = code && code != SG_ERR_INTERRUPTED;
    return code;
}

/* Reads the summary of the processes before, if there is one that can be read: it is written anew.
 */
static void read_earlier(sg_run *r)
{
    if (sg_run_has(r->ctx, r->params.folder, "summary.json"))
        sg_run_read_json(r->ctx, r->params.folder, "summary.json", "summary.json of a run",
                         &r->earlier);
    sg_clear_error(r->ctx);
}

/* Whether the run's summary is that of its end. */
static bool is_summed_up(const sg_run *r, int iteration)
{
    return json_integer_value(json_object_get(r->earlier, "iterations")) == iteration &&
           json_is_false(json_object_get(r->earlier, "interrupted"));
}

/* A run that goes on is not at its end, even if it is killed before it says so. */
static int reopen_summary(const sg_run *r)
{
    if (!json_is_false(json_object_get(r->earlier, "interrupted")))
        return SG_OK;
    json_t *s = json_copy(r->earlier);
    json_object_set_new(s, "interrupted", json_true());
    return sg_run_write_json(r->ctx, r->params.folder, "summary.json", s);
}

/* From the checkpoint. */
static int restore(sg_run *r)
{
    const char *folder = r->params.folder;
    json_t *config = NULL;
    char *path = sg_strf(r->ctx, "%s/checkpoint.bin", folder);
    int code =
        path ? sg_run_read_json(r->ctx, folder, "config.json", "config.json of a run", &config)
             : SG_ERR_BUDGET;
    if (!code)
        code = sg_run_check_inside(r->ctx, folder, "checkpoint.bin");
    if (!code) {
        sg_run_remove_temporary(folder);
        r->train.seconds_before = sg_seconds() - r->begun; /* reading photos */
        code = sg_trainer_resume(r->ctx, r->scene, path, &r->train, &r->trainer);
    }
    sg_free(path);
    const char *now = code ? NULL : sg_trainer_variant(r->trainer),
               *variant = json_string_value(json_object_get(config, "cpu_variant"));
    if (!code && variant && strcmp(variant, now))
        sg_log(
            r->ctx, SG_LOG_WARN,
            "the run was made with %s and continues with %s: results can differ in the last digits",
            variant, now);
    if (!code) {
        read_earlier(r);
        /* a model comes before its checkpoint */
        r->saved = r->checkpoint = r->trainer->resumed;
        /* a tighter limit would only thin it out */
        r->finished = r->saved >= r->params.train.iterations && is_summed_up(r, r->saved);
    }
    if (!code && !r->finished && ask(r, NULL))
        code = sg_fail(r->ctx, SG_ERR_INTERRUPTED,
                       "interrupted before the first step; %s is as it was", folder);
    if (!code && !r->finished) /* iterations may have been raised */
        code = sg_run_write_config(r->ctx, &r->params, variant ? variant : now);
    if (!code && !r->finished)
        code = reopen_summary(r);
    json_decref(config);
    return code;
}

/* From points, or the model in the file `init`. */
static int create(sg_run *r, const char *init)
{
    const struct sg_run_params *p = &r->params;
    struct sg_model *initial = NULL;
    int code = p->init ? sg_model_read(r->ctx, init, UINT32_MAX, &initial) : SG_OK;
    if (!code && initial)
        code = sg_model_check(r->ctx, initial, p->init);
    r->train.seconds_before = sg_seconds() - r->begun; /* reading photos and model */
    if (!code)
        code = sg_trainer_create(r->ctx, r->scene, initial, &r->train, &r->trainer);
    sg_model_destroy(&initial);
    if (!code)
        code = sg_trainer_model(r->trainer, &initial);
    if (!code && ask(r, NULL)) /* an earlier run is still there */
        code = sg_fail(r->ctx, SG_ERR_INTERRUPTED, "interrupted before anything was written");
    if (!code) {
        r->created = true;
        code = sg_run_create_files(r->ctx, p, r->scene, initial, sg_trainer_variant(r->trainer));
    }
    sg_model_destroy(&initial);
    return code;
}

/* What a run goes on from or begins with, before photos are read in vain. init: the model's file.
 */
static int check_begin(sg_run *r, char init[PATH_MAX])
{
    const struct sg_run_params *p = &r->params;
    if (!r->resume)
        return p->init ? sg_run_find_model(r->ctx, p->init, 0, init, PATH_MAX) : SG_OK;
    if (sg_run_has(r->ctx, p->folder, "checkpoint.bin"))
        return SG_OK;
    return sg_fail(r->ctx, SG_ERR_INPUT,
                   "%s: found no checkpoint, expected one: the run cannot be continued, only "
                   "replaced",
                   p->folder);
}

static int open_run(sg_run *r, const struct sg_output_rules *rules)
{
    const struct sg_run_params *p = &r->params;
    char init[PATH_MAX];
    int code = sg_run_check(r->ctx, p);
    if (!code)
        code = sg_output_claim_by(r->ctx, p->folder, rules, &r->output);
    if (!code)
        code = check_begin(r, init);
    if (!code)
        code = sg_scene_load(r->ctx, p->source, &p->scene, &r->scene);
    if (!code && p->scene.eval && !sg_views_used(r->scene->test, r->scene->n_test))
        code = sg_fail(r->ctx, SG_ERR_INPUT,
                       "%s: found no test view with a used pixel, needed to evaluate", p->source);
    if (!code)
        code = sg_run_decide_defense(r);
    if (!code)
        ask(r, NULL); /* before the trainer, which takes its time */
    if (!code)
        code = r->resume ? restore(r) : create(r, init);
    if (code || r->finished)
        return code;
    r->totals.max_gaussians = sg_trainer_gaussians(r->trainer);
    return sg_run_open_log(r);
}

int sg_run_open_in(sg_ctx *ctx, const struct sg_run_params *params, enum sg_run_start start,
                   bool nested, sg_run **out)
{
    sg_clear_error(ctx);
    sg_run *r = *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*r));
    if (!r)
        return SG_ERR_BUDGET;
    *r = (sg_run){
        .ctx = ctx, .params = *params, .resume = start == SG_RUN_RESUME, .begun = sg_seconds()};
    sg_config_round(sg_run_config, &r->params);
    const struct sg_output_rules rules = {.maker = "train",
                                          .earlier = "run",
                                          .is_own = sg_run_is_run,
                                          .is_lost = sg_run_is_lost,
                                          .within = "point_cloud/iteration_N",
                                          .replace = start == SG_RUN_REPLACE,
                                          .resume = start == SG_RUN_RESUME,
                                          .nested = nested,
                                          .inputs = {params->source, params->init}};
    const int code = params->source && params->folder
                         ? open_run(r, &rules)
                         : sg_fail(ctx, SG_ERR_USAGE, "run: found no source or folder");
    r->failed = code && code != SG_ERR_INTERRUPTED;
    if (code)
        sg_run_close(out);
    return code;
}

int sg_run_open(sg_ctx *ctx, const struct sg_run_params *params, enum sg_run_start start,
                sg_run **out)
{
    return sg_run_open_in(ctx, params, start, false, out);
}

void sg_run_status(const sg_run *r, struct sg_run_status *out)
{
    *out = (struct sg_run_status){.iteration = sg_trainer_iteration(r->trainer),
                                  .iterations = r->params.train.iterations,
                                  .saved = r->saved,
                                  .finished = r->finished,
                                  .resumable = r->resumable,
                                  .ended_by = r->ended_by,
                                  .defended = r->train.defense.on,
                                  .filter_removed = r->totals.filter_removed};
    sg_trainer_limits(r->trainer, &out->limits);
}

const struct sg_scene *sg_run_scene(const sg_run *r)
{
    return r->scene;
}

int sg_run_renderer(sg_run *r, sg_renderer **out)
{
    return sg_trainer_renderer(r->trainer, out);
}

int sg_run_model(sg_run *r, struct sg_model **out)
{
    return sg_trainer_model(r->trainer, out);
}

int sg_run_scores(sg_run *r, double *score, double *hits, uint8_t *stays,
                  struct sg_filter_pass *next)
{
    return sg_trainer_scores(r->trainer, score, hits, stays, next);
}

void sg_run_close(sg_run **run)
{
    sg_run *r = run ? *run : NULL;
    if (!r)
        return;
    sg_run_log_close(&r->log);
    sg_eval_clear(&r->eval);
    sg_trainer_destroy(&r->trainer);
    sg_scene_destroy(&r->scene);
    if (r->failed && r->created && !r->saved)
        sg_run_remove_files(r->ctx, r->params.folder);
    sg_output_release(&r->output);
    sg_free(r->view_weights);
    sg_free(r->tolerances);
    sg_free(r->write_message);
    json_decref(r->earlier);
    sg_free(r);
    *run = NULL;
}
