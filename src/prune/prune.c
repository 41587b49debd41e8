/* SPDX-License-Identifier: Apache-2.0 */
/* Rounds of scoring, removing and fine-tuning. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/compare.h"
#include "defense/filter.h"
#include "finetune.h"
#include "model/anchors.h"
#include "option/option.h"
#include "scene/cameras.h"
#include "scene/used.h"
#include "score.h"

struct sg_prune_params sg_prune_params_default(void)
{
    return (struct sg_prune_params){SG_PRUNE_DEFAULTS};
}

int sg_prune_check(sg_ctx *ctx, const struct sg_prune_params *params)
{
    struct sg_prune_params p = *params; /* with numbers in place of words */
    sg_clear_error(ctx);
    p.ratio = p.ratio == SG_PRUNE_PUBLISHED ? 0 : p.ratio;
    p.second_ratio = p.second_ratio == SG_PRUNE_PUBLISHED ? 0 : p.second_ratio;
    return sg_check_options(ctx, sg_prune_options(), &p);
}

static int check(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *m,
                 const struct sg_prune_params *p)
{
    int code = sg_prune_check(ctx, p);
    if (!code)
        code = sg_model_refuse_anchors(ctx, m);
    if (!code)
        code = sg_check_cameras(ctx, scene);
    if (!code && !scene->n_train)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no training view, expected at least one",
                       scene->path);
    if (!code && p->finetune)
        code = sg_check_used(ctx, scene);
    if (!code && !m->count)
        return sg_fail(ctx, SG_ERR_INPUT, "model: found no Gaussian, expected at least one");
    return code;
}

/* The scores of the spectral filter over all views. */
static int spectral(struct sg_engine *engine, const struct sg_scene *scene,
                    const struct sg_prune_params *p, const struct sg_render_params *render,
                    double *score, size_t *unseen)
{
    struct sg_defense_params d = sg_defense_params_default();
    struct sg_scores s;
    d.frequency = p->frequency > 0 ? p->frequency : sg_defense_frequency(scene->extent);
    d.exponent = p->exponent;
    d.sample = SG_VIEWS_ALL;
    const int code = sg_score(engine, scene, &d, render, p->seed, 0, &s);
    if (code)
        return code;
    memcpy(score, s.score, s.count * sizeof(*score));
    *unseen = s.unseen;
    sg_scores_clear(&s);
    return SG_OK;
}

static int score_model(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *m,
                       const struct sg_prune_params *p, double *score, size_t *unseen)
{
    struct sg_render_params render = sg_render_params_default();
    struct sg_engine *engine = NULL;
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = p->white_background ? 1 : 0;
    if (p->method == SG_PRUNER_PUP)
        return sg_pup(ctx, scene, m, p, score, unseen);
    int code = sg_engine_create(ctx, p->engine, p->cpu, &engine);
    if (!code)
        code = sg_engine_upload(engine, m, NULL);
    if (!code)
        code = p->method == SG_PRUNER_SPECTRAL
                   ? spectral(engine, scene, p, &render, score, unseen)
                   : sg_lightgaussian(engine, scene, m, p, &render, score, unseen);
    sg_engine_destroy(&engine);
    return sg_engine_give_way(ctx, p->engine, p->cpu, code)
               ? score_model(ctx, scene, m, p, score, unseen)
               : code;
}

int sg_prune_scores(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *model,
                    const struct sg_prune_params *params, double *score)
{
    const struct sg_prune_params p = params ? *params : sg_prune_params_default();
    size_t unseen;
    const int code = check(ctx, scene, model, &p);
    return code ? code : score_model(ctx, scene, model, &p, score, &unseen);
}

