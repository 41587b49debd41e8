/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_TRAIN_H
#define SPLATGUARD_TRAIN_H

#include <stdbool.h>
#include <stdint.h>

#include "context.h"
#include "defense.h"
#include "model.h"
#include "render.h"
#include "scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* How the set of Gaussians changes while a model learns. */
enum sg_train_strategy {
    SG_STRATEGY_DEFAULT, /* clones, splits, prunes, resets opacities (Kerbl et al. 2023) */
    SG_STRATEGY_MCMC,    /* relocates, adds up to a cap, explores (Kheradmand et al. 2024) */
    /* The default, and LightGaussian during training (Fan et al. 2024): at 8/15 and 12/15 of the
     * iterations its score removes 50 % and 40 %, and every 1000 iterations the rates shrink by
     * 3 %, that of positions for one iteration. */
    SG_STRATEGY_LIGHTGAUSSIAN
};

/* What happens where the default strategy's growth meets max_gaussians. */
enum sg_at_limit {
    SG_AT_LIMIT_SCORE,  /* new Gaussians replace those that the defense's filter scores lowest */
    SG_AT_LIMIT_RANDOM, /* new Gaussians replace some that are drawn by seed */
    SG_AT_LIMIT_STOP,   /* of those that would grow, the steepest do until the limit is met */
    /* As the universal threshold of Poison-splat: at a densification that finds fewer than the
     * limit, all that would grow do, which can go up to twice beyond it; at one that finds as many,
     * none does, statistics go on, and after the first reset of opacity what was larger than 20
     * pixels on the screen goes. */
    SG_AT_LIMIT_UNIVERSAL
};

/* What a Gaussian is drawn as. */
enum sg_train_model {
    SG_MODEL_3DGS,
    SG_MODEL_MIP, /* with a 3D and a 2D filter against aliasing (Mip-Splatting, Yu et al. 2024) */
    /* Anchors, of which networks make up to 10 Gaussians each for every view anew (Scaffold-GS, Lu
     * et al. 2024). */
    SG_MODEL_SCAFFOLD
};

/* Of SG_STRATEGY_MCMC. It edits as often as densification_interval says, after densify_from_iter,
 * and takes nothing else of the default's parameters. */
struct sg_mcmc_params {
    uint64_t cap_max;  /* most Gaussians, 4..4e9. Default 1000000. */
    double growth;     /* factor of their number at an edit, 1..2. Default 1.05. */
    int until;         /* edits before this iteration, 0..1e9. Default 25000. */
    float opacity_reg; /* weight of the mean opacity in the loss, 0..1e3. Default 0.01. */
    float scale_reg;   /* weight of the mean scale in the loss, 0..1e3. Default 0.01. */
    float noise_lr;    /* of positions, in learning rates of positions, 0..1e9. Default 5e5. */
    /* Opacity up to which a Gaussian is dead, 0..0.5, and what a copy has at least. The noise on
     * positions is multiplied by 1 / (1 + exp(noise_gate (opacity - dead))); noise_gate: 0..1e6.
     * Default 0.005 and 100. */
    float dead, noise_gate;
    int copies; /* a Gaussian shares its opacity among at most so many, 1..1000. Default 50. */
    /* What points begin with: opacity, 0.001..0.999, and scale in distances to their neighbours,
     * 1e-6..1e3. Default 0.5 and 0.1. */
    float init_opacity, init_scale;
};

#define SG_MCMC_DEFAULTS                                                                           \
    .cap_max = 1000000, .growth = 1.05, .until = 25000, .opacity_reg = 0.01f, .scale_reg = 0.01f,  \
    .noise_lr = 5e5f, .dead = 0.005f, .noise_gate = 100, .copies = 50, .init_opacity = 0.5f,       \
    .init_scale = 0.1f

/* Of SG_MODEL_MIP. */
struct sg_mip_params {
    float kernel; /* variance of the 2D filter, squared pixels, 1e-3..100. Default 0.1. */
    /* The 3D filter of a Gaussian has this variance, in squared pixels of the camera that sees it
     * from nearest. 0..100. Default 0.2. */
    double variance;
    /* A camera also sees what is beyond its image by at most this share of the sides. 0..10.
     * Default 0.15. */
    double margin;
    /* Iterations between two computations of the 3D filter once nothing densifies any more, and
     * from the last one to the end. Before, each densification computes it. 1..10 million. Default
     * 100. */
    int interval;
};

