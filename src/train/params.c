/* SPDX-License-Identifier: Apache-2.0 */
/* The ranges of a run's parameters. */
#include "splatguard/train.h"

#include "engine/engine.h"
#include "core/ranges.h"

struct sg_train_params sg_train_params_default(void)
{
    return (struct sg_train_params){SG_TRAIN_DEFAULTS};
}

struct sg_defense_params sg_defense_params_default(void)
{
    return (struct sg_defense_params){SG_DEFENSE_DEFAULTS};
}

static int check_defense(sg_ctx *ctx, const struct sg_defense_params *d)
{
    const struct sg_spectrum_params *band = &d->spectrum.band;
    const struct sg_range ranges[] = {
        {"rho", d->rho, -0.9, 0.5},
        {"rho-least", d->rho_least, 0, 0.5},
        {"filter-frequency", d->frequency, 1e-9, 1e9},
        {"filter-exponent", d->exponent, 0, 100},
        {"filter-views", d->views, 1, 1e7},
        {"filter-interval", d->interval, 1, 1e7},
        {"filter-from", d->from, -1, 1e9},
        {"filter-until", d->until, -1, 1e9},
        {"lambda", d->lambda, 0, 1e6},
        {"anisotropy-scale", d->anisotropy_scale, 0, 1e6},
        {"tv-scale", d->tv_scale, 0, 1e6},
        {"band-low", band->low, 0, 1},
        {"band-high", band->high, band->low, 1},
        {"bins", band->bins, 2, SG_SPECTRUM_BINS_MAX},
    };
    const int code = sg_check_ranges(ctx, ranges, sizeof(ranges) / sizeof(ranges[0]));
    if (!code && band->bins % 2)
        return sg_fail(ctx, SG_ERR_USAGE, "bins: found %d, expected an even number from 2 to %d",
                       band->bins, SG_SPECTRUM_BINS_MAX);
    return code;
}

int sg_train_check(sg_ctx *ctx, const struct sg_train_params *p)
{
    sg_clear_error(ctx);
    const struct sg_range ranges[] = {
        {"iterations", p->iterations, 1, 1e7},
        {"sh-degree", p->sh_degree, 0, 3},
        {"sh-interval", p->sh_interval, 1, 1e7},
        {"lambda-dssim", (double) p->lambda_dssim, 0, 1},
        {"tolerance", (double) p->tolerance, 0, 255},
        {"position-lr-init", (double) p->position_lr_init, 1e-12, 1e3},
        {"position-lr-final", (double) p->position_lr_final, 1e-12, 1e3},
        {"position-lr-max-steps", p->position_lr_max_steps, 1, 1e9},
        {"feature-lr", (double) p->feature_lr, 0, 1e3},
        {"opacity-lr", (double) p->opacity_lr, 0, 1e3},
        {"scaling-lr", (double) p->scaling_lr, 0, 1e3},
        {"rotation-lr", (double) p->rotation_lr, 0, 1e3},
        {"percent-dense", (double) p->percent_dense, 0, 1e3},
        {"densification-interval", p->densification_interval, 1, 1e7},
        {"densify-from-iter", p->densify_from_iter, 0, 1e9},
        {"densify-until-iter", p->densify_until_iter, 0, 1e9},
        {"densify-grad-threshold", (double) p->densify_grad_threshold, 0, 1e9},
        {"opacity-reset-interval", p->opacity_reset_interval, 1, 1e9},
        {"init-points", (double) p->init_points, 4, 1e8},
        {"max-instances", (double) p->max_instances, 1, 4e9},
        {"max-time", p->max_seconds, 0, 1e9},
        {"seconds before", p->seconds_before, 0, 1e9},
    };
    int code = sg_check_ranges(ctx, ranges, sizeof(ranges) / sizeof(ranges[0]));
    if (!code)
        code = sg_check_max_gaussians(ctx, p->max_gaussians);
    if (!code)
        code = check_defense(ctx, &p->defense);
    return code ? code : sg_engine_check(ctx, p->engine, p->cpu);
}
