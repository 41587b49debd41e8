/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include <time.h>

#include "interrupt.h"
#include "train_run.h"

#define T(field) offsetof(struct train_config, field)
#define INTEGER(name, field, low, high, help)                                                                          \
    {                                                                                                                  \
        name, 0, OPT_INT, T(field), low, high, NULL, "N", help, false                                                  \
    }
#define RATE(name, field, help)                                                                                        \
    {                                                                                                                  \
        name, 0, OPT_FLOAT, T(train.field), 0, 1000, NULL, "X", help, false                                            \
    }

#define DOUBLE(name, field, low, high, help)                                                                           \
    {                                                                                                                  \
        name, 0, OPT_DOUBLE, T(train.defense.field), low, high, NULL, "X", help, false                                 \
    }

static const struct option train_options[] = {
    {"Run", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"output", 'o', OPT_STRING, T(output), 0, 0, NULL, "RUN", "Folder to write the run to.", true},
    {"model-path", 'm', OPT_STRING, T(output), 0, 0, NULL, "RUN", "The reference's name for --output.", true},
    {"source-path", 's', OPT_STRING, T(source), 0, 0, NULL, "SCENE", "The reference's way to name the scene.", false},
    INTEGER("iterations", train.iterations, 1, 10000000, "Training iterations."),
    {"seed", 0, OPT_U64, T(train.seed), 0, 9e15, NULL, "S", "Seed of every random draw.", false},
    {"threads", 'j', OPT_INT, T(threads), 0, 256, NULL, "T", "Worker threads; 0 = one per CPU. Results are the same.",
     true},
    {"eval", 0, OPT_FLAG, T(eval), 0, 0, NULL, NULL, "Hold the test views out and measure PSNR and SSIM on them.",
     false},
    {"resume", 0, OPT_FLAG, T(resume), 0, 0, NULL, NULL,
     "Continue RUN from its checkpoint with its own options: same bytes as an uninterrupted run.", true},
    {"force", 0, OPT_FLAG, T(force), 0, 0, NULL, NULL, "Replace an earlier run in the folder.", true},
    {"quiet", 'q', OPT_FLAG, T(quiet), 0, 0, NULL, NULL, "No progress.", true},
    INTEGER("save-every", save_every, 0, 10000000,
            "Save model and checkpoint every N iterations; 0 = at the end only."),
    INTEGER("eval-every", eval_every, 0, 10000000, "Measure the test views every N iterations; 0 = at the end only."),
    INTEGER("log-every", log_every, 1, 10000000, "Write a line to log.jsonl every N iterations."),
    {"backend", 0, OPT_CHOICE, T(backend), 0, 0, BACKENDS, "NAME", "cpu, or ref: the slow scalar oracle.", false},
    {"cpu", 0, OPT_STRING, T(train.cpu), 0, 0, NULL, "VARIANT",
     "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU).", false},
    SCENE_OPTIONS(struct train_config, scene, false),
    {"Initialisation", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"init", 0, OPT_STRING, T(init), 0, 0, NULL, "MODEL.ply", "Start from this model.", false},
    {"init-points", 0, OPT_U64, T(train.init_points), 4, 1e8, NULL, "N", "Random points where the scene has none.",
     false},
    {"Model and loss", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    INTEGER("sh-degree", train.sh_degree, 0, 3, "Degree of the spherical harmonics."),
    INTEGER("sh-interval", train.sh_interval, 1, 10000000, "Iterations between raises of the degree in use."),
    {"random-background", 0, OPT_FLAG, T(train.random_background), 0, 0, NULL, NULL,
     "A random background colour each iteration.", false},
    {"lambda-dssim", 0, OPT_FLOAT, T(train.lambda_dssim), 0, 1, NULL, "X", "Weight of 1 - SSIM against L1.", false},
    {"Learning rates", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    RATE("position-lr-init", position_lr_init, "Position, at the start, in scene extents."),
    RATE("position-lr-final", position_lr_final, "Position, at the end, in scene extents."),
    INTEGER("position-lr-max-steps", train.position_lr_max_steps, 1, 1000000000, "Iterations between the two."),
    RATE("feature-lr", feature_lr, "Colour; higher SH degrees learn at a twentieth."),
    RATE("opacity-lr", opacity_lr, "Opacity."),
    RATE("scaling-lr", scaling_lr, "Scale."),
    RATE("rotation-lr", rotation_lr, "Rotation."),
    {"Densification", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    RATE("percent-dense", percent_dense, "Split Gaussians larger than this share of the extent, clone smaller ones."),
    INTEGER("densification-interval", train.densification_interval, 1, 10000000, "Iterations between densifications."),
    INTEGER("densify-from-iter", train.densify_from_iter, 0, 1000000000, "Densify after this iteration."),
    INTEGER("densify-until-iter", train.densify_until_iter, 0, 1000000000, "Densify before this iteration."),
    RATE("densify-grad-threshold", densify_grad_threshold, "Mean view-space gradient that makes a Gaussian grow."),
    INTEGER("opacity-reset-interval", train.opacity_reset_interval, 1, 1000000000,
            "Iterations between opacity resets."),
    {"Budgets", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"max-gaussians", 0, OPT_U64, T(train.max_gaussians), 0, 4e9, NULL, "N",
     "Most Gaussians; at the limit, new ones take the place of those that the defense's filter scores lowest. 0 = no "
     "limit.",
     false},
    {"max-memory", 0, OPT_BYTES, T(max_memory), 0, 9e15, NULL, "BYTES",
     "Most memory of the whole process, e.g. 1500M or 4G: limits Gaussians and tile lists to what fits. 0 = no limit.",
     false},
    {"max-time", 0, OPT_TIME, T(max_time), 0, 1e9, NULL, "TIME",
     "Most time until the model is trained, e.g. 90s, 10m or 2h: iterations are skipped so that the schedule still "
     "ends. "
     "0 = no limit.",
     false},
    {"Defense", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"defense", 0, OPT_CHOICE, T(defense), 0, 0, "off|spectral", "NAME",
     "Against poisoned photos: prune Gaussians of high frequency, keep renders smooth and even over directions.",
     false},
    {"audit", 0, OPT_CHOICE, T(audit), 0, 0, "off|warn|refuse|defend", "MODE",
     "Look at the photos first (see `audit`): say what is found, refuse poisoned ones with exit status 2, or turn the "
     "defense on unless they are clean.",
     false},
    {"preset", 0, OPT_CHOICE, T(preset), 0, 0, "auto|ns|tt|mip", "NAME",
     "The paper's rho and lambda for NeRF-Synthetic, Tanks and Temples, Mip-NeRF 360; auto: a share of the run's own "
     "growth, and for each photo the more lambda the more it looks poisoned (see `audit`).",
     false},
    DOUBLE(
        "rho", rho, -1, 0.5,
        "Share of the Gaussians that the filter removes at a time; -0.9 to 0: minus the share of what grew; -1 = the "
        "preset's."),
    DOUBLE("filter-frequency", frequency, 1e-9, 1e9, "Reference frequency t, cycles per scene unit."),
    DOUBLE("filter-exponent", exponent, 0, 100, "Exponent alpha of the frequency weight."),
    INTEGER("filter-views", train.defense.views, 1, 10000000, "Training views that hits are counted in."),
    INTEGER("filter-interval", train.defense.interval, 1, 10000000, "Iterations between removals."),
    INTEGER("filter-from", train.defense.from, -1, 1000000000, "Remove after this iteration; -1 = as densification."),
    INTEGER("filter-until", train.defense.until, -1, 1000000000,
            "Remove before this iteration; -1 = as densification."),
    {"filter-sigma", 0, OPT_CHOICE, T(train.defense.sigma), 0, 0, "std|eigen", "NAME",
     "Size in the frequency weight: smallest scale, or its square (the smallest eigenvalue).", false},
    {"filter-hits", 0, OPT_CHOICE, T(train.defense.hit), 0, 0, "pixels|views|weight", "NAME",
     "Hits of a Gaussian: pixels it is blended in, views, or its weight in the pixels.", false},
    {"filter-rule", 0, OPT_CHOICE, T(train.defense.rule), 0, 0, "exact|threshold", "NAME",
     "Remove exactly the share, or all up to the score there (LightGaussian's rule).", false},
    {"filter-sample", 0, OPT_CHOICE, T(train.defense.sample), 0, 0, "random|all", "NAME",
     "Views to count in: a new sample each time, or all.", false},
    DOUBLE("lambda", lambda, -1, 1e6,
           "Weight of the two losses on renders (auto: of photos that look poisoned); -1 = the preset's."),
    DOUBLE("anisotropy-scale", anisotropy_scale, 0, 1e6, "Times lambda: weight of the spectrum's anisotropy."),
    DOUBLE("tv-scale", tv_scale, 0, 1e6, "Times lambda: weight of the total variation."),
    {"tv-norm", 0, OPT_CHOICE, T(train.defense.tv), 0, 0, "l2|l1|huber", "NAME",
     "Total variation: mean of squared or of absolute differences; huber: squared up to 16 grey levels, then linear.",
     false},
    DOUBLE("band-low", spectrum.band.low, 0, 1, "Lower edge of the band, as a part of the Nyquist frequency."),
    DOUBLE("band-high", spectrum.band.high, 0, 1, "Upper edge of the band."),
    INTEGER("bins", train.defense.spectrum.band.bins, 2, SG_SPECTRUM_BINS_MAX, "Directions of the spectrum, even."),
    {"energy", 0, OPT_CHOICE, T(train.defense.spectrum.energy), 0, 0, "power|amplitude", "NAME",
     "What a coefficient of the spectrum counts.", false},
    {"channels", 0, OPT_CHOICE, T(train.defense.spectrum.channels), 0, 0, "sum|luma", "NAME",
     "Energy of all three channels, or of the luma.", false},
    {"exact-spectrum", 0, OPT_FLAG, T(train.defense.spectrum.exact_size), 0, 0, NULL, NULL,
     "Transform awkward image sides as they are; by default they are continued to the next quick length.", false},
    {"Rasteriser", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"max-instances", 0, OPT_U64, T(train.max_instances), 1, 4e9, NULL, "N",
     "(Gaussian, tile) pairs held at once; views with more are processed in bands, with the same result.", false},
    {"reference-tiles", 0, OPT_FLAG, T(train.reference_tiles), 0, 0, NULL, NULL,
     "Keep every tile of the 3-sigma square, for parity checks.", false},
    {0},
};

static const struct train_config defaults = {
    .scene = {SCENE_OPTION_DEFAULTS},
    .train = {SG_TRAIN_DEFAULTS, .defense = {SG_DEFENSE_DEFAULTS, .rho = -1, .lambda = -1}},
    .save_every = 7000,
    .eval_every = 7000,
    .log_every = 100,
};

static double cpu_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Measures the test views; fps only on request. Where memory is short for that, the run goes on without. */
static int measure(struct train_run *r, int time_fps)
{
    const struct train_config *c = r->config;
    sg_renderer *renderer = NULL;
    int error = sg_trainer_renderer(r->trainer, &renderer);
    if (!error) {
        sg_eval_clear(r->ctx, &r->eval);
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
        say(stderr, "iteration %d: PSNR %.3f, SSIM %.4f on %zu test views\n", r->evaluated, r->eval.psnr, r->eval.ssim,
            r->eval.views);
    }
    return train_log_eval(r);
}

static int save(struct train_run *r)
{
    /* The log's line at a checkpoint carries the totals that a resumed run goes on from. */
    int code = train_log_step(r);
    if (!code)
        code = run_save_model(r->ctx, r->config->output, r->trainer);
    return code ? code : run_save_checkpoint(r->ctx, r->config->output, r->trainer);
}

/* Where time is short, a step goes over several iterations. */
static bool due(const struct train_run *r, int every)
{
    return every && r->step.iteration / every > r->before / every;
}

/* Everything that is due after an iteration; the end has its own. */
static int after_step(struct train_run *r)
{
    const struct sg_train_step *s = &r->step;
    const struct train_config *c = r->config;
    const bool last = s->iteration == c->train.iterations;
    int code = 0;
    progress_step(&r->progress, s);
    if (s->gaussians > r->totals.max_gaussians)
        r->totals.max_gaussians = s->gaussians;
    if (s->render.instances > r->totals.max_instances)
        r->totals.max_instances = s->render.instances;
    r->cloned += s->cloned, r->split += s->split, r->pruned += s->pruned;
    if (s->defense.filtered) {
        r->totals.filter_events++, r->totals.filter_removed += s->defense.removed;
        code = train_log_filter(r);
    }
    if (!code && (due(r, c->log_every) || last || s->iteration == 1))
        code = train_log_step(r);
    if (!code && due(r, c->save_every) && !last)
        code = save(r);
    if (!code && c->eval && due(r, c->eval_every) && !last)
        code = measure(r, 0);
    return code;
}

static int loop(struct train_run *r)
{
    int code = 0;
    while (!code && sg_trainer_iteration(r->trainer) < r->config->train.iterations && !interrupted()) {
        const double start = sg_seconds(), cpu = cpu_now();
        r->before = sg_trainer_iteration(r->trainer);
        const int error = sg_trainer_step(r->trainer, &r->step);
        r->totals.seconds += sg_seconds() - start;
        r->totals.cpu_seconds += cpu_now() - cpu;
        if (error) {
            /* The model so far is worth keeping; the checkpoint stays, for this iteration is half done. */
            progress_break(&r->progress);
            code = report(r->ctx, error);
            const int done = sg_trainer_iteration(r->trainer);
            if (done > 0 && !run_save_model(r->ctx, r->config->output, r->trainer)) {
                say(stderr, "the model of iteration %d is saved in %s\n", done, r->config->output);
                code = error == SG_ERR_BUDGET ? 0 : code; /* a smaller model than asked for, but a model */
            }
            r->error = error;
            if (train_summary_write(r) && !code)
                code = 2;
            return code;
        }
        code = after_step(r);
    }
    return code;
}

/* Ends the run: what there is, is saved, interrupted or not. */
static int finish(struct train_run *r)
{
    const bool cut = sg_trainer_iteration(r->trainer) < r->config->train.iterations;
    if (cut)
        progress_break(&r->progress);
    int code = save(r);
    if (!code && r->config->eval && !cut)
        code = measure(r, 1);
    if (!code)
        code = train_summary_write(r);
    if (!code && cut) {
        say(stderr, "interrupted at iteration %d; saved. Continue with: splatguard train --resume %s\n",
            sg_trainer_iteration(r->trainer), r->config->output);
        code = 130;
    }
    return code;
}

static int restore(struct train_run *r, const char *variant)
{
    char *path = run_path(r->config->output, "checkpoint.bin");
    if (!path)
        return 4;
    const int error = sg_trainer_load(r->trainer, path);
    free(path);
    if (error)
        return report(r->ctx, error);
    if (variant && strcmp(variant, sg_trainer_variant(r->trainer)))
        say(stderr, "warning: the run was made with %s and goes on with %s: results can differ in the last digits\n",
            variant, sg_trainer_variant(r->trainer));
    /* Iterations may have been raised. */
    return run_write_config(r->config, variant ? variant : sg_trainer_variant(r->trainer));
}

/* Trainer on the loaded scene, from points, a model or the checkpoint. */
static int start(struct train_run *r, const char *variant)
{
    const struct train_config *c = r->config;
    struct sg_model *initial = NULL;
    int error = 0, code = 0;
    r->config->train.max_seconds = c->max_time;
    if (c->init && !c->resume) /* the checkpoint has what became of it */
        error = sg_model_read_ply(r->ctx, c->init, UINT32_MAX, &initial);
    r->config->train.seconds_before = sg_seconds() - r->begun; /* reading photos and model */
    if (!error)
        error = sg_trainer_create(r->ctx, r->scene, initial, &c->train, &r->trainer);
    sg_model_destroy(r->ctx, &initial);
    if (error)
        return report(r->ctx, error);
    if (c->resume)
        code = restore(r, variant);
    else if ((error = sg_trainer_model(r->trainer, &initial)))
        code = report(r->ctx, error);
    else
        code = run_create(r->ctx, c, r->scene, initial, sg_trainer_variant(r->trainer));
    sg_model_destroy(r->ctx, &initial);
    r->totals.max_gaussians = sg_trainer_gaussians(r->trainer);
    return code ? code : train_log_open(r);
}

/* RUN's own options. The command line may say where the scene is now, ask for more iterations, and change what does not
 * touch the result; anything else that differs is refused. */
static int adopt_run(struct train_config *c, const bool *given, const char *argument, json_t **keep)
{
    struct train_config now = *c;
    const struct command *t = &command_train;
    now.source = now.output && argument ? argument : now.source;
    now.output = now.output ? now.output : argument;
    if (!now.output || now.force) {
        say(stderr, now.force ? "splatguard train: --resume and --force exclude each other\n"
                              : "splatguard train: --resume needs the run's folder\n");
        return 1;
    }
    *c = defaults;
    int code = run_read_config(now.output, c, keep);
    if (code)
        return code;
    c->output = now.output;
    c->resume = true;
    c->quiet = now.quiet;
    c->threads = now.threads;
    c->max_memory = options_given(t, given, T(max_memory)) ? now.max_memory : c->max_memory;
    c->source = now.source ? now.source : c->source;
    c->train.cpu = now.train.cpu ? now.train.cpu /* for a machine without the run's: the last digits may differ */
                                 : json_string_value(json_object_get(*keep, "cpu_variant"));
    if (now.train.iterations > c->train.iterations && options_given(t, given, T(train.iterations)))
        c->train.iterations = now.train.iterations;
    c->save_every = options_given(t, given, T(save_every)) ? now.save_every : c->save_every;
    c->eval_every = options_given(t, given, T(eval_every)) ? now.eval_every : c->eval_every;
    c->log_every = options_given(t, given, T(log_every)) ? now.log_every : c->log_every;
    now.source = c->source;
    return options_conflict(t, given, &now, c);
}

/* suspicion: 0..1, of the photos; decides only with preset auto. Its rho has few digits, so that config.json gives a
 * resumed run the same number. */
static void settle_defense(struct train_config *c, double suspicion)
{
    const struct {
        double rho, lambda;
    } presets[] = {[DEFENSE_AUTO] = {-round(1e6 * (0.1 + 0.35 * suspicion)) / 1e6, 6},
                   [DEFENSE_NS] = {0.03, 4},
                   [DEFENSE_TT] = {0.045, 4},
                   [DEFENSE_MIP] = {0.05, 5}};
    struct sg_defense_params *d = &c->train.defense;
    d->on = c->defense;
    d->rho = d->rho <= -1 ? presets[c->preset].rho : d->rho;
    d->lambda = d->lambda < 0 ? presets[c->preset].lambda : d->lambda;
}

/* With preset auto each photo is smoothed as much as it looks poisoned, and rho follows from all. */
static int settle_automatic(struct train_run *r, const struct sg_audit *found)
{
    double sum = 0;
    if (!(r->shares = malloc(found->count * sizeof(*r->shares)))) {
        say(stderr, "splatguard: out of memory\n");
        return 3;
    }
    for (size_t i = 0; i < found->count; i++) {
        const double suspicion = fmin(fmax((found->images[i].score - 0.3) / 0.6, 0), 1);
        r->shares[i] = (float) suspicion;
        sum += suspicion;
    }
    settle_defense(r->config, sum / (double) found->count);
    r->config->train.defense.shares = r->shares;
    return 0;
}

/* The parts of the configuration that follow from others. */
static void settle(struct train_config *c)
{
    static const char *const backends[] = {"cpu", "ref"};
    c->train.backend = backends[c->backend];
    c->train.cpu = cpu_variant(c->train.cpu);
    c->train.white_background = c->scene.params.white_background;
    c->scene.params.format = (enum sg_scene_format) c->scene.format;
    c->scene.params.eval = c->eval;
}

/* Says what was found, and does what --audit asks for. */
static int heed(struct train_config *c, const struct sg_audit *found)
{
    const bool clean = found->verdict == SG_AUDIT_CLEAN;
    if (!clean || !c->quiet)
        say(stderr, "%saudit: the photos look %s, score %.3f\n",
            clean ? "" : "warning: ", sg_audit_verdict_name(found->verdict), found->score);
    for (size_t i = 0; i < found->count_reasons && !clean; i++)
        say(stderr, "  %s\n", found->reasons[i]);
    if (c->audit == AUDIT_REFUSE && found->verdict == SG_AUDIT_POISONED) {
        say(stderr, "splatguard: %s: found poisoned photos, expected clean ones (--audit refuse)\n", c->source);
        return 2;
    }
    if (c->audit == AUDIT_DEFEND && !clean)
        c->defense = 1;
    return 0;
}

/* What the photos look like, and the defense that follows from it. A resumed run has decided whether there is one. */
static int audit(struct train_run *r)
{
    struct train_config *c = r->config;
    struct sg_audit *found = NULL;
    if (c->audit == AUDIT_OFF && !(c->defense && c->preset == DEFENSE_AUTO)) {
        settle_defense(c, 1);
        return 0;
    }
    const int error = sg_audit_scene(r->ctx, r->scene, &found);
    if (error)
        return report(r->ctx, error);
    r->audit = sg_audit_verdict_name(found->verdict), r->audit_score = found->score;
    int code = c->resume ? 0 : heed(c, found);
    if (!code && c->defense && c->preset == DEFENSE_AUTO)
        code = settle_automatic(r, found);
    else
        settle_defense(c, 1);
    sg_audit_destroy(r->ctx, &found);
    return code;
}

static int run_train(const void *config, const bool *given, const char *const *positional, int count)
{
    struct train_config c = *(const struct train_config *) config;
    struct train_run r = {.config = &c, .begun = sg_seconds()};
    json_t *keep = NULL;
    int code = 0;
    if (c.resume)
        code = adopt_run(&c, given, count ? positional[0] : NULL, &keep);
    else if (count)
        c.source = positional[0];
    if (!code && (!c.source || !c.output)) {
        say(stderr, "splatguard train: missing %s; usage: splatguard train %s\n", c.source ? "-o RUN" : "SCENE",
            command_train.arguments);
        code = 1;
    }
    if (!code && !c.resume && !c.force)
        code = run_refuse_earlier(c.output);
    if (code)
        goto done;
    settle(&c);
    if ((code = open_context(&r.ctx, c.threads, c.max_memory, c.quiet)))
        goto done;
    const int error = sg_scene_load(r.ctx, c.source, &c.scene.params, &r.scene);
    if (error) {
        code = report(r.ctx, error);
        goto done;
    }
    if (c.eval && !r.scene->n_test) {
        say(stderr, "splatguard: %s: found no test views, needed for --eval\n", c.source);
        code = 2;
        goto done;
    }
    if ((code = audit(&r)) || (code = start(&r, json_string_value(json_object_get(keep, "cpu_variant")))))
        goto done;
    interrupt_catch();
    progress_begin(&r.progress, c.quiet, sg_trainer_iteration(r.trainer), c.train.iterations);
    if (!(code = loop(&r)) && !r.error)
        code = finish(&r);
done:
    if (r.log && fclose(r.log) && !code)
        code = 2;
    if (r.ctx) {
        sg_eval_clear(r.ctx, &r.eval);
        sg_trainer_destroy(&r.trainer);
        sg_scene_destroy(r.ctx, &r.scene);
    }
    sg_ctx_destroy(&r.ctx);
    free(r.shares);
    json_decref(keep);
    return code;
}

const struct command command_train = {
    .name = "train",
    .arguments = "SCENE -o RUN [options]",
    .summary = "Trains a model from photos with known cameras.",
    .description =
        "Trains a 3D Gaussian Splatting model of SCENE (Blender, COLMAP or nerfstudio layout) into the folder "
        "RUN. Ctrl-C saves and exits; `train --resume RUN` continues.",
    .options = train_options,
    .config_size = sizeof(struct train_config),
    .defaults = &defaults,
    .max_positional = 1,
    .run = run_train,
};