#define SG_MIP_DEFAULTS .kernel = 0.1f, .variance = 0.2, .margin = 0.15, .interval = 100

/* Of SG_MODEL_SCAFFOLD. Rates that have two values fall from the first to the last as those of
 * positions do, over position_lr_max_steps. Growth is as often as densification_interval says and
 * ends at densify_until_iter; densify_grad_threshold is that of its coarsest grid, and
 * densify_from_iter is when its statistics begin. No other parameter of densification counts. */
struct sg_scaffold_params {
    float voxel; /* side of the cells that get an anchor from points, scene units, 0..1e6; 0 = by
                    the points' distances. Default 0.001. */
    int every;   /* anchors begin at every so many-th point, 1..1 million. Default 1. */
    /* Grids of growth: their number, 1..8; cells of the coarsest one, in voxels, 1..4096; and how
     * many times finer each is than the one before, 2..64. Half of that, rounded down, is how many
     * times higher its threshold is. Below one voxel there is none. Default 3, 16, 4. */
    int grids, cells, finer;
    /* Of the Gaussians that would grow, this share is left out by chance on the coarsest grid; its
     * square on the next, and so on. 0..1. Default 0.5. */
    float drop;
    /* After growth the logarithm of the factor of an anchor's Gaussians' scales is at most this,
     * -100..100. Default 0.05. */
    float log_size_max;
    int from; /* growth after this iteration, 0..1e9. Default 1500. */
    /* Anchors that were seen in more than this share of the iterations between two growths are
     * removed if the sum of their Gaussians' opacities has a mean below min_opacity. Gaussians
     * that were drawn in more than half of that share can grow. 0..1 and 0..10. Default 0.8 and
     * 0.005. */
    float seen, min_opacity;
    /* Weight in the loss of the mean product of the drawn Gaussians' scales, 0..1e3. Default 0.01.
     */
    float volume;
    /* Optional parts: the distance from camera to anchor as an input of all networks; the feature
     * bank, which mixes a feature with coarser copies of itself by direction and distance; 32
     * numbers of each training photo as inputs of the colours' network. Default false. */
    bool distance, bank, appearance;
    /* How many there are: Gaussians of an anchor, 1..10; numbers of a feature, 1..32, 32 with the
     * feature bank; hidden values of a network, 1..32; numbers of a photo, 1..32. Files, memory and
     * counts have room for all. Default 10, 32, 32, 32. */
    int offsets, features, hidden, numbers;
    float offset_lr_init, offset_lr_final; /* x scene extent. Default 0.01 and 1e-4. */
    float feature_lr;                      /* Default 0.0075. */
    float scaling_lr;                      /* Default 0.007. */
    /* of the networks */
    float opacity_lr_init, opacity_lr_final;       /* Default 0.002 and 2e-5. */
    float covariance_lr_init, covariance_lr_final; /* Default 0.004 and 0.004. */
    float colour_lr_init, colour_lr_final;         /* Default 0.008 and 5e-5. */
    float bank_lr_init, bank_lr_final;             /* Default 0.01 and 1e-5. */
    float appearance_lr_init, appearance_lr_final; /* Default 0.05 and 5e-4. */
};

#define SG_SCAFFOLD_DEFAULTS                                                                       \
    .voxel = 0.001f, .every = 1, .grids = 3, .cells = 16, .finer = 4, .drop = 0.5f,                \
    .log_size_max = 0.05f, .from = 1500, .seen = 0.8f, .min_opacity = 0.005f, .volume = 0.01f,     \
    .offsets = 10, .features = 32, .hidden = 32, .numbers = 32, .offset_lr_init = 0.01f,           \
    .offset_lr_final = 1e-4f, .feature_lr = 0.0075f, .scaling_lr = 0.007f,                         \
    .opacity_lr_init = 0.002f, .opacity_lr_final = 2e-5f, .covariance_lr_init = 0.004f,            \
    .covariance_lr_final = 0.004f, .colour_lr_init = 0.008f, .colour_lr_final = 5e-5f,             \
    .bank_lr_init = 0.01f, .bank_lr_final = 1e-5f, .appearance_lr_init = 0.05f,                    \
    .appearance_lr_final = 5e-4f

