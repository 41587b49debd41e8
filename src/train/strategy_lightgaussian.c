/* SPDX-License-Identifier: Apache-2.0 */
/* LightGaussian during training, as its released program does it: after the densification and the
 * reset of an iteration it removes by its score. */
#include "filtering.h"
#include "prune/score.h"
#include "schedule.h"
#include "strategy.h"
#include "trainer.h"

#define SHRINK 0.97
#define INTERVAL 1000 /* iterations */

/* The program's iterations 16000 and 24000 of 30000; 50 %, and 0.8 of that. */
static const struct {
    int numerator;
    double ratio;
} removals[] = {{8, 0.5}, {12, 0.4}};
#define REMOVALS (sizeof(removals) / sizeof(removals[0]))

/* The share that is removed in this step, or 0. A step that passes over both takes the second. */
static double share(const sg_trainer *t, int before, int it)
{
    double ratio = 0;
    for (size_t i = 0; i < REMOVALS; i++) {
        const int at = (int) ((int64_t) t->params.iterations * removals[i].numerator / 15);
        if (before < at && it >= at)
            ratio = removals[i].ratio;
    }
    return ratio;
}

static void rates(const sg_trainer *t, int before, int it, double *lr)
{
    (void) t;
    sg_shrink_rates(before, it, SHRINK, INTERVAL, lr);
}

static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    struct sg_strategy_plan p = sg_strategy_default.plan(t, before, it);
    p.rests |= share(t, before, it) > 0;
    return p;
}

static int remove_lowest(sg_trainer *t, double ratio, const struct sg_render_params *render,
                         struct sg_train_step *out)
{
    const size_t n = sg_engine_count(t->engine);
    size_t unseen;
    const struct sg_prune_params params = sg_prune_params_default();
    struct sg_model *m = NULL;
    double *score = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, 2 * n, sizeof(*score));
    uint8_t *keep = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, n, 1);
    int code = score && keep ? sg_model_create(t->ctx, n, t->sh_degree, &m) : SG_ERR_BUDGET;
    if (!code)
        code = sg_engine_download(t->engine, m, NULL);
    if (!code)
        code = sg_lightgaussian(t->engine, t->scene, m, &params, render, score, &unseen);
    sg_model_destroy(&m);
    if (!code) {
        const size_t removed = sg_prune_choose(score, n, ratio, score + n, keep);
        out->pruned += removed;
        code = sg_engine_edit(
            t->engine, &(struct sg_edit){.keep = keep, .kept = n - removed, .statistics = true});
        if (!code)
            sg_log(t->ctx, SG_LOG_DEBUG, "of %zu Gaussians LightGaussian's score removed %zu", n,
                   removed);
    }
    sg_free(score);
    sg_free(keep);
    return code;
}

static int after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out)
{
    const double ratio = share(t, before, it);
    int code = sg_strategy_default.after_step(t, planned, before, it, render, out);
    const double start = sg_trainer_seconds_not_counting(t);
    if (!code && ratio > 0) {
        code = remove_lowest(t, ratio, render, out);
        t->prune_seconds += sg_trainer_seconds_not_counting(t) - start;
    }
    return code;
}

const struct sg_strategy sg_strategy_lightgaussian = {
    .name = "lightgaussian",
    .state_bytes = sizeof(struct sg_filtering), /* the default's */
    .sound = sg_filtering_sound,
    .filter_next = sg_filtering_next,
    .rates = rates,
    .plan = plan,
    .after_step = after_step,
};
