/* SPDX-License-Identifier: Apache-2.0 */
/* The parameters of a training: names, ranges and help, which the check, the command line and
 * config.json are made from. */
#include "option/anchors.h"
#include "option/option.h"
#include "splatguard/train.h"

#define STRUCT struct sg_train_params
#define GROUP(name) .group = name
#define EXPERT .expert = true

#define INTEGER(name, field, low, high, help, ...)                                                 \
    SG_NUMBER(SG_OPTION_INT, name, field, low, high, "N", help, __VA_ARGS__)
#define COUNT(name, field, low, high, help, ...)                                                   \
    SG_NUMBER(SG_OPTION_U64, name, field, low, high, "N", help, __VA_ARGS__)
#define FLOAT(name, field, low, high, help, ...)                                                   \
    SG_NUMBER(SG_OPTION_FLOAT, name, field, low, high, "X", help, __VA_ARGS__)
#define DOUBLE(name, field, low, high, help, ...)                                                  \
    SG_NUMBER(SG_OPTION_DOUBLE, name, field, low, high, "X", help, __VA_ARGS__)

#define RUN GROUP("Run")
#define LOSS GROUP("Model and loss")
#define RATES GROUP("Learning rates"), EXPERT
#define DENSIFY GROUP("Densification")
#define MCMC GROUP("Densification by --strategy mcmc")
#define MIP GROUP("Filters of --model mip"), EXPERT
#define BUDGETS GROUP("Budgets")
#define DEFENSE GROUP("Defense")
#define RASTERISER GROUP("Rasteriser"), EXPERT

/* Choices are indices of enums. */
_Static_assert(SG_STRATEGY_MCMC == 1, "the order of the strategies");
_Static_assert(SG_MODEL_MIP == 1 && SG_MODEL_SCAFFOLD == 2, "the order of the models");
_Static_assert(SG_SIGMA_EIGEN == 1 && SG_ANCHOR_SIGMA_ANCHOR == 1 && SG_ANCHOR_HITS_ANCHOR == 1 &&
                   SG_UNIT_GAUSSIAN == 1 && SG_COMBINE_MAX == 1 && SG_COMBINE_MEAN == 2 &&
                   SG_UNSEEN_KEEP == 1 && SG_HIT_VIEWS == 1 && SG_HIT_WEIGHT == 2 &&
                   SG_PRUNE_THRESHOLD == 1 && SG_VIEWS_ALL == 1 && SG_TV_PENALTY_L1 == 1 &&
                   SG_TV_PENALTY_HUBER == 2 && SG_STRATEGY_LIGHTGAUSSIAN == 2 &&
                   SG_AT_LIMIT_UNIVERSAL == 3 && SG_ENERGY_AMPLITUDE == 1 && SG_CHANNELS_LUMA == 1,
               "the order of the defense's choices");

