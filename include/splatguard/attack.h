/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_ATTACK_H
#define SPLATGUARD_ATTACK_H

#include "context.h"
#include "model.h"
#include "scene.h"
#include "train.h"
#include "variation.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What the decoy is. */
enum sg_attack_model {
    SG_ATTACK_3DGS,
    SG_ATTACK_SCAFFOLD /* Scaffold-GS, see SG_MODEL_SCAFFOLD: not in the paper */
};

/* Poison-splat (Lu et al. 2025, "Poison-splat: Computation Cost Attack on 3D Gaussian Splatting").
 * Ranges that are not given below are 0..1. */
struct sg_attack_params {
    /* Bound on |poison - photo| for values in [0, 1]; INFINITY = none. A multiple of 1/255 is kept
     * to the byte. Default 16/255. */
    float epsilon;
    int iterations;       /* views visited. 1..10 million. Default 36000. */
    int inner;            /* ascent steps per visit, 0..1000. Default 15. */
    float step;           /* size of an ascent step. Default 2/255. */
    enum sg_attack_tv tv; /* Default SG_ATTACK_TV_VERTICAL2. */
    /* Against a spectral defense: the ascent also lowers the anisotropy loss of the image (band and
     * directions of SG_SPECTRUM_DEFAULTS). Its gradient is scaled to a mean magnitude of this
     * weight; each neighbour adds 1 to the gradient of the total variation. 0..1e6. Default 0. */
    float spectral_weight;
    /* Against an audit: where neighbouring values of the photo differ by less than this many grey
     * levels on average, within 3 pixels, the bound shrinks in proportion, to whole levels. Needs a
     * finite epsilon; no effect on SG_NAIVE_DRIFT. 0..255, 0 = epsilon everywhere. Default 0. */
    float texture;
    /* Of SG_NAIVE_DRIFT, in pixels. 0..1e6, 0 = the longer side of each photo. Default 0. */
    float wavelength;
    /* Against a filter of thin Gaussians: the smallest scale in the decoy, in scene units, set
     * again at each densification and at the end. Large Gaussians can then show the poison. 0..1e6,
     * 0 = none. Default 0. */
    float scale_floor;
    /* Views whose gradients are summed for one step of the decoy, 1..1000. Default 1. */
    int update_interval;
    /* Train the decoy's positions at a rate of 1.6e-4 x extent. Default false: frozen. */
    bool move_positions;
    float lambda_dssim;           /* Default 0.2. */
    float feature_lr;             /* f_dc; f_rest uses 1/20. Default 0.0025. */
    float opacity_lr;             /* Default 0.05. */
    float scaling_lr;             /* Default 0.005. */
    float rotation_lr;            /* Default 0.001. */
    float percent_dense;          /* Default 0.01. */
    int densification_interval;   /* 1..10 million. Default 100. */
    float densify_grad_threshold; /* 0..1e30. Default 0.0002. */
    /* Against a victim that trains with this tolerance (see sg_train_params): the decoy learns
     * through it, and the poison lies beyond the decoy's render, as far as the bound allows and at
     * most the tolerance beyond the ascended image. 0..255 grey levels. Default 0. */
    float victim_tolerance;
    /* Against a victim that trains with this max_gaussians: at the limit new Gaussians of the decoy
     * take the place of those that the defense's filter scores lowest, as the victim's do
     * (SG_AT_LIMIT_SCORE). So what the poison shows is what stays in a model of that size. The
     * proxy should have been trained with the same limit. At least 4, 0 = none; max_gaussians has
     * to be 0. Default 0. */
    uint64_t victim_gaussians;
    /* The proxy has to be of this model. Default SG_ATTACK_3DGS. */
    enum sg_attack_model model;
    /* With SG_ATTACK_SCAFFOLD: rates of the decoy are the first ones of each pair, its voxels those
     * of the proxy, whose networks have the optional parts named here. Its offsets learn, since all
     * Gaussians of a new anchor begin in one place. Anchors do not move, have no least scale, and
     * learn from one view at a time: move_positions, scale_floor and victim_gaussians have to be 0,
     * update_interval 1. The rates above and percent_dense have no effect. */
    struct sg_scaffold_params scaffold;
    uint64_t seed; /* Default 42. */
    /* Of the decoy; 0 = no limit, else 4..4e9, with SG_ATTACK_SCAFFOLD from 40: an anchor counts as
     * its 10 Gaussians. Default 0. */
    uint64_t max_gaussians;
    uint64_t max_instances; /* see sg_render_params. Default 1 << 24. */
    const char *engine;     /* see SG_ENGINE_HELP; NULL = "auto". Default "auto". */
    const char *cpu;        /* CPU variant; NULL = best. Default NULL. */
};

