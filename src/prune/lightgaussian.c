/* SPDX-License-Identifier: Apache-2.0 */
/* The global significance score of LightGaussian (Fan et al. 2024), as its program computes it. The
 * program adds up in floats from many threads without atomic operations and loses some; here
 * nothing is lost. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/compare.h"
#include "score.h"
#include "scene/cameras.h"

static double exp_sum(const struct sg_model *m, size_t i)
{
    return exp((double) *sg_model_at(m, i, SG_P_SCALE) +
               (double) *sg_model_at(m, i, SG_P_SCALE + 1) +
               (double) *sg_model_at(m, i, SG_P_SCALE + 2));
}

static double largest_scale(const struct sg_model *m, size_t i)
{
    const float *s = sg_model_at(m, i, SG_P_SCALE);
    return exp((double) fmaxf(fmaxf(s[0], s[SG_LANES]), s[2 * SG_LANES]));
}

int sg_volume_factors(sg_ctx *ctx, const struct sg_prune_params *p, const double *volume, size_t n,
                      double *factor)
{
    double *sorted = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*sorted));
    if (!sorted)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++) /* NaN has no place in an order */
        sorted[i] = isnan(volume[i]) ? INFINITY : volume[i];
    qsort(sorted, n, sizeof(*sorted), sg_double_ascending);
    /* Of the volumes in descending order, that at index trunc(0.9 n). */
    const double v90 = sorted[n - 1 - (size_t) (0.9 * (double) n)];
    sg_free(sorted);
    for (size_t i = 0; i < n; i++) {
        /* Infinite ones are equal. */
        const double relative = v90 > 0 && volume[i] < INFINITY ? volume[i] / v90
                                : v90 > 0 && v90 < INFINITY     ? INFINITY
                                                                : 1;
        factor[i] = pow(p->volume_clip ? fmin(relative, 1) : relative, p->volume_power);
    }
    return SG_OK;
}

/* Multiplies the sums by what the kind of score asks for. */
static int finish(sg_ctx *ctx, const struct sg_model *m, const struct sg_prune_params *p,
                  double *score)
{
    const size_t n = m->count;
    if (p->score == SG_GLOBAL_IMPORTANT || p->score == SG_GLOBAL_COUNT)
        return SG_OK;
    double *factor = sg_alloc_raw(ctx, SG_MEM_MISC, 2 * n, sizeof(*factor));
    if (!factor)
        return SG_ERR_BUDGET;
    double *volume = factor + n;
    int code = SG_OK;
    for (size_t i = 0; i < n; i++)
        if (p->score == SG_GLOBAL_MAX_V)
            factor[i] = largest_scale(m, i);
        else
            volume[i] = exp_sum(m, i);
    if (p->score != SG_GLOBAL_MAX_V)
        code = sg_volume_factors(ctx, p, volume, n, factor);
    for (size_t i = 0; i < n && !code; i++)
        if (score[i] > 0) /* 0 also where the volume is infinite */
            score[i] *= factor[i];
    sg_free(factor);
    return code;
}

int sg_lightgaussian(struct sg_engine *engine, const struct sg_scene *scene,
                     const struct sg_model *m, const struct sg_prune_params *p,
                     const struct sg_render_params *render, double *score, size_t *unseen)
{
    sg_ctx *ctx = sg_engine_ctx(engine);
    const struct sg_camera **views = sg_training_cameras(ctx, scene);
    if (!views)
        return SG_ERR_BUDGET;
    int code = sg_engine_count_hits(engine, views, scene->n_train, render,
                                    p->weight == SG_GLOBAL_WEIGHT_TRANSMITTANCE &&
                                            p->score != SG_GLOBAL_COUNT
                                        ? SG_HIT_TRANSMITTANCE
                                        : SG_HIT_PIXELS,
                                    score);
    sg_free(views);
    *unseen = 0;
    for (size_t i = 0; i < m->count && !code; i++)
        *unseen += score[i] == 0;
    for (size_t i = 0; i < m->count && !code && p->score != SG_GLOBAL_COUNT; i++) {
        const double opacity = 1 / (1 + exp(-(double) *sg_model_at(m, i, SG_P_OPACITY)));
        score[i] = p->score == SG_GLOBAL_OPACITY ? opacity : opacity * score[i];
    }
    if (!code && p->score != SG_GLOBAL_OPACITY)
        code = finish(ctx, m, p, score);
    return code;
}