/* Defaults are those of the reference (Kerbl et al. 2023, the 2023 release). Ranges that are not
 * given below: learning rates and percent_dense 0..1e3 (those that fall from a first to a last
 * value from 1e-12), intervals 1..1e9 iterations, densify_from_iter and densify_until_iter
 * 0..1e9. */
struct sg_train_params {
    int iterations;            /* 1..10 million. Default 30000. */
    uint64_t seed;             /* Default 42. */
    enum sg_train_model model; /* Default SG_MODEL_3DGS. Others need SG_STRATEGY_DEFAULT. */
    /* With SG_MODEL_MIP: models have the 3D filter beside their parameters, and PLY files as the
     * property filter_3D. Renderers do not know it; reading such a file folds it in. Default
     * false. */
    bool keep_filter;
    int sh_degree;          /* 0..3. Default 3. */
    int sh_interval;        /* iterations between degree raises, 1..10 million. Default 1000. */
    bool white_background;  /* As the scene was loaded. Default false. */
    bool random_background; /* a random colour each iteration. Default false. */
    float lambda_dssim;     /* weight of 1 - SSIM, 0..1. Default 0.2. */
    /* The loss compares a render with the nearest image that differs from the photo by at most
     * `tolerance` grey levels (0..255) in each value. A change of the photos within it has no
     * gradient at a model of the unchanged photos. Default 0. */
    float tolerance;
    /* NULL, or one tolerance per training view, instead. Must outlive the trainer. */
    const float *tolerances;
    /* Weight of the total variation (mean of absolute differences) of renders of photos with a
     * tolerance, 0..1000. It chooses among the images that the tolerance allows. It is left out if
     * the defense's total variation has a weight for the photo. Default 0.1. */
    float tolerance_tv;
    /* After this iteration, and 3, 5, 7 and 9 times as many if that is at most densify_until_iter,
     * photos with a tolerance are compared with their renders (struct sg_noise). With
     * `tolerances` the measured level of noise replaces every one above 0, and photos that show the
     * bound of a poison get it too. 0..1e9, 0 = never, -1 = a tenth of densify_until_iter, or of
     * iterations if there are fewer. Default -1. */
    int tolerance_look;
    /* A tolerance hides gradients, so that fewer Gaussians grow. All strategies but
     * SG_STRATEGY_MCMC multiply densify_grad_threshold by this times the share of the differences
     * that the tolerances do not hide, as the newest look has found it, but at least by 0.6 and at
     * most by 1. 0..1000, 0 = off. Default 2. */
    float tolerance_growth;
    /* The loss of photos with a tolerance, in the last tenth of the iterations: weight of the mean
     * squared difference from the photo itself after a low-pass filter. So contrast below the
     * tolerance comes back as far as many pixels of many photos agree on it. Where any photo has a
     * tolerance, no Gaussian is added or removed in these iterations, and learning rates fall to a
     * fiftieth. 0..1000, 0 = off, and so always with SG_MODEL_SCAFFOLD. Default 20. */
    float tolerance_low_pass;
    /* With `tolerances`, where the first look finds more than this share of the differences beyond
     * the tolerances and no bound of a poison, photos agree too little for a tolerance to help:
     * those with one are smoothed from then on, and have none. The filter is SG_SMOOTH_BILATERAL.
     * Its standard deviation of colours is 75 x with x = level / 16, or 75 x^1.5 for x below 1.
     * 0..1, 1 = never. Default 0.37. */
    float tolerance_smooth;
    /* Each photo has an affine map of colours, which is learned with the model and shows how the
     * photo was exposed. Renders are without. Default false. */
    bool exposure;
    float exposure_lr_init;    /* at the first iteration. Default 0.01. */
    float exposure_lr_final;   /* at the last. Default 0.001. */
    float position_lr_init;    /* x scene extent. Default 1.6e-4. */
    float position_lr_final;   /* x scene extent. Default 1.6e-6. */
    int position_lr_max_steps; /* Default 30000. */
    float feature_lr;          /* f_dc; f_rest uses 1/20. Default 0.0025. */
    float opacity_lr;          /* Default 0.05. */
    float scaling_lr;          /* Default 0.005. */
    float rotation_lr;         /* Default 0.001. */
    float percent_dense; /* clone below, split above this share of the extent. Default 0.01. */
    int densification_interval;   /* 1..10 million. Default 100. */
    int densify_from_iter;        /* Default 500. */
    int densify_until_iter;       /* Default 15000. */
    float densify_grad_threshold; /* view-space gradient, NDC; 0..1e9. Default 0.0002. */
    /* Growth follows from absolute gradients of the pixels (Ye et al. 2024), which need a higher
     * densify_grad_threshold: 0.0008. Default false. */
    bool absgrad;
    int opacity_reset_interval;      /* Default 3000. */
    enum sg_train_strategy strategy; /* Default SG_STRATEGY_DEFAULT. */
    struct sg_mcmc_params mcmc;
    struct sg_mip_params mip;
    struct sg_scaffold_params scaffold;
    uint64_t init_points; /* random points where the scene has none, 4..1e8. Default 100000. */
    bool random_points;   /* begin with random points although the scene has some. Default false. */
    /* Half of the side of the cube of random points, in scene extents, 0..1000. 0: 1.3 scene units,
     * as for NeRF-Synthetic; with SG_STRATEGY_MCMC and a scene of another layout 3 extents. Default
     * 0. */
    float random_extent;
    /* Budgets; 0 = none. If the context limits memory, the trainer also keeps within that. */
    uint64_t max_gaussians;    /* 4..4e9, with SG_MODEL_SCAFFOLD from 40. Default 0. */
    enum sg_at_limit at_limit; /* Default SG_AT_LIMIT_SCORE. */
    /* Seconds since creation, including the time between steps; at most 1e9. The schedule advances
     * by iterations or by time since the first step, whichever is ahead, so a shortened run still
     * completes its schedule. Default 0. */
    double max_seconds;
    double seconds_before; /* spent already, e.g. on reading the photos. Default 0. */
    /* Returns seconds since any fixed time; must not go backwards. NULL = the system's clock.
     * Default NULL. */
    double (*clock)(void *);
    void *clock_arg;        /* passed to clock */
    uint64_t max_instances; /* see sg_render_params. Default 1 << 24. */
    bool reference_tiles;   /* see sg_render_params. Default false. */
    struct sg_defense_params defense;
    const char *engine; /* see SG_ENGINE_HELP; NULL = "auto". Default "auto". */
    const char *cpu;    /* CPU variant; NULL = best. Default NULL. */
};