static const struct sg_option train_options[] = {
    INTEGER("iterations", iterations, 1, 1e7, "Training iterations.", RUN),
    SG_NUMBER(SG_OPTION_U64, "seed", seed, 0, 9e15, "S", "Seed of every random draw.", RUN,
              .any = true),
    SG_OPTION_ENGINE(RUN),
    SG_OPTION_CPU(RUN, EXPERT),
    COUNT("init-points", init_points, 4, 1e8, "Random points where the scene has none.",
          GROUP("Initialisation"), EXPERT),
    SG_FLAG("random-points", random_points,
            "Begin with random points although the scene has some, as the released code of MCMC "
            "can.",
            GROUP("Initialisation"), EXPERT),
    FLOAT(
        "random-extent", random_extent, 0, 1000,
        "Half of the side of the cube of random points, in scene extents. 0 = 1.3 scene units, as "
        "for NeRF-Synthetic; with --strategy mcmc and a scene of another layout 3 extents.",
        GROUP("Initialisation"), EXPERT),
    SG_CHOICE("model", model, "3dgs|mip|scaffold", "NAME",
              "mip: Mip-Splatting, with filters against aliasing at other distances and sizes. "
              "scaffold: Scaffold-GS, anchors of which networks make Gaussians for each view.",
              LOSS, EXPERT),
    SG_FLAG("keep-filter", keep_filter,
            "With --model mip: save the 3D filter as the property filter_3D, as the released code "
            "does, instead of folded into scales and opacities.",
            LOSS, EXPERT),
    INTEGER("sh-degree", sh_degree, 0, 3, "Degree of the spherical harmonics.", LOSS),
    INTEGER("sh-interval", sh_interval, 1, 1e7, "Iterations between raises of the degree in use.",
            LOSS, EXPERT),
    SG_FLAG("random-background", random_background, "A random background colour each iteration.",
            LOSS, EXPERT),
    FLOAT("lambda-dssim", lambda_dssim, 0, 1, "Weight of 1 - SSIM against L1.", LOSS, EXPERT),
    SG_FLAG(
        "exposure", exposure,
        "Learn how each photo was exposed, as an affine map of colours. Test views are measured "
        "without, and after matching colours.",
        LOSS),
    FLOAT("exposure-lr-init", exposure_lr_init, 1e-12, 1000, "Exposures, at the start.", RATES),
    FLOAT("exposure-lr-final", exposure_lr_final, 1e-12, 1000, "Exposures, at the end.", RATES),
    FLOAT("position-lr-init", position_lr_init, 1e-12, 1000,
          "Position, at the start, in scene extents.", RATES),
    FLOAT("position-lr-final", position_lr_final, 1e-12, 1000,
          "Position, at the end, in scene extents.", RATES),
    INTEGER("position-lr-max-steps", position_lr_max_steps, 1, 1e9, "Iterations between the two.",
            RATES),
    FLOAT("feature-lr", feature_lr, 0, 1000, "Colour; higher SH degrees learn at a twentieth.",
          RATES),
    FLOAT("opacity-lr", opacity_lr, 0, 1000, "Opacity.", RATES),
    FLOAT("scaling-lr", scaling_lr, 0, 1000, "Scale.", RATES),
    FLOAT("rotation-lr", rotation_lr, 0, 1000, "Rotation.", RATES),
    SG_CHOICE("strategy", strategy, "default|mcmc|lightgaussian", "NAME",
              "How the number of Gaussians changes. default: clones, splits, prunes and resets of "
              "opacity. mcmc: transparent Gaussians move to opaque ones, copies of these are added "
              "up to --cap-max, and noise on positions explores. lightgaussian: the default, and "
              "LightGaussian's score removes 50 % and 40 % at 8/15 and 12/15 of the iterations.",
              DENSIFY),
    FLOAT("percent-dense", percent_dense, 0, 1000,
          "Split Gaussians larger than this share of the extent, clone smaller ones.", DENSIFY,
          EXPERT),
    INTEGER("densification-interval", densification_interval, 1, 1e7,
            "Iterations between densifications.", DENSIFY, EXPERT),
    INTEGER("densify-from-iter", densify_from_iter, 0, 1e9, "Densify after this iteration.",
            DENSIFY, EXPERT),
    INTEGER("densify-until-iter", densify_until_iter, 0, 1e9, "Densify before this iteration.",
            DENSIFY, EXPERT),
    FLOAT("densify-grad-threshold", densify_grad_threshold, 0, 1e9,
          "Mean view-space gradient that makes a Gaussian grow.", DENSIFY, EXPERT),
    SG_FLAG("absgrad", absgrad,
            "Growth follows from the sum over pixels of absolute gradients; use a higher "
            "--densify-grad-threshold, 0.0008.",
            DENSIFY, EXPERT),
    INTEGER("opacity-reset-interval", opacity_reset_interval, 1, 1e9,
            "Iterations between opacity resets.", DENSIFY, EXPERT),
    COUNT("cap-max", mcmc.cap_max, 4, 4e9, "Most Gaussians.", MCMC, EXPERT),
    DOUBLE("mcmc-growth", mcmc.growth, 1, 2, "Factor of their number at each edit, up to the cap.",
           MCMC, EXPERT),
    INTEGER("mcmc-until", mcmc.until, 0, 1e9, "Edit before this iteration.", MCMC, EXPERT),
    FLOAT("opacity-reg", mcmc.opacity_reg, 0, 1000, "Weight of the mean opacity in the loss.", MCMC,
          EXPERT),
    FLOAT("scale-reg", mcmc.scale_reg, 0, 1000, "Weight of the mean scale in the loss.", MCMC,
          EXPERT),
    FLOAT("noise-lr", mcmc.noise_lr, 0, 1e9, "Noise on positions, in learning rates of positions.",
          MCMC, EXPERT),
    FLOAT("noise-gate", mcmc.noise_gate, 0, 1e6,
          "How sharply the noise ends at the opacity of --mcmc-dead.", MCMC, EXPERT),
    FLOAT("mcmc-dead", mcmc.dead, 0, 0.5, "Opacity up to which a Gaussian is dead.", MCMC, EXPERT),
    INTEGER("mcmc-copies", mcmc.copies, 1, 1000,
            "A Gaussian shares its opacity among at most so many copies.", MCMC, EXPERT),
    FLOAT("mcmc-init-opacity", mcmc.init_opacity, 0.001, 0.999, "Opacity of initial points.", MCMC,
          EXPERT),
    FLOAT("mcmc-init-scale", mcmc.init_scale, 1e-6, 1000,
          "Scale of initial points, in distances to their neighbours.", MCMC, EXPERT),
    FLOAT("mip-kernel", mip.kernel, 1e-3, 100, "Variance of the 2D filter, squared pixels.", MIP),
    DOUBLE("mip-variance", mip.variance, 0, 100,
           "Variance of a Gaussian's 3D filter, in squared pixels of the camera that sees it from "
           "nearest.",
           MIP),
    DOUBLE("mip-margin", mip.margin, 0, 10,
           "A camera also sees what is beyond its image by at most this share of the sides.", MIP),
    INTEGER("mip-interval", mip.interval, 1, 1e7,
            "Iterations between two computations of the 3D filter once nothing densifies any more.",
            MIP),
    SG_ANCHOR_OPTIONS,
    COUNT("max-gaussians", max_gaussians, 4, 4e9,
          "Most Gaussians; --at-limit says what happens there. 0 = no limit.", BUDGETS,
          .or_zero = true),
    SG_CHOICE(
        "at-limit", at_limit, "score|random|stop|universal", "NAME",
        "What happens where growth meets --max-gaussians. score: new Gaussians take the place "
        "of those that the defense's filter scores lowest; random: of some that chance "
        "chooses. stop: those with the steepest gradients grow until the limit is met. "
        "universal: all grow while there are fewer than the limit, so the model can exceed it "
        "(Poison-splat's universal threshold).",
        BUDGETS, EXPERT),
    SG_NUMBER(SG_OPTION_TIME, "max-time", max_seconds, 0, 1e9, "TIME",
              "Most time until the model is trained, e.g. 90s, 10m or 1h30m: iterations are "
              "skipped so that the schedule still ends. 0 = no limit.",
              BUDGETS),
    SG_SWITCH("defense", defense.on, "off|spectral", "NAME",
              "Against poisoned photos: prune Gaussians of high frequency, keep renders smooth and "
              "even over directions. With --preset auto photos that are not clean have a tolerance "
              "instead.",
              DEFENSE),
    SG_NUMBER(SG_OPTION_FLOAT, "tolerance", tolerance, 0, 255, "LEVELS|auto",
              "The loss compares a render with the nearest image that differs from the photo by "
              "at most LEVELS grey levels, so that noise within them has no effect. auto: for each "
              "photo as many levels as the audit finds noise in it. preset: auto with --defense "
              "spectral --preset auto, else 0.",
              DEFENSE, .words = "auto|preset", .first_word = SG_TOLERANCE_AUTO),
    FLOAT("tolerance-tv", tolerance_tv, 0, 1000,
          "Weight of the total variation of renders of photos with a tolerance: it chooses among "
          "the images that the tolerance allows. With --lambda the defense's own takes its place.",
          DEFENSE, EXPERT),
    INTEGER(
        "tolerance-look", tolerance_look, -1, 1e9,
        "After N iterations, and after 3, 5, 7 and 9 times as many while Gaussians are added, "
        "photos with a tolerance are compared with their renders. With --tolerance auto the noise "
        "that the first comparison finds becomes the tolerance, and so does a bound that any of "
        "them finds on black or white. -1 = a tenth of --densify-until-iter, or of --iterations "
        "if that is less; 0 = never.",
        DEFENSE, EXPERT),
    FLOAT("tolerance-growth", tolerance_growth, 0, 1000,
          "Multiplies --densify-grad-threshold by X times the share of the difference between "
          "photos and renders that exceeds the tolerance, but by at least 0.6 and at most 1. A "
          "tolerance hides gradients, and a lower threshold makes up for them. 0 = off.",
          DEFENSE, EXPERT),
    FLOAT("tolerance-low-pass", tolerance_low_pass, 0, 1000,
          "Weight of the squared low-pass difference from photos with a tolerance in the last "
          "tenth of the iterations, which restores contrast below the tolerance. Rates fall "
          "there, and no Gaussian is added or removed. 0 = off.",
          DEFENSE, EXPERT),
    FLOAT("tolerance-smooth", tolerance_smooth, 0, 1,
          "With --tolerance auto: if more than this share of the difference between photos and "
          "renders exceeds the tolerance in the first comparison (--tolerance-look), photos agree "
          "too little for a tolerance. Those that have one are then smoothed instead, as by "
          "--smooth bilateral, with a strength that follows their noise. 1 = never.",
          DEFENSE, EXPERT),
    DOUBLE("rho", defense.rho, -0.9, 0.5,
           "Share of the Gaussians that the filter removes at a time, 0 to 0.5; growth:X = the "
           "share X of recent growth, up to 0.9, which -X means too; -1 = the preset's.",
           DEFENSE, EXPERT, .words = "preset", .first_word = SG_PRESET_RHO, .negative = "growth",
           .numbered = true),
    DOUBLE("rho-least", defense.rho_least, 0, 0.5,
           "Least share that the filter removes at a time while --rho is a share of growth. It "
           "shrinks to 0 when densification ends, and holds only while the model is larger than "
           "half of its first size. -1 = the preset's, 0 with a --rho.",
           DEFENSE, EXPERT, .words = "preset", .first_word = SG_PRESET_RHO, .numbered = true),
    DOUBLE("filter-frequency", defense.frequency, 1e-9, 1e9,
           "Reference frequency t, cycles per scene unit; 0 = the preset's: 8, auto: 41.6 / the "
           "scene's extent.",
           DEFENSE, EXPERT, .words = "preset", .first_word = SG_PRESET_FREQUENCY, .numbered = true),
    DOUBLE("filter-exponent", defense.exponent, 0, 100, "Exponent alpha of the frequency weight.",
           DEFENSE, EXPERT),
    INTEGER("filter-views", defense.views, 1, 1e7, "Training views in which hits are counted.",
            DEFENSE, EXPERT),
    INTEGER("filter-interval", defense.interval, 1, 1e7, "Iterations between removals.", DEFENSE,
            EXPERT),
    INTEGER("filter-from", defense.from, -1, 1e9,
            "Remove after this iteration; -1 = as densification.", DEFENSE, EXPERT),
    INTEGER("filter-until", defense.until, -1, 1e9,
            "Remove before this iteration; -1 = until densification ends, which always holds while "
            "--rho is a share of growth.",
            DEFENSE, EXPERT),
    SG_CHOICE("filter-sigma", defense.sigma, "std|eigen", "NAME",
              "Size in the frequency weight: smallest scale, or its square (the smallest "
              "eigenvalue).",
              DEFENSE, EXPERT),
    SG_CHOICE("filter-unit", defense.unit, "anchor|gaussian", "NAME",
              "With --model scaffold, what the filter removes: anchors, or single Gaussians of "
              "them, which leaves nearly as many anchors.",
              DEFENSE, EXPERT),
    SG_CHOICE("filter-anchors", defense.anchor_sigma, "neural|anchor", "NAME",
              "With --model scaffold, whose size: that of each Gaussian where it is drawn, or that "
              "of its anchor.",
              DEFENSE, EXPERT),
    SG_CHOICE("filter-anchor-hits", defense.anchor_hits, "neural|anchor", "NAME",
              "With --model scaffold, whose hits a Gaussian has in a view: its own, or all of its "
              "anchor's.",
              DEFENSE, EXPERT),
    SG_CHOICE(
        "filter-anchor-score", defense.anchor_score, "sum|max|mean", "NAME",
        "With --model scaffold, what an anchor has of its Gaussians' scores, over all sampled "
        "views that make them.",
        DEFENSE, EXPERT),
    INTEGER("filter-grace", defense.grace, 0, 1e9,
            "With --model scaffold, iterations in which the filter spares a new anchor.", DEFENSE,
            EXPERT),
    SG_CHOICE(
        "filter-unseen", defense.unseen, "first|keep", "NAME",
        "Gaussians without a hit in the sampled views: they go first, or they stay unless all "
        "training views are counted.",
        DEFENSE, EXPERT),
    SG_CHOICE("filter-hits", defense.hit, "pixels|views|weight", "NAME",
              "Hits of a Gaussian: pixels it is blended in, views, or its weight in the pixels.",
              DEFENSE, EXPERT),
    SG_CHOICE("filter-rule", defense.rule, "exact|threshold", "NAME",
              "Remove exactly the share, or all up to the score there (LightGaussian's rule).",
              DEFENSE, EXPERT),
    SG_CHOICE("filter-sample", defense.sample, "random|all", "NAME",
              "Views to count in: a new sample each time, or all.", DEFENSE, EXPERT),
    DOUBLE("lambda", defense.lambda, 0, 1e6,
           "Weight of the two losses on renders (auto: of photos that look poisoned, up to four "
           "times as much where they oscillate strongly); -1 = the preset's.",
           DEFENSE, EXPERT, .words = "preset", .first_word = SG_PRESET_LAMBDA, .numbered = true),
    DOUBLE("anisotropy-scale", defense.anisotropy_scale, 0, 1e6,
           "Times lambda: weight of the spectrum's anisotropy.", DEFENSE, EXPERT),
    DOUBLE("tv-scale", defense.tv_scale, 0, 1e6, "Times lambda: weight of the total variation.",
           DEFENSE, EXPERT),
    SG_CHOICE("tv-norm", defense.tv, "l2|l1|huber", "NAME",
              "Total variation: mean of squared or of absolute differences; huber: squared up to "
              "16 grey levels, then linear.",
              DEFENSE, EXPERT),
    DOUBLE("band-low", defense.spectrum.band.low, 0, 1,
           "Lower edge of the band, as a part of the Nyquist frequency.", DEFENSE, EXPERT),
    DOUBLE("band-high", defense.spectrum.band.high, 0, 1, "Upper edge of the band.", DEFENSE,
           EXPERT),
    INTEGER("bins", defense.spectrum.band.bins, 2, SG_SPECTRUM_BINS_MAX,
            "Directions of the spectrum, even.", DEFENSE, EXPERT),
    SG_CHOICE("energy", defense.spectrum.energy, "power|amplitude", "NAME",
              "What a coefficient of the spectrum counts.", DEFENSE, EXPERT),
    SG_CHOICE("channels", defense.spectrum.channels, "sum|luma", "NAME",
              "Energy of all three channels, or of the luma.", DEFENSE, EXPERT),
    SG_FLAG("exact-spectrum", defense.spectrum.exact_size,
            "Transform image sides of any length as they are; by default they are extended to the "
            "next fast length.",
            DEFENSE, EXPERT),
    COUNT("max-instances", max_instances, 1, 4e9,
          "(Gaussian, tile) pairs held at once; views with more are processed in bands, with the "
          "same result.",
          RASTERISER),
    SG_FLAG("reference-tiles", reference_tiles,
            "Keep every tile of the 3-sigma square, for parity checks.", RASTERISER),
    {0},
};

const struct sg_option *sg_train_options(void)
{
    return train_options;
}

#undef STRUCT
#define STRUCT struct sg_render_params

static const struct sg_option render_options[] = {
    COUNT("max-instances", max_instances, 1, 4e9,
          "(Gaussian, tile) pairs held at once; more are processed in bands.", RASTERISER,
          .transient = true),
    FLOAT(
        "mip-kernel", mip_kernel, 0, 100,
        "Variance of the 2D filter of Mip-Splatting, squared pixels, for models that were trained "
        "with it: usually 0.1. 0 = that of the run, or no such filter.",
        RASTERISER, .transient = true),
    INTEGER("appearance", appearance, -3, 1e6,
            "Of which training photo, from 0, a model with --photo-appearance has the appearance. "
            "mean: the mean of all; index: view i has that of photo i, as in the released code; "
            "zero: zeros.",
            RASTERISER, .words = "index|mean|zero", .first_word = SG_APPEARANCE_INDEX,
            .transient = true),
    SG_FLAG("reference-tiles", reference_tiles,
            "Keep every tile of the 3-sigma square, for parity checks.", RASTERISER,
            .transient = true),
    {0},
};

const struct sg_option *sg_render_options(void)
{
    return render_options;
}
