/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard attack: proxy, decoy, poisons. While it runs, POISONED/attack holds the proxy's run,
 * the checkpoint and the log; poison.json comes last and marks a finished attack. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "attack_run.h"
#include "core/file.h"
#include "interrupt.h"
#include "output.h"

#define A(field) offsetof(struct attack_config, field)
#define INTEGER(name, field, low, high, help)                                                      \
    NUMBER_ROW(name, OPT_INT, A(field), low, high, "N", help)
#define RATE(name, field, help) NUMBER_ROW(name, OPT_FLOAT, A(attack.field), 0, 1, "X", help)

/* Choices are indices of enums. */
_Static_assert(SG_TV_ANISO == 1 && SG_TV_ISO == 2 && SG_POISON_PNG == 1 && SG_POISON_JPEG == 2,
               "the order of the attack's choices");

static const struct option attack_options[] = {
    GROUP_ROW("Run"),
    TEXT_ROW("output", A(output), "POISONED", "Folder to write the poisoned scene to.",
             .letter = 'o', .transient = true),
    TEXT_ROW("source-path", A(source), "SCENE", "Another way to name the scene.", .letter = 's'),
    NUMBER_ROW("seed", OPT_U64, A(attack.seed), 0, 9e15, "S", "Seed of every random draw."),
    NUMBER_ROW("threads", OPT_INT, A(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU. Results are the same.", .letter = 'j',
               .transient = true),
    NUMBER_ROW("max-memory", OPT_BYTES, A(max_memory), 0, 9e15, "BYTES",
               "Most memory of the whole process, e.g. 1500M: limits the decoy to what fits. 0 = "
               "no limit."),
    FLAG_ROW(
        "resume", A(resume),
        "Continue an interrupted attack with its own options: same bytes as an uninterrupted one.",
        .transient = true),
    FLAG_ROW("force", A(force), "Replace an earlier attack in the folder.", .transient = true),
    FLAG_ROW("quiet", A(quiet), "No progress.", .letter = 'q', .transient = true),
    INTEGER("save-every", save_every, 0, 10000000,
            "Save a checkpoint every N iterations; 0 = when interrupted only."),
    CHOICE_ROW("engine", A(engine), ENGINES, "NAME", "cpu, or ref: the slow scalar oracle.",
               .alias = "backend"),
    TEXT_ROW("cpu", A(attack.cpu), "VARIANT",
             "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU)."),
    GROUP_ROW("Scene"),
    SCENE_PLACE_ROWS(struct attack_config, scene, false),
    NUMBER_ROW("downscale", OPT_DOUBLE, A(scene.params.downscale), 1, 64, "F",
               "Divides the image size further; the poisoned images have the reduced size."),
    NUMBER_ROW("test-every", OPT_INT, A(scene.params.test_every), 2, 1000000, "N",
               "With --views train: every N-th view by name is a test view (COLMAP, nerfstudio)."),
    SCENE_LENS_ROWS(struct attack_config, scene, false),
    CHOICE_ROW("views", A(views), "all|train", "WHICH",
               "Poison all views of COLMAP and nerfstudio scenes, or leave the test views clean. "
               "Blender's test file always stays clean."),
    GROUP_ROW("Attack"),
    CHOICE_ROW("method", A(method), "poison-splat|noise|tv-per-view|drift", "NAME",
               "Poison-splat, or an attack on each photo alone: noise of +-epsilon, ascent of its "
               "total variation, or a smooth drift of its brightness."),
    NUMBER_ROW("wavelength", OPT_FLOAT, A(attack.wavelength), 0, 1e6, "PIXELS",
               "Of the drift; from the photo's size on it looks like a change of exposure. 0 = the "
               "photo's longer side."),
    TEXT_ROW("epsilon", A(epsilon), "LEVELS",
             "Bound on every value's change in whole grey levels (8, 16, 24), or inf."),
    CHOICE_ROW("preset", A(preset), "auto|ns|mip|tt", "NAME",
               "The published schedules for NeRF-Synthetic, Mip-NeRF 360, Tanks and Temples; auto: "
               "ns for Blender scenes, else mip."),
    INTEGER("iterations", iterations, 0, 10000000,
            "Views visited; 0 = the preset's (6000 to 36000)."),
    INTEGER("inner", inner, 0, 1000,
            "Ascent steps a visit; 0 = the preset's (15 or 25; tv-per-view 100)."),
    INTEGER(
        "update-interval", update_interval, 0, 1000,
        "Views whose gradients are summed for one step of the decoy; 0 = the preset's (1 or 10)."),
    NUMBER_ROW("step", OPT_FLOAT, A(grey_step), 0, 255, "LEVELS",
               "Size of an ascent step in grey levels."),
    CHOICE_ROW("tv", A(tv), "vertical2|aniso|iso", "FORM",
               "Total variation to raise: vertical differences only, as published; both "
               "directions; root of their squares."),
    NUMBER_ROW("spectral-weight", OPT_FLOAT, A(attack.spectral_weight), 0, 1e6, "X",
               "Against a spectral defense: also keep the poison's energy even over directions; 1 "
               "= a mean gradient as of one neighbour's difference."),
    NUMBER_ROW(
        "scale-floor", OPT_FLOAT, A(attack.scale_floor), 0, 1e6, "X",
        "Against a filter of thin Gaussians: smallest scale in the decoy, scene units; 0 = none."),
    NUMBER_ROW("ratio", OPT_FLOAT, A(ratio), 0, 1, "X",
               "Poison only this share of the views, drawn by seed."),
    NUMBER_ROW("spare", OPT_FLOAT, A(spare), 0, 1, "X",
               "Against an audit: leave this share of each photo, from the left, as it is."),
    NUMBER_ROW("victim-tolerance", OPT_FLOAT, A(attack.victim_tolerance), 0, 255, "LEVELS",
               "Against training with --tolerance LEVELS: the decoy learns as such a victim does, "
               "and poisons go beyond what it shows, within the bound."),
    NUMBER_ROW("texture", OPT_FLOAT, A(attack.texture), 0, 255, "LEVELS",
               "Against an audit: where neighbouring values of the clean photo differ by less than "
               "LEVELS on average (within 3 pixels), the bound shrinks in proportion, to 0 in flat "
               "parts; 0 = epsilon everywhere."),
    GROUP_ROW("Proxy and decoy"),
    TEXT_ROW("proxy", A(proxy), "MODEL",
             "A model of the clean scene (PLY or run folder); else one is trained."),
    INTEGER("proxy-iterations", proxy_iterations, 1, 10000000,
            "Iterations of the proxy that is trained."),
    FLAG_ROW("keep-decoy", A(keep_decoy), "Save the decoy as attack/decoy.ply.", .transient = true),
    FLAG_ROW("move-positions", A(attack.move_positions),
             "Let the decoy's positions learn; the published attack freezes them."),
    NUMBER_ROW("lambda-dssim", OPT_FLOAT, A(attack.lambda_dssim), 0, 1, "X",
               "Weight of 1 - SSIM against L1."),
    RATE("feature-lr", feature_lr, "Colour; higher SH degrees learn at a twentieth."),
    RATE("opacity-lr", opacity_lr, "Opacity."),
    RATE("scaling-lr", scaling_lr, "Scale."),
    RATE("rotation-lr", rotation_lr, "Rotation."),
    RATE("percent-dense", percent_dense,
         "Split Gaussians larger than this share of the extent, clone smaller ones."),
    INTEGER("densification-interval", attack.densification_interval, 1, 10000000,
            "Iterations between densifications."),
    NUMBER_ROW("densify-grad-threshold", OPT_FLOAT, A(attack.densify_grad_threshold), 0, 1000, "X",
               "Mean view-space gradient that makes a Gaussian grow."),
    NUMBER_ROW("max-gaussians", OPT_U64, A(attack.max_gaussians), 0, 4e9, "N",
               "Growth of the decoy stops there; 0 = no limit."),
    NUMBER_ROW("max-instances", OPT_U64, A(attack.max_instances), 1, 4e9, "N",
               "(Gaussian, tile) pairs held at once; views with more are processed in bands, with "
               "the same result."),
    GROUP_ROW("Files"),
    CHOICE_ROW(
        "save", A(save), "auto|png|jpg", "FORMAT",
        "auto: JPEG for COLMAP scenes, as published, else PNG. JPEG does not keep the bound."),
    INTEGER("jpeg-quality", files.jpeg_quality, 1, 100, "JPEG quality."),
    CHOICE_ROW("jpeg-chroma", A(chroma), "420|444", "FORMAT", "JPEG chroma subsampling."),
    {0},
};

static const struct attack_config defaults = {
    .epsilon = "16",
    .scene = {SCENE_OPTION_DEFAULTS},
    .attack = {SG_ATTACK_DEFAULTS},
    .files = {SG_POISON_FILE_DEFAULTS},
    .grey_step = 2,
    .proxy_iterations = 30000,
    .save_every = 5000,
    .ratio = 1,
};

/* The published schedules by experiment: see docs/attack.md. */
static void apply_preset(struct attack_config *c, enum sg_scene_format format)
{
    struct schedule {
        int iterations, inner, update_interval;
    };
    const bool bounded = isfinite(c->attack.epsilon), strong = c->attack.epsilon > 20 / 255.0f;
    const struct schedule ns = !bounded ? (struct schedule){6000, 25, 10}
                               : strong ? (struct schedule){24000, 25, 1}
                                        : (struct schedule){36000, 15, 1};
    const struct schedule mip =
        bounded ? (struct schedule){12000, 25, 1} : (struct schedule){6000, 25, 1};
    const struct schedule tt =
        bounded ? (struct schedule){36000, 25, 1} : (struct schedule){6000, 25, 10};
    enum attack_preset preset = (enum attack_preset) c->preset;
    if (preset == PRESET_AUTO)
        preset = format == SG_FORMAT_BLENDER ? PRESET_NS : PRESET_MIP;
    const struct schedule s = preset == PRESET_NS ? ns : preset == PRESET_MIP ? mip : tt;
    c->attack.iterations = c->iterations ? c->iterations : s.iterations;
    c->attack.inner = c->inner ? c->inner : c->method == METHOD_TV_PER_VIEW ? 100 : s.inner;
    c->attack.update_interval = c->update_interval ? c->update_interval : s.update_interval;
}

/* An option that would have no effect. */
static int refuse_vain(const struct attack_config *c)
{
    const struct {
        const char *option, *methods;
        bool vain;
    } rules[] = {
        {"epsilon inf", "poison-splat",
         !isfinite(c->attack.epsilon) && c->method != METHOD_POISON_SPLAT},
        {"victim-tolerance", "poison-splat",
         c->attack.victim_tolerance > 0 && c->method != METHOD_POISON_SPLAT},
        {"texture", "poison-splat, noise or tv-per-view",
         c->attack.texture > 0 && c->method == METHOD_DRIFT},
        {"wavelength", "drift", c->attack.wavelength > 0 && c->method != METHOD_DRIFT},
    };
    for (size_t i = 0; i < sizeof(rules) / sizeof(rules[0]); i++)
        if (rules[i].vain) {
            say(stderr, "splatguard attack: --%s goes with --method %s only\n", rules[i].option,
                rules[i].methods);
            return 1;
        }
    return 0;
}

/* The parts of the configuration that follow from others. */
static int settle(struct attack_config *c)
{
    static const char *const engines[] = {"cpu", "ref"};
    char *end;
    const double levels = strtod(c->epsilon, &end);
    if (end == c->epsilon || *end || !(levels >= 0) ||
        (isfinite(levels) && (levels > 255 || levels != floor(levels)))) {
        say(stderr,
            "splatguard attack: --epsilon: found \"%s\", expected a whole number of grey levels, 0 "
            "to 255, or inf\n",
            c->epsilon);
        return 1;
    }
    c->attack.epsilon = (float) (levels / 255);
    c->attack.step = c->grey_step / 255;
    c->attack.tv = (enum sg_tv_form) c->tv;
    c->attack.engine = engines[c->engine];
    c->attack.cpu = cpu_variant(c->attack.cpu);
    c->files.save = (enum sg_poison_save) c->save;
    c->files.full_chroma = c->chroma == 1;
    c->scene.params.format = (enum sg_scene_format) c->scene.format;
    return refuse_vain(c);
}

static bool is_attack(const char *folder)
{
    return run_options_in(folder, "attack/config.json", "epsilon") ||
           run_options_in(folder, "poison.json", "epsilon");
}

/* Nothing in it to go on from, and nothing to use. */
static bool is_lost(const char *folder)
{
    return !run_has(folder, "poison.json") && !run_has(folder, "attack/checkpoint.bin") &&
           !run_has(folder, "attack/proxy");
}

/* Its last file is there, and nothing to go on from. */
static bool is_finished(const char *output)
{
    return run_has(output, "poison.json") && !run_has(output, "attack/checkpoint.bin");
}

static void remove_earlier(const char *output)
{
    static const char *const files[] = {
        "poison.json",      "attack/checkpoint.bin",     "attack/log.jsonl",
        "attack/decoy.ply", "attack/proxy/summary.json", "attack/proxy/checkpoint.bin"};
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
        char *path = run_path(output, files[i]);
        if (path)
            unlink(path);
        free(path);
    }
}