#define SG_TRAIN_DEFAULTS                                                                          \
    .iterations = 30000, .seed = 42, .sh_degree = 3, .sh_interval = 1000, .lambda_dssim = 0.2f,    \
    .tolerance_tv = 0.1f, .tolerance_look = -1, .tolerance_growth = 2, .tolerance_low_pass = 20,   \
    .tolerance_smooth = 0.37f, .exposure_lr_init = 0.01f, .exposure_lr_final = 0.001f,             \
    .position_lr_init = 1.6e-4f, .position_lr_final = 1.6e-6f, .position_lr_max_steps = 30000,     \
    .feature_lr = 0.0025f, .opacity_lr = 0.05f, .scaling_lr = 0.005f, .rotation_lr = 0.001f,       \
    .percent_dense = 0.01f, .densification_interval = 100, .densify_from_iter = 500,               \
    .densify_until_iter = 15000, .densify_grad_threshold = 0.0002f,                                \
    .opacity_reset_interval = 3000, .init_points = 100000, .mcmc = {SG_MCMC_DEFAULTS},             \
    .mip = {SG_MIP_DEFAULTS}, .scaffold = {SG_SCAFFOLD_DEFAULTS}, .max_instances = 1u << 24,       \
    .defense = {SG_DEFENSE_DEFAULTS}, .engine = "auto"
SG_API struct sg_train_params sg_train_params_default(void);

/* Values of `tolerance` in struct sg_run_params. AUTO: the audit's estimate for each photo. PRESET:
 * as AUTO if the defense is on with preset auto, else 0. */
#define SG_TOLERANCE_AUTO (-1.0f)
#define SG_TOLERANCE_PRESET (-2.0f)

