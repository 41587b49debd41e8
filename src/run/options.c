/* SPDX-License-Identifier: Apache-2.0 */
/* What runs have beside the parameters of training and attack: names, ranges and help. */
#include <string.h>

#include "option/option.h"
#include "splatguard/run.h"

#define GROUP(name) .group = name
#define EXPERT .expert = true
#define INTEGER(name, field, low, high, help, ...)                                                 \
    SG_NUMBER(SG_OPTION_INT, name, field, low, high, "N", help, __VA_ARGS__)

/* Choices are indices of enums. */
_Static_assert(SG_RUN_PRESET_MIP == 3 && SG_RUN_AUDIT_DEFEND == 3 && SG_METHOD_DRIFT == 3 &&
                   SG_SCHEDULE_TT == 3 && SG_ATTACK_TRAIN_VIEWS == 1 && SG_POISON_PNG == 1 &&
                   SG_POISON_JPEG == 2,
               "the order of the choices of runs");

#define STRUCT struct sg_run_params
static const struct sg_option run_options[] = {
    SG_TEXT("source-path", source, "SCENE", "The reference's name for the argument SCENE.",
            GROUP("Run"), EXPERT, .letter = 's'),
    SG_FLAG("eval", scene.eval, "Hold the test views out and measure PSNR and SSIM on them.",
            GROUP("Run")),
    INTEGER("save-every", save_every, 0, 1e7,
            "Save model and checkpoint every N iterations (less often where --max-time makes "
            "larger steps); 0 = at the end only.",
            GROUP("Run")),
    INTEGER("eval-every", eval_every, 0, 1e7,
            "Measure the test views every N iterations (less often where --max-time makes larger "
            "steps); 0 = at the end only.",
            GROUP("Run")),
    INTEGER("log-every", log_every, 1, 1e7, "Write a line to log.jsonl every N iterations.",
            GROUP("Run"), EXPERT),
    SG_TEXT("init", init, "RUN|MODEL", "Start from this model, or the newest of a run.",
            GROUP("Initialisation")),
    SG_NUMBER(SG_OPTION_BYTES, "max-memory", max_memory, 0, 9e15, "BYTES",
              "Most memory of the whole process, e.g. 1500M, 1.5G or 500MB: limits Gaussians and "
              "tile lists to what fits, and reads photos again that do not fit. 0 = no limit.",
              GROUP("Budgets")),
    SG_NUMBER(
        SG_OPTION_BYTES, "max-vram", max_vram, 0, 9e15, "BYTES",
        "Most memory of the device that --engine vulkan runs on, likewise; 0 = nine tenths of "
        "what is free.",
        GROUP("Budgets")),
    SG_CHOICE("audit", audit, "off|warn|refuse|defend", "MODE",
              "Look at the photos first (see `audit`): say what is found, refuse poisoned ones "
              "with exit status 5, or turn the defense on unless they are clean.",
              GROUP("Defense")),
    SG_CHOICE("preset", preset, "auto|ns|tt|mip", "NAME",
              "auto: a tolerance for photos that are not clean (see --tolerance), for the others a "
              "filter by the run's own growth and a lambda by the audit. ns, tt, mip: the paper's "
              "rho and lambda for NeRF-Synthetic, Tanks and Temples, Mip-NeRF 360.",
              GROUP("Defense")),
    {0},
};

const struct sg_option *sg_run_options(void)
{
    return run_options;
}

struct sg_run_params sg_run_params_default(void)
{
    struct sg_run_params p = {.scene = sg_scene_params_default(),
                              .train = sg_train_params_default(),
                              .save_every = 7000,
                              .eval_every = 7000,
                              .log_every = 100};
    p.train.tolerance = SG_TOLERANCE_PRESET;
    p.train.defense.rho = p.train.defense.rho_least = SG_PRESET_RHO;
    p.train.defense.lambda = SG_PRESET_LAMBDA;
    p.train.defense.frequency = SG_PRESET_FREQUENCY;
    return p;
}

static bool is_in_group(const struct sg_option *o, const char *group)
{
    return o->group && !strcmp(o->group, group);
}

