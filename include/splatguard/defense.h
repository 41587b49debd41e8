/* SPDX-License-Identifier: Apache-2.0 */
/* The spectral defense ("Spectral Defense Against Resource-Targeting Attack in 3D Gaussian
 * Splatting"): training on images that may be poisoned. In space, Gaussians of high frequency are
 * pruned; in the image, renders are kept smooth and even over directions. */
#ifndef SPLATGUARD_DEFENSE_H
#define SPLATGUARD_DEFENSE_H

#include <stdbool.h>
#include <stddef.h>

#include "render.h"
#include "spectrum.h"
#include "variation.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Which size of a Gaussian its frequency response exp(-2 pi^2 t^2 sigma^2) is of. The paper's text
 * names the smallest eigenvalue of the covariance, its formula the square of a size; both rank
 * alike and weigh hits differently. */
enum sg_filter_sigma { SG_SIGMA_STD /* the smallest scale */, SG_SIGMA_EIGEN /* its square */ };

/* Which Gaussians are "the lowest share rho of N". */
enum sg_prune_rule {
    SG_PRUNE_EXACT,    /* floor(rho N) of them */
    SG_PRUNE_THRESHOLD /* all with at most the score at rank trunc(rho (N - 1)): ties go together
                          (LightGaussian) */
};

enum sg_prune_views { SG_VIEWS_RANDOM /* a fresh sample each time */, SG_VIEWS_ALL };

struct sg_defense_params {
    bool on; /* Default false; then the filter's score is used at a limit of Gaussians only. */
    /* In space: score = (1 - exp(-2 pi^2 t^2 sigma^2))^alpha x hits; the lowest share rho is
     * removed. rho is 0..0.5, 0 = no filter; or -0.9..0: minus a share of what grew of late,
     * nothing once densification ends. */
    double rho;       /* Default 0.03. */
    double rho_least; /* 0..0.5. With a share of growth: removed at least when the filter begins,
                         less and less until densification ends, and down to half of the first
                         model. Default 0. */
    double frequency; /* t, cycles per scene unit, 1e-9..1e9. Default 8. */
    double exponent;  /* alpha, 0..100. Default 2. */
    int views;        /* K*, training views that hits are counted in, 1..10 million. Default 48. */
    int interval;     /* T_prune, iterations, 1..10 million. Default 100. */
    int from, until;  /* iterations, exclusive, to 1e9; -1 = as densification: pruning on after it
                         kills the model. Default -1. */
    enum sg_filter_sigma sigma; /* Default SG_SIGMA_STD. */
    enum sg_hit hit;            /* Default SG_HIT_PIXELS. */
    enum sg_prune_rule rule;    /* Default SG_PRUNE_EXACT. */
    enum sg_prune_views sample; /* Default SG_VIEWS_RANDOM. */
    /* In the image: loss + lambda (anisotropy_scale L_ani + tv_scale L_tv) of the render. */
    double lambda;             /* 0..1e6, as the scales. Default 4. */
    const float *view_weights; /* NULL, or of each training view, 0..1e3: how many times lambda it
                                gets, so that photos which look clean are not smoothed. Borrowed as
                                long as the trainer. */
    double anisotropy_scale;   /* Default 0.005: docs/design/defense.md has the sweep. */
    double tv_scale;           /* Default 1. */
    enum sg_tv_norm tv;        /* Default SG_TV_NORM_HUBER. */
    struct sg_anisotropy_params spectrum;
};

#define SG_DEFENSE_DEFAULTS                                                                        \
    .rho = 0.03, .frequency = 8, .exponent = 2, .views = 48, .interval = 100, .from = -1,          \
    .until = -1, .lambda = 4, .anisotropy_scale = 0.005, .tv_scale = 1, .tv = SG_TV_NORM_HUBER,    \
    .spectrum = {SG_ANISOTROPY_DEFAULTS}
SG_API struct sg_defense_params sg_defense_params_default(void);

/* The paper's rho and lambda for its data sets: "ns" (NeRF-Synthetic), "tt" (Tanks and Temples) or
 * "mip" (Mip-NeRF 360). Sets rho, rho_least, frequency, lambda and view_weights, not `on`. Returns
 * false for any other name, "auto" too: that one needs the photos, see sg_defense_automatic. */
SG_API bool sg_defense_preset(const char *name, struct sg_defense_params *params);

/* What stands for "the preset's" in struct sg_run_params and its options. */
#define SG_PRESET_RHO (-1.0) /* of rho and rho_least */
#define SG_PRESET_LAMBDA (-1.0)
#define SG_PRESET_FREQUENCY 0.0

struct sg_audit;

/* Cycles per scene unit that mean the same in scenes of any units. extent: the scene's. */
SG_API double sg_defense_frequency(double extent);

/* Preset auto: what to do about the photos that an audit describes, whatever the units of their
 * scene. Photos that are not clean get the tolerance that the audit estimates, and a light
 * regulariser; those changed by more than a tolerance can answer get a strong regulariser and
 * filter. Clean ones are hardly touched. Sets rho, rho_least, frequency, lambda and view_weights of
 * `params`, not `on`. extent: the scene's. view_weights, tolerances: memory for one number a
 * training view each. `params` borrows view_weights; tolerances (grey levels) are for
 * sg_train_params.tolerances. */
SG_API void sg_defense_automatic(const struct sg_audit *audit, double extent, float *view_weights,
                                 float *tolerances, struct sg_defense_params *params);

/* What one iteration's defense did. */
struct sg_defense_step {
    /* L_ani and L_tv of the render; NAN = not weighed, not measured; 0 without a defense. */
    double anisotropy, total_variation;
    bool filtered;                  /* the filter ran */
    double rho;                     /* share asked for */
    size_t scored, removed, unseen; /* Gaussians; unseen: without a hit in the sampled views */
    double score[3]; /* ln score at the 10th, 50th and 90th percentile, of those with a hit */
};

#ifdef __cplusplus
}
#endif

#endif
