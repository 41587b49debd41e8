/* SPDX-License-Identifier: Apache-2.0 */
#include "finetune.h"

#include "model/columns.h"
#include "train/schedule.h"
#include "train/trainer.h"

#define SHRINK 0.95
#define INTERVAL 400 /* iterations */

static void rates(const sg_trainer *t, int before, int it, double *lr)
{
    (void) t;
    sg_shrink_rates(before, it, SHRINK, INTERVAL, lr);
}

static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    (void) t, (void) it;
    return (struct sg_strategy_plan){.rests = before < 1};
}

const struct sg_strategy sg_strategy_finetune = {.name = "finetune", .rates = rates, .plan = plan};

struct sg_train_params sg_finetune_params(const struct sg_prune_params *p)
{
    struct sg_train_params t = sg_train_params_default();
    const double done = (double) p->trained / (double) (p->trained + p->finetune),
                 first = log((double) t.position_lr_init), last = log((double) t.position_lr_final);
    t.iterations = t.position_lr_max_steps = p->finetune;
    t.position_lr_init = (float) exp(first + (last - first) * done);
    t.densify_until_iter = 0;
    t.seed = p->seed;
    t.white_background = p->white_background;
    t.engine = p->engine, t.cpu = p->cpu;
    return t;
}

int sg_finetune(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_prune_params *p,
                struct sg_model **model)
{
    const struct sg_train_params params = sg_finetune_params(p);
    const struct sg_trainer_start start = {.initial = *model, .strategy = &sg_strategy_finetune};
    sg_trainer *t = NULL;
    int code = sg_trainer_open(ctx, scene, &start, &params, &t);
    sg_model_destroy(model); /* its memory is promised to the trainer */
    while (!code && sg_trainer_iteration(t) < params.iterations) {
        struct sg_train_step step;
        code = sg_trainer_advance(t, p->step ? &step : NULL);
        if (!code && p->step && p->step(p->step_priv, &step))
            code = sg_fail(ctx, SG_ERR_INTERRUPTED, "interrupted at iteration %d of fine-tuning",
                           step.iteration);
    }
    if (!code)
        code = sg_trainer_model(t, model);
    sg_trainer_destroy(&t);
    return code;
}
