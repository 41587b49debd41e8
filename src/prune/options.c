/* SPDX-License-Identifier: Apache-2.0 */
/* The parameters of pruning: names, ranges and help. */
#include "option/option.h"
#include "splatguard/prune.h"

#define STRUCT struct sg_prune_params
#define EXPERT .expert = true
#define PRUNING .group = "Pruning"
#define LIGHTGAUSSIAN .group = "LightGaussian", EXPERT
#define PUP .group = "PUP 3D-GS", EXPERT
#define SPECTRAL .group = "Spectral", EXPERT
#define INTEGER(name, field, low, high, help, ...)                                                 \
    SG_NUMBER(SG_OPTION_INT, name, field, low, high, "N", help, __VA_ARGS__)
#define DOUBLE(name, field, low, high, help, ...)                                                  \
    SG_NUMBER(SG_OPTION_DOUBLE, name, field, low, high, "X", help, __VA_ARGS__)

/* Choices are indices of enums. */
_Static_assert(SG_PRUNER_PUP == 1 && SG_PRUNER_SPECTRAL == 2 && SG_GLOBAL_OPACITY == 4 &&
                   SG_GLOBAL_WEIGHT_TRANSMITTANCE == 1,
               "the order of the choices of pruning");

static const struct sg_option prune_options[] = {
    SG_CHOICE("method", method, "lightgaussian|pup|spectral", "NAME",
              "Score that decides which Gaussians are removed: LightGaussian's, PUP 3D-GS's, or "
              "that of the spectral defense.",
              PRUNING),
    DOUBLE("ratio", ratio, 0, 1,
           "Share of the Gaussians to remove; published: 0.8 for pup, else 0.66.", PRUNING,
           .words = "published", .first_word = SG_PRUNE_PUBLISHED),
    DOUBLE("second-ratio", second_ratio, 0, 1,
           "Share to remove in a second round, after the fine-tuning of the first; 0 = one round "
           "only; published: 0.5 for pup with its published --ratio, else 0.",
           PRUNING, .words = "published", .first_word = SG_PRUNE_PUBLISHED),
    SG_NUMBER(SG_OPTION_U64, "max-gaussians", max_gaussians, 0, 4e9, "N",
              "Most Gaussians that are left, in place of the ratios; with pup a first round keeps "
              "twice as many. 0 = the ratios count.",
              PRUNING),
    INTEGER("finetune", finetune, 0, 1e7,
            "Iterations of training after each round, without densification; 0 = none.", PRUNING),
    INTEGER("trained", trained, 0, 1e7,
            "Iterations that MODEL was trained for: learning rates continue from there; a run "
            "knows its own.",
            PRUNING, EXPERT),
    SG_NUMBER(SG_OPTION_U64, "seed", seed, 0, 9e15, "S", "Seed of the order of the views.", PRUNING,
              .any = true, EXPERT),
    SG_OPTION_ENGINE(PRUNING, EXPERT),
    SG_OPTION_CPU(PRUNING, EXPERT),
    SG_CHOICE("global-score", score, "v-important|important|max-v|count|opacity", "NAME",
              "The released program's scores: the sum over pixels times a power of the volume, the "
              "sum alone, times the largest scale, the number of pixels, the opacity.",
              LIGHTGAUSSIAN),
    SG_CHOICE("global-weight", weight, "opacity|transmittance", "NAME",
              "What each pixel adds to the sum: the opacity, as the released program does, or "
              "opacity times transmittance, as in the paper.",
              LIGHTGAUSSIAN),
    DOUBLE("volume-power", volume_power, 0, 10, "Power of the volume.", LIGHTGAUSSIAN),
    SG_FLAG("volume-clip", volume_clip,
            "Limit volume / V90 to 1, as in the paper. 90 % of the Gaussians are larger than V90.",
            LIGHTGAUSSIAN),
    INTEGER("reduce", reduce, 1, 64, "Score at views that are this many times smaller.", PUP),
    SG_FLAG("released-gradient", released_gradient,
            "The released program's gradient, in which colour channels leak into each other.", PUP),
    DOUBLE("filter-frequency", frequency, 1e-9, 1e9,
           "Reference frequency t, cycles per scene unit; 0 = 41.6 / the scene's extent.", SPECTRAL,
           .or_zero = true),
    DOUBLE("filter-exponent", exponent, 0, 100, "Exponent alpha of the frequency weight.",
           SPECTRAL),
    {0},
};

const struct sg_option *sg_prune_options(void)
{
    return prune_options;
}
