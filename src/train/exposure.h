/* SPDX-License-Identifier: Apache-2.0 */
/* An affine map of colours for each training photo, learned with the model (the code of Kerbl et
 * al. since 2024). It begins as the identity; Adam moves all of them in every step, those of other
 * photos by their momentum alone. */
#ifndef SG_TRAIN_EXPOSURE_H
#define SG_TRAIN_EXPOSURE_H

#include "engine/engine.h"
#include "splatguard/train.h"

/* Those of n photos before the first step, for sg_engine_set_exposures. */
int sg_exposures_create(sg_ctx *ctx, size_t n, float **out);
/* The step of iteration `it`. steps: with this one. */
struct sg_exposure_update sg_exposures_update(const struct sg_train_params *params, int it,
                                              uint64_t steps);

#endif
