/* SPDX-License-Identifier: Apache-2.0 */
#include <limits.h>
#include <string.h>

#include "interrupt.h"
#include "model_views.h"
#include "progress.h"

struct prune_config {
    struct sg_prune_params prune;
    struct sg_scene_params scene;
    const char *scene_path, *output;
    int threads, iteration;
    uint64_t max_memory, max_vram;
    bool eval, json, quiet;
};

#define P(field) offsetof(struct prune_config, field)
#define GROUP .group = "Model and views"

static const struct sg_option prune_options[] = {
    TEXT_ROW("output", P(output), "OUT.ply",
             "File to write the pruned model to, in the format of its ending.", GROUP,
             .letter = 'o'),
    TEXT_ROW("scene", P(scene_path), "SCENE", "The photos and cameras; a run knows its own.", GROUP,
             .letter = 's'),
    FLAG_ROW("eval", P(eval),
             "Hold the test views out: score and fine-tune on the others; a run knows its own.",
             GROUP),
    NUMBER_ROW("iteration", SG_OPTION_INT, P(iteration), 0, 10000000, "N",
               "Which model of a run; 0 = the newest.", GROUP),
    NUMBER_ROW("threads", SG_OPTION_INT, P(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU. Results are the same.", GROUP, .letter = 'j'),
    MEMORY_ROW(struct prune_config, max_memory, GROUP),
    VRAM_ROW(struct prune_config, max_vram, GROUP),
    FLAG_ROW("json", P(json), "Print one JSON object.", GROUP),
    FLAG_ROW("quiet", P(quiet), "Warnings only.", GROUP, .letter = 'q'),
    {0},
};

static const struct option_part prune_parts[] = {
    {sg_prune_options, P(prune), NULL}, {sg_scene_options, P(scene), NULL}, {0}};

static void defaults(void *config)
{
    *(struct prune_config *) config = (struct prune_config){.prune = sg_prune_params_default(),
                                                            .scene = sg_scene_params_default()};
}

/* Refuses options of the scores that --method does not ask for. */
static int check_method(const struct prune_config *c, const bool *given)
{
    static const char *const groups[] = {[SG_PRUNER_LIGHTGAUSSIAN] = "LightGaussian",
                                         [SG_PRUNER_PUP] = "PUP 3D-GS",
                                         [SG_PRUNER_SPECTRAL] = "Spectral"};
    const struct sg_option *method = sg_option_find(sg_prune_options(), "method");
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(&command_prune, list);
    for (size_t i = 0; i < n; i++)
        for (int m = 0; m <= SG_PRUNER_SPECTRAL; m++)
            if (given[i] && m != (int) c->prune.method && !strcmp(list[i].row->group, groups[m])) {
                char found[16], expected[16];
                struct sg_prune_params other = c->prune;
                other.method = (enum sg_pruner) m;
                sg_option_get(method, &c->prune, found, sizeof(found));
                sg_option_get(method, &other, expected, sizeof(expected));
                say(stderr,
                    "splatguard prune: --%s: found with --method %s, expected --method %s with "
                    "it\n",
                    list[i].row->name, found, expected);
                return STATUS_USAGE;
            }
    return STATUS_DONE;
}

/* Plans give these to prunings of all kinds: not refused. */
static void warn_idle(const struct prune_config *c, const bool *given)
{
    const struct sg_prune_params *p = &c->prune;
    const bool limited = p->max_gaussians, volume = p->score == SG_GLOBAL_V_IMPORTANT,
               sum = p->score != SG_GLOBAL_COUNT && p->score != SG_GLOBAL_OPACITY;
    const char *no_device = vram_unused(p->engine, p->cpu);
    const struct {
        size_t offset;
        const char *option;
        bool idle;
        const char *why;
    } rules[] = {
        {P(prune.ratio), "ratio", limited, "with --max-gaussians"},
        {P(prune.second_ratio), "second-ratio", limited, "with --max-gaussians"},
        {P(prune.volume_power), "volume-power", !volume, "without --global-score v-important"},
        {P(prune.volume_clip), "volume-clip", !volume, "without --global-score v-important"},
        {P(prune.weight), "global-weight", !sum, "with --global-score count or opacity"},
        {P(prune.trained), "trained", !p->finetune, "with --finetune 0"},
        {P(prune.seed), "seed", !p->finetune && p->method != SG_PRUNER_SPECTRAL,
         "with --finetune 0"},
        {P(max_vram), "max-vram", no_device, no_device},
    };
    for (size_t i = 0; i < sizeof(rules) / sizeof(rules[0]); i++)
        if (rules[i].idle && options_given(&command_prune, given, rules[i].offset))
            warn_unused(rules[i].option, rules[i].why);
}

static int on_step(void *priv, const struct sg_train_step *step)
{
    struct progress *p = priv;
    if (step->iteration == 1) /* of each round; its time is that of the scores too */
        progress_begin(p, p->quiet, 1, p->iterations);
    progress_step(p, step);
    return interrupted();
}

static int say_result(const struct prune_config *c, const struct sg_prune_result *r, size_t left)
{
    if (c->json) {
        json_t *rounds = json_array();
        for (int i = 0; i < r->rounds; i++)
            json_array_append_new(
                rounds, json_pack("{s:I,s:I,s:I}", "before", (json_int_t) r->before[i], "removed",
                                  (json_int_t) r->removed[i], "unseen", (json_int_t) r->unseen[i]));
        return json_print(json_pack("{s:I,s:o}", "gaussians", (json_int_t) left, "rounds", rounds),
                          0);
    }
    if (!c->quiet) /* each round has logged what it removed */
        say(stdout, "%s: %zu Gaussians\n", c->output, left);
    return STATUS_DONE;
}

/* own_scene: what the run names, or NULL. */
static int prune(sg_ctx *ctx, struct prune_config *c, const char *path, const char *own_scene)
{
    struct sg_model *model = NULL, *pruned = NULL;
    struct sg_scene *scene = NULL;
    struct sg_prune_result result = {0};
    struct progress progress = {.quiet = c->quiet, .iterations = c->prune.finetune};
    struct sg_model_file file = sg_model_file_default();
    if (choose_format(&command_prune, c->output, &file.format))
        return STATUS_USAGE;
    interrupt_catch();
    int error = sg_output_check_file(ctx, c->output);
    if (!error)
        error = sg_model_read(ctx, path, UINT32_MAX, &model);
    if (!error)
        error = sg_model_check(ctx, model, path);
    if (!error)
        error = sg_scene_load(ctx, c->scene_path, &c->scene, &scene);
    if (!error) {
        c->prune.white_background = c->scene.white_background;
        c->prune.step = on_step, c->prune.step_priv = &progress;
        error = sg_prune(ctx, scene, model, &c->prune, &pruned, &result);
    }
    if (!error)
        error = sg_model_write(ctx, pruned, c->output, &file);
    const size_t left = pruned ? pruned->count : 0;
    sg_model_destroy(&model);
    sg_model_destroy(&pruned);
    sg_scene_destroy(&scene);
    if (error == SG_ERR_INTERRUPTED)
        progress_break(&progress);
    const int code =
        error ? report_option(ctx, &command_prune, error) : say_result(c, &result, left);
    if (error && c->scene_path == own_scene)
        say_moved(c->scene_path);
    return code;
}

/* A run knows how long its model was trained, and on which photos. */
static void adopt_training(struct prune_config *c, const struct sg_run_params *run,
                           const char *folder, const char *model, const bool *given)
{
    int iteration;
    adopt_scene_options(run, "Defense", &command_prune, given, c, &c->scene);
    if (!options_given(&command_prune, given, P(prune.trained)) &&
        sscanf(model + strlen(folder), "/point_cloud/iteration_%d/", &iteration) == 1)
        c->prune.trained = iteration;
    const struct sg_train_params *t = &run->train;
    const bool tolerant = t->tolerance > 0 || t->tolerance == SG_TOLERANCE_AUTO;
    if (c->prune.finetune && (t->defense.on || tolerant || run->audit == SG_RUN_AUDIT_DEFEND))
        say(stderr,
            "warning: the run was trained with a defense; fine-tuning learns from its photos "
            "without one, --finetune 0 does not\n");
}

static int run_prune(const void *config, const bool *given, const char *const *positional,
                     int count)
{
    (void) count;
    struct prune_config copy = *(const struct prune_config *) config, *c = &copy;
    struct sg_run_params run = sg_run_params_default();
    sg_ctx *ctx = NULL;
    char path[PATH_MAX];
    const bool is_run = is_folder(positional[0]);
    int code = check_method(c, given);
    if (!code) {
        warn_idle(c, given);
        code = open_engine_context(&ctx, c->threads, c->max_memory, c->max_vram, c->quiet);
    }
    if (!code)
        code = report(ctx, sg_run_find_model(ctx, positional[0], c->iteration, path, sizeof(path)));
    if (!code && is_run)
        code = adopt_run_scene(ctx, positional[0], &command_prune, given, c, &c->scene,
                               &c->scene_path, &run);
    if (!code && is_run && run.train.model != SG_MODEL_3DGS) {
        say(stderr,
            "splatguard prune: %s: found a run of another --model, expected one of 3dgs: scores "
            "and fine-tuning draw Gaussians as 3DGS does\n",
            positional[0]);
        code = STATUS_INPUT;
    }
    if (!code && is_run)
        adopt_training(c, &run, positional[0], path, given);
    if (!code && (!c->scene_path || !c->output))
        code = missing(&command_prune, c->scene_path ? "-o OUT.ply" : "--scene SCENE");
    if (!code)
        code = check_iteration(&command_prune, positional[0], c->iteration);
    c->scene.eval = c->eval || (is_run && run.scene.eval);
    c->prune.cpu = cpu_variant(c->prune.cpu);
    if (!code)
        code = prune(ctx, c, path, run.source);
    sg_ctx_destroy(&ctx);
    sg_run_params_clear(&run);
    return code;
}

const struct command command_prune = {
    .name = "prune",
    .arguments = "RUN|MODEL --scene SCENE -o OUT.ply [options]",
    .summary = "Removes Gaussians by a published score and trains what is left.",
    .description =
        "Scores the Gaussians of a trained model over the training views of SCENE, removes the "
        "lowest and trains the others without densification, as LightGaussian and PUP 3D-GS do; "
        "also with the score of the spectral defense. A run's folder brings its own scene options, "
        "--smooth and --trained.",
    .groups = "Pruning|Model and views|Scene|LightGaussian|PUP 3D-GS|Spectral|Defense",
    .options = prune_options,
    .parts = prune_parts,
    .config_size = sizeof(struct prune_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_prune,
};
