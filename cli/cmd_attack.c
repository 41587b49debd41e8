/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard attack: proxy, decoy, poisons. */
#include <math.h>
#include <string.h>

#include "commands.h"
#include "interrupt.h"
#include "progress.h"

struct attack_config {
    struct sg_attack_run_params run;
    bool resume, force, quiet;
    bool unnamed; /* the scene is the one that the attack names */
    int threads;
};

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
    {sg_scene_options, A(run.scene),
     "white-background|smooth|test-halves"}, /* renders are on black */
    {sg_attack_options, A(run.attack), NULL},
    {0}};

static void defaults(void *config)
{
    *(struct attack_config *) config =
        (struct attack_config){.run = sg_attack_run_params_default()};
}

#define POISON_SPLAT (1u << SG_METHOD_POISON_SPLAT)
#define NOISE (1u << SG_METHOD_NOISE)
#define TV_PER_VIEW (1u << SG_METHOD_TV_PER_VIEW)
#define DRIFT (1u << SG_METHOD_DRIFT)

/* The methods that an option has an effect on. *refused: without it the poison would not be what
 * was asked for. */
static unsigned methods_of(const struct sg_option *o, bool unbounded, bool *refused)
{
    static const struct {
        const char *name;
        unsigned methods;
        bool refused;
    } rules[] = {
        {"texture", POISON_SPLAT | NOISE | TV_PER_VIEW, true},
        {"victim-tolerance", POISON_SPLAT, true},
        {"victim-gaussians", POISON_SPLAT, true},
        {"wavelength", DRIFT, true},
        {"inner", POISON_SPLAT | TV_PER_VIEW, false},
        {"step", POISON_SPLAT | TV_PER_VIEW, false},
        {"tv", POISON_SPLAT | TV_PER_VIEW, false},
        {"spectral-weight", POISON_SPLAT | TV_PER_VIEW, false},
        {"scale-floor", POISON_SPLAT, false},
        {"preset", POISON_SPLAT, false},
        {"iterations", POISON_SPLAT, false},
        {"update-interval", POISON_SPLAT, false},
        {"save-every", POISON_SPLAT, false},
    };
    *refused = false;
    for (size_t i = 0; i < sizeof(rules) / sizeof(rules[0]); i++)
        if (!strcmp(o->name, rules[i].name)) {
            *refused = rules[i].refused;
            return rules[i].methods;
        }
    if (!strcmp(o->name, "epsilon") && unbounded) {
        *refused = true;
        return POISON_SPLAT;
    }
    return !strcmp(o->group, "Proxy and decoy") || !strncmp(o->group, "Anchors", strlen("Anchors"))
               ? POISON_SPLAT
               : ~0u;
}

/* Beside the method, what takes the effect from an option; NULL if it has one. */
static const char *without_effect(const struct sg_attack_run_params *p, const struct sg_option *o)
{
    static const char *const rates[] = {"feature-lr", "opacity-lr", "scaling-lr", "rotation-lr",
                                        "percent-dense"};
    const bool scaffold = p->attack.model == SG_ATTACK_SCAFFOLD;
    if (!strcmp(o->name, "max-vram"))
        return vram_unused(p->attack.engine, p->attack.cpu);
    if (p->views == SG_ATTACK_ALL_VIEWS && !strcmp(o->name, "test-every"))
        return "without --views train";
    if (p->files.save == SG_POISON_PNG && !strncmp(o->name, "jpeg-", strlen("jpeg-")))
        return "with --save png";
    if (p->proxy && !strcmp(o->name, "proxy-iterations"))
        return "with --proxy";
    if (!scaffold && !strncmp(o->group, "Anchors", strlen("Anchors")))
        return "without --model scaffold";
    for (size_t i = 0; i < sizeof(rates) / sizeof(rates[0]); i++)
        if (scaffold && !strcmp(o->name, rates[i]))
            return "with --model scaffold";
    return NULL;
}

/* Refuses options without an effect, or warns of them. */
static int check_effects(const struct sg_attack_run_params *p, const bool *given)
{
    const struct sg_option *method = sg_option_find(sg_attack_run_options(), "method");
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(&command_attack, list);
    for (size_t i = 0; i < n; i++) {
        const struct sg_option *o = list[i].row;
        bool refused;
        const unsigned methods = methods_of(o, !isfinite(p->attack.epsilon), &refused);
        if (!given[i])
            continue;
        if (methods >> p->method & 1) {
            const char *why = without_effect(p, o);
            if (why)
                warn_unused(o->name, why);
            continue;
        }
        char found[16], name[16], expected[64] = "";
        sg_option_get(method, p, found, sizeof(found));
        for (int m = 0; m <= SG_METHOD_DRIFT; m++)
            if (methods >> m & 1) {
                struct sg_attack_run_params other = *p;
                other.method = (enum sg_attack_method) m;
                sg_option_get(method, &other, name, sizeof(name));
                snprintf(expected + strlen(expected), sizeof(expected) - strlen(expected), "%s%s",
                         *expected ? " or " : "", name);
            }
        const bool bound = !strcmp(o->name, "epsilon"); /* which others have, but not without end */
        say(stderr, "%s--%s %s with --method %s; it belongs to --method %s\n",
            refused ? "splatguard attack: " : "warning: ", o->name,
            bound ? "inf: found" : "has no effect", found, expected);
        if (refused)
            return STATUS_USAGE;
    }
    return 0;
}

