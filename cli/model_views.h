/* SPDX-License-Identifier: Apache-2.0 */
/* What eval and render share: a model on a renderer and the views of its scene. */
#ifndef CLI_MODEL_VIEWS_H
#define CLI_MODEL_VIEWS_H

#include "commands.h"

struct model_options {
    const char *scene_path, *cpu;
    struct scene_options scene;
    struct sg_render_params render;
    int split, backend, threads, iteration;
    bool quiet;
};
#define SPLITS "test|train"

#define MODEL_OPTIONS(config)                                                                                          \
    {"Model and views", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},                                               \
        {"scene",                                                                                                      \
         's',                                                                                                          \
         OPT_STRING,                                                                                                   \
         offsetof(config, m.scene_path),                                                                               \
         0,                                                                                                            \
         0,                                                                                                            \
         NULL,                                                                                                         \
         "SCENE",                                                                                                      \
         "The photos and cameras; a run knows its own.",                                                               \
         true},                                                                                                        \
        {"split", 0, OPT_CHOICE, offsetof(config, m.split), 0, 0, SPLITS, "SPLIT", "Which views: " SPLITS ".", true},  \
        {"iteration", 0,    OPT_INT, offsetof(config, m.iteration),           0,                                       \
         10000000,    NULL, "N",     "Which model of a run; 0 = the newest.", true},                                   \
        {"threads", 'j',  OPT_INT, offsetof(config, m.threads),        0,                                              \
         256,       NULL, "T",     "Worker threads; 0 = one per CPU.", true},                                          \
        {"quiet", 'q', OPT_FLAG, offsetof(config, m.quiet), 0, 0, NULL, NULL, "Warnings only.", true},                 \
        {"backend",                                                                                                    \
         0,                                                                                                            \
         OPT_CHOICE,                                                                                                   \
         offsetof(config, m.backend),                                                                                  \
         0,                                                                                                            \
         0,                                                                                                            \
         "cpu|ref",                                                                                                    \
         "NAME",                                                                                                       \
         "cpu, or ref: the slow scalar oracle.",                                                                       \
         true},                                                                                                        \
        {"cpu",                                                                                                        \
         0,                                                                                                            \
         OPT_STRING,                                                                                                   \
         offsetof(config, m.cpu),                                                                                      \
         0,                                                                                                            \
         0,                                                                                                            \
         NULL,                                                                                                         \
         "VARIANT",                                                                                                    \
         "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU).",                          \
         true},                                                                                                        \
        {"max-instances",                                                                                              \
         0,                                                                                                            \
         OPT_U64,                                                                                                      \
         offsetof(config, m.render.max_instances),                                                                     \
         1,                                                                                                            \
         4e9,                                                                                                          \
         NULL,                                                                                                         \
         "N",                                                                                                          \
         "(Gaussian, tile) pairs held at once; more are processed in bands.",                                          \
         true},                                                                                                        \
    {                                                                                                                  \
        "reference-tiles", 0, OPT_FLAG, offsetof(config, m.render.reference_tiles), 0, 0, NULL, NULL,                  \
            "Keep every tile of the 3-sigma square, for parity checks.", true                                          \
    }

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

/* MODEL is a PLY or a run's folder, whose own scene and scene options hold where the command line says nothing else.
 * config is the command's, options its `struct model_options`. Returns an exit code; close in any case. */
int model_views_open(struct model_views *v, const char *model, const struct command *command, const bool *given,
                     void *config, struct model_options *options);
void model_views_close(struct model_views *v);

#endif
