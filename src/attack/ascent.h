/* SPDX-License-Identifier: Apache-2.0 */
/* The attack's inner maximisation: sign steps up the total variation of an image, kept near a
 * photo. */
#ifndef SG_ASCENT_H
#define SG_ASCENT_H

#include "engine/engine.h"
#include "spectral/anisotropy.h"
#include "splatguard/attack.h"

struct ascent {
    float epsilon; /* INFINITY: no bound but [0, 1] */
    float step;
    int steps;
    enum sg_attack_tv form;
    const float *bound;             /* a plane: the epsilon of each pixel instead; or NULL */
    struct sg_anisotropy *spectral; /* NULL, or a loss to lower too, of this image size */
    float spectral_weight;
    float *extra; /* 3 planes, with spectral */
};

/* x: 3 planes, changed in place; photo: 3 planes. scratch: 3 planes. Same bytes for any number of
 * threads. All steps: y = x + step sgn(dTV/dx), x = clamp(photo + clamp(y - photo, -epsilon,
 * epsilon), 0, 1). */
int sg_ascend(struct sg_engine *e, const struct ascent *a, const float *photo, int width,
              int height, float *x, float *scratch);

/* The bound of each pixel by sg_attack_params.texture: whole grey levels below epsilon, or epsilon.
 * bound: a plane. SG_ERR_BUDGET. */
int sg_texture_bound(sg_ctx *ctx, const uint8_t *rgb, int width, int height, float epsilon,
                     float texture, float *bound);

#endif
