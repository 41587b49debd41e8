/* SPDX-License-Identifier: Apache-2.0 */
/* Densification as Markov chain Monte Carlo (Kheradmand et al. 2024), in the order of its released
 * code: nearly transparent Gaussians are dead, and take the place of opaque ones; then the model
 * grows by copies of opaque ones. An opaque one and its copies look together like it did. */
#include <math.h>

#include "core/clock.h"
#include "math/constants.h"
#include "schedule.h"
#include "strategy.h"
#include "trainer.h"

#define SHARE_OPACITY_MAX (1 - 0x1p-23)

/* Its integral along a line through the centre stays the same. */
double sg_mcmc_share(const struct sg_mcmc_params *p, double opacity, unsigned count, double *scale)
{
    /* More copies are made, but count no more. */
    const unsigned n = count < (unsigned) p->copies ? count : (unsigned) p->copies;
    /* Beyond 50 terms the sum cancels for an opacity of 1. At an opacity of 0 there is none. */
    const double o = n > 50 ? fmin(opacity, SHARE_OPACITY_MAX) : opacity;
    const double own = fmax(1 - pow(1 - o, 1.0 / n), 1e-12);
    double sum = 0, term = 1; /* C(n, j) own^j */
    for (unsigned j = 1; j <= n; j++) {
        term *= own * (n - j + 1) / j;
        sum += (j % 2 ? term : -term) / sqrt(j);
    }
    *scale = opacity / sum;
    return fmin(fmax(own, (double) p->dead), SHARE_OPACITY_MAX);
}

/* NaN is dead too. */
static bool is_dead(const struct sg_mcmc_params *p, float opacity)
{
    return !(opacity > p->dead);
}

size_t sg_mcmc_target(const sg_trainer *t, size_t n, bool *bound)
{
    const struct sg_mcmc_params *p = &t->params.mcmc;
    const uint64_t budget = t->budget.gaussians;
    uint64_t to = (uint64_t) (p->growth * (double) n);
    to = to < p->cap_max ? to : p->cap_max;
    *bound = budget && to > budget;
    to = *bound ? budget : to;
    return to > n ? (size_t) to : n;
}

static int read_opacities(const sg_trainer *t, float **out)
{
    *out = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, sg_engine_count(t->engine), sizeof(**out));
    return *out ? sg_engine_read_statistics(t->engine, &(struct sg_statistics){.opacity = *out})
                : SG_ERR_BUDGET;
}

/* Whether there is something to relocate. Without the memory to know, the attempt says why. */
static bool any_dead(const sg_trainer *t)
{
    const size_t n = sg_engine_count(t->engine);
    float *opacity;
    const int code = read_opacities(t, &opacity);
    size_t dead = 0;
    for (size_t i = 0; i < n && !code; i++)
        dead += is_dead(&t->params.mcmc, opacity[i]);
    sg_free(opacity);
    return code || (dead > 0 && dead < n);
}

static bool is_due(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    return it > p->densify_from_iter && it < p->mcmc.until && it < p->iterations &&
           sg_due(before, it, p->densification_interval);
}

static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    const size_t n = sg_engine_count(t->engine);
    bool bound;
    const bool edits = is_due(t, before, it) && (sg_mcmc_target(t, n, &bound) > n || any_dead(t));
    /* As in the released code: tensors that are made anew have no gradient. */
    return (struct sg_strategy_plan){
        .rests = edits, .mean_opacity = p->mcmc.opacity_reg, .mean_scale = p->mcmc.scale_reg};
}

/* Draws with replacement, each with the probability of its opacity. */
struct draws {
    const struct sg_mcmc_params *params;
    size_t n;
    float *opacity;
    double *below;   /* sum of the opacities up to each, itself included */
    uint32_t *times; /* that each was drawn */
};

