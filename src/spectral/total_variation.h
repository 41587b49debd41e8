/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SPECTRAL_TOTAL_VARIATION_H
#define SG_SPECTRAL_TOTAL_VARIATION_H

#include "core/internal.h"
#include "splatguard/defense.h"

/* Mean over the vertical differences plus mean over the horizontal ones of the norm of d. gradient:
 * adds weight x its own. rows: scratch, 3 x height x 2. */
double sg_tv_loss(sg_ctx *ctx, const float *planes, int width, int height, enum sg_tv_norm norm,
                  double weight, float *gradient, double *rows);

#endif
