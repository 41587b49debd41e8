/* SPDX-License-Identifier: Apache-2.0 */
/* The limits of a run. Before it starts, the context's memory limit is converted to limits on
 * Gaussians and tile lists. */
#ifndef SG_TRAIN_BUDGET_H
#define SG_TRAIN_BUDGET_H

#include "core/context.h"
#include "splatguard/train.h"

struct sg_budget {
    uint64_t gaussians; /* 0 = no limit */
    uint64_t instances; /* held at once */
    bool by_memory;     /* `gaussians` comes from the limit on memory */
    bool overshoots;    /* growth that begins below `gaussians` may reach twice as many */
    uint64_t photos;    /* bytes of lazy photos that may stay in memory without a user */
    bool photos_stay;   /* all of them fit */
    bool read_ahead;    /* if not: there is room for one that is read before it is used */
};

/* The most Gaussians that a model can have, the first one too; 0 = no limit. */
static inline uint64_t sg_budget_most(const struct sg_budget *limits)
{
    return limits->gaussians * (limits->overshoots ? 2 : 1);
}

/* Of a run on this scene. leaving: bytes in use that will be free before the first step;
 * accumulate: gradients add up over views. Where photos can be read again, at least half of the
 * memory that both can have is for Gaussians, as far as max_gaussians needs it. SG_ERR_BUDGET with
 * an estimate where not even a small model fits. */
int sg_budget_plan(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_train_params *params,
                   int sh_degree, uint64_t leaving, bool accumulate, struct sg_budget *out);
/* Lowers the limits to what the device of the engine, which is created, has room for. SG_ERR_BUDGET
 * likewise. spectral: see struct sg_trainer_start. */
int sg_budget_plan_device(sg_ctx *ctx, const struct sg_scene *scene,
                          const struct sg_train_params *params, int sh_degree, bool accumulate,
                          bool spectral, struct sg_budget *limits);

#endif