static void sum_opacities(struct draws *d, bool alive_only)
{
    double sum = 0;
    for (size_t i = 0; i < d->n; i++) {
        const bool counts = alive_only ? !is_dead(d->params, d->opacity[i]) : d->opacity[i] > 0;
        sum += counts ? (double) d->opacity[i] : 0;
        d->below[i] = sum;
        d->times[i] = 0;
    }
}

static uint32_t draw(struct draws *d, uint64_t seed, enum sg_rng_use use, int it, size_t k)
{
    const double u = (double) (sg_rng_u64(seed, use, (uint64_t) it, k) >> 11) * 0x1p-53;
    const double at = u * d->below[d->n - 1];
    size_t low = 0, high = d->n - 1; /* the first whose sum is above */
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (d->below[middle] > at)
            high = middle;
        else
            low = middle + 1;
    }
    d->times[low]++;
    return (uint32_t) low;
}

/* Entries of an sg_relocation. */
struct entries {
    size_t count;
    uint32_t *to, *from;
    float *opacity, *scale;
    uint8_t *fresh;
};

static int create_entries(sg_ctx *ctx, size_t n, struct entries *e)
{
    *e = (struct entries){.to = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*e->to)),
                          .from = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*e->from)),
                          .opacity = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*e->opacity)),
                          .scale = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*e->scale)),
                          .fresh = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, 1)};
    return e->to && e->from && e->opacity && e->scale && e->fresh ? SG_OK : SG_ERR_BUDGET;
}

static void clear_entries(struct entries *e)
{
    sg_free(e->to);
    sg_free(e->from);
    sg_free(e->opacity);
    sg_free(e->scale);
    sg_free(e->fresh);
}

static void add_entry(struct entries *e, const struct draws *d, size_t to, size_t from, bool fresh)
{
    double scale;
    const double own =
        sg_mcmc_share(d->params, (double) d->opacity[from], d->times[from] + 1, &scale);
    e->to[e->count] = (uint32_t) to, e->from[e->count] = (uint32_t) from;
    e->opacity[e->count] = (float) log(own / (1 - own));
    e->scale[e->count] = (float) log(scale);
    e->fresh[e->count++] = fresh;
}

/* Those that were drawn become one of their copies. */
static void share(struct entries *e, struct draws *d)
{
    for (size_t i = 0; i < d->n; i++)
        if (d->times[i]) {
            add_entry(e, d, i, i, true);
            const float logit = e->opacity[e->count - 1];
            d->opacity[i] = 1 / (1 + expf(-logit));
        }
}

static int run_entries(sg_trainer *t, struct entries *e)
{
    const int code = sg_engine_relocate(t->engine, &(struct sg_relocation){.count = e->count,
                                                                           .to = e->to,
                                                                           .from = e->from,
                                                                           .opacity = e->opacity,
                                                                           .scale = e->scale,
                                                                           .fresh = e->fresh});
    e->count = 0;
    return code;
}

/* Every dead Gaussian becomes a copy of one that is alive; the moments of its place stay. */
static int relocate(sg_trainer *t, int it, struct draws *d, struct entries *e, size_t *dead)
{
    *dead = 0;
    for (size_t i = 0; i < d->n; i++)
        *dead += is_dead(d->params, d->opacity[i]);
    if (!*dead || *dead == d->n)
        return SG_OK;
    sum_opacities(d, true);
    for (size_t k = 0; k < *dead; k++)
        e->from[k] = draw(d, t->params.seed, SG_RNG_RELOCATE, it, k);
    for (size_t i = 0; i < d->n; i++)
        if (is_dead(d->params, d->opacity[i]))
            add_entry(e, d, i, e->from[e->count], false);
    for (size_t k = 0; k < *dead; k++) /* before the sources have other opacities */
        d->opacity[e->to[k]] = 1 / (1 + expf(-e->opacity[k]));
    share(e, d);
    return run_entries(t, e);
}

