/* SPDX-License-Identifier: Apache-2.0 */
/* Exposures for engines in host memory, over the context's threads. */
#ifndef SG_HOST_EXPOSURE_H
#define SG_HOST_EXPOSURE_H

#include "engine/engine.h"

struct sg_host_exposure {
    float *image; /* 3 planes: the render as the photo would show it */
    double *rows; /* SG_EXPOSURE sums of each row */
    size_t cap_image, cap_rows;
};

/* Fills x->image from the render. SG_ERR_BUDGET. */
int sg_host_expose(sg_ctx *ctx, struct sg_host_exposure *x, const float *exposure, const float *rgb,
                   int width, int height);
/* gradient: of x->image, becomes that of the render. out: that of the exposure. */
void sg_host_expose_backward(sg_ctx *ctx, struct sg_host_exposure *x, const float *exposure,
                             const float *rgb, int width, int height, float *gradient,
                             double out[SG_EXPOSURE]);
/* One step of sg_engine_learn_exposures. exposures: as of sg_engine_set_exposures. gradient: of the
 * one with this number. */
void sg_host_learn_exposures(float *exposures, size_t n, size_t number,
                             const double gradient[SG_EXPOSURE],
                             const struct sg_exposure_update *update);
void sg_host_exposure_clear(struct sg_host_exposure *x);

#endif
