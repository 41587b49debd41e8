/* SPDX-License-Identifier: Apache-2.0 */
#include "filtering.h"

#include <math.h>

#include "core/rng.h"
#include "schedule.h"

#define GROWTH_PACE 0.25 /* weight of the newest densification in the smoothed growth */

static int draw_scores(const struct sg_limit_call *c, struct sg_scores *out)
{
    const int code = sg_scores_create(c->t->ctx, sg_engine_count(c->t->engine), out);
    for (size_t i = 0; i < out->count && !code; i++) {
        out->score[i] =
            (double) sg_rng_uniform(c->t->params.seed, SG_RNG_REPLACE, (uint64_t) c->it, i);
        out->log_smallest[i] = 0;
    }
    return code;
}

int sg_filtering_at_limit(void *arg, struct sg_scores *out)
{
    const struct sg_limit_call *c = arg;
    const struct sg_train_params *p = &c->t->params;
    if (p->at_limit == SG_AT_LIMIT_RANDOM)
        return draw_scores(c, out);
    return sg_score(c->t->engine, c->t->scene, &p->defense, c->render, p->seed, c->it, out);
}

bool sg_filtering_sound(const void *state, int iteration)
{
    const struct sg_filtering *s = state;
    return s->growth >= 0 && s->growth <= 1 && s->growths <= (uint64_t) iteration;
}

void sg_filtering_grown(const sg_trainer *t, struct sg_filtering *s, int it, double share)
{
    s->growth += (share - s->growth) * (s->growth > 0 ? GROWTH_PACE : 1);
    s->growths += it > sg_filters_from(&t->params);
}

/* Removing a share of the growth cannot shrink the model, and the minimum share stops at half of
 * its first size, so neither can empty it. The minimum fades, since only early removals leave time
 * to grow again what is missed. */
static double share_of(const sg_trainer *t, const struct sg_filtering *s, int it)
{
    const struct sg_train_params *p = &t->params;
    const struct sg_defense_params *d = &p->defense;
    const double from = sg_filters_from(p), until = p->densify_until_iter;
    if (d->rho >= 0)
        return d->rho;
    if (it >= until || !s->growths)
        return 0;
    const double n = (double) sg_engine_count(t->engine);
    const double first = s->filter_first ? (double) s->filter_first : n,
                 spare = n > 0 ? 1 - first / 2 / n : 0;
    const double least = d->rho_least * (until - it) / (until - from);
    return fmax(fmin(-d->rho * s->growth * (double) s->growths, 0.5), fmin(least, spare));
}

bool sg_filtering_due(const sg_trainer *t, const struct sg_filtering *s, int before, int it,
                      bool densifies)
{
    return sg_filters(&t->params, before, it) && (densifies || share_of(t, s, it) > 0);
}

double sg_filtering_next(const sg_trainer *t, int *next)
{
    const struct sg_train_params *p = &t->params;
    struct sg_filtering grown = *(const struct sg_filtering *) t->strategy_state;
    const int from = sg_filters_from(p), now = t->iteration > from ? t->iteration : from;
    grown.growths += !grown.growths;
    for (int it = now + 1; it - now <= p->defense.interval && it <= t->settles_from; it++)
        if (sg_filters(p, it - 1, it)) {
            *next = it;
            return share_of(t, &grown, it);
        }
    return 0;
}

int sg_filtering_run(sg_trainer *t, struct sg_filtering *s, int it,
                     const struct sg_render_params *render, struct sg_defense_step *step)
{
    const struct sg_train_params *p = &t->params;
    const size_t each = sg_engine_each(t->engine) / sg_filter_each(t->engine, &p->defense);
    const double start = sg_trainer_seconds_not_counting(t);
    if (!s->filter_first)
        s->filter_first = sg_engine_count(t->engine);
    const int code =
        sg_filter(t->engine, t->scene, &p->defense, render, share_of(t, s, it), p->seed, it, step);
    step->scored *= each, step->removed *= each, step->unseen *= each;
    if (!code)
        sg_log(t->ctx, SG_LOG_DEBUG, "iteration %d: of %zu Gaussians the filter removed %zu", it,
               step->scored, step->removed);
    t->prune_seconds += sg_trainer_seconds_not_counting(t) - start;
    s->growths = 0;
    return code;
}