#define SG_ATTACK_DEFAULTS                                                                         \
    .epsilon = 16 / 255.0f, .iterations = 36000, .inner = 15, .step = 2 / 255.0f,                  \
    .update_interval = 1, .lambda_dssim = 0.2f, .feature_lr = 0.0025f, .opacity_lr = 0.05f,        \
    .scaling_lr = 0.005f, .rotation_lr = 0.001f, .percent_dense = 0.01f,                           \
    .densification_interval = 100, .densify_grad_threshold = 0.0002f, .seed = 42,                  \
    .max_instances = 1u << 24, .engine = "auto", .scaffold = {SG_SCAFFOLD_DEFAULTS}
SG_API struct sg_attack_params sg_attack_params_default(void);

/* The published schedules by data set and epsilon: "ns" (NeRF-Synthetic), "mip" (Mip-NeRF 360),
 * "tt" (Tanks and Temples), or "auto": ns for Blender scenes, else mip. Sets iterations, inner and
 * update_interval of `params` by its epsilon and model. Returns false for any other name. */
SG_API bool sg_attack_preset(const char *name, enum sg_scene_format format,
                             struct sg_attack_params *params);

/* In struct sg_attack_run_params and its options this value of iterations, inner and
 * update_interval means "that of the preset". */
#define SG_ATTACK_BY_PRESET 0
/* As sg_attack_preset, but sets those of the three only that are SG_ATTACK_BY_PRESET. */
SG_API bool sg_attack_complete(const char *name, enum sg_scene_format format,
                               struct sg_attack_params *params);

/* The results of one visit of a view. */
struct sg_attack_step {
    int iteration;               /* 1-based */
    size_t view;                 /* index into scene->train */
    double loss, l1, ssim, psnr; /* of the decoy's render against the ascended image */
    double tv; /* total variation of the ascended image in the form `tv`: mean over its values */
    size_t gaussians;     /* of the decoy, after densification */
    double inner_seconds; /* spent on ascent; of a device, as far as it was known since the last */
    uint64_t inner_bytes; /* moved by ascent: per step image read and written, photo read */
};

/* Checks the ranges given above. Errors: SG_ERR_USAGE. params: not NULL. */
SG_API int sg_attack_check(sg_ctx *ctx, const struct sg_attack_params *params);

/* Thread safety: unsafe. The scene must outlive the attack and is not changed. */
typedef struct sg_attack sg_attack;

/* Poisons all training views of the scene: load it with eval = false. proxy: a model trained on the
 * scene, which is copied. Errors for one that is not of params->model: SG_ERR_INPUT. With a memory
 * limit, destroy `proxy` before the first step. Renders are on black, whatever the scene's
 * background is. params may be NULL. Errors: SG_ERR_USAGE for values out of range, SG_ERR_INPUT if
 * the scene has no training views or the proxy has a value that is not finite, SG_ERR_BUDGET. */
SG_API int sg_attack_create(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *proxy,
                            const struct sg_attack_params *params, sg_attack **out);
/* Continues from a file of sg_attack_save. With the same scene and params the result has the same
 * bytes as an uninterrupted attack. Iterations, limits and engine may differ; but the last
 * iteration of an attack adds no Gaussians, so that one that goes on after its end is not the same
 * as a longer one. Errors: those of sg_attack_create; SG_ERR_INPUT if the file is not a checkpoint
 * of this scene and attack, or is one with other parameters. */
SG_API int sg_attack_resume(sg_ctx *ctx, const struct sg_scene *scene, const char *path,
                            const struct sg_attack_params *params, sg_attack **out);
SG_API void sg_attack_destroy(sg_attack **attack);

/* Runs one iteration. step may be NULL. Errors: those of sg_trainer_step. After a
 * cancelled step the attack is as before the call, but one that is cancelled in SG_STAGE_COUNT is
 * completed first. */
SG_API int sg_attack_step(sg_attack *attack, struct sg_attack_step *step);
SG_API int sg_attack_iteration(const sg_attack *attack);

/* The poison of a training view: the decoy's render (with victim_tolerance an image beyond it),
 * clamped to epsilon around the photo and rounded to 8 bits. rgb: height x width x 3. Errors:
 * SG_ERR_USAGE if there is no such view, SG_ERR_INPUT for a photo that cannot be read again,
 * SG_ERR_BUDGET. */
SG_API int sg_attack_poison(sg_attack *attack, size_t view, uint8_t *rgb);

/* Copies the decoy; the caller owns *out. Errors: those of sg_trainer_model. */
SG_API int sg_attack_decoy(sg_attack *attack, struct sg_model **out);

/* Saves the whole state for sg_attack_resume. Allowed between two steps of the decoy only, that is
 * at the last iteration and at those divisible by update_interval. Errors: SG_ERR_USAGE elsewhere,
 * else those of sg_trainer_save. */