static int grow(sg_trainer *t, int it, struct draws *d, struct entries *e, size_t more)
{
    uint32_t *source = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, more, sizeof(*source));
    uint8_t *kind = sg_alloc(t->ctx, SG_MEM_OPTIMISER, more, 1),
            *keep = sg_alloc(t->ctx, SG_MEM_OPTIMISER, d->n, 1);
    int code = source && kind && keep ? SG_OK : SG_ERR_BUDGET;
    sum_opacities(d, false);
    for (size_t k = 0; k < more && !code; k++) {
        source[k] = draw(d, t->params.seed, SG_RNG_GROW, it, k);
        kind[k] = SG_EDIT_COPY;
    }
    for (size_t i = 0; i < d->n && !code; i++)
        keep[i] = 1;
    if (!code) {
        share(e, d);
        code = run_entries(t, e);
    }
    if (!code)
        code = sg_engine_edit(t->engine, &(struct sg_edit){.keep = keep,
                                                           .kept = d->n,
                                                           .appended = more,
                                                           .source = source,
                                                           .kind = kind,
                                                           .statistics = true});
    sg_free(source);
    sg_free(kind);
    sg_free(keep);
    return code;
}

static int edit(sg_trainer *t, int it, struct sg_train_step *step)
{
    const size_t n = sg_engine_count(t->engine);
    struct draws d = {.params = &t->params.mcmc, .n = n};
    struct entries e = {0};
    bool bound;
    const double start = sg_seconds();
    const size_t more = sg_mcmc_target(t, n, &bound) - n;
    int code = read_opacities(t, &d.opacity);
    if (code)
        goto done;
    d.below = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, n, sizeof(*d.below));
    d.times = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, n, sizeof(*d.times));
    code = d.below && d.times ? create_entries(t->ctx, n, &e) : SG_ERR_BUDGET;
    if (!code)
        code = relocate(t, it, &d, &e, &step->relocated);
    if (!code && more)
        code = grow(t, it, &d, &e, more);
    if (!code)
        sg_log(t->ctx, SG_LOG_DEBUG, "iteration %d: of %zu Gaussians %zu relocated, %zu added", it,
               n, step->relocated, more);
    step->cloned = more;
done:
    sg_free(d.opacity);
    sg_free(d.below);
    sg_free(d.times);
    clear_entries(&e);
    t->densify_seconds += sg_seconds() - start;
    return code;
}

static int after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out)
{
    (void) render;
    const struct sg_train_params *p = &t->params;
    bool bound = false;
    if (is_due(t, before, it)) /* also where a full model leaves nothing to edit */
        sg_mcmc_target(t, sg_engine_count(t->engine), &bound);
    int code = planned->rests ? edit(t, it, out) : SG_OK;
    t->gaussians_bound |= !code && bound;
    const double amount = (double) p->mcmc.noise_lr * sg_position_lr(p, it) * t->extent;
    if (!code && it < p->iterations && amount > 0)
        code = sg_engine_explore(t->engine, &(struct sg_exploration){.amount = (float) amount,
                                                                     .gate = p->mcmc.noise_gate,
                                                                     .dead = p->mcmc.dead,
                                                                     .seed = p->seed,
                                                                     .stream = (uint64_t) it});
    return code;
}

/* Points begin with a scale and an opacity of their own. */
static int begin(sg_trainer *t)
{
    const size_t n = sg_engine_count(t->engine);
    const struct sg_mcmc_params *p = &t->params.mcmc;
    struct entries e = {0};
    int code = t->from_points ? create_entries(t->ctx, n, &e) : SG_OK;
    for (; t->from_points && !code && e.count < n; e.count++) {
        e.to[e.count] = e.from[e.count] = (uint32_t) e.count;
        e.opacity[e.count] = logf(p->init_opacity / (1 - p->init_opacity));
        e.scale[e.count] = logf(p->init_scale);
        e.fresh[e.count] = 0;
    }
    if (!code)
        code = run_entries(t, &e);
    clear_entries(&e);
    return code;
}

const struct sg_strategy sg_strategy_mcmc = {
    .name = "mcmc",
    .begin = begin,
    .plan = plan,
    .after_step = after_step,
};
