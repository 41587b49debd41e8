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
#include "core/json_text.h"
#include "run/config.h"
#include "interrupt.h"
#include "output.h"

#define A(field) offsetof(struct attack_config, field)

static const struct sg_option attack_options[] = {
    TEXT_ROW("output", A(run.folder), "POISONED", "Folder to write the poisoned scene to.",
             .group = "Run", .letter = 'o'),
    NUMBER_ROW("threads", SG_OPTION_INT, A(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU. Results are the same.", .group = "Run",
               .letter = 'j'),
    FLAG_ROW(
        "resume", A(resume),
        "Continue an interrupted attack with its own options: same bytes as an uninterrupted one.",
        .group = "Run"),
    FLAG_ROW("force", A(force), "Replace an earlier attack in the folder.", .group = "Run"),
    FLAG_ROW("quiet", A(quiet), "No progress.", .group = "Run", .letter = 'q'),
    {0},
};

static const struct option_part attack_parts[] = {
    {sg_attack_run_options, A(run), NULL},
    {sg_scene_options, A(run.scene), "white-background|smooth"}, /* renders are on black */
    {sg_attack_options, A(run.attack), NULL},
    {0}};

static void defaults(void *config)
{
    *(struct attack_config *) config =
        (struct attack_config){.run = sg_attack_run_params_default()};
}

/* The published schedule where the options leave it to the preset. */
static struct sg_attack_params apply_preset(const struct sg_attack_run_params *run,
                                            enum sg_scene_format format)
{
    static const char *const names[] = {"auto", "ns", "mip", "tt"};
    struct sg_attack_params p = run->attack, preset = run->attack;
    sg_attack_preset(names[run->preset], format, &preset);
    if (run->method == SG_METHOD_TV_PER_VIEW)
        preset.inner = 100;
    p.iterations = p.iterations ? p.iterations : preset.iterations;
    p.inner = p.inner ? p.inner : preset.inner;
    p.update_interval = p.update_interval ? p.update_interval : preset.update_interval;
    return p;
}

/* An option that would have no effect. */
static int refuse_vain(const struct attack_config *c)
{
    const struct {
        const char *option, *methods;
        bool vain;
    } rules[] = {
        {"epsilon inf", "poison-splat",
         !isfinite(c->run.attack.epsilon) && c->run.method != SG_METHOD_POISON_SPLAT},
        {"victim-tolerance", "poison-splat",
         c->run.attack.victim_tolerance > 0 && c->run.method != SG_METHOD_POISON_SPLAT},
        {"texture", "poison-splat, noise or tv-per-view",
         c->run.attack.texture > 0 && c->run.method == SG_METHOD_DRIFT},
        {"wavelength", "drift", c->run.attack.wavelength > 0 && c->run.method != SG_METHOD_DRIFT},
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
    c->run.attack.cpu = cpu_variant(c->run.attack.cpu);
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
    const char *output = now.run.folder ? now.run.folder : argument;
    if (!output || now.force) {
        say(stderr, now.force ? "splatguard attack: --resume and --force exclude each other\n"
                              : "splatguard attack: --resume needs the poisoned folder\n");
        return 1;
    }
    char *path = run_path(output, "attack/config.json");
    *keep = path ? run_read_json(path, "config.json of an attack") : NULL;
    defaults(c);
    sg_ctx *ctx;
    int code = *keep ? open_context(&ctx, 1, 0, now.quiet) : STATUS_INPUT;
    if (*keep && !code) {
        code = report(ctx, sg_config_from_json(ctx, sg_attack_run_config, &c->run,
                                               json_object_get(*keep, "options"), true, path));
        sg_ctx_destroy(&ctx);
    }
    free(path);
    if (code)
        return code;
    c->run.folder = output;
    c->resume = true;
    c->run.scene.follow_links =
        now.run.scene.follow_links; /* leave is the user's to give, each time */
    c->run.scene.strict = now.run.scene.strict;
    c->quiet = now.quiet, c->threads = now.threads, c->run.keep_decoy = now.run.keep_decoy;
    c->run.max_memory = options_given(&command_attack, given, A(run.max_memory))
                            ? now.run.max_memory
                            : c->run.max_memory;
    if (now.run.folder && argument && take_scene(&command_attack, argument, &now.run.source))
        return STATUS_USAGE;
    c->run.source = now.run.source = now.run.source ? now.run.source : c->run.source;
    c->run.proxy = now.run.proxy = now.run.proxy ? now.run.proxy : c->run.proxy;
    return options_conflict(&command_attack, given, &now, c);
}

static int write_config(const struct attack_config *c)
{
    char *path = run_path(c->run.folder, "attack/config.json");
    json_t *options = sg_config_to_json(sg_attack_run_config, &c->run);
    json_object_set_new(options, "source-path", run_place_json(c->run.source));
    if (c->run.proxy)
        json_object_set_new(options, "proxy", run_place_json(c->run.proxy));
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
        code = take_scene(&command_attack, positional[0], &c.run.source);
    if (!code && (!c.run.source || !c.run.folder)) {
        say(stderr, "splatguard attack: missing %s; usage: splatguard attack %s\n",
            c.run.source ? "-o POISONED" : "SCENE", command_attack.arguments);
        code = 1;
    }
    if (!code)
        code = settle(&c);
    if (!code && c.resume && is_finished(c.run.folder)) {
        say(stderr, "%s: the attack is finished; --force replaces it\n", c.run.folder);
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
                                       .inputs = {c.run.source, c.run.proxy}};
    if (!code)
        code = open_context(&r.ctx, c.threads, c.run.max_memory, c.quiet);
    if (!code)
        code = output_claim(&output, r.ctx, c.run.folder, &rules);
    if (!code)
        code = attack_load(&r);
    if (!code) {
        r.params = apply_preset(&c.run, r.scene->format);
        const int error = sg_attack_check(r.ctx, &r.params);
        code = report_option(r.ctx, &command_attack, error);
    }
    if (!code && c.run.method == SG_METHOD_POISON_SPLAT && c.run.proxy &&
        !(proxy = find_model(c.run.proxy, 0)))
        code = 2;
    /* Nothing of an earlier attack goes before this one can begin. */
    if (!code && !c.resume) {
        fresh = !run_has_other_files(c.run.folder);
        char *state = run_path(c.run.folder, "attack");
        const int error = state ? sg_dir_create(r.ctx, state) : SG_ERR_BUDGET;
        code = error ? report(r.ctx, error) : 0;
        free(state);
        if (!code) {
            remove_earlier(c.run.folder);
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
        forget(c.run.folder);
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
    .groups = "Run|Scene|Attack|Proxy and decoy|Files",
    .options = attack_options,
    .parts = attack_parts,
    .config_size = sizeof(struct attack_config),
    .defaults = defaults,
    .max_positional = 1,
    .run = run_attack,
};