/* The attack's own options; the command line may change what does not touch the result. */
static int adopt_attack(struct attack_config *c, const bool *given, const char *argument)
{
    struct attack_config now = *c;
    struct sg_attack_run_params *run = &c->run, *p = &now.run;
    const char *folder = p->folder ? p->folder : argument;
    if (!folder || now.force) {
        say(stderr, now.force ? "splatguard attack: --resume and --force exclude each other\n"
                              : "splatguard attack: --resume needs the poisoned folder\n");
        return STATUS_USAGE;
    }
    sg_ctx *ctx;
    int code = open_context(&ctx, 1, 0, now.quiet);
    if (!code)
        code = report(ctx, sg_attack_run_read_params(ctx, folder, run));
    sg_ctx_destroy(&ctx);
    if (code)
        return code;
    run->scene.follow_links = p->scene.follow_links; /* permission is given anew for each run */
    run->scene.strict = p->scene.strict;
    run->keep_decoy = p->keep_decoy = p->keep_decoy || run->keep_decoy;
    if (options_given(&command_attack, given, A(run.max_memory)))
        run->max_memory = p->max_memory;
    if (options_given(&command_attack, given, A(run.max_vram)))
        run->max_vram = p->max_vram;
    if (p->folder && argument && take_scene(&command_attack, argument, &p->source))
        return STATUS_USAGE;
    c->unnamed = !p->source;
    run->source = p->source = p->source ? p->source : run->source;
    run->proxy = p->proxy = p->proxy ? p->proxy : run->proxy;
    return options_conflict(&command_attack, given, &now, c);
}

/* Shows one line for the proxy and one for the attack. The first step of each only starts the
 * clock: how long it took is not known here. */
struct attack_progress {
    struct progress line;
    struct sg_attack_run_status status;
    bool quiet, begun, proxy;
    int proxy_iterations;
};

static int on_proxy_step(void *priv, const struct sg_train_step *step)
{
    struct attack_progress *p = priv;
    interrupt_by_steps();
    if (step && !p->proxy)
        progress_begin(&p->line, p->quiet, step->iteration, p->proxy_iterations);
    if (step)
        progress_step(&p->line, step);
    p->proxy |= step != NULL;
    return interrupted();
}

static int on_step(void *priv, const struct sg_attack_step *step)
{
    struct attack_progress *p = priv;
    interrupt_by_steps();
    if (step && !p->begun)
        progress_begin(&p->line, p->quiet, step->iteration, p->status.iterations);
    if (step)
        progress_step(&p->line, &(struct sg_train_step){.iteration = step->iteration,
                                                        .loss = step->loss,
                                                        .psnr = step->psnr,
                                                        .gaussians = step->gaussians});
    p->begun |= step != NULL;
    return interrupted();
}

static int attack(sg_ctx *ctx, struct attack_config *c)
{
    struct attack_progress p = {.quiet = c->quiet, .proxy_iterations = c->run.proxy_iterations};
    c->run.step = on_step, c->run.proxy_step = on_proxy_step, c->run.step_priv = &p;
    const enum sg_run_start start = c->resume  ? SG_RUN_RESUME
                                    : c->force ? SG_RUN_REPLACE
                                               : SG_RUN_NEW;
    interrupt_catch();
    const int error = sg_attack_run(ctx, &c->run, start, &p.status);
    if (error && (p.begun || p.proxy))
        progress_break(&p.line);
    if (p.status.finished)
        say(stderr, "%s: the attack is finished; --force replaces it\n", c->run.folder);
    report_option(ctx, &command_attack, error);
    if (error && start == SG_RUN_NEW && strstr(sg_last_error(ctx), "found an earlier attack"))
        say(stderr, "--resume continues it if it was interrupted, --force replaces it\n");
    if (error && c->unnamed)
        say_moved(c->run.source);
    if (error && p.status.resumable)
        say_resume("attack", c->run.folder);
    return exit_code(error);
}

static int run_attack(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    struct attack_config c = *(const struct attack_config *) config;
    sg_ctx *ctx = NULL;
    int code = 0;
    if (count > 1)
        code = refuse_second(&command_attack, c.resume, positional);
    else if (c.resume)
        code = adopt_attack(&c, given, count ? positional[0] : NULL);
    else if (count)
        code = take_scene(&command_attack, positional[0], &c.run.source);
    if (!code && (!c.run.source || !c.run.folder))
        code = missing(&command_attack, c.run.source ? "-o POISONED" : "SCENE");
    c.run.attack.cpu = cpu_variant(c.run.attack.cpu);
    if (!code)
        code = check_effects(&c.run, given);
    if (!code)
        code = open_engine_context(&ctx, c.threads, c.run.max_memory, c.run.max_vram, c.quiet);
    if (!code)
        code = attack(ctx, &c);
    sg_ctx_destroy(&ctx);
    sg_attack_run_params_clear(&c.run);
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
    .max_positional = 2, /* to say what is wrong with the second */
    .run = run_attack,
};
