/* SPDX-License-Identifier: Apache-2.0 */
/* Pruning of trained models by the scores of published methods, and the training that repairs what
 * is left. */
#ifndef SPLATGUARD_PRUNE_H
#define SPLATGUARD_PRUNE_H

#include <stdbool.h>
#include <stdint.h>

#include "context.h"
#include "model.h"
#include "scene.h"
#include "train.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sg_pruner {
    /* LightGaussian (Fan et al. 2024): opacity summed over the pixels that a Gaussian is blended
     * in, times a power of its volume. */
    SG_PRUNER_LIGHTGAUSSIAN,
    /* PUP 3D-GS (Hanson et al. 2024): ln det of the Fisher information of position and log scale,
     * from the gradient of every pixel and channel. */
    SG_PRUNER_PUP,
    /* The score of the spectral defense's filter, over all views. */
    SG_PRUNER_SPECTRAL
};

/* What LightGaussian multiplies or leaves out. */
enum sg_global_score {
    SG_GLOBAL_V_IMPORTANT, /* the sum x (volume / V90)^power, where 90 % are larger than V90 */
    SG_GLOBAL_IMPORTANT,   /* the sum alone */
    SG_GLOBAL_MAX_V,       /* the sum x the largest scale */
    SG_GLOBAL_COUNT,       /* the number of pixels */
    SG_GLOBAL_OPACITY      /* the opacity alone */
};

/* What a pixel adds to that sum. */
enum sg_global_weight {
    SG_GLOBAL_WEIGHT_OPACITY,      /* the opacity, as the released program does */
    SG_GLOBAL_WEIGHT_TRANSMITTANCE /* the opacity x the transmittance in front, as in the paper */
};

/* Values of ratio and second_ratio: those that the method was published with. */
#define SG_PRUNE_PUBLISHED (-1.0)

struct sg_prune_params {
    enum sg_pruner method; /* Default SG_PRUNER_LIGHTGAUSSIAN. */
    /* Share of the Gaussians to remove, 0..1: with N of them, all with at most the score at rank
     * trunc(ratio (N - 1)), so at least one. At least one is left. 0 removes none. Published: 0.8
     * for PUP 3D-GS, else 0.66. Default SG_PRUNE_PUBLISHED. */
    double ratio;
    /* Of what a first round has left, after its fine-tuning. Published: 0.5 for PUP 3D-GS with its
     * published ratio, else 0, which is no second round. Default SG_PRUNE_PUBLISHED. */
    double second_ratio;
    /* Most Gaussians that are left, in place of both ratios; PUP 3D-GS keeps twice as many in a
     * first round, as its published ratios do. 0 = the ratios count. 0..4e9. Default 0. */
    uint64_t max_gaussians;
    /* Iterations of training after each round, without densification, 0..10 million. The rates of
     * all groups but the positions shrink by 5 % every 400. Default 5000. */
    int finetune;
    int trained;   /* iterations that the model was trained for: the position's rate continues from
                      there. 0..10 million. Default 30000. */
    uint64_t seed; /* of the order of the views. Default 42. */
    /* LightGaussian: */
    enum sg_global_score score;   /* Default SG_GLOBAL_V_IMPORTANT. */
    enum sg_global_weight weight; /* Default SG_GLOBAL_WEIGHT_OPACITY. */
    double volume_power;          /* 0..10. Default 0.1. */
    bool volume_clip; /* volume / V90 at most 1, as in the paper's text. Default false. */
    /* PUP 3D-GS: */
    int reduce; /* views are this many times smaller on each side, 1..64. Default 4. */
    /* The released program does not clear the gradient of the view direction between channels, so
     * that green also has red's and blue has all three. Default false: corrected. */
    bool released_gradient;
    /* Spectral: */
    double frequency;      /* t, cycles per scene unit, 1e-9..1e9; 0 = 41.6 / the scene's extent.
                              Default 0. */
    double exponent;       /* alpha, 0..100. Default 2. */
    bool white_background; /* Default false. */
    const char *engine;    /* see SG_ENGINE_HELP; NULL = "auto". Default "auto". */
    const char *cpu;       /* CPU variant; NULL = best. Default NULL. */
    /* NULL, or called after each iteration of fine-tuning. A result other than 0 cancels with
     * SG_ERR_INTERRUPTED. On a GPU it tells of losses and renders of an iteration a few before.
     * Default NULL. */
    int (*step)(void *priv, const struct sg_train_step *step);
    void *step_priv;
};
#define SG_PRUNE_DEFAULTS                                                                          \
    .ratio = SG_PRUNE_PUBLISHED, .second_ratio = SG_PRUNE_PUBLISHED, .finetune = 5000,             \
    .trained = 30000, .seed = 42, .volume_power = 0.1, .reduce = 4, .exponent = 2,                 \
    .engine = "auto"
SG_API struct sg_prune_params sg_prune_params_default(void);

/* Range checks: SG_ERR_USAGE names the value and its range. */
SG_API int sg_prune_check(sg_ctx *ctx, const struct sg_prune_params *params);

/* The scores of all Gaussians over the training views of a scene; the lowest go first. A Gaussian
 * that no view shows has 0 with LightGaussian (but its opacity with SG_GLOBAL_OPACITY), else
 * -INFINITY; so has one with PUP 3D-GS of which the views do not determine all of position and
 * size. NaN, where numbers of the model overflow, is kept longest. score: model->count values.
 * Photos are not read. Errors: SG_ERR_USAGE for parameters out of range, SG_ERR_INPUT for a scene
 * without a training view, SG_ERR_BUDGET, SG_ERR_INTERRUPTED. */
SG_API int sg_prune_scores(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *model,
                           const struct sg_prune_params *params, double *score);

struct sg_prune_result {
    int rounds;
    size_t before[2], removed[2]; /* Gaussians, per round */
    size_t unseen[2];             /* no view shows them */
};

/* Prunes and fine-tunes a copy of a model in one or two rounds; the caller owns *out. params and
 * result may be NULL. Errors: as of sg_prune_scores and of sg_trainer_step. */
SG_API int sg_prune(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *model,
                    const struct sg_prune_params *params, struct sg_model **out,
                    struct sg_prune_result *result);

/* The options of struct sg_prune_params. */
SG_API const struct sg_option *sg_prune_options(void);

#ifdef __cplusplus
}
#endif

#endif
