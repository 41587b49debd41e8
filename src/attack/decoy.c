/* SPDX-License-Identifier: Apache-2.0 */
#include "decoy.h"

#include "math/constants.h"
#include "train/densify.h"
#include "train/filtering.h"
#include "train/schedule.h"
#include "train/trainer.h"

/* As in training, gradients are lost where the model is densified. */
static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    return (struct sg_strategy_plan){.rests = it != p->iterations &&
                                              sg_due(before, it, p->densification_interval),
                                     .statistics = true};
}

static int after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out)
{
    const struct sg_train_params *p = &t->params;
    const bool stops = p->at_limit == SG_AT_LIMIT_STOP;
    struct sg_densify_result r;
    (void) before;
    if (!planned->rests)
        return SG_OK;
    const int code = sg_densify(
        t->engine,
        &(struct sg_densify_params){.gradient = p->densify_grad_threshold,
                                    .split_scale = (float) ((double) p->percent_dense * t->extent),
                                    .prune_scale = (float) (SG_PRUNE_EXTENT * t->extent),
                                    .max_gaussians = t->budget.gaussians,
                                    .score = stops ? NULL : sg_filtering_at_limit,
                                    .arg = &(struct sg_limit_call){t, render, it},
                                    .replace = SG_REPLACED,
                                    .seed = p->seed,
                                    .stream = (uint64_t) it},
        &r);
    out->cloned = r.cloned, out->split = r.split, out->pruned = r.pruned;
    return code;
}

const struct sg_strategy sg_strategy_decoy = {
    .name = "decoy", .plan = plan, .after_step = after_step};

static void anchor_rates(const sg_trainer *t, int before, int it, double rates[SG_GROUPS])
{
    sg_strategy_scaffold.rates(t, before, it, rates);
}

static int anchors_after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before,
                              int it, const struct sg_render_params *render,
                              struct sg_train_step *out)
{
    (void) before, (void) render;
    const int code = sg_trainer_learn_networks(t, it);
    return code || !planned->rests ? code : sg_trainer_grow_anchors(t, it, out);
}

const struct sg_strategy sg_strategy_decoy_anchors = {
    .name = "decoy-anchors", .rates = anchor_rates, .plan = plan, .after_step = anchors_after_step};
