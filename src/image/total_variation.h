/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_IMAGE_TOTAL_VARIATION_H
#define SG_IMAGE_TOTAL_VARIATION_H

#include "core/context.h"
#include "splatguard/variation.h"

/* Mean over the vertical differences plus mean over the horizontal ones of the norm of d. gradient:
 * adds weight x its own. rows: scratch, 3 x height x 2. */
double sg_tv_loss(sg_ctx *ctx, const float *planes, int width, int height, enum sg_tv_penalty norm,
                  double weight, float *gradient, double *rows);

/* A form of planes: its sum over the values of 3 planes (rows: scratch, 3 x height), and its
 * gradient at one row of a plane. sg_total_variation is that of bytes. */
double sg_tv_planes(sg_ctx *ctx, const float *planes, int width, int height, enum sg_attack_tv form,
                    double *rows);
void sg_tv_gradient_row(const float *plane, int width, int height, int y, enum sg_attack_tv form,
                        float *out);

#endif