/* Checks the ranges: SG_ERR_USAGE names the value and its range. sg_trainer_create checks this too,
 * and what depends on scene and machine. params: not NULL. */
SG_API int sg_train_check(sg_ctx *ctx, const struct sg_train_params *params);

/* What photos with a tolerance and their renders differ in, see tolerance_look. */
struct sg_noise {
    size_t compared; /* photos; 0 in iterations without a look */
    size_t photos;   /* those of them with enough quiet parts to measure noise */
    size_t bounded;  /* those that show the bound of a poison, where renders are black or white */
    size_t added;    /* photos without a tolerance that show it too, and have one from now on */
    bool smooths;    /* photos with a tolerance are smoothed from now on, see tolerance_smooth */
    /* Of the noise in grey levels. If a quarter of those compared show a bound: its 75th
     * percentile, but at least half of the median of `tolerances`. Else that of the earlier looks,
     * at the first one the 75th percentile over `photos`, and half of it again as far as that
     * median allows, or without that half where photos are smoothed. 0 = never measured. */
    double level;
    /* Where photos have `tolerances` of their own: the level until now, at the first look the
     * median of those above 0. Else 0. */
    double before;
    size_t deciding; /* photos that decided the level: those that show a bound, or noise */
    double kurtosis; /* median. Below 2.5 for a bounded poison, 3 for normal noise, more for texture
                        that the model lacks. */
    double beyond;   /* share of the absolute differences that exceeds the tolerances, 0..1, over
                        all training views: one without a tolerance counts in full */
};

/* The results of one iteration. */
struct sg_train_step {
    int iteration;                /* 1-based */
    size_t view;                  /* index into scene->train */
    double loss, l1, ssim, psnr;  /* of this view, before the update; psnr of unclamped values */
    size_t gaussians;             /* at its end: after densification and the filter */
    size_t cloned, split, pruned; /* by the densification of this iteration, else 0 */
    size_t relocated;             /* dead Gaussians, by SG_STRATEGY_MCMC; it adds those cloned */
    struct sg_render_stats render;
    struct sg_defense_step defense;
    struct sg_noise noise;
};

/* Seconds spent per stage since creation (wall clock). */
struct sg_train_times {
    double project, bin, raster, loss, raster_backward, update, densify;
    /* Of the defense; count: counting hits, prune: ranking and removal. */
    double anisotropy, total_variation, count, prune;
};

/* Thread safety: unsafe. The scene must outlive the trainer and is not changed. */
typedef struct sg_trainer sg_trainer;

/* initial: a model to start from, which is copied, but for spherical harmonics of higher degrees
 * than params->sh_degree; NULL = the points of the scene, or random ones. With a memory limit,
 * destroy `initial` before the first step: its memory is already promised to the run. params may be
 * NULL. Errors: SG_ERR_USAGE for values out of range, and for `initial` with random_points or
 * SG_MODEL_SCAFFOLD; SG_ERR_INPUT if the scene has no training view or no used pixel, or a photo
 * that cannot be read, or if `initial` is one of anchors or has a value that is not finite;
 * SG_ERR_BUDGET if the run cannot fit. */
SG_API int sg_trainer_create(sg_ctx *ctx, const struct sg_scene *scene,
                             const struct sg_model *initial, const struct sg_train_params *params,
                             sg_trainer **out);
/* Continues from a file of sg_trainer_save. With the same scene and params the result has the same
 * bytes as an uninterrupted run, also where the file is of a run that had ended and params have
 * more iterations: its last iteration, which changed nothing, is done again. (Not the same are
 * looks and settling of tolerances, rates of exposures, renewals of 3D filters and LightGaussian's
 * removals, which follow the number of iterations.) Limits, engine and sh_degree may differ, and
 * then the bytes do. If the photos have changed since the file was saved, tolerance,
 * tolerances, rho, rho_least, frequency, lambda and view_weights may differ too; tolerances of each
 * photo stay those of the file. Errors: those of sg_trainer_create; SG_ERR_INPUT
 * if the file is not a checkpoint of this scene and run, or is one with other parameters. */
SG_API int sg_trainer_resume(sg_ctx *ctx, const struct sg_scene *scene, const char *path,
                             const struct sg_train_params *params, sg_trainer **out);
SG_API void sg_trainer_destroy(sg_trainer **trainer);

