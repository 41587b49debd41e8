/* SPDX-License-Identifier: Apache-2.0 */
/* What eval, render and others share: a model, on a renderer, and the views of its scene. */
#ifndef CLI_MODEL_VIEWS_H
#define CLI_MODEL_VIEWS_H

#include <limits.h>

#include "commands.h"

struct model_options {
    const char *scene_path, *cpu;
    const char *engine;  /* NULL: nothing is drawn */
    const char *cameras; /* NULL, or the file that takes the place of a scene: no photos */
    struct sg_scene_params scene;
    struct sg_render_params render;
    int split, threads, iteration;
    uint64_t max_memory, max_vram;
    bool quiet;
};
#define SPLITS "test|train"

#define MODEL_ROWS(config) MODEL_UNDRAWN_ROWS(config), MODEL_ENGINE_ROWS(config)
#define MODEL_UNDRAWN_ROWS(config)                                                                 \
    MODEL_SCENE_ROW(config),                                                                       \
        CHOICE_ROW("split", offsetof(config, m.split), SPLITS, "SPLIT",                            \
                   "Which views: " SPLITS ".", .group = MODEL_GROUP),                              \
        MODEL_OTHER_ROWS(config)
#define MODEL_SCENE_ROW(config)                                                                    \
    TEXT_ROW("scene", offsetof(config, m.scene_path), "SCENE",                                     \
             "The photos and cameras; a run knows its own.", .group = MODEL_GROUP, .letter = 's')
#define MODEL_OTHER_ROWS(config)                                                                   \
    NUMBER_ROW("iteration", SG_OPTION_INT, offsetof(config, m.iteration), 0, 10000000, "N",        \
               "Which model of a run; 0 = the newest.", .group = MODEL_GROUP),                     \
        NUMBER_ROW("threads", SG_OPTION_INT, offsetof(config, m.threads), 0, 256, "T",             \
                   "Worker threads; 0 = one per CPU.", .group = MODEL_GROUP, .letter = 'j'),       \
        MEMORY_ROW(config, m.max_memory, .group = MODEL_GROUP),                                    \
        FLAG_ROW("quiet", offsetof(config, m.quiet), "Warnings only.", .group = MODEL_GROUP,       \
                 .letter = 'q')
#define MODEL_ENGINE_ROWS(config)                                                                  \
    VRAM_ROW(config, m.max_vram, .group = MODEL_GROUP),                                            \
        TEXT_ROW("engine", offsetof(config, m.engine), "NAME", SG_ENGINE_HELP,                     \
                 .group = MODEL_GROUP, .expert = true, .choices = SG_ENGINE_CHOICES,               \
                 .alias = "backend"),                                                              \
        TEXT_ROW(                                                                                  \
            "cpu", offsetof(config, m.cpu), "VARIANT",                                             \
            "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU).",   \
            .field = "cpu", .group = MODEL_GROUP, .expert = true)
#define MODEL_GROUP "Model and views"
#define MODEL_GROUPS MODEL_GROUP "|Scene|Rasteriser"
#define MODEL_PARTS(config)                                                                        \
    {                                                                                              \
        {sg_scene_options, offsetof(config, m.scene), "smooth"},                                   \
            {sg_render_options, offsetof(config, m.render), NULL}, {0},                            \
    }

struct model_options model_options_default(void);

/* The run's own settings of its scene apply where the command line has none: scene, of the
 * command's config, and *scene_path. run: owns the texts. Returns an exit code. */
int adopt_run_scene(sg_ctx *ctx, const char *folder, const struct command *command,
                    const bool *given, const void *config, struct sg_scene_params *scene,
                    const char **scene_path, struct sg_run_params *run);

/* The same of the scene options of one group. */
void adopt_scene_options(const struct sg_run_params *run, const char *group,
                         const struct command *command, const bool *given, const void *config,
                         struct sg_scene_params *scene);

struct model_views {
    sg_ctx *ctx;
    char path[PATH_MAX];    /* of the model */
    struct sg_scene *scene; /* NULL with cameras of a file */
    struct sg_model *model;
    sg_renderer *renderer;
    const struct sg_view *views;
    struct sg_view *cameras; /* of a file */
    size_t n_cameras;
    struct sg_run_params run; /* owns texts of the options */
    size_t n;
    struct sg_eval_params eval; /* for sg_evaluate */
    size_t *photos;             /* that the views show, for eval.photos */
    float *exposures;           /* of the training views, for eval.exposures; or NULL */
};

/* Draws the models of a run as it does, unless the command line says how. */
void render_as_trained(struct sg_render_params *render, const struct sg_train_params *train);

/* A picture of what sg_render says of n pixels: the nearest white, the farthest dark grey, and
 * black where alpha is too small for a depth. */
void depth_to_grey(const float *depth, const float *alpha, size_t n, int channels, uint8_t *out);

/* Warns of options that change nothing. */
void model_views_warn(const struct model_options *options);
/* MODEL is a model's file or a run's folder, whose scene and scene options apply where the command
 * line has none. config is the command's, options its `struct model_options`. Returns an exit code;
 * close in any case. */
int model_views_open(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *options);
/* Its two steps: finding what is named, and reading model and scene, which takes its time. */
int model_views_find(struct model_views *v, const char *model, const struct command *command,
                     const bool *given, void *config, struct model_options *options);
int model_views_load(struct model_views *v, const struct command *command, const bool *given,
                     const void *config, struct model_options *options);
/* The next renders are of view i. */
void model_views_choose(struct model_views *v, size_t i);
void model_views_close(struct model_views *v);

#endif
