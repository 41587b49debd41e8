/* SPDX-License-Identifier: Apache-2.0 */
/* What eval and render share: a model on a renderer and the views of its scene. */
#ifndef CLI_MODEL_VIEWS_H
#define CLI_MODEL_VIEWS_H

#include "commands.h"

struct model_options {
    const char *scene_path, *cpu;
    struct scene_options scene;
    struct sg_render_params render;
    int split, engine, threads, iteration;
    uint64_t max_memory;
    bool quiet;
};
#define SPLITS "test|train"

#define MODEL_OPTIONS(config)                                                                      \
    GROUP_ROW("Model and views"),                                                                  \
        TEXT_ROW("scene", offsetof(config, m.scene_path), "SCENE",                                 \
                 "The photos and cameras; a run knows its own.", .letter = 's',                    \
                 .transient = true),                                                               \
        CHOICE_ROW("split", offsetof(config, m.split), SPLITS, "SPLIT",                            \
                   "Which views: " SPLITS ".", .transient = true),                                 \
        NUMBER_ROW("iteration", OPT_INT, offsetof(config, m.iteration), 0, 10000000, "N",          \
                   "Which model of a run; 0 = the newest.", .transient = true),                    \
        NUMBER_ROW("threads", OPT_INT, offsetof(config, m.threads), 0, 256, "T",                   \
                   "Worker threads; 0 = one per CPU.", .letter = 'j', .transient = true),          \
        MEMORY_ROW(config, m.max_memory),                                                          \
        FLAG_ROW("quiet", offsetof(config, m.quiet), "Warnings only.", .letter = 'q',              \
                 .transient = true),                                                               \
        CHOICE_ROW("engine", offsetof(config, m.engine), ENGINES, "NAME",                          \
                   "cpu, or ref: the slow scalar oracle.", .alias = "backend", .transient = true), \
        TEXT_ROW(                                                                                  \
            "cpu", offsetof(config, m.cpu), "VARIANT",                                             \
            "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU).",   \
            .transient = true),                                                                    \
        NUMBER_ROW("max-instances", OPT_U64, offsetof(config, m.render.max_instances), 1, 4e9,     \
                   "N", "(Gaussian, tile) pairs held at once; more are processed in bands.",       \
                   .transient = true),                                                             \
        FLAG_ROW("reference-tiles", offsetof(config, m.render.reference_tiles),                    \
                 "Keep every tile of the 3-sigma square, for parity checks.", .transient = true)

#define MODEL_OPTION_DEFAULTS .scene = {SCENE_OPTION_DEFAULTS}, .render = {SG_RENDER_DEFAULTS}

struct model_views {
    sg_ctx *ctx;
    struct sg_scene *scene;
    struct sg_model *model;
    sg_renderer *renderer;
    const struct sg_view *views;
    json_t *run; /* config.json of the run folder; owns texts of the options */
    size_t n;
};

/* MODEL is a PLY or a run's folder, whose own scene and scene options hold where the command line
 * says nothing else. config is the command's, options its `struct model_options`. Returns an exit
 * code; close in any case. */
int model_views_open(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *options);
void model_views_close(struct model_views *v);

#endif
