/* SPDX-License-Identifier: Apache-2.0 */
/* What happens at which iteration: pure functions of the parameters, so that they can be read and
 * tested alone. */
#ifndef SG_SCHEDULE_H
#define SG_SCHEDULE_H

#include <math.h>

#include "core/rng.h"
#include "model/columns.h"
#include "splatguard/train.h"

/* Whether an event of every `every` iterations is due in the step from iteration `before` to `it`.
 * Steps are longer than one where a run's time is short. */
static inline bool sg_due(int before, int it, int every)
{
    return it / every > before / every;
}

/* No Gaussian is added or removed in the last iteration, after which none could learn. The released
 * code, which goes on to densify there, saves and measures its model before. */
static inline bool sg_densifies(const struct sg_train_params *p, int before, int it)
{
    return it < p->densify_until_iter && it > p->densify_from_iter && it < p->iterations &&
           sg_due(before, it, p->densification_interval);
}

/* The extra reset on white keeps the background from being explained by opaque white Gaussians.
 * After the last iteration nothing could learn the opacities again. */
static inline bool sg_resets_opacity(const struct sg_train_params *p, int before, int it)
{
    return it < p->densify_until_iter && it < p->iterations && p->strategy != SG_STRATEGY_MCMC &&
           p->model != SG_MODEL_SCAFFOLD &&
           (sg_due(before, it, p->opacity_reset_interval) ||
            (p->white_background && before < p->densify_from_iter && it >= p->densify_from_iter));
}

/* Where nothing densifies any more the 3D filter of Mip-Splatting follows the positions on a
 * schedule of its own; after a densification it is always made anew. settles_from: see struct
 * sg_trainer. */
static inline bool sg_renews_filter(const struct sg_train_params *p, int settles_from, int before,
                                    int it)
{
    return p->model == SG_MODEL_MIP && (it > p->densify_until_iter || it > settles_from) &&
           it < p->iterations - p->mip.interval && sg_due(before, it, p->mip.interval);
}

/* Whether the largest radii on the screen count: for what the universal threshold removes. */
static inline bool sg_counts_radii(const struct sg_train_params *p)
{
    return p->strategy != SG_STRATEGY_MCMC && p->at_limit == SG_AT_LIMIT_UNIVERSAL &&
           p->max_gaussians > 0;
}

/* Whether the filter spares anchors that have grown lately. */
static inline bool sg_spares_anchors(const struct sg_train_params *p)
{
    return p->model == SG_MODEL_SCAFFOLD && p->defense.on && p->defense.grace > 0;
}

/* The optional parts of the networks of anchors: bits of enum sg_network_part. */
static inline unsigned sg_network_parts(const struct sg_scaffold_params *s)
{
    return (s->distance ? SG_PART_DISTANCE : 0u) | (s->bank ? SG_PART_BANK : 0u) |
           (s->appearance ? SG_PART_APPEARANCE : 0u);
}

static inline int sg_filters_from(const struct sg_train_params *p)
{
    const int grows = p->model == SG_MODEL_SCAFFOLD ? p->scaffold.from : p->densify_from_iter;
    return p->defense.from < 0 ? grows : p->defense.from;
}

static inline bool sg_filters(const struct sg_train_params *p, int before, int it)
{
    const struct sg_defense_params *d = &p->defense;
    return d->on && d->rho != 0 && it > sg_filters_from(p) &&
           it < (d->until < 0 ? p->densify_until_iter : d->until) && it < p->iterations &&
           sg_due(before, it, d->interval);
}

/* Active at iteration it: raised at its start whenever it is divisible by the interval. start: of
 * the initial model. */
static inline int sg_active_degree(const struct sg_train_params *p, int start, int it)
{
    const int d = start + it / p->sh_interval;
    return d < p->sh_degree ? d : p->sh_degree;
}

/* From `first` at u = 0 to `last` at 1, linear in its logarithm. */
static inline double sg_log_linear(double u, float first, float last)
{
    return exp((1 - u) * log((double) first) + u * log((double) last));
}

/* A rate that falls over as many iterations as that of positions. */
static inline double sg_falling_lr(const struct sg_train_params *p, int it, float first, float last)
{
    const double u = (double) it / p->position_lr_max_steps;
    return sg_log_linear(u > 1 ? 1 : u, first, last);
}

static inline double sg_position_lr(const struct sg_train_params *p, int it)
{
    return sg_falling_lr(p, it, p->position_lr_init, p->position_lr_final);
}

static inline double sg_exposure_lr(const struct sg_train_params *p, int it)
{
    return sg_log_linear((double) it / p->iterations, p->exposure_lr_init, p->exposure_lr_final);
}

/* Every `every` iterations all rates shrink by a factor. LightGaussian and PUP 3D-GS do so after
 * the schedule of positions has set its own, so that the position's is smaller in that iteration
 * only. */
static inline void sg_shrink_rates(int before, int it, double factor, int every,
                                   double lr[SG_GROUPS])
{
    for (int g = 0; g < SG_GROUPS; g++)
        if (g != SG_G_XYZ)
            lr[g] *= pow(factor, it / every);
        else if (sg_due(before, it, every))
            lr[g] *= factor;
}

/* Order of views in an epoch: Fisher-Yates, the same distribution as drawing from a shrinking
 * stack. */
static inline void sg_view_order(uint64_t seed, uint64_t epoch, uint32_t *order, size_t n)
{
    for (size_t i = 0; i < n; i++)
        order[i] = (uint32_t) i;
    for (size_t i = n; i > 1; i--) {
        const size_t j = (size_t) (sg_rng_u64(seed, SG_RNG_VIEWS, epoch, i) % i);
        const uint32_t swap = order[i - 1];
        order[i - 1] = order[j], order[j] = swap;
    }
}

#endif