/* The attack's own options; the command line may change what does not touch the result. */
static int adopt(struct attack_config *c, const bool *given, const char *argument, json_t **keep)
{
    struct attack_config now = *c;
    const char *output = now.output ? now.output : argument;
    if (!output || now.force) {
        say(stderr, now.force ? "splatguard attack: --resume and --force exclude each other\n"
                              : "splatguard attack: --resume needs the poisoned folder\n");
        return 1;
    }
    char *path = run_path(output, "attack/config.json");
    *keep = path ? run_read_json(path, "config.json of an attack") : NULL;
    *c = defaults;
    const int code =
        !*keep || options_from_json(&command_attack, c, json_object_get(*keep, "options"), path)
            ? 2
            : 0;
    free(path);
    if (code)
        return code;
    c->output = output;
    c->resume = true;
    c->scene.params.follow_links =
        now.scene.params.follow_links; /* leave is the user's to give, each time */
    c->scene.params.strict = now.scene.params.strict;
    c->quiet = now.quiet, c->threads = now.threads, c->keep_decoy = now.keep_decoy;
    c->max_memory =
        options_given(&command_attack, given, A(max_memory)) ? now.max_memory : c->max_memory;
    if (now.output && argument && take_scene(&command_attack, argument, &now.source))
        return STATUS_USAGE;
    c->source = now.source = now.source ? now.source : c->source;
    c->proxy = now.proxy = now.proxy ? now.proxy : c->proxy;
    return options_conflict(&command_attack, given, &now, c);
}

