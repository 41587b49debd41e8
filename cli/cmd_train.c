/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "interrupt.h"
#include "output.h"
#include "scene/used.h"
#include "train_run.h"

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
    {0},
};

static const struct option_part train_parts[] = {{sg_run_options, T(run), NULL},
                                                 {sg_scene_options, T(run.scene), NULL},
                                                 {sg_train_options, T(run.train), NULL},
                                                 {0}};

static void defaults(void *config)
{
    *(struct train_config *) config = (struct train_config){.run = sg_run_params_default()};
}

/* RUN's own options. The command line may say where the scene is now, ask for more iterations, and
 * change what does not touch the result; anything else that differs is refused. What is left to the
 * preset does not differ. */
static int adopt_run(struct train_config *c, const bool *given, const char *argument, json_t **keep)
{
    struct train_config now = *c;
    const struct command *t = &command_train;
    if (now.run.folder && argument && take_scene(t, argument, &now.run.source))
        return STATUS_USAGE;
    now.run.folder = now.run.folder ? now.run.folder : argument;
    if (!now.run.folder || now.force) {
        say(stderr, now.force ? "splatguard train: --resume and --force exclude each other\n"
                              : "splatguard train: --resume needs the run's folder\n");
        return 1;
    }
    defaults(c);
    sg_ctx *ctx;
    int code = open_context(&ctx, 1, 0, now.quiet);
    if (!code)
        code = run_read_config(ctx, now.run.folder, &c->run, keep);
    sg_ctx_destroy(&ctx);
    if (code)
        return code;
    c->run.folder = now.run.folder;
    c->resume = true;
    c->proxy_of = now.proxy_of;
    c->quiet = now.quiet;
    c->threads = now.threads;
    c->run.max_memory =
        options_given(t, given, T(run.max_memory)) ? now.run.max_memory : c->run.max_memory;
    c->run.source = now.run.source ? now.run.source : c->run.source;
    c->run.scene.follow_links =
        now.run.scene.follow_links; /* leave is the user's to give, each time */
    c->run.scene.strict = now.run.scene.strict;
    c->run.train.cpu =
        now.run.train.cpu
            ? now.run.train.cpu /* for a machine without the run's: the last digits may differ */
            : json_string_value(json_object_get(*keep, "cpu_variant"));
    if (now.run.train.iterations > c->run.train.iterations &&
        options_given(t, given, T(run.train.iterations)))
        c->run.train.iterations = now.run.train.iterations;
    c->run.save_every =
        options_given(t, given, T(run.save_every)) ? now.run.save_every : c->run.save_every;
    c->run.eval_every =
        options_given(t, given, T(run.eval_every)) ? now.run.eval_every : c->run.eval_every;
    c->run.log_every =
        options_given(t, given, T(run.log_every)) ? now.run.log_every : c->run.log_every;
    now.run.source = c->run.source;
    train_settle_defense(&now, &c->run.train.defense);
    return options_conflict(t, given, &now, c);
}

/* The parts of the configuration that follow from others. */
static void settle(struct train_config *c)
{
    c->run.train.cpu = cpu_variant(c->run.train.cpu);
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
        code = take_scene(&command_train, positional[0], &c.run.source);
    if (!code && (!c.run.source || !c.run.folder)) {
        say(stderr, "splatguard train: missing %s; usage: splatguard train %s\n",
            c.run.source ? "-o RUN" : "SCENE", command_train.arguments);
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
                                       .inputs = {c.run.source, c.run.init}};
    if ((code = open_context(&r.ctx, c.threads, c.run.max_memory, c.quiet)) ||
        (code = train_check(&r, given)) ||
        (code = output_claim(&output, r.ctx, c.run.folder, &rules)))
        goto done;
    const int error = sg_scene_load(r.ctx, c.run.source, &c.run.scene, &r.scene);
    if (error) {
        code = report(r.ctx, error);
        goto done;
    }
    if (c.run.scene.eval &&
        !sg_views_used(r.scene->test, r.scene->n_test)) { /* nothing to measure */
        say(stderr, "splatguard: %s: found no test view with a used pixel, needed for --eval\n",
            c.run.source);
        code = 2;
        goto done;
    }
    if ((code = train_decide(&r)))
        goto done;
    interrupt_catch(); /* before anything is written */
    if ((code = train_start(&r, json_string_value(json_object_get(keep, "cpu_variant")))) ||
        r.finished)
        goto done;
    progress_begin(&r.progress, c.quiet, sg_trainer_iteration(r.trainer), c.run.train.iterations);
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
        run_forget(c.run.folder);
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
    .groups = "Run|Scene|Initialisation|Model and loss|Learning rates|Densification|Budgets|"
              "Defense|Rasteriser",
    .options = train_options,
    .parts = train_parts,
    .config_size = sizeof(struct train_config),
    .defaults = defaults,
    .max_positional = 1,
    .run = run_train,
};
