/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_ATTACK_H
#define SPLATGUARD_ATTACK_H

#include "context.h"
#include "model.h"
#include "scene.h"
#include "variation.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Poison-splat (Lu et al. 2025, "Poison-splat: Computation Cost Attack on 3D Gaussian Splatting").
 * Where a range is not given: 0..1. */
struct sg_attack_params {
    float epsilon;  /* bound on |poison - photo|, values in [0, 1], kept to the byte where it is a
                       multiple of  1/255; INFINITY = none. Default 16/255. */
    int iterations; /* views visited. 1..10 million. Default 36000. */
    int inner;      /* ascent steps a visit, 0..1000. Default 15. */
    float step;     /* size of an ascent step. Default 2/255. */
    enum sg_tv_form tv;    /* Default SG_TV_VERTICAL2. */
    float spectral_weight; /* against a spectral defense: the ascent also lowers the image's
                              anisotropy loss (band and directions of SG_SPECTRUM_DEFAULTS). The
                              weight of its gradient, scaled to a mean of 1, next to that of the
                              total variation, whose terms are 1 a neighbour. 0..1e6. Default 0. */
    float texture; /* against an audit: where neighbouring values of the photo differ by less than
                      this many grey levels on average, within 3 pixels, the bound shrinks in
                      proportion, to whole levels. With a finite epsilon; no effect on
                      SG_NAIVE_DRIFT. 0..255, 0 = epsilon everywhere. Default 0. */
    float wavelength; /* of SG_NAIVE_DRIFT, in pixels. 0..1e6, 0 = the longer side of each photo.
                         Default 0. */
    /* against a filter of thin Gaussians: the decoy's smallest scale, scene units, set again at
     * each densification and at the end, so that the poison is one that fat Gaussians can show.
     * 0..1e6, 0 = none. Default 0. */
    float scale_floor;
    int update_interval; /* views whose gradients are summed for one step of the decoy. 1..1000.
                            Default 1. */
    /* the decoy's positions learn at 1.6e-4 x extent. Default false: frozen. */
    bool move_positions;
    float lambda_dssim;           /* Default 0.2. */
    float feature_lr;             /* f_dc; f_rest uses 1/20. Default 0.0025. */
    float opacity_lr;             /* Default 0.05. */
    float scaling_lr;             /* Default 0.005. */
    float rotation_lr;            /* Default 0.001. */
    float percent_dense;          /* Default 0.01. */
    int densification_interval;   /* 1..10 million. Default 100. */
    float densify_grad_threshold; /* 0..1e30. Default 0.0002. */
    /* against a victim that trains with this tolerance (see sg_train_params): the decoy learns
     * through it, and a poison lies as far beyond what the decoy shows as the bound allows, at most
     * the tolerance beyond the ascended image. 0..255 grey levels. Default 0. */
    float victim_tolerance;
    uint64_t seed;          /* Default 42. */
    uint64_t max_gaussians; /* of the decoy; 0 = no limit, else at least 4. Default 0. */
    uint64_t max_instances; /* see sg_render_params. Default 1 << 24. */
    const char *engine;     /* "cpu" or "ref"; NULL = "cpu". Default "cpu". */
    const char *cpu;        /* CPU variant; NULL = best. Default NULL. */
};

#define SG_ATTACK_DEFAULTS                                                                         \
    .epsilon = 16 / 255.0f, .iterations = 36000, .inner = 15, .step = 2 / 255.0f,                  \
    .update_interval = 1, .lambda_dssim = 0.2f, .feature_lr = 0.0025f, .opacity_lr = 0.05f,        \
    .scaling_lr = 0.005f, .rotation_lr = 0.001f, .percent_dense = 0.01f,                           \
    .densification_interval = 100, .densify_grad_threshold = 0.0002f, .seed = 42,                  \
    .max_instances = 1u << 24, .engine = "cpu"
SG_API struct sg_attack_params sg_attack_params_default(void);

/* The published schedules by data set and epsilon: "ns" (NeRF-Synthetic), "mip" (Mip-NeRF 360),
 * "tt" (Tanks and Temples), or "auto": ns for Blender scenes, else mip. Sets iterations, inner and
 * update_interval of `params` by its epsilon. Returns false for any other name. */
SG_API bool sg_attack_preset(const char *name, enum sg_scene_format format,
                             struct sg_attack_params *params);

/* What stands for "the preset's" in these three, in struct sg_attack_run_params and the options. */
#define SG_ATTACK_BY_PRESET 0

/* What one visit of a view did. */
struct sg_attack_step {
    int iteration;               /* 1-based */
    size_t view;                 /* index into scene->train */
    double loss, l1, ssim, psnr; /* of the decoy's render against the ascended image */
    double tv; /* of the ascended image: mean over its values, by the form of the parameters */
    size_t gaussians;     /* of the decoy, after densification */
    double inner_seconds; /* spent on ascent */
    uint64_t inner_bytes; /* moved by it, counted once a step: image read and written, photo read */
};

/* Whether the values are within their ranges, which the struct gives: SG_ERR_USAGE. params: not
 * NULL. */
SG_API int sg_attack_check(sg_ctx *ctx, const struct sg_attack_params *params);

/* Thread safety: unsafe. The scene must outlive the attack and is not changed. */
typedef struct sg_attack sg_attack;