static bool is_limited(const struct sg_run_params *p)
{
    return p->train.max_gaussians || p->max_memory || p->max_vram;
}

/* Whether the filter's score decides at a limit which Gaussians stay. */
static bool is_ranked(const struct sg_run_params *p)
{
    const struct sg_train_params *t = &p->train;
    return is_limited(p) && t->at_limit == SG_AT_LIMIT_SCORE && t->model != SG_MODEL_SCAFFOLD &&
           t->strategy != SG_STRATEGY_MCMC;
}

static const char *unused_defense(const struct sg_run_params *p, const struct sg_option *o)
{
    const struct sg_train_params *t = &p->train;
    static const char ranking[] = "filter-frequency|filter-exponent|filter-views|filter-sigma|"
                                  "filter-hits|filter-sample";
    const bool tolerates =
        t->tolerance > 0 || t->tolerance == SG_TOLERANCE_AUTO || t->tolerances != NULL;
    const bool of_tolerance = !strncmp(o->name, "tolerance-", 10);
    if (!is_in_group(o, "Defense") || t->defense.on || p->audit == SG_RUN_AUDIT_DEFEND ||
        sg_word_index("defense|audit|tolerance|smooth", o->name) >= 0 ||
        (tolerates && of_tolerance) || (is_ranked(p) && sg_word_index(ranking, o->name) >= 0))
        return NULL;
    return of_tolerance ? "found without a defense, expected --defense spectral, --tolerance or "
                          "--audit defend with it"
                        : "found without a defense, expected --defense spectral or --audit defend "
                          "with it";
}

const char *sg_run_option_unused(const struct sg_run_params *p, const struct sg_option *o)
{
    static const char of_anchors[] = "filter-unit|filter-anchors|filter-anchor-hits|"
                                     "filter-anchor-score|filter-grace",
                      not_scaffold[] = "sh-degree|percent-dense|tolerance-low-pass",
                      rates[] = "position-lr-init|position-lr-final|feature-lr|opacity-lr|"
                                "scaling-lr|rotation-lr",
                      not_mcmc[] = "absgrad|densify-grad-threshold|percent-dense|at-limit|"
                                   "tolerance-growth|rho-least";
    const bool mip = p->train.model == SG_MODEL_MIP, mcmc = p->train.strategy == SG_STRATEGY_MCMC,
               scaffold = p->train.model == SG_MODEL_SCAFFOLD;
    if (!mip && (is_in_group(o, "Filters of --model mip") || !strcmp(o->name, "keep-filter")))
        return "found without effect, expected --model mip with it";
    if (!scaffold &&
        (is_in_group(o, "Anchors of --model scaffold") || sg_word_index(of_anchors, o->name) >= 0))
        return "found without effect, expected --model scaffold with it";
    if (!p->train.scaffold.appearance && !strncmp(o->name, "appearance-", 11))
        return "found without effect, expected --photo-appearance with it";
    if (!p->train.scaffold.bank && !strncmp(o->name, "feature-bank-", 13))
        return "found without effect, expected --feature-bank with it";
    if (p->train.tolerance > 0 && !p->train.tolerances && !strcmp(o->name, "tolerance-smooth"))
        return "found without effect, expected --tolerance auto with it";
    if (!mcmc && is_in_group(o, "Densification by --strategy mcmc"))
        return "found without effect, expected --strategy mcmc with it";
    if (mcmc && (sg_word_index(not_mcmc, o->name) >= 0 || !strncmp(o->name, "filter-", 7)))
        return "found without effect, expected another strategy than mcmc with it";
    if (scaffold && sg_word_index(rates, o->name) >= 0)
        return "found without effect, expected another model than scaffold, which has rates of its "
               "own";
    if (scaffold && sg_word_index(not_scaffold, o->name) >= 0)
        return "found without effect, expected another model than scaffold";
    if (!p->train.exposure && !strncmp(o->name, "exposure-lr", 11))
        return "found without effect, expected --exposure with it";
    if (!is_limited(p) && !strcmp(o->name, "at-limit"))
        return "found without effect, expected --max-gaussians or another limit with it";
    if (p->train.at_limit == SG_AT_LIMIT_UNIVERSAL && !p->train.max_gaussians &&
        !strcmp(o->name, "at-limit"))
        return "found universal, expected --max-gaussians with it";
    return unused_defense(p, o);
}

