/* SPDX-License-Identifier: Apache-2.0 */
/* There is no FFTW for the emulated machine; the tests that run there do not regularise. */
#include "spectral/regulariser.h"

int sg_regularise(sg_ctx *ctx, struct sg_regulariser *r, const struct sg_regulariser_params *params,
                  const float *planes, int width, int height, float *gradient, struct sg_regulariser_value *out)
{
    (void) r, (void) params, (void) planes, (void) width, (void) height, (void) gradient, (void) out;
    return sg_fail(ctx, SG_ERR_INTERNAL, "no Fourier transform here");
}

void sg_regulariser_clear(struct sg_regulariser *r)
{
    (void) ctx, (void) r;
}
