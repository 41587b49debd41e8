/* SPDX-License-Identifier: Apache-2.0 */
/* An affine map of colours for each training photo, learned with the model (the code of Kerbl et
 * al. since 2024). It begins as the identity; Adam moves all of them in every step, those of other
 * photos by their momentum alone. */
#ifndef SG_TRAIN_EXPOSURE_H
#define SG_TRAIN_EXPOSURE_H

#include "engine/engine.h"
#include "splatguard/train.h"

/* Floats of a photo: the map, and both moments. */
#define SG_EXPOSURE_FLOATS (3 * SG_EXPOSURE)

/* The maps of n photos, then their first moments, then the second. */
int sg_exposures_create(sg_ctx *ctx, size_t n, float **out);
/* steps: with this one. */
void sg_exposures_step(float *exposures, size_t n, size_t view, const double *gradient,
                       const struct sg_train_params *params, int it, uint64_t steps);

#endif
