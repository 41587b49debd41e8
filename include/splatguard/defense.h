/* SPDX-License-Identifier: Apache-2.0 */
/* The spectral defense ("Spectral Defense Against Resource-Targeting Attack in 3D Gaussian
 * Splatting") against poisoned photos. In space, a filter removes Gaussians of high frequency. In
 * the image, losses keep renders smooth and their spectra isotropic. */
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

/* The size sigma of a Gaussian in its frequency response exp(-2 pi^2 t^2 sigma^2). The paper's text
 * names the smallest eigenvalue of the covariance, its formula the square of a size. Both give the
 * same order of sizes but different weights next to hits. */
enum sg_filter_sigma { SG_SIGMA_STD /* the smallest scale */, SG_SIGMA_EIGEN /* its square */ };

/* Of a model of anchors, whose size: that of each Gaussian in each view where it is drawn, or that
 * of the anchor, which limits them. */
enum sg_anchor_sigma { SG_ANCHOR_SIGMA_NEURAL, SG_ANCHOR_SIGMA_ANCHOR };

/* And what goes: whole anchors, or single Gaussians of anchors, which are hidden from then on. An
 * anchor whose Gaussians are all hidden goes too. */
enum sg_filter_unit { SG_UNIT_ANCHOR, SG_UNIT_GAUSSIAN };

/* And whose hits: those of each Gaussian in each view, or of all Gaussians of its anchor there. */
enum sg_anchor_hits { SG_ANCHOR_HITS_NEURAL, SG_ANCHOR_HITS_ANCHOR };

/* Gaussians without a hit in the sampled views. */
enum sg_filter_unseen {
    SG_UNSEEN_FIRST, /* have score 0 and go first */
    SG_UNSEEN_KEEP   /* stay, unless all training views are counted */
};

/* Which Gaussians are "the lowest share rho of N". */
enum sg_prune_rule {
    SG_PRUNE_EXACT,    /* floor(rho N) of them */
    SG_PRUNE_THRESHOLD /* all with at most the score at rank trunc(rho (N - 1)), as LightGaussian:
                          equal scores are removed together */
};

enum sg_prune_views { SG_VIEWS_RANDOM /* a fresh sample each time */, SG_VIEWS_ALL };

struct sg_defense_params {
    /* Default false: the filter's score is then used only at a limit of Gaussians. */
    bool on;
    /* In space: score = (1 - exp(-2 pi^2 t^2 sigma^2))^alpha x hits. The share rho with the lowest
     * scores is removed. 0..0.5, 0 = no filter. A value of -0.9..0 is minus a share of the recent
     * growth, and removes nothing after densification has ended. Default 0.03. */
    double rho;
    /* Minimum share removed per pass while rho is negative, 0..0.5. It fades to 0 until
     * densification ends, and stops at half of the model's size at the first pass. Default 0. */
    double rho_least;
    double frequency; /* t, cycles per scene unit, 1e-9..1e9. Default 8. */
    double exponent;  /* alpha, 0..100. Default 2. */
    int views;        /* K*, training views in which hits are counted, 1..10 million. Default 48. */
    int interval;     /* T_prune, iterations, 1..10 million. Default 100. */
    /* Iterations, exclusive, at most 1e9; -1 = as densification. A model does not survive pruning
     * that continues long after densification. Default -1. */
    int from, until;
    enum sg_filter_sigma sigma;        /* Default SG_SIGMA_STD. */
    enum sg_anchor_sigma anchor_sigma; /* Default SG_ANCHOR_SIGMA_NEURAL. */
    enum sg_anchor_hits anchor_hits;   /* Default SG_ANCHOR_HITS_NEURAL. */
    enum sg_filter_unit unit;          /* Default SG_UNIT_ANCHOR. */
    /* What an anchor has of its Gaussians' scores, one for each sampled view that makes them.
     * Default SG_COMBINE_SUM. */
    enum sg_combine anchor_score;
    /* Iterations in which an anchor that has grown stays, 0..1e9. Default 0. */
    int grace;
    enum sg_filter_unseen unseen; /* Default SG_UNSEEN_FIRST. */
    enum sg_hit hit;              /* Not SG_HIT_TRANSMITTANCE. Default SG_HIT_PIXELS. */
    enum sg_prune_rule rule;      /* Default SG_PRUNE_EXACT. */
    enum sg_prune_views sample;   /* Default SG_VIEWS_RANDOM. */
    /* In the image: loss + lambda (anisotropy_scale L_ani + tv_scale L_tv) of the render. */
    double lambda; /* 0..1e6, also the range of the scales. Default 4. */
    /* NULL, or a factor of lambda per training view, 0..1e3, so that photos that look clean are not
     * smoothed. Must outlive the trainer. */
    const float *view_weights;
    double anisotropy_scale; /* Default 0.005: docs/design/defense.md has the measurements. */
    double tv_scale;         /* Default 1. */
    enum sg_tv_penalty tv;   /* Default SG_TV_PENALTY_HUBER. */
    struct sg_anisotropy_params spectrum;
};

