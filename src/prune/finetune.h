/* SPDX-License-Identifier: Apache-2.0 */
/* Training after pruning, as LightGaussian and PUP 3D-GS do it. */
#ifndef SG_PRUNE_FINETUNE_H
#define SG_PRUNE_FINETUNE_H

#include "splatguard/prune.h"
#include "train/strategy.h"

/* No densification and no opacity reset. The first iteration takes no step: the released programs
 * prune in it. Every 400 iterations all rates but that of positions shrink by 5 %. */
extern const struct sg_strategy sg_strategy_finetune;

/* Parameters of the fine-tuning. The learning rate of positions continues from the last iteration
 * of the model's training. */
struct sg_train_params sg_finetune_params(const struct sg_prune_params *params);

/* *model becomes a fine-tuned one, or NULL after an error. */
int sg_finetune(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_prune_params *params,
                struct sg_model **model);

#endif
