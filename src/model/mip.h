/* SPDX-License-Identifier: Apache-2.0 */
/* What a Gaussian with a 3D filter is drawn as (Yu et al. 2024, section 5.1): wider by the filter,
 * and its opacity makes up for that. */
#ifndef SG_MODEL_MIP_H
#define SG_MODEL_MIP_H

#include "splatguard/model.h"

/* Functions of a struct sg_shape; filter: standard deviations of the block, 0 = none. */
void sg_mip_forward(const void *unused, const float *params, const float *filter, int planes,
                    float *shaped);
void sg_mip_backward(const void *unused, const float *params, const float *filter, int planes,
                     float *gradients);

/* Gives a model that has filters in a column the scales and opacities that it is drawn with, and
 * takes the column away. path: for messages. SG_ERR_INPUT for a filter that is not a finite number
 * of at least 0. */
int sg_mip_fold(sg_ctx *ctx, struct sg_model *m, const char *path);

#endif