#define SG_DEFENSE_DEFAULTS                                                                        \
    .rho = 0.03, .frequency = 8, .exponent = 2, .views = 48, .interval = 100, .from = -1,          \
    .until = -1, .lambda = 4, .anisotropy_scale = 0.005, .tv_scale = 1, .tv = SG_TV_PENALTY_HUBER, \
    .spectrum = {SG_ANISOTROPY_DEFAULTS}
SG_API struct sg_defense_params sg_defense_params_default(void);

/* The paper's rho and lambda for its data sets: "ns" (NeRF-Synthetic), "tt" (Tanks and Temples) or
 * "mip" (Mip-NeRF 360). Sets rho, rho_least, frequency, lambda and view_weights, not `on`. Returns
 * false for any other name, also for "auto", which needs the photos: see sg_defense_automatic. */
SG_API bool sg_defense_preset(const char *name, struct sg_defense_params *params);

/* The largest amplitude, in grey levels, that a tolerance answers. Photos that are changed by more
 * say too little about their scene: the filter and the regulariser keep their model small. */
#define SG_TOLERANCE_MAX 32.0

/* Values of struct sg_run_params and its options that mean "that of the preset". */
#define SG_PRESET_RHO (-1.0) /* rho and rho_least */
#define SG_PRESET_LAMBDA (-1.0)
#define SG_PRESET_FREQUENCY 0.0

struct sg_audit;

/* A frequency t, in cycles per scene unit, that does not depend on the scene's unit of length.
 * extent: that of the scene. */
SG_API double sg_defense_frequency(double extent);

/* Preset auto: chooses the defense by an audit of the photos, independently of the scene's unit of
 * length. Photos that are not clean get the tolerance that the audit estimates. Photos that are
 * changed by more than a tolerance can cover get a strong regulariser and filter. Clean photos are
 * hardly affected. Sets rho, rho_least, frequency, lambda and view_weights of `params`, not `on`.
 * extent: that of the scene. tolerance: that of training, in grey levels, or SG_TOLERANCE_AUTO.
 * With a number photos that are changed by more than that get the regulariser and the filter.
 * view_weights, tolerances: arrays of one float per training view, which are filled. view_weights
 * must outlive the use of `params`; tolerances (grey levels) are for sg_train_params.tolerances
 * with SG_TOLERANCE_AUTO, else they say which photos the tolerance covers. */
SG_API void sg_defense_automatic(const struct sg_audit *audit, double extent, double tolerance,
                                 float *view_weights, float *tolerances,
                                 struct sg_defense_params *params);

/* The tolerances of photos that training uses without preset auto: what the audit estimates, of
 * those that are not clean. tolerances: one float per training view, grey levels. */
SG_API void sg_defense_tolerances(const struct sg_audit *audit, float *tolerances);

/* What the defense did in one iteration. */
struct sg_defense_step {
    /* L_ani and L_tv of the render; NAN where the loss has no such term, since it is not measured
     * then; 0 without a defense. The total variation that belongs to a tolerance counts. */
    double anisotropy, total_variation;
    bool filtered;                  /* the filter ran */
    double rho;                     /* the share to remove */
    size_t scored, removed, unseen; /* Gaussians; unseen: without a hit in the sampled views */
    double score[3]; /* 10th, 50th and 90th percentile of ln score, over Gaussians with a hit */
};

#ifdef __cplusplus
}
#endif

#endif
