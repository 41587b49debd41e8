/* SPDX-License-Identifier: Apache-2.0 */
/* The parameters of an attack: names, ranges and help. */
#include "option/anchors.h"
#include "option/option.h"
#include "splatguard/attack.h"

#define STRUCT struct sg_attack_params
#define GROUP(name) .group = name
#define EXPERT .expert = true
#define PRESET .words = "preset", .first_word = SG_ATTACK_BY_PRESET, .numbered = true

#define INTEGER(name, field, low, high, help, ...)                                                 \
    SG_NUMBER(SG_OPTION_INT, name, field, low, high, "N", help, __VA_ARGS__)
#define COUNT(name, field, low, high, help, ...)                                                   \
    SG_NUMBER(SG_OPTION_U64, name, field, low, high, "N", help, __VA_ARGS__)
#define FLOAT(name, field, low, high, unit, help, ...)                                             \
    SG_NUMBER(SG_OPTION_FLOAT, name, field, low, high, unit, help, __VA_ARGS__)
#define LEVELS(name, field, help, ...)                                                             \
    SG_NUMBER(SG_OPTION_LEVELS, name, field, 0, 255, "LEVELS", help, __VA_ARGS__)
#define RATE(name, field, help)                                                                    \
    SG_NUMBER(SG_OPTION_FLOAT, name, field, 0, 1, "X", help, DECOY, EXPERT)

#define RUN GROUP("Run")
#define ATTACK GROUP("Attack")
#define DECOY GROUP("Proxy and decoy")

/* Choices are indices of enums. */
_Static_assert(SG_ATTACK_TV_VERTICAL2 == 0 && SG_ATTACK_TV_ANISO == 1 && SG_ATTACK_TV_ISO == 2,
               "the order of the attack's choices");
_Static_assert(SG_ATTACK_SCAFFOLD == 1, "the order of the models");

static const struct sg_option attack_options[] = {
    SG_NUMBER(SG_OPTION_U64, "seed", seed, 0, 9e15, "S", "Seed of every random draw.", RUN,
              .any = true),
    SG_OPTION_ENGINE(RUN, EXPERT),
    SG_OPTION_CPU(RUN, EXPERT),
    LEVELS("epsilon", epsilon,
           "Bound on every value's change in whole grey levels (8, 16, 24), or inf.", ATTACK,
           .whole = true),
    INTEGER("iterations", iterations, 1, 1e7, "Views visited; 0 = the preset's (6000 to 36000).",
            ATTACK, PRESET),
    INTEGER("inner", inner, 0, 1000,
            "Ascent steps a visit; 0 = the preset's (15 or 25; tv-per-view 100).", ATTACK, EXPERT,
            PRESET),
    INTEGER("update-interval", update_interval, 1, 1000,
            "Views whose gradients are summed for one step of the decoy; 0 = the preset's (1 or "
            "10).",
            ATTACK, EXPERT, PRESET),
    LEVELS("step", step, "Size of an ascent step in grey levels.", ATTACK, EXPERT),
    SG_CHOICE("tv", tv, "vertical2|aniso|iso", "FORM",
              "Total variation to raise: vertical differences only, as published; both "
              "directions; root of their squares.",
              ATTACK, EXPERT),
    FLOAT("spectral-weight", spectral_weight, 0, 1e6, "X",
          "Against a spectral defense: also keep the poison's energy even over directions; 1 = a "
          "mean gradient as of one neighbour's difference.",
          ATTACK, EXPERT),
    FLOAT("scale-floor", scale_floor, 0, 1e6, "X",
          "Against a filter of thin Gaussians: smallest scale in the decoy, scene units; 0 = none.",
          ATTACK, EXPERT),
    FLOAT("wavelength", wavelength, 0, 1e6, "PIXELS",
          "Wavelength of the drift. At the photo's size or more it looks like a change of "
          "exposure. 0 = the photo's longer side.",
          ATTACK, EXPERT),
    FLOAT("victim-tolerance", victim_tolerance, 0, 255, "LEVELS",
          "Against training with --tolerance LEVELS: the decoy learns as such a victim does, and "
          "poisons exceed what it shows, within the bound.",
          ATTACK, EXPERT),
    COUNT("victim-gaussians", victim_gaussians, 4, 4e9,
          "Against training with --max-gaussians N: at N the decoy's new Gaussians take the place "
          "of those that the filter scores lowest, as such a victim's do. 0 = none. Not with "
          "--max-gaussians or --model scaffold.",
          ATTACK, EXPERT, .or_zero = true),
    FLOAT("texture", texture, 0, 255, "LEVELS",
          "Against an audit: where neighbouring values of the clean photo differ by less than "
          "LEVELS on average (within 3 pixels), the bound shrinks in proportion, to 0 in flat "
          "parts; 0 = epsilon everywhere.",
          ATTACK, EXPERT),
    SG_CHOICE("model", model, "3dgs|scaffold", "NAME",
              "Model of the proxy and the decoy, best that of the victim. scaffold: Scaffold-GS.",
              DECOY),
    SG_FLAG("move-positions", move_positions,
            "Let the decoy's positions learn; the published attack freezes them.", DECOY, EXPERT),
    FLOAT("lambda-dssim", lambda_dssim, 0, 1, "X", "Weight of 1 - SSIM against L1.", DECOY, EXPERT),
    RATE("feature-lr", feature_lr, "Colour; higher SH degrees learn at a twentieth."),
    RATE("opacity-lr", opacity_lr, "Opacity."),
    RATE("scaling-lr", scaling_lr, "Scale."),
    RATE("rotation-lr", rotation_lr, "Rotation."),
    RATE("percent-dense", percent_dense,
         "Split Gaussians larger than this share of the extent, clone smaller ones."),
    INTEGER("densification-interval", densification_interval, 1, 1e7,
            "Iterations between densifications.", DECOY, EXPERT),
    FLOAT("densify-grad-threshold", densify_grad_threshold, 0, 1e30, "X",
          "Mean view-space gradient that makes a Gaussian grow.", DECOY, EXPERT),
    COUNT("max-gaussians", max_gaussians, 4, 4e9,
          "Growth of the decoy stops at this number; 0 = no limit.", DECOY, .or_zero = true),
    COUNT("max-instances", max_instances, 1, 4e9,
          "(Gaussian, tile) pairs held at once; views with more are processed in bands, with the "
          "same result.",
          DECOY, EXPERT),
    SG_ANCHOR_OPTIONS,
    {0},
};

const struct sg_option *sg_attack_options(void)
{
    return attack_options;
}
