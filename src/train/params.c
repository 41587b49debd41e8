/* SPDX-License-Identifier: Apache-2.0 */
/* Defaults of a run's parameters, and what their table of options cannot check. */
#include "splatguard/train.h"

#include "engine/engine.h"
#include "model/anchor.h"
#include "option/option.h"

#define LEAST_OF_ANCHORS (4 * SG_ANCHOR_GAUSSIANS)

struct sg_train_params sg_train_params_default(void)
{
    return (struct sg_train_params){SG_TRAIN_DEFAULTS};
}

struct sg_defense_params sg_defense_params_default(void)
{
    return (struct sg_defense_params){SG_DEFENSE_DEFAULTS};
}

int sg_train_check(sg_ctx *ctx, const struct sg_train_params *p)
{
    sg_clear_error(ctx);
    const struct sg_spectrum_params *band = &p->defense.spectrum.band;
    const int code = sg_check_options(ctx, sg_train_options(), p);
    if (code)
        return code;
    if (p->model == SG_MODEL_MIP && (p->strategy != SG_STRATEGY_DEFAULT || p->absgrad))
        return sg_fail(ctx, SG_ERR_USAGE,
                       "model: found mip with %s, expected the strategy default without absgrad",
                       p->absgrad ? "absgrad" : "another strategy");
    if (p->model == SG_MODEL_SCAFFOLD && (p->strategy != SG_STRATEGY_DEFAULT || p->absgrad))
        return sg_fail(ctx, SG_ERR_USAGE,
                       "model: found scaffold with %s, expected the strategy default, in whose "
                       "place its anchors grow, without absgrad",
                       p->absgrad ? "absgrad" : "another strategy");
    if (p->model == SG_MODEL_SCAFFOLD && p->max_gaussians && p->max_gaussians < LEAST_OF_ANCHORS)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "max_gaussians: found %llu with the model scaffold, expected at least %d: "
                       "those of 4 anchors",
                       (unsigned long long) p->max_gaussians, LEAST_OF_ANCHORS);
    if (p->model == SG_MODEL_SCAFFOLD &&
        (p->at_limit == SG_AT_LIMIT_RANDOM || p->at_limit == SG_AT_LIMIT_UNIVERSAL))
        return sg_fail(ctx, SG_ERR_USAGE,
                       "at_limit: found %s with the model scaffold, expected score or stop: at the "
                       "limit the steepest anchors grow",
                       p->at_limit == SG_AT_LIMIT_RANDOM ? "random" : "universal");
    if (p->strategy == SG_STRATEGY_MCMC && p->defense.on && p->defense.rho != 0)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "defense.rho: found %g with the strategy mcmc, which moves Gaussians where "
                       "the default removes them, expected 0",
                       p->defense.rho);
    if (p->model == SG_MODEL_SCAFFOLD && p->defense.on && p->defense.unit == SG_UNIT_GAUSSIAN &&
        p->defense.rho < 0)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "defense.rho: found a share of growth with the unit gaussian, whose growth "
                       "is not known, expected 0 to 0.5");
    if (p->model == SG_MODEL_SCAFFOLD && p->defense.on && p->defense.unit == SG_UNIT_GAUSSIAN &&
        p->scaffold.offsets < SG_ANCHOR_GAUSSIANS)
        return sg_fail(
            ctx, SG_ERR_USAGE,
            "defense.unit: found gaussian with %d offsets of an anchor, expected anchor, or "
            "%d offsets",
            p->scaffold.offsets, SG_ANCHOR_GAUSSIANS);
    if (p->model == SG_MODEL_SCAFFOLD && p->scaffold.bank &&
        p->scaffold.features < SG_ANCHOR_FEATURES)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "scaffold.features: found %d with the feature bank, expected %d",
                       p->scaffold.features, SG_ANCHOR_FEATURES);
    if (!(p->seconds_before >= 0 && p->seconds_before <= 1e9))
        return sg_fail(ctx, SG_ERR_USAGE, "seconds_before: found %g, expected 0 to 1e9",
                       p->seconds_before);
    if (band->high < band->low)
        return sg_fail(ctx, SG_ERR_USAGE, "defense.spectrum.band.high: found %g, expected %g to 1",
                       band->high, band->low);
    if (band->bins % 2)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "defense.spectrum.band.bins: found %d, expected an even number from 2 to %d",
                       band->bins, SG_SPECTRUM_BINS_MAX);
    return sg_engine_check(ctx, p->engine, p->cpu);
}