#undef STRUCT
#define STRUCT struct sg_attack_run_params
static const struct sg_option attack_run_options[] = {
    SG_TEXT("source-path", source, "SCENE", "Another way to name the scene.", GROUP("Run"), EXPERT,
            .letter = 's'),
    SG_NUMBER(SG_OPTION_BYTES, "max-memory", max_memory, 0, 9e15, "BYTES",
              "Most memory of the whole process, e.g. 1500M: limits the decoy to what fits. 0 = "
              "no limit.",
              GROUP("Run")),
    SG_NUMBER(
        SG_OPTION_BYTES, "max-vram", max_vram, 0, 9e15, "BYTES",
        "Most memory of the device that --engine vulkan runs on, likewise; 0 = nine tenths of "
        "what is free.",
        GROUP("Run"), EXPERT),
    INTEGER("save-every", save_every, 0, 1e7,
            "Save a checkpoint every N iterations; 0 = when interrupted only.", GROUP("Run")),
    SG_CHOICE("views", views, "all|train", "WHICH",
              "Poison all views of COLMAP and nerfstudio scenes, or leave the test views clean. "
              "Blender's test file always stays clean.",
              GROUP("Scene")),
    SG_CHOICE("method", method, "poison-splat|noise|tv-per-view|drift", "NAME",
              "Poison-splat, or an attack on each photo alone: noise of +-epsilon, ascent of its "
              "total variation, or a smooth drift of its brightness.",
              GROUP("Attack")),
    SG_CHOICE("preset", preset, "auto|ns|mip|tt", "NAME",
              "The published schedules for NeRF-Synthetic, Mip-NeRF 360, Tanks and Temples; auto: "
              "ns for Blender scenes, else mip.",
              GROUP("Attack")),
    SG_NUMBER(SG_OPTION_FLOAT, "ratio", ratio, 0, 1, "X",
              "Poison only this share of the views, drawn by seed.", GROUP("Attack")),
    SG_NUMBER(SG_OPTION_FLOAT, "spare", spare, 0, 1, "X",
              "Against an audit: leave this share of each photo, from the left, as it is.",
              GROUP("Attack"), EXPERT),
    SG_TEXT("proxy", proxy, "MODEL",
            "A model of the clean scene, or a run's newest; else one is trained.",
            GROUP("Proxy and decoy")),
    INTEGER("proxy-iterations", proxy_iterations, 1, 1e7,
            "Iterations of the proxy that is trained.", GROUP("Proxy and decoy")),
    SG_FLAG("keep-decoy", keep_decoy, "Save the decoy as attack/decoy.ply.",
            GROUP("Proxy and decoy")),
    SG_CHOICE("save", files.save, "auto|png|jpg", "FORMAT",
              "auto: JPEG for COLMAP scenes, as published, else PNG. JPEG does not keep the bound.",
              GROUP("Files")),
    INTEGER("jpeg-quality", files.jpeg_quality, 1, 100, "JPEG quality.", GROUP("Files"), EXPERT),
    SG_SWITCH("jpeg-chroma", files.full_chroma, "420|444", "FORMAT", "JPEG chroma subsampling.",
              GROUP("Files"), EXPERT),
    {0},
};

const struct sg_option *sg_attack_run_options(void)
{
    return attack_run_options;
}

struct sg_attack_run_params sg_attack_run_params_default(void)
{
    struct sg_attack_run_params p = {.scene = sg_scene_params_default(),
                                     .attack = sg_attack_params_default(),
                                     .files = sg_poison_files_default(),
                                     .ratio = 1,
                                     .proxy_iterations = 30000,
                                     .save_every = 5000};
    p.attack.iterations = p.attack.inner = p.attack.update_interval = SG_ATTACK_BY_PRESET;
    return p;
}
