/* SPDX-License-Identifier: Apache-2.0 */
#include <limits.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"
#include "interrupt.h"
#include "published.h"
#include "train_view.h"

struct train_config {
    struct sg_run_params run;
    bool resume, force, quiet, view;
    bool unnamed; /* the scene is the one that the run names */
    int threads, port, published;
};

#define T(field) offsetof(struct train_config, field)

static const struct sg_option train_options[] = {
    TEXT_ROW("output", T(run.folder), "RUN", "Folder to write the run to.", .group = "Run",
             .letter = 'o'),
    TEXT_ROW("model-path", T(run.folder), "RUN", "The reference's name for --output.",
             .group = "Run", .letter = 'm', .expert = true),
    NUMBER_ROW("threads", SG_OPTION_INT, T(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU. Results are the same.", .group = "Run",
               .letter = 'j'),
    FLAG_ROW("resume", T(resume),
             "Continue RUN from its checkpoint with its own options: same bytes as an "
             "uninterrupted run.",
             .group = "Run"),
    FLAG_ROW("force", T(force), "Replace an earlier run in the folder.", .group = "Run"),
    FLAG_ROW("quiet", T(quiet), "No progress.", .group = "Run", .letter = 'q'),
    CHOICE_ROW("published", T(published), PUBLISHED_SETS, "DATA",
               "The settings with which the model or strategy was published, where no option says "
               "otherwise: for NeRF-Synthetic, outdoor or indoor scenes of Mip-NeRF 360, Tanks and "
               "Temples, Deep Blending, BungeeNeRF, or as a victim of Poison-splat.",
               .group = "Model and loss", .expert = true),
    FLAG_ROW("view", T(view),
             "Print the address of a page that shows the training, and can pause and stop it.",
             .group = "Run"),
    NUMBER_ROW("port", SG_OPTION_INT, T(port), 0, 65535, "N",
               "Port of that page; 0 = any that is free.", .group = "Run", .expert = true),
    {0},
};

static const struct option_part train_parts[] = {{sg_run_options, T(run), NULL},
                                                 {sg_scene_options, T(run.scene), NULL},
                                                 {sg_train_options, T(run.train), NULL},
                                                 {0}};

static const struct option_hint train_hints[] = {
    {"save-iterations", "--save-every N saves every N iterations"},
    {"checkpoint-iterations", "--save-every N saves every N iterations"},
    {"test-iterations", "--eval-every N measures every N iterations"},
    {"start-checkpoint", "train --resume RUN goes on from a checkpoint"},
    {"data-device", "photos stay in memory, within --max-memory"},
    {"optimizer-type", "there is one optimiser, Adam"},
    {"train-test-exp", "--exposure --test-halves does the same"},
    {"depths", "there is no training with depth maps"},
    {0},
};

static void defaults(void *config)
{
    *(struct train_config *) config = (struct train_config){.run = sg_run_params_default()};
}

/* Plans give these to runs of all kinds: not refused. */
static void warn_idle(const struct train_config *c, const bool *given)
{
    const struct command *t = &command_train;
    const struct sg_train_params *p = &c->run.train;
    const bool scaffold = p->model == SG_MODEL_SCAFFOLD, mcmc = p->strategy == SG_STRATEGY_MCMC;
    const char *no_device = vram_unused(p->engine, p->cpu);
    if (no_device && options_given(t, given, T(run.max_vram)))
        warn_unused("max-vram", no_device);
    if (!c->run.scene.eval && options_given(t, given, T(run.scene.test_every)))
        warn_unused("test-every", "without --eval");
    if (!c->run.scene.eval && options_given(t, given, T(run.eval_every)))
        warn_unused("eval-every", "without --eval");
    if (scaffold && options_given(t, given, T(run.train.sh_interval)))
        warn_unused("sh-interval", "with --model scaffold");
    if ((scaffold || mcmc) && options_given(t, given, T(run.train.opacity_reset_interval)))
        warn_unused("opacity-reset-interval",
                    scaffold ? "with --model scaffold" : "with --strategy mcmc");
    if (mcmc && !p->defense.on && p->tolerance <= 0 && p->tolerance != SG_TOLERANCE_AUTO &&
        options_given(t, given, T(run.train.densify_until_iter)))
        warn_unused("densify-until-iter", "with --strategy mcmc, which has --mcmc-until");
}

static int check_options(const struct train_config *c, const bool *given)
{
    if (!c->view && options_given(&command_train, given, T(port))) {
        say(stderr, "splatguard train: --port: found without --view, expected with it\n");
        return STATUS_USAGE;
    }
    struct option_place list[OPTIONS_MAX];
    const size_t n = c->resume ? 0 : options_list(&command_train, list);
    for (size_t i = 0; i < n; i++) {
        const char *unused = given[i] ? sg_run_option_unused(&c->run, list[i].row) : NULL;
        if (unused) {
            say(stderr, "splatguard train: --%s: %s\n", list[i].row->name, unused);
            return STATUS_USAGE;
        }
    }
    warn_idle(c, given);
    /* A run of such an audit that found clean photos has no defense, and may be told so. */
    if (!c->resume && c->run.audit == SG_RUN_AUDIT_DEFEND && !c->run.train.defense.on &&
        options_given(&command_train, given, T(run.train.defense.on))) {
        say(stderr, "splatguard train: --defense off and --audit defend exclude each other\n");
        return STATUS_USAGE;
    }
    return STATUS_DONE;
}

/* A run that found no room for its first checkpoint has none. */
static bool has_checkpoint(const char *folder)
{
    char path[PATH_MAX];
    snprintf(path, sizeof(path), "%s/checkpoint.bin", folder);
    return !access(path, F_OK);
}

/* RUN's own options. The command line may say where the scene is now, ask for more iterations, and
 * change what does not touch the result; anything else that differs is refused. */
static int adopt_run(struct train_config *c, const bool *given, const char *argument)
{
    struct train_config now = *c;
    const struct command *t = &command_train;
    struct sg_run_params *run = &c->run, *p = &now.run;
    if (p->folder && argument && has_checkpoint(argument)) {
        say(stderr,
            "splatguard train: --resume: found the run %s and -o %s, expected one of them\n",
            argument, p->folder);
        return STATUS_USAGE;
    }
    if (p->folder && argument && take_scene(t, argument, &p->source))
        return STATUS_USAGE;
    p->folder = p->folder ? p->folder : argument;
    if (!p->folder || now.force) {
        say(stderr, now.force ? "splatguard train: --resume and --force exclude each other\n"
                              : "splatguard train: --resume needs the run's folder\n");
        return STATUS_USAGE;
    }
    if (now.published) {
        say(stderr, "splatguard train: --resume and --published exclude each other\n");
        return STATUS_USAGE;
    }
    sg_ctx *ctx;
    int code = open_context(&ctx, 1, 0, now.quiet);
    if (!code)
        code = report(ctx, sg_run_read_params(ctx, p->folder, run));
    sg_ctx_destroy(&ctx);
    if (code)
        return code;
    c->unnamed = !p->source;
    run->source = p->source ? p->source : run->source;
    run->scene.follow_links = p->scene.follow_links; /* permission is given anew for each run */
    run->scene.strict = p->scene.strict;
    /* For a machine without the run's: the last digits may differ. A variant is one of an engine.
     */
    if (options_given(t, given, T(run.train.engine)))
        run->train.engine = p->train.engine, run->train.cpu = NULL;
    if (p->train.cpu)
        run->train.cpu = p->train.cpu;
    if (options_given(t, given, T(run.train.iterations))) {
        if (p->train.iterations < run->train.iterations) {
            say(stderr,
                "splatguard train: --iterations: found %d, expected at least %d, those of the "
                "run\n",
                p->train.iterations, run->train.iterations);
            return STATUS_USAGE;
        }
        run->train.iterations = p->train.iterations;
    }
    if (options_given(t, given, T(run.train.max_seconds)))
        run->train.max_seconds = p->train.max_seconds;
    if (options_given(t, given, T(run.max_memory)))
        run->max_memory = p->max_memory;
    if (options_given(t, given, T(run.max_vram)))
        run->max_vram = p->max_vram;
    if (options_given(t, given, T(run.save_every)))
        run->save_every = p->save_every;
    if (options_given(t, given, T(run.eval_every)))
        run->eval_every = p->eval_every;
    if (options_given(t, given, T(run.log_every)))
        run->log_every = p->log_every;
    p->source = run->source;
    return options_conflict(t, given, &now, c);
}

struct stepping {
    struct progress progress;
    struct train_view *view; /* or NULL */
};

/* Called before anything is written, and after each iteration. */
static int on_step(void *priv, const struct sg_train_step *step)
{
    struct stepping *s = priv;
    interrupt_by_steps();
    if (step)
        progress_step(&s->progress, step);
    return (step && s->view && train_view_step(s->view, &s->progress, step)) || interrupted();
}

/* Prints how the run ended. */
static void say_end(const struct train_config *c, const struct sg_run_status *s, int error)
{
    const bool kept = error && error != SG_ERR_INTERRUPTED;
    if (s->ended_by == SG_ERR_BUDGET && !error)
        say_limit("");
    if ((kept || s->ended_by) && s->saved)
        say(stderr, "the model of iteration %d is saved in %s\n", s->saved, c->run.folder);
    else if (!error && s->saved && !c->quiet)
        say(stderr, "%s/point_cloud/iteration_%d/point_cloud.ply\n", c->run.folder, s->saved);
    if ((!error || error == SG_ERR_INTERRUPTED) && !s->ended_by && s->limits.time_bound)
        say(stderr, "time was short: %llu of %d iterations were done, on the schedule of all\n",
            (unsigned long long) s->limits.steps, s->iteration);
}

static int train(sg_ctx *ctx, struct train_config *c, struct train_view *view)
{
    sg_run *run;
    struct sg_run_status s;
    struct stepping stepping = {.progress.quiet = true, .view = view};
    struct progress *progress = &stepping.progress;
    c->run.step = on_step, c->run.step_priv = &stepping;
    const enum sg_run_start start = c->resume  ? SG_RUN_RESUME
                                    : c->force ? SG_RUN_REPLACE
                                               : SG_RUN_NEW;
    interrupt_catch();
    int error = sg_run_open(ctx, &c->run, start, &run);
    if (error) {
        const int code = report_option(ctx, &command_train, error);
        if (start == SG_RUN_NEW && strstr(sg_last_error(ctx), "found an earlier run"))
            say(stderr, "%s--force replaces it\n",
                has_checkpoint(c->run.folder) ? "--resume continues it, " : "");
        if (c->unnamed)
            say_moved(c->run.source);
        return code;
    }
    sg_run_status(run, &s);
    if (s.finished) {
        if (s.limits.steps < (uint64_t) s.iteration)
            say(stderr,
                "%s: time was short: %llu iterations were done, and the schedule of all %d is "
                "complete; a longer training begins anew (--force)\n",
                c->run.folder, (unsigned long long) s.limits.steps, s.iteration);
        else
            say(stderr, "%s: all %d iterations are done; --iterations asks for more\n",
                c->run.folder, s.iteration);
        sg_run_close(&run);
        return STATUS_DONE;
    }
    if (view && train_view_begin(view, ctx, run, &c->run)) {
        sg_run_close(&run);
        return STATUS_BUDGET;
    }
    progress_begin(progress, c->quiet, s.iteration, s.iterations);
    error = sg_run_train(run);
    sg_run_status(run, &s);
    if (s.iteration < s.iterations)
        progress_break(progress);
    report(ctx, error);
    say_end(c, &s, error);
    if (error == SG_ERR_INTERRUPTED && s.resumable)
        say_resume("train", c->run.folder);
    sg_run_close(&run);
    return exit_code(error);
}

static int run_train(const void *config, const bool *given, const char *const *positional,
                     int count)
{
    struct train_config c = *(const struct train_config *) config;
    sg_ctx *ctx = NULL;
    struct train_view *view = NULL;
    int code = 0;
    if (count > 1)
        code = refuse_second(&command_train, c.resume, positional);
    else if (c.resume)
        code = adopt_run(&c, given, count ? positional[0] : NULL);
    else if (count)
        code = take_scene(&command_train, positional[0], &c.run.source);
    if (!code && (!c.run.source || !c.run.folder))
        code = missing(&command_train, c.run.source ? "-o RUN" : "SCENE");
    if (!code)
        code = published_apply(&command_train, c.published, c.run.train.model, c.run.train.strategy,
                               given, &c);
    if (!code)
        code = check_options(&c, given);
    c.run.train.cpu = cpu_variant(c.run.train.cpu);
    if (!code)
        code = open_engine_context(&ctx, c.threads, c.run.max_memory, c.run.max_vram, c.quiet);
    if (!code)
        code = c.view ? train_view_open(c.port, &view) : STATUS_DONE;
    if (!code)
        code = train(ctx, &c, view);
    train_view_close(&view);
    sg_ctx_destroy(&ctx);
    sg_run_params_clear(&c.run);
    return code;
}

const struct command command_train = {
    .name = "train",
    .arguments = "SCENE -o RUN [options]",
    .summary = "Trains a model from photos with known cameras.",
    .description = "Trains a 3D Gaussian Splatting model of SCENE (Blender, COLMAP or nerfstudio "
                   "layout, a folder "
                   "or a zip archive of it) into the folder RUN. Ctrl-C saves and exits; `train "
                   "--resume RUN` continues. --view prints the "
                   "address of a page that shows it.",
    .groups = "Run|Scene|Initialisation|Model and loss|Learning rates|Densification|Budgets|"
              "Defense|Rasteriser",
    .options = train_options,
    .parts = train_parts,
    .hints = train_hints,
    .config_size = sizeof(struct train_config),
    .defaults = defaults,
    .max_positional = 2, /* to say what is wrong with the second */
    .run = run_train,
};
