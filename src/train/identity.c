/* SPDX-License-Identifier: Apache-2.0 */
#include "identity.h"

#define XXH_INLINE_ALL
#include <string.h>
#include <xxhash.h>

#include "schedule.h"

uint64_t sg_hash_numbers(const double *numbers, size_t n)
{
    return XXH3_64bits(numbers, n * sizeof(*numbers));
}

/* Numbers of released programs became parameters later: they count where they are others. */
static uint64_t hash_unusual(const double *numbers, const double *usual, size_t n, uint64_t hash)
{
    return memcmp(numbers, usual, n * sizeof(*numbers)) != 0
               ? XXH3_64bits_withSeed(numbers, n * sizeof(*numbers), hash)
               : hash;
}

uint64_t sg_hash_anchors(const struct sg_train_params *p, uint64_t hash)
{
    const struct sg_scaffold_params *s = &p->scaffold;
    const double scaffold[] = {(double) s->voxel,
                               s->cells,
                               s->from,
                               (double) s->offset_lr_init,
                               (double) s->offset_lr_final,
                               (double) s->feature_lr,
                               (double) s->scaling_lr,
                               (double) s->opacity_lr_init,
                               (double) s->opacity_lr_final,
                               (double) s->covariance_lr_init,
                               (double) s->covariance_lr_final,
                               (double) s->colour_lr_init,
                               (double) s->colour_lr_final,
                               p->defense.anchor_sigma};
    if (p->model != SG_MODEL_SCAFFOLD)
        return hash;
    hash = XXH3_64bits_withSeed(scaffold, sizeof(scaffold), hash);
    const double parts[] = {s->distance,
                            s->bank,
                            (double) s->bank_lr_init,
                            (double) s->bank_lr_final,
                            s->appearance,
                            (double) s->appearance_lr_init,
                            (double) s->appearance_lr_final};
    if (sg_network_parts(s))
        hash = XXH3_64bits_withSeed(parts, sizeof(parts), hash);
    const struct sg_scaffold_params usual = {SG_SCAFFOLD_DEFAULTS};
    const double constants[] = {s->every,
                                s->grids,
                                s->finer,
                                (double) s->seen,
                                (double) s->min_opacity,
                                (double) s->volume},
                 defaults[] = {usual.every,
                               usual.grids,
                               usual.finer,
                               (double) usual.seen,
                               (double) usual.min_opacity,
                               (double) usual.volume};
    hash = hash_unusual(constants, defaults, sizeof(constants) / sizeof(constants[0]), hash);
    const double growth[] = {(double) s->drop, (double) s->log_size_max},
                 usually[] = {(double) usual.drop, (double) usual.log_size_max};
    hash = hash_unusual(growth, usually, 2, hash);
    const double sizes[] = {s->offsets, s->features, s->hidden, s->numbers},
                 whole[] = {usual.offsets, usual.features, usual.hidden, usual.numbers};
    hash = hash_unusual(sizes, whole, 4, hash);
    const double readings[] = {p->defense.anchor_hits, p->defense.anchor_score, p->defense.grace};
    if (readings[0] > 0 || readings[1] > 0 || readings[2] > 0)
        hash = XXH3_64bits_withSeed(readings, sizeof(readings), hash);
    if (p->defense.unit)
        hash = XXH3_64bits_withSeed("unit", strlen("unit"), hash);
    return hash;
}

static uint64_t hash_mcmc(const struct sg_mcmc_params *m, uint64_t hash)
{
    const struct sg_mcmc_params u = {SG_MCMC_DEFAULTS};
    const double numbers[] = {(double) m->cap_max,
                              m->growth,
                              m->until,
                              (double) m->opacity_reg,
                              (double) m->scale_reg,
                              (double) m->noise_lr},
                 later[] = {(double) m->dead, (double) m->noise_gate, m->copies},
                 usual[] = {(double) u.dead, (double) u.noise_gate, u.copies};
    return hash_unusual(later, usual, 3, XXH3_64bits_withSeed(numbers, sizeof(numbers), hash));
}

static uint64_t hash_mip(const struct sg_mip_params *m, uint64_t hash)
{
    const struct sg_mip_params u = {SG_MIP_DEFAULTS};
    const double numbers[] = {(double) m->kernel, m->variance, m->margin, m->interval},
                 usual[] = {(double) u.kernel, u.variance, u.margin, u.interval};
    return hash_unusual(numbers, usual, 4, XXH3_64bits_withSeed("mip", strlen("mip"), hash));
}

/* Those of each photo, or NULL. */
static uint64_t hash_views(const float *numbers, size_t n, uint64_t hash)
{
    return numbers ? XXH3_64bits_withSeed(numbers, n * sizeof(*numbers), hash) : hash;
}

struct sg_identity sg_train_identity(const struct sg_train_params *p, size_t n_views)
{
    const struct sg_defense_params *d = &p->defense;
    const double numbers[] = {p->sh_interval,
                              p->white_background,
                              p->random_background,
                              (double) p->lambda_dssim,
                              (double) p->tolerance_tv,
                              p->tolerance_look,
                              (double) p->tolerance_growth,
                              (double) p->tolerance_low_pass,
                              (double) p->position_lr_init,
                              (double) p->position_lr_final,
                              p->position_lr_max_steps,
                              (double) p->feature_lr,
                              (double) p->opacity_lr,
                              (double) p->scaling_lr,
                              (double) p->rotation_lr,
                              (double) p->percent_dense,
                              p->densification_interval,
                              p->densify_from_iter,
                              p->densify_until_iter,
                              (double) p->densify_grad_threshold,
                              p->opacity_reset_interval,
                              p->reference_tiles,
                              d->on,
                              d->exponent,
                              d->views,
                              d->interval,
                              d->from,
                              d->until,
                              d->sigma,
                              d->hit,
                              d->rule,
                              d->sample,
                              d->anisotropy_scale,
                              d->tv_scale,
                              d->tv,
                              d->spectrum.band.low,
                              d->spectrum.band.high,
                              d->spectrum.band.bins,
                              d->spectrum.energy,
                              d->spectrum.channels,
                              d->spectrum.exact_size};
    const double strength[] = {(double) p->tolerance, d->rho, d->rho_least, d->frequency,
                               d->lambda};
    uint64_t parameters = sg_hash_numbers(numbers, sizeof(numbers) / sizeof(numbers[0]));
    const double smooth = (double) p->tolerance_smooth,
                 usual = (double) sg_train_params_default().tolerance_smooth;
    parameters = hash_unusual(&smooth, &usual, 1, parameters);
    if (p->strategy == SG_STRATEGY_MCMC)
        parameters = hash_mcmc(&p->mcmc, parameters);
    const double exposure[] = {(double) p->exposure_lr_init, (double) p->exposure_lr_final};
    if (p->exposure)
        parameters = XXH3_64bits_withSeed(exposure, sizeof(exposure), parameters);
    if (p->model == SG_MODEL_MIP)
        parameters = hash_mip(&p->mip, parameters);
    parameters = sg_hash_anchors(p, parameters);
    if (d->unseen)
        parameters = XXH3_64bits_withSeed("unseen", strlen("unseen"), parameters);
    if (p->absgrad)
        parameters = XXH3_64bits_withSeed("absgrad", strlen("absgrad"), parameters);
    const uint64_t strengths = sg_hash_numbers(strength, sizeof(strength) / sizeof(strength[0]));
    return (struct sg_identity){.kind = SG_RUN_TRAINING,
                                .parameters = parameters,
                                .strength =
                                    hash_views(d->on ? d->view_weights : NULL, n_views,
                                               hash_views(p->tolerances, n_views, strengths))};
}
