/* SPDX-License-Identifier: Apache-2.0 */
/* There is no FFTW for the emulated machine; the tests that run there have no anisotropy loss. */
#include "spectral/plans.h"

int sg_plans_find(sg_ctx *ctx, struct sg_plans *plans, const struct sg_anisotropy_params *params, int width, int height,
                  struct sg_anisotropy **out)
{
    (void) plans, (void) params, (void) width, (void) height, (void) out;
    return sg_fail(ctx, SG_ERR_INTERNAL, "no Fourier transform here");
}

void sg_plans_clear(struct sg_plans *plans)
{
    (void) plans;
}

double sg_anisotropy_loss(struct sg_anisotropy *a, const float *planes, double weight, float *gradient)
{
    (void) a, (void) planes, (void) weight, (void) gradient;
    return 0;
}
