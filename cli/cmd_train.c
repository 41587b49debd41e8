/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "interrupt.h"
#include "output.h"
#include "scene/used.h"
#include "train_run.h"

#define T(field) offsetof(struct train_config, field)
#define INTEGER(name, field, low, high, help)                                                      \
    NUMBER_ROW(name, OPT_INT, T(field), low, high, "N", help)
#define RATE(name, field, help) NUMBER_ROW(name, OPT_FLOAT, T(train.field), 0, 1000, "X", help)

#define DOUBLE(name, field, low, high, help)                                                       \
    NUMBER_ROW(name, OPT_DOUBLE, T(train.defense.field), low, high, "X", help)

/* Choices are indices of enums. */
_Static_assert(SG_SIGMA_EIGEN == 1 && SG_HIT_VIEWS == 1 && SG_HIT_WEIGHT == 2 &&
                   SG_PRUNE_THRESHOLD == 1 && SG_VIEWS_ALL == 1 && SG_TV_NORM_L1 == 1 &&
                   SG_TV_NORM_HUBER == 2 && SG_ENERGY_AMPLITUDE == 1 && SG_CHANNELS_LUMA == 1,
               "the order of the defense's choices");

static const struct option train_options[] = {
    GROUP_ROW("Run"),
    TEXT_ROW("output", T(output), "RUN", "Folder to write the run to.", .letter = 'o',
             .transient = true),
    TEXT_ROW("model-path", T(output), "RUN", "The reference's name for --output.", .letter = 'm',
             .transient = true),
    TEXT_ROW("source-path", T(source), "SCENE", "The reference's way to name the scene.",
             .letter = 's'),
    INTEGER("iterations", train.iterations, 1, 10000000, "Training iterations."),
    NUMBER_ROW("seed", OPT_U64, T(train.seed), 0, 9e15, "S", "Seed of every random draw."),
    NUMBER_ROW("threads", OPT_INT, T(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU. Results are the same.", .letter = 'j',
               .transient = true),
    FLAG_ROW("eval", T(eval), "Hold the test views out and measure PSNR and SSIM on them."),
    FLAG_ROW("resume", T(resume),
             "Continue RUN from its checkpoint with its own options: same bytes as an "
             "uninterrupted run.",
             .transient = true),
    FLAG_ROW("force", T(force), "Replace an earlier run in the folder.", .transient = true),
    FLAG_ROW("quiet", T(quiet), "No progress.", .letter = 'q', .transient = true),
    INTEGER("save-every", save_every, 0, 10000000,
            "Save model and checkpoint every N iterations, unless --max-time makes steps of as "
            "many; 0 = at the end only."),
    INTEGER("eval-every", eval_every, 0, 10000000,
            "Measure the test views every N iterations, likewise; 0 = at the end only."),
    INTEGER("log-every", log_every, 1, 10000000, "Write a line to log.jsonl every N iterations."),
    CHOICE_ROW("engine", T(engine), ENGINES, "NAME", "cpu, or ref: the slow scalar oracle.",
               .alias = "backend"),
    TEXT_ROW("cpu", T(train.cpu), "VARIANT",
             "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU)."),
    SCENE_OPTIONS(struct train_config, scene, false),
    GROUP_ROW("Initialisation"),
    TEXT_ROW("init", T(init), "MODEL.ply", "Start from this model."),
    NUMBER_ROW("init-points", OPT_U64, T(train.init_points), 4, 1e8, "N",
               "Random points where the scene has none."),
    GROUP_ROW("Model and loss"),
    INTEGER("sh-degree", train.sh_degree, 0, 3, "Degree of the spherical harmonics."),
    INTEGER("sh-interval", train.sh_interval, 1, 10000000,
            "Iterations between raises of the degree in use."),
    FLAG_ROW("random-background", T(train.random_background),
             "A random background colour each iteration."),
    NUMBER_ROW("lambda-dssim", OPT_FLOAT, T(train.lambda_dssim), 0, 1, "X",
               "Weight of 1 - SSIM against L1."),
    GROUP_ROW("Learning rates"),
    RATE("position-lr-init", position_lr_init, "Position, at the start, in scene extents."),
    RATE("position-lr-final", position_lr_final, "Position, at the end, in scene extents."),
    INTEGER("position-lr-max-steps", train.position_lr_max_steps, 1, 1000000000,
            "Iterations between the two."),
    RATE("feature-lr", feature_lr, "Colour; higher SH degrees learn at a twentieth."),
    RATE("opacity-lr", opacity_lr, "Opacity."),
    RATE("scaling-lr", scaling_lr, "Scale."),
    RATE("rotation-lr", rotation_lr, "Rotation."),
    GROUP_ROW("Densification"),
    RATE("percent-dense", percent_dense,
         "Split Gaussians larger than this share of the extent, clone smaller ones."),
    INTEGER("densification-interval", train.densification_interval, 1, 10000000,
            "Iterations between densifications."),
    INTEGER("densify-from-iter", train.densify_from_iter, 0, 1000000000,
            "Densify after this iteration."),
    INTEGER("densify-until-iter", train.densify_until_iter, 0, 1000000000,
            "Densify before this iteration."),
    RATE("densify-grad-threshold", densify_grad_threshold,
         "Mean view-space gradient that makes a Gaussian grow."),
    INTEGER("opacity-reset-interval", train.opacity_reset_interval, 1, 1000000000,
            "Iterations between opacity resets."),
    GROUP_ROW("Budgets"),
    NUMBER_ROW("max-gaussians", OPT_U64, T(train.max_gaussians), 0, 4e9, "N",
               "Most Gaussians; at the limit, new ones take the place of those that the defense's "
               "filter scores lowest. 0 = no limit."),
    NUMBER_ROW("max-memory", OPT_BYTES, T(max_memory), 0, 9e15, "BYTES",
               "Most memory of the whole process, e.g. 1500M, 1.5G or 500MB: limits Gaussians and "
               "tile lists to what fits. 0 = no limit."),
    NUMBER_ROW("max-time", OPT_TIME, T(train.max_seconds), 0, 1e9, "TIME",
               "Most time until the model is trained, e.g. 90s, 10m or 1h30m: iterations are "
               "skipped so that the schedule still ends. 0 = no limit."),
    GROUP_ROW("Defense"),
    CHOICE_ROW("defense", T(defense), "off|spectral", "NAME",
               "Against poisoned photos: prune Gaussians of high frequency, keep renders smooth "
               "and even over directions."),
    CHOICE_ROW("audit", T(audit), "off|warn|refuse|defend", "MODE",
               "Look at the photos first (see `audit`): say what is found, refuse poisoned ones "
               "with exit status 5, or turn the defense on unless they are clean."),
    CHOICE_ROW("smooth", T(scene.params.smooth), "off|gaussian|bilateral", "FILTER",
               "Smooth the training photos after resizing, as a simple defense to compare with: "
               "Gaussian of 5 x 5 pixels, sigma 1.5; bilateral of diameter 9, both sigmas 75."),
    NUMBER_ROW("tolerance", OPT_FLOAT, T(tolerance), 0, 255, "LEVELS|auto",
               "The loss compares a render with the nearest image that differs from the photo by "
               "at most LEVELS grey levels, so that noise within them has no effect. auto: of each "
               "photo as much as the audit finds noise in it. preset: auto with --defense spectral "
               "--preset auto, else 0.",
               .words = "auto|preset"),
    CHOICE_ROW("preset", T(preset), "auto|ns|tt|mip", "NAME",
               "The paper's rho and lambda for NeRF-Synthetic, Tanks and Temples, Mip-NeRF 360; "
               "auto: a share of the run's own growth, and for each photo the more lambda the more "
               "it looks poisoned (see `audit`)."),
    DOUBLE("rho", rho, -1, 0.5,
           "Share of the Gaussians that the filter removes at a time, 0 to 0.5; from -0.9 to below "
           "0: that share of what grew of late; -1 = the preset's."),
    DOUBLE("rho-least", rho_least, -1, 0.5,
           "With a share of growth: what is removed at least when the filter begins, less and less "
           "until densification ends, and down to half of the first model, 0 to 0.5; -1 = the "
           "preset's, 0 with a --rho."),
    DOUBLE("filter-frequency", frequency, 0, 1e9,
           "Reference frequency t, cycles per scene unit; 0 = the preset's: 8, auto: 41.6 / the "
           "scene's extent."),
    DOUBLE("filter-exponent", exponent, 0, 100, "Exponent alpha of the frequency weight."),
    INTEGER("filter-views", train.defense.views, 1, 10000000,
            "Training views that hits are counted in."),
    INTEGER("filter-interval", train.defense.interval, 1, 10000000, "Iterations between removals."),
    INTEGER("filter-from", train.defense.from, -1, 1000000000,
            "Remove after this iteration; -1 = as densification."),
    INTEGER(
        "filter-until", train.defense.until, -1, 1000000000,
        "Remove before this iteration; -1 = as densification, with which a share of growth ends."),
    CHOICE_ROW(
        "filter-sigma", T(train.defense.sigma), "std|eigen", "NAME",
        "Size in the frequency weight: smallest scale, or its square (the smallest eigenvalue)."),
    CHOICE_ROW("filter-hits", T(train.defense.hit), "pixels|views|weight", "NAME",
               "Hits of a Gaussian: pixels it is blended in, views, or its weight in the pixels."),
    CHOICE_ROW("filter-rule", T(train.defense.rule), "exact|threshold", "NAME",
               "Remove exactly the share, or all up to the score there (LightGaussian's rule)."),
    CHOICE_ROW("filter-sample", T(train.defense.sample), "random|all", "NAME",
               "Views to count in: a new sample each time, or all."),
    DOUBLE("lambda", lambda, -1, 1e6,
           "Weight of the two losses on renders (auto: of photos that look poisoned, up to four "
           "times as much where they oscillate strongly); -1 = the preset's."),
    DOUBLE("anisotropy-scale", anisotropy_scale, 0, 1e6,
           "Times lambda: weight of the spectrum's anisotropy."),
    DOUBLE("tv-scale", tv_scale, 0, 1e6, "Times lambda: weight of the total variation."),
    CHOICE_ROW("tv-norm", T(train.defense.tv), "l2|l1|huber", "NAME",
               "Total variation: mean of squared or of absolute differences; huber: squared up to "
               "16 grey levels, then linear."),
    DOUBLE("band-low", spectrum.band.low, 0, 1,
           "Lower edge of the band, as a part of the Nyquist frequency."),
    DOUBLE("band-high", spectrum.band.high, 0, 1, "Upper edge of the band."),
    INTEGER("bins", train.defense.spectrum.band.bins, 2, SG_SPECTRUM_BINS_MAX,
            "Directions of the spectrum, even."),
    CHOICE_ROW("energy", T(train.defense.spectrum.energy), "power|amplitude", "NAME",
               "What a coefficient of the spectrum counts."),
    CHOICE_ROW("channels", T(train.defense.spectrum.channels), "sum|luma", "NAME",
               "Energy of all three channels, or of the luma."),
    FLAG_ROW("exact-spectrum", T(train.defense.spectrum.exact_size),
             "Transform awkward image sides as they are; by default they are continued to the next "
             "quick length."),
    GROUP_ROW("Rasteriser"),
    NUMBER_ROW("max-instances", OPT_U64, T(train.max_instances), 1, 4e9, "N",
               "(Gaussian, tile) pairs held at once; views with more are processed in bands, with "
               "the same result."),
    FLAG_ROW("reference-tiles", T(train.reference_tiles),
             "Keep every tile of the 3-sigma square, for parity checks."),
    {0},
};

static const struct train_config defaults = {
    .scene = {SCENE_OPTION_DEFAULTS},
    .train = {SG_TRAIN_DEFAULTS,
              .defense = {SG_DEFENSE_DEFAULTS, .rho = PRESET_RHO, .rho_least = PRESET_RHO_LEAST,
                          .lambda = PRESET_LAMBDA, .frequency = PRESET_FREQUENCY}},
    .tolerance = TOLERANCE_PRESET,
    .save_every = 7000,
    .eval_every = 7000,
    .log_every = 100,
};

/* RUN's own options. The command line may say where the scene is now, ask for more iterations, and
 * change what does not touch the result; anything else that differs is refused. What is left to the
 * preset does not differ. */
static int adopt_run(struct train_config *c, const bool *given, const char *argument, json_t **keep)
{
    struct train_config now = *c;
    const struct command *t = &command_train;
    if (now.output && argument && take_scene(t, argument, &now.source))
        return STATUS_USAGE;
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
    c->proxy_of = now.proxy_of;
    c->quiet = now.quiet;
    c->threads = now.threads;
    c->max_memory = options_given(t, given, T(max_memory)) ? now.max_memory : c->max_memory;
    c->source = now.source ? now.source : c->source;
    c->scene.params.follow_links =
        now.scene.params.follow_links; /* leave is the user's to give, each time */
    c->scene.params.strict = now.scene.params.strict;
    c->train.cpu =
        now.train.cpu
            ? now.train.cpu /* for a machine without the run's: the last digits may differ */
            : json_string_value(json_object_get(*keep, "cpu_variant"));
    if (now.train.iterations > c->train.iterations && options_given(t, given, T(train.iterations)))
        c->train.iterations = now.train.iterations;
    c->save_every = options_given(t, given, T(save_every)) ? now.save_every : c->save_every;
    c->eval_every = options_given(t, given, T(eval_every)) ? now.eval_every : c->eval_every;
    c->log_every = options_given(t, given, T(log_every)) ? now.log_every : c->log_every;
    now.source = c->source;
    train_settle_defense(&now, &c->train.defense);
    return options_conflict(t, given, &now, c);
}

/* The parts of the configuration that follow from others. */
static void settle(struct train_config *c)
{
    static const char *const engines[] = {"cpu", "ref"};
    c->train.engine = engines[c->engine];
    c->train.cpu = cpu_variant(c->train.cpu);
    c->train.white_background = c->scene.params.white_background;
    c->scene.params.format = (enum sg_scene_format) c->scene.format;
    c->scene.params.eval = c->eval;
}

static int run_train(const void *config, const bool *given, const char *const *positional,
                     int count)
{
    struct train_config c = *(const struct train_config *) config;
    struct train_run r = {.config = &c, .begun = sg_seconds()};
    struct output output = OUTPUT_NONE;
    json_t *keep = NULL;
    int code = 0;
    if (c.resume)
        code = adopt_run(&c, given, count ? positional[0] : NULL, &keep);
    else if (count)
        code = take_scene(&command_train, positional[0], &c.source);
    if (!code && (!c.source || !c.output)) {
        say(stderr, "splatguard train: missing %s; usage: splatguard train %s\n",
            c.source ? "-o RUN" : "SCENE", command_train.arguments);
        code = 1;
    }
    if (code)
        goto done;
    settle(&c);
    const struct output_rules rules = {.command = "train",
                                       .earlier = "run",
                                       .is_own = run_is_ours,
                                       .is_lost = run_is_lost,
                                       .within = "point_cloud/iteration_N",
                                       .force = c.force,
                                       .resume = c.resume,
                                       .nested = c.proxy_of != NULL,
                                       .inputs = {c.source, c.init}};
    if ((code = open_context(&r.ctx, c.threads, c.max_memory, c.quiet)) ||
        (code = train_check(&r, given)) || (code = output_claim(&output, r.ctx, c.output, &rules)))
        goto done;
    const int error = sg_scene_load(r.ctx, c.source, &c.scene.params, &r.scene);
    if (error) {
        code = report(r.ctx, error);
        goto done;
    }
    if (c.eval && !sg_views_used(r.scene->test, r.scene->n_test)) { /* nothing to measure */
        say(stderr, "splatguard: %s: found no test view with a used pixel, needed for --eval\n",
            c.source);
        code = 2;
        goto done;
    }
    if ((code = train_decide(&r)))
        goto done;
    interrupt_catch(); /* before anything is written */
    if ((code = train_start(&r, json_string_value(json_object_get(keep, "cpu_variant")))) ||
        r.finished)
        goto done;
    progress_begin(&r.progress, c.quiet, sg_trainer_iteration(r.trainer), c.train.iterations);
    code = train_whole(&r);
done:
    if (r.log && fclose(r.log) && !code)
        code = 2;
    if (r.ctx) {
        sg_eval_clear(&r.eval);
        sg_trainer_destroy(&r.trainer);
        sg_scene_destroy(&r.scene);
    }
    if (code && code != STATUS_INTERRUPTED && r.created && !r.saved)
        run_forget(c.output);
    output_release(&output);
    sg_ctx_destroy(&r.ctx);
    free(r.view_weights);
    free(r.tolerances);
    free(r.log_path);
    json_decref(keep);
    return code;
}

const struct command command_train = {
    .name = "train",
    .arguments = "SCENE -o RUN [options]",
    .summary = "Trains a model from photos with known cameras.",
    .description =
        "Trains a 3D Gaussian Splatting model of SCENE (Blender, COLMAP or nerfstudio layout) into "
        "the folder RUN. Ctrl-C saves and exits; `train --resume RUN` continues.",
    .options = train_options,
    .config_size = sizeof(struct train_config),
    .defaults = &defaults,
    .max_positional = 1,
    .run = run_train,
};
