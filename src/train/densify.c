/* SPDX-License-Identifier: Apache-2.0 */
#include "densify.h"
#include "core/compare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "math/constants.h"

enum { STAYS, CLONES, SPLITS, GOES };

/* Clones take the place after all survivors, then the first children, then the second, in index
 * order: the order of the released code. The screen-size test of the paper is dead there: the radii
 * are cleared by the clone step before they are read. So it is left out, but where growth is
 * paused. */
struct plan {
    size_t n;             /* Gaussians now */
    bool paused;          /* none grows: overshoot, and the limit is reached */
    uint8_t *keep, *kind; /* keep: first what becomes of each, then whether it stays */
    uint32_t *source;
    size_t appended;
};

static void append(struct plan *p, size_t source, enum sg_edit_kind kind)
{
    p->source[p->appended] = (uint32_t) source;
    p->kind[p->appended++] = (uint8_t) kind;
}

/* Marks Gaussians for removal: those above the limit, and as many more as would grow, within
 * params->replace. The lowest scored are removed, or the last ones where there are no scores.
 * Returns an error code. */
static int make_room(struct sg_engine *engine, const struct sg_densify_params *p, struct plan *plan,
                     size_t wish, size_t *goes)
{
    const size_t n = plan->n, limit = p->max_gaussians, surplus = n > limit ? n - limit : 0,
                 short_of = n + wish - limit;
    const size_t most = surplus + (size_t) ((double) p->replace * (double) n);
    *goes = surplus;
    if (!p->score) {
        memset(plan->keep + n - surplus, GOES, surplus);
        return SG_OK;
    }
    struct sg_scores scores;
    const int code = p->score(p->arg, &scores);
    if (code)
        return code;
    *goes = short_of < most ? short_of : most;
    *goes = *goes < n ? *goes : n - 1;
    uint8_t *stays = sg_alloc_raw(sg_engine_ctx(engine), SG_MEM_OPTIMISER, n, 1);
    if (stays) {
        memset(stays, 1, n);
        sg_scores_remove(&scores, *goes, stays);
        for (size_t i = 0; i < n; i++)
            plan->keep[i] = stays[i] ? plan->keep[i] : GOES;
    }
    sg_free(stays);
    sg_scores_clear(&scores);
    return stays ? SG_OK : SG_ERR_BUDGET;
}

/* Of those that would grow, only the `room` with the largest gradients may; among equals, the first
 * ones. */
static int choose_growth(struct sg_engine *engine, struct plan *plan, const float *gradient,
                         size_t room, bool *limited)
{
    const size_t n = plan->n;
    float *wishes = sg_alloc_raw(sg_engine_ctx(engine), SG_MEM_OPTIMISER, n, sizeof(*wishes));
    size_t wish = 0, above = 0;
    if (!wishes)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++)
        if (plan->keep[i] == CLONES || plan->keep[i] == SPLITS)
            wishes[wish++] = gradient[i];
    *limited = wish > room;
    if (*limited) {
        qsort(wishes, wish, sizeof(*wishes), sg_float_descending);
        const float least = room ? wishes[room - 1] : INFINITY;
        while (above < room && wishes[above] > least)
            above++;
        size_t equals = room - above;
        for (size_t i = 0; i < n; i++)
            if ((plan->keep[i] == CLONES || plan->keep[i] == SPLITS) && !(gradient[i] > least)) {
                const bool grows = gradient[i] == least && equals > 0;
                equals -= grows;
                plan->keep[i] = grows ? plan->keep[i] : STAYS;
            }
    }
    sg_free(wishes);
    return SG_OK;
}

/* Of n values that lie before n of scratch: as large a share reaches it as that of the gradients
 * that reach `least`. Linear between values. */
static float quantile(float *values, const float *gradient, size_t n, float least)
{
    size_t reach = 0;
    float *sorted = values + n;
    for (size_t i = 0; i < n; i++)
        reach += gradient[i] >= least;
    memcpy(sorted, values, n * sizeof(*sorted));
    qsort(sorted, n, sizeof(*sorted), sg_float_descending);
    const double at = (double) reach / (double) n * (double) (n - 1);
    const size_t k = (size_t) at, next = k + 1 < n ? k + 1 : k;
    return (float) ((double) sorted[k] +
                    (at - (double) k) * ((double) sorted[next] - (double) sorted[k]));
}

static bool dies(const struct sg_densify_params *p, float opacity, float scale)
{
    return opacity < SG_PRUNE_OPACITY || (p->prune_scale > 0 && scale > p->prune_scale);
}

/* Marks who grows; returns how many: each adds one Gaussian, whether it is cloned or split. */
static size_t mark_growth(const struct sg_densify_params *p, const struct sg_statistics *s,
                          struct plan *plan)
{
    const size_t n = plan->n;
    const float steep = p->absolute ? quantile(s->absolute, s->gradient, n, p->gradient) : INFINITY;
    size_t wish = 0;
    for (size_t i = 0; i < n; i++) {
        const bool grows =
            s->gradient[i] >= p->gradient || (p->absolute && s->absolute[i] >= steep);
        plan->keep[i] = !grows ? STAYS : s->largest[i] <= p->split_scale ? CLONES : SPLITS;
        wish += grows;
    }
    return wish;
}

