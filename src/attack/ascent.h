/* SPDX-License-Identifier: Apache-2.0 */
/* The attack's inner maximisation: sign steps up the total variation of an image, kept near a photo. */
#ifndef SG_ASCENT_H
#define SG_ASCENT_H

#include "core/internal.h"
#include "splatguard/attack.h"

struct ascent {
    float epsilon; /* INFINITY: no bound but [0, 1] */
    float step;
    int steps;
    enum sg_tv_form form;
};

/* x: 3 planes, changed in place; photo: 3 planes. scratch: 6 planes. Same bytes for any number of threads.
 * All steps: y = x + step sgn(dTV/dx), x = clamp(photo + clamp(y - photo, -epsilon, epsilon), 0, 1). */
void sg_ascend(sg_ctx *ctx, const struct ascent *a, const float *photo, int width, int height, float *x,
               float *scratch);

/* Sum over the values of 3 planes. */
double sg_tv_planes(const float *planes, int width, int height, enum sg_tv_form form);

/* dTV/dx of one row of a plane. norms: 1 / sqrt(..) of the SG_TV_ISO terms, a plane, else NULL. */
void sg_tv_gradient_row(const float *plane, const float *norms, int width, int height, int y, enum sg_tv_form form,
                        float *out);

#endif