/* Poisons are made for all training views of the scene: load it with eval = false. proxy: a model
 * trained on the scene, which is copied; where the context has a limit on memory the caller
 * destroys it before the first step. Renders are on black, whatever the scene's background. params
 * may be NULL. Errors: SG_ERR_USAGE for values out of range, SG_ERR_INPUT where the scene has no
 * training views or the proxy a value that is not finite, SG_ERR_BUDGET. */
SG_API int sg_attack_create(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *proxy,
                            const struct sg_attack_params *params, sg_attack **out);
/* From a file of sg_attack_save, with the same scene and params: goes on to the very bytes of an
 * uninterrupted one. Iterations, limits and engine may differ. Errors: those of sg_attack_create;
 * SG_ERR_INPUT for a file that is no checkpoint of this scene and attack, or of one with other
 * parameters. */
SG_API int sg_attack_resume(sg_ctx *ctx, const struct sg_scene *scene, const char *path,
                            const struct sg_attack_params *params, sg_attack **out);
SG_API void sg_attack_destroy(sg_attack **attack);

/* One iteration. step may be NULL. Errors: as of sg_trainer_step. */
SG_API int sg_attack_step(sg_attack *attack, struct sg_attack_step *step);
SG_API int sg_attack_iteration(const sg_attack *attack);

/* The poison of a training view: the decoy's render (with a victim's tolerance: beyond it) within
 * epsilon of the photo, rounded to 8 bits. rgb: height x width x 3. Errors: SG_ERR_USAGE for a view
 * that is not there, SG_ERR_BUDGET. */
SG_API int sg_attack_poison(sg_attack *attack, size_t view, uint8_t *rgb);

/* A copy of the decoy; the caller owns *out. Errors: SG_ERR_BUDGET. */
SG_API int sg_attack_decoy(sg_attack *attack, struct sg_model **out);

/* The whole state, for sg_attack_resume. Only between two steps of the decoy, at the last iteration
 * and those divisible by update_interval, else SG_ERR_USAGE. Other errors: SG_ERR_INPUT where it
 * cannot be written, SG_ERR_BUDGET. */
SG_API int sg_attack_save(sg_attack *attack, const char *path);

/* Attacks that look at each photo alone, for comparison: what they add does not agree between
 * views. SG_NAIVE_NOISE: the photo plus normal noise of unit variance cut off at epsilon, that is
 * nearly +-epsilon everywhere. SG_NAIVE_TV: `inner` ascent steps from the photo. SG_NAIVE_DRIFT:
 * the photo plus a cosine of the given wavelength, the same in all channels. Direction, sign and
 * the pixel where it is +-epsilon are drawn. From the size of a photo on it looks like a change of
 * exposure. index: of the view, which noise and drift are drawn by. params may be NULL. rgb: height
 * x width x 3. Errors: SG_ERR_USAGE for values out of range and without a finite epsilon,
 * SG_ERR_BUDGET. */
enum sg_naive_attack { SG_NAIVE_NOISE, SG_NAIVE_TV, SG_NAIVE_DRIFT };
SG_API int sg_attack_naive(sg_ctx *ctx, const struct sg_view *view, uint64_t index,
                           const struct sg_attack_params *params, enum sg_naive_attack method,
                           uint8_t *rgb);

/* In [0, 1): for choosing which views to poison. */
SG_API float sg_attack_draw(uint64_t seed, uint64_t view);

/* How a poisoned copy of a scene is written. */
struct sg_poison_files {
    enum sg_poison_save {
        SG_POISON_AUTO,
        SG_POISON_PNG,
        SG_POISON_JPEG
    } save;           /* default: JPEG for COLMAP, else PNG */
    int jpeg_quality; /* 1..100. Default 75. */
    bool full_chroma; /* JPEG 4:4:4. Default false: 4:2:0. */
};
#define SG_POISON_FILE_DEFAULTS .jpeg_quality = 75
SG_API struct sg_poison_files sg_poison_files_default(void);

/* What one written image is, next to its photo. */
struct sg_poison_report {
    char *file;                 /* below the folder; owned by the report: sg_poison_report_clear */
    double linf;                /* largest difference in the file as written, in grey levels */
    double psnr;                /* dB; 100 for equal images */
    double tv_before, tv_after; /* sg_total_variation of photo and file, SG_TV_ANISO */
};
SG_API void sg_poison_report_clear(struct sg_poison_report *report);

/* The folder with cameras and points as the scene has them: transforms and points of Blender scenes
 * and models of COLMAP are copied; nerfstudio scenes and photos whose lens distortion was taken out
 * get a transforms.json for the images as they are written. Cameras that another set left there are
 * removed. Errors: SG_ERR_USAGE for the scene's own folder; SG_ERR_INPUT for links in the folder,
 * names that are not UTF-8 and what cannot be read or written; SG_ERR_BUDGET. */
SG_API int sg_poisoned_scene_begin(sg_ctx *ctx, const struct sg_scene *scene,
                                   const struct sg_poison_files *files, const char *folder);
/* Writes the image of a view (of train or test), and its mask; what another set left there under
 * the name with another ending is removed. rgb: height x width x 3. report may be NULL. Errors: as
 * above. */
SG_API int sg_poisoned_scene_image(sg_ctx *ctx, const struct sg_scene *scene,
                                   const struct sg_view *view, const struct sg_poison_files *files,
                                   const char *folder, const uint8_t *rgb,
                                   struct sg_poison_report *report);

/* Total variation of height x width x 3 bytes by a form: mean over the values, in grey levels. */
SG_API double sg_total_variation(const uint8_t *rgb, int width, int height, enum sg_tv_form form);

#ifdef __cplusplus
}
#endif

#endif