/* Runs one iteration. The last iteration, and any after it, does not move parameters. step may be
 * NULL, and then nobody waits for a GPU: its errors come with a later call. Errors: SG_ERR_BUDGET;
 * SG_ERR_INPUT if every Gaussian has become transparent, so that none is left, or for a photo that
 * did not stay in memory and cannot be read again. After an error the trainer can still be saved
 * and destroyed, with that iteration half done. A run that is resumed from there has a sound model,
 * but not that of an uninterrupted run. SG_ERR_INTERRUPTED: a step that is cancelled in
 * SG_STAGE_TRAIN is not begun; one that is cancelled in SG_STAGE_COUNT is completed first, and
 * sg_trainer_iteration has risen. */
SG_API int sg_trainer_step(sg_trainer *trainer, struct sg_train_step *step);

/* Iterations so far, including those that were skipped for lack of time. */
SG_API int sg_trainer_iteration(const sg_trainer *trainer);

/* The limits of the run, as far as they are known, and which of them were reached. */
struct sg_train_limits {
    uint64_t max_gaussians;           /* 0 = none */
    bool by_memory;                   /* max_gaussians follows from max_memory or max_vram */
    bool gaussians_bound, time_bound; /* the limit was reached */
    uint64_t steps;                   /* iterations done, without those that were skipped */
};
SG_API void sg_trainer_limits(const sg_trainer *trainer, struct sg_train_limits *out);
/* Tolerance of the photo of a training view now, in grey levels; 0 = none. view: below n_train. */
SG_API float sg_trainer_tolerance(const sg_trainer *trainer, size_t view);
/* The exposures of the training views' photos now, of a run that learns them: of each photo 3 rows
 * of 4 numbers, where channel c of the photo is the sum over k of colour[k] row[k][c], and
 * row[c][3]. NULL without. Valid until the next step. Waits for a device. */
SG_API int sg_trainer_exposures(sg_trainer *trainer, const float **out);
SG_API size_t sg_trainer_gaussians(const sg_trainer *trainer);
SG_API void sg_trainer_times(const sg_trainer *trainer, struct sg_train_times *out);

/* The variant of the engine that runs: "avx512", "ref", ... */
SG_API const char *sg_trainer_variant(const sg_trainer *trainer);

/* Copies the current model; the caller owns *out. With SG_MODEL_MIP the 3D filter is in its scales
 * and opacities, unless keep_filter; it is to be drawn with sg_render_params.mip_kernel. With
 * SG_MODEL_SCAFFOLD it is one of anchors, see sg_model_read_drawable. Errors: SG_ERR_BUDGET;
 * SG_ERR_INPUT if networks or 3D filters have values that are not finite: the training has
 * diverged. */
SG_API int sg_trainer_model(sg_trainer *trainer, struct sg_model **out);

/* A renderer of the current model that uses the buffers of the run, without a copy, on the run's
 * background. It is valid until the next step of the trainer or its destruction. The caller
 * destroys *out. Errors: SG_ERR_BUDGET. */
SG_API int sg_trainer_renderer(sg_trainer *trainer, sg_renderer **out);

/* The next pass of the defense's filter. */
struct sg_filter_pass {
    int iteration;
    double share; /* of the Gaussians: rho. 0: no pass is left */
};
/* What the filter says of each Gaussian of sg_trainer_model as it is now: ln of its score,
 * -INFINITY without a hit, and its hits, both counted in the views of the next pass; and whether it
 * stays, 1, or that pass would remove it, 0. The pass itself comes after more training. Neither the
 * result of the training nor its times change. Errors: SG_ERR_USAGE for SG_MODEL_SCAFFOLD,
 * SG_ERR_BUDGET. */
SG_API int sg_trainer_scores(sg_trainer *trainer, double *score, double *hits, uint8_t *stays,
                             struct sg_filter_pass *next);

/* Saves the whole state for sg_trainer_resume. The file appears whole or not at all. Errors:
 * SG_ERR_INPUT if it cannot be written, or if networks of SG_MODEL_SCAFFOLD have values that are
 * not finite; SG_ERR_BUDGET. */
SG_API int sg_trainer_save(sg_trainer *trainer, const char *path);

#ifdef __cplusplus
}
#endif

#endif