/* Keeps growth below the limit. */
static int limit_growth(struct sg_engine *engine, const struct sg_densify_params *p,
                        const struct sg_statistics *s, size_t wish, struct plan *plan,
                        struct sg_densify_result *result)
{
    if (plan->paused) {
        memset(plan->keep, STAYS, plan->n);
        result->limited = wish > 0;
        return SG_OK;
    }
    if (p->overshoot || !p->max_gaussians || plan->n + wish <= p->max_gaussians)
        return SG_OK;
    const int code = make_room(engine, p, plan, wish, &result->replaced);
    if (code)
        return code;
    const size_t room = p->max_gaussians - (plan->n - result->replaced);
    return choose_growth(engine, plan, s->gradient, room, &result->limited);
}

/* Clones, then children. A Gaussian and its copies share opacity, so that they are pruned together;
 * children are smaller. */
static void append_growth(const struct sg_densify_params *p, const struct sg_statistics *s,
                          struct plan *plan, struct sg_densify_result *result)
{
    const size_t n = plan->n;
    for (size_t i = 0; i < n; i++)
        if (plan->keep[i] == CLONES) {
            result->cloned++;
            if (dies(p, s->opacity[i], s->largest[i]))
                result->pruned++;
            else
                append(plan, i, SG_EDIT_COPY);
        }
    for (int child = 0; child < SG_SPLIT_CHILDREN; child++)
        for (size_t i = 0; i < n; i++)
            if (plan->keep[i] == SPLITS) {
                result->split += child == 0;
                if (dies(p, s->opacity[i], s->largest[i] / SG_SPLIT_SHRINK))
                    result->pruned++;
                else
                    append(plan, i, SG_EDIT_CHILD);
            }
}

/* Turns plan->keep into what stays, without those that were split; returns how many. */
static size_t mark_kept(const struct sg_densify_params *p, const struct sg_statistics *s,
                        struct plan *plan, struct sg_densify_result *result)
{
    size_t kept = 0;
    for (size_t i = 0; i < plan->n; i++) {
        const bool parent = plan->keep[i] == SPLITS,
                   goes = plan->keep[i] == GOES || dies(p, s->opacity[i], s->largest[i]) ||
                          (plan->paused && p->prune_scale > 0 && s->radius[i] > SG_PRUNE_RADIUS);
        result->pruned += !parent && goes;
        plan->keep[i] = !parent && !goes;
        kept += plan->keep[i];
    }
    return kept;
}

int sg_densify(struct sg_engine *engine, const struct sg_densify_params *p,
               struct sg_densify_result *result)
{
    sg_ctx *ctx = sg_engine_ctx(engine);
    const size_t n = sg_engine_count(engine);
    int code = SG_ERR_BUDGET;
    struct plan plan = {.n = n,
                        .paused = p->overshoot && p->max_gaussians && n >= p->max_gaussians};
    *result = (struct sg_densify_result){0};
    float *stats = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, (p->absolute ? 5 : 3) * sizeof(float));
    float *radius = p->overshoot ? sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(float)) : NULL;
    plan.keep = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, 1);
    plan.kind = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, SG_SPLIT_CHILDREN);
    plan.source = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, SG_SPLIT_CHILDREN * sizeof(uint32_t));
    if (!stats || (p->overshoot && !radius) || !plan.keep || !plan.kind || !plan.source)
        goto done;
    const struct sg_statistics s = {.gradient = stats,
                                    .opacity = stats + n,
                                    .largest = stats + 2 * n,
                                    .radius = radius,
                                    .absolute = p->absolute ? stats + 3 * n : NULL};
    if ((code = sg_engine_read_statistics(engine, &s)))
        goto done;

    const size_t wish = mark_growth(p, &s, &plan);
    if ((code = limit_growth(engine, p, &s, wish, &plan, result)))
        goto done;
    append_growth(p, &s, &plan, result);
    const size_t kept = mark_kept(p, &s, &plan, result);
    if (kept + plan.appended == 0) {
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "train: every Gaussian became transparent: the scene cannot be fitted");
        goto done;
    }
    code = sg_engine_edit(engine, &(struct sg_edit){.keep = plan.keep,
                                                    .kept = kept,
                                                    .appended = plan.appended,
                                                    .source = plan.source,
                                                    .kind = plan.kind,
                                                    .statistics = plan.paused,
                                                    .seed = p->seed,
                                                    .stream = p->stream});
done:
    sg_free(stats);
    sg_free(radius);
    sg_free(plan.keep);
    sg_free(plan.kind);
    sg_free(plan.source);
    return code;
}