size_t sg_prune_choose(const double *score, size_t n, double ratio, double *sorted, uint8_t *keep)
{
    for (size_t i = 0; i < n; i++)
        sorted[i] = isnan(score[i]) ? INFINITY : score[i];
    qsort(sorted, n, sizeof(*sorted), sg_double_ascending);
    const double limit = sorted[(size_t) (ratio * (double) (n - 1))];
    size_t removed = 0, best = 0;
    for (size_t i = 0; i < n; i++) {
        keep[i] = !(score[i] <= limit);
        removed += !keep[i];
        best = score[i] >= score[best] ? i : best;
    }
    if (removed == n) /* none is NaN */
        keep[best] = 1, removed--;
    return removed;
}

/* Removes the Gaussians with the lowest scores from *model. */
static int remove_lowest(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_prune_params *p,
                         double ratio, struct sg_model **model, struct sg_prune_result *result)
{
    const struct sg_model *m = *model;
    const size_t n = m->count;
    const int round = result->rounds;
    struct sg_model *left = NULL;
    double *score = sg_alloc_raw(ctx, SG_MEM_MISC, 2 * n, sizeof(*score));
    uint8_t *keep = sg_alloc_raw(ctx, SG_MEM_MISC, n, 1);
    int code = score && keep ? score_model(ctx, scene, m, p, score, &result->unseen[round])
                             : SG_ERR_BUDGET;
    if (!code) {
        result->before[round] = n;
        result->removed[round] = sg_prune_choose(score, n, ratio, score + n, keep);
        code = sg_model_create_like(ctx, m, n - result->removed[round], m->sh_degree, &left);
    }
    for (size_t i = 0, to = 0; i < n && !code; i++)
        if (keep[i])
            sg_model_copy_row(m, i, left, to++);
    sg_free(score);
    sg_free(keep);
    if (code)
        return code;
    sg_model_destroy(model);
    *model = left;
    result->rounds++;
    return SG_OK;
}

static int copy_model(sg_ctx *ctx, const struct sg_model *m, struct sg_model **out)
{
    const int code = sg_model_create_like(ctx, m, m->count, m->sh_degree, out);
    for (size_t i = 0; i < m->count && !code; i++)
        sg_model_copy_row(m, i, *out, i);
    return code;
}

/* The ratio that removes at least n - most of n Gaussians, and no more where scores differ. */
static double ratio_to(size_t n, uint64_t most)
{
    return n > most ? ((double) (n - most) - 0.5) / (double) (n - 1) : 0;
}

int sg_prune(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *model,
             const struct sg_prune_params *params, struct sg_model **out,
             struct sg_prune_result *result)
{
    const struct sg_prune_params p = params ? *params : sg_prune_params_default();
    struct sg_prune_result r = {0};
    *out = NULL;
    int code = check(ctx, scene, model, &p);
    if (!code)
        code = sg_model_check(ctx, model, "model");
    if (!code)
        code = copy_model(ctx, model, out);
    const bool pup = p.method == SG_PRUNER_PUP, published = p.ratio == SG_PRUNE_PUBLISHED;
    const double ratio[2] = {published ? (pup ? 0.8 : 0.66) : p.ratio,
                             p.second_ratio != SG_PRUNE_PUBLISHED ? p.second_ratio
                             : pup && published                   ? 0.5
                                                                  : 0};
    const uint64_t most[2] = {pup ? 2 * p.max_gaussians : p.max_gaussians, p.max_gaussians};
    for (int round = 0; round < 2 && !code; round++) {
        const double share = p.max_gaussians ? ratio_to((*out)->count, most[round]) : ratio[round];
        if (!(share > 0))
            continue;
        code = remove_lowest(ctx, scene, &p, share, out, &r);
        if (!code)
            sg_log(ctx, SG_LOG_INFO, "of %zu Gaussians %zu removed; no view shows %zu",
                   r.before[r.rounds - 1], r.removed[r.rounds - 1], r.unseen[r.rounds - 1]);
        if (!code && p.finetune)
            code = sg_finetune(ctx, scene, &p, out);
    }
    if (code)
        sg_model_destroy(out);
    else if (result)
        *result = r;
    return code;
}