static int write_config(const struct attack_config *c)
{
    char *path = run_path(c->output, "attack/config.json");
    json_t *options = options_to_json(&command_attack, c);
    json_object_set_new(options, "source-path", run_place_json(c->source));
    if (c->proxy)
        json_object_set_new(options, "proxy", run_place_json(c->proxy));
    json_t *root = json_pack("{s:s,s:o}", "version", sg_version(), "options", options);
    const int code = root && path ? run_write_json(path, root) : no_memory();
    json_decref(root);
    free(path);
    return code;
}

/* Nothing came of it: what was begun goes, so that the same command works once the cause is
 * gone. */
static void forget(const char *output)
{
    char *config = run_path(output, "attack/config.json"),
         *log = run_path(output, "attack/log.jsonl");
    char *state = run_path(output, "attack");
    if (config && log && state && is_lost(output)) {
        unlink(config);
        unlink(log);
        rmdir(state); /* where it is empty */
    }
    free(config);
    free(log);
    free(state);
}

static int run_attack(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    struct attack_config c = *(const struct attack_config *) config;
    struct attack_run r = {.config = &c};
    struct output output = OUTPUT_NONE;
    json_t *keep = NULL;
    char *proxy = NULL;
    bool fresh = false; /* a folder that was not there, or empty */
    int code = 0;
    if (c.resume)
        code = adopt(&c, given, count ? positional[0] : NULL, &keep);
    else if (count)
        code = take_scene(&command_attack, positional[0], &c.source);
    if (!code && (!c.source || !c.output)) {
        say(stderr, "splatguard attack: missing %s; usage: splatguard attack %s\n",
            c.source ? "-o POISONED" : "SCENE", command_attack.arguments);
        code = 1;
    }
    if (!code)
        code = settle(&c);
    if (!code && c.resume && is_finished(c.output)) {
        say(stderr, "%s: the attack is finished; --force replaces it\n", c.output);
        goto done;
    }
    const struct output_rules rules = {.command = "attack",
                                       .earlier = "attack",
                                       .is_own = is_attack,
                                       .is_lost = is_lost,
                                       .within = "attack/proxy/config.json",
                                       .makes_scenes = true,
                                       .force = c.force,
                                       .resume = c.resume,
                                       .inputs = {c.source, c.proxy}};
    if (!code)
        code = open_context(&r.ctx, c.threads, c.max_memory, c.quiet);
    if (!code)
        code = output_claim(&output, r.ctx, c.output, &rules);
    if (!code)
        code = attack_load(&r);
    if (!code) {
        apply_preset(&c, r.scene->format);
        const int error = sg_attack_check(r.ctx, &c.attack);
        code = report_option(r.ctx, "attack", error);
    }
    if (!code && c.method == METHOD_POISON_SPLAT && c.proxy && !(proxy = find_model(c.proxy, 0)))
        code = 2;
    /* Nothing of an earlier attack goes before this one can begin. */
    if (!code && !c.resume) {
        fresh = !run_has_other_files(c.output);
        char *state = run_path(c.output, "attack");
        const int error = state ? sg_dir_create(r.ctx, state) : SG_ERR_BUDGET;
        code = error ? report(r.ctx, error) : 0;
        free(state);
        if (!code) {
            remove_earlier(c.output);
            code = write_config(&c);
        }
    }
    if (!code)
        code = attack_whole(&r, proxy);
done:
    free(proxy);
    free(r.log_path);
    if (r.log && fclose(r.log) && !code)
        code = 2;
    if (r.ctx) {
        sg_attack_destroy(&r.attack);
        sg_scene_destroy(&r.scene);
    }
    if (fresh && code && code != 130 && !r.lasting)
        forget(c.output);
    output_release(&output);
    sg_ctx_destroy(&r.ctx);
    json_decref(keep);
    return code;
}

const struct command command_attack = {
    .name = "attack",
    .arguments = "SCENE -o POISONED [options]",
    .summary = "Makes a poisoned copy of a scene, to measure what it costs a victim.",
    .description = "Writes POISONED, a scene in the layout of SCENE whose images make training "
                   "expensive (Poison-splat, Lu et al. 2025), and poison.json, which says what was "
                   "done to each image. For red teams and measurements; SCENE is not changed. "
                   "Ctrl-C saves; `attack --resume POISONED` continues.",
    .options = attack_options,
    .config_size = sizeof(struct attack_config),
    .defaults = &defaults,
    .max_positional = 1,
    .run = run_attack,
};
