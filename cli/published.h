/* SPDX-License-Identifier: Apache-2.0 */
/* The published settings of models and strategies, by data set. */
#ifndef SG_PUBLISHED_H
#define SG_PUBLISHED_H

#include "options.h"
#include "splatguard/train.h"

#define PUBLISHED_SETS "off|ns|mip-outdoor|mip-indoor|tt|db|bungee|poison-splat"

/* Where they differ from the defaults, options of `c` that are not `given` get the values that were
 * published for the model or strategy and this data set, an index of PUBLISHED_SETS. Returns an
 * exit status: STATUS_USAGE where none are known. */
int published_apply(const struct command *c, int set, enum sg_train_model model,
                    enum sg_train_strategy strategy, const bool *given, void *config);

#endif
