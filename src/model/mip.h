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

#endif