SG_API int sg_attack_save(sg_attack *attack, const char *path);

/* Attacks on each photo alone, for comparison: what they add is not consistent between views.
 * SG_NAIVE_NOISE: the photo plus normal noise of unit variance, clamped at epsilon; most values are
 * close to +-epsilon. SG_NAIVE_TV: `inner` ascent steps from the photo. SG_NAIVE_DRIFT: the photo
 * plus a cosine of the given wavelength, the same in all channels. Its direction, its sign and the
 * pixel where it is +-epsilon are drawn. With a wavelength of at least the photo's size it looks
 * like a change of exposure. index: of the view; it selects the random numbers of noise and drift.
 * params may be NULL. rgb: height x width x 3. Errors: SG_ERR_USAGE for values out of range or an
 * infinite epsilon, SG_ERR_BUDGET. */
enum sg_naive_attack { SG_NAIVE_NOISE, SG_NAIVE_TV, SG_NAIVE_DRIFT };
SG_API int sg_attack_naive(sg_ctx *ctx, const struct sg_view *view, uint64_t index,
                           const struct sg_attack_params *params, enum sg_naive_attack method,
                           uint8_t *rgb);

enum sg_poison_save { SG_POISON_AUTO, SG_POISON_PNG, SG_POISON_JPEG };

/* How a poisoned copy of a scene is written. */
struct sg_poison_files {
    enum sg_poison_save save; /* default: JPEG for COLMAP, else PNG */
    int jpeg_quality;         /* 1..100. Default 75. */
    bool full_chroma;         /* JPEG 4:4:4. Default false: 4:2:0. */
};
#define SG_POISON_FILE_DEFAULTS .jpeg_quality = 75
SG_API struct sg_poison_files sg_poison_files_default(void);

/* One written image compared with its photo. */
struct sg_poison_report {
    char *file;                 /* below the folder; owned by the report: sg_poison_report_clear */
    double linf;                /* largest difference in the file as written, in grey levels */
    double psnr;                /* dB; 100 for equal images */
    double tv_before, tv_after; /* sg_total_variation of photo and file, SG_ATTACK_TV_ANISO */
};
SG_API void sg_poison_report_clear(struct sg_poison_report *report);

/* Loads a scene to make a copy of. params->eval: the test views stay as they are; params may be
 * NULL. Without it all views of COLMAP and nerfstudio scenes are training views, but Blender scenes
 * come with their test views in any case, if they have some, since their copies need those photos.
 * Errors: those of sg_scene_load. */
SG_API int sg_poisoned_scene_load(sg_ctx *ctx, const char *path,
                                  const struct sg_scene_params *params, struct sg_scene **out);
/* Makes the folder. Cameras that another set left there are removed, and what a killed process left
 * unfinished: one process at a time writes to a folder. Errors: SG_ERR_USAGE for the scene's own
 * folder and a quality out of range; SG_ERR_INPUT for links in the folder, names that are not UTF-8
 * or too long, two images whose names differ only in their endings, and files that cannot be read
 * or written; SG_ERR_BUDGET. */
SG_API int sg_poisoned_scene_begin(sg_ctx *ctx, const struct sg_scene *scene,
                                   const struct sg_poison_files *files, const char *folder);
/* Writes the image of a training or test view, and its mask. An image that another set left there
 * with the same name and another ending is removed. rgb: height x width x 3. report may be NULL.
 * Errors: as above. */
SG_API int sg_poisoned_scene_image(sg_ctx *ctx, const struct sg_scene *scene,
                                   const struct sg_view *view, const struct sg_poison_files *files,
                                   const char *folder, const uint8_t *rgb,
                                   struct sg_poison_report *report);
/* Writes cameras and points, which make the folder a scene: call it after the images. The
 * transforms and points of Blender scenes and the models of COLMAP are copied. Cameras of the
 * latter whose images all have another size are scaled. Where images have other endings than the
 * photos, the model gets the new names, and files of images that are not read are left out.
 * nerfstudio scenes, photos whose lens distortion was undone, and reduced ones of Blender scenes
 * whose cameras are in pixels get a transforms.json for the images as written, which keeps what was
 * held out: the test views of the scene, or without any the lists of a nerfstudio scene's own file.
 * After an error the folder is no scene.
 * Errors: as above. */
SG_API int sg_poisoned_scene_finish(sg_ctx *ctx, const struct sg_scene *scene,
                                    const struct sg_poison_files *files, const char *folder);

/* Total variation of height x width x 3 bytes: mean over the values, in grey levels. Sides of at
 * least 1. */
SG_API double sg_total_variation(const uint8_t *rgb, int width, int height, enum sg_attack_tv form);

#ifdef __cplusplus
}
#endif

#endif
