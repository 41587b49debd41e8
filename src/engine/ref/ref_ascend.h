/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_REF_ASCEND_H
#define SG_REF_ASCEND_H

#include "splatguard/variation.h"

/* dTV/dx of one row of a plane. */
void sg_tv_gradient_row(const float *plane, int width, int height, int y, enum sg_tv_form form,
                        float *out);

#endif
