/* SPDX-License-Identifier: Apache-2.0 */
#include "ascent.h"

#include <math.h>
#include <string.h>

/* Down the anisotropy loss, its mean absolute value scaled to the weight. */
static const float *spectral_descent(const struct ascent *a, const float *x, size_t values)
{
    double sum = 0;
    memset(a->extra, 0, values * sizeof(float));
    sg_anisotropy_loss(a->spectral, x, 1, a->extra);
    for (size_t i = 0; i < values; i++)
        sum += (double) fabsf(a->extra[i]);
    const float scale =
        sum > 0 ? (float) (-(double) a->spectral_weight * (double) values / sum) : 0;
    for (size_t i = 0; i < values; i++)
        a->extra[i] *= scale;
    return a->extra;
}

int sg_ascend(struct sg_engine *e, const struct ascent *a, const float *photo, int width,
              int height, float *x, float *scratch)
{
    const size_t values = 3 * (size_t) width * (size_t) height;
    struct sg_ascend step = {.epsilon = a->epsilon,
                             .step = a->step,
                             .form = a->form,
                             .width = width,
                             .height = height,
                             .photo = photo,
                             .bound = a->bound,
                             .from = x,
                             .to = scratch};
    for (int k = 0; k < a->steps; k++) {
        int code =
            sg_progress(sg_engine_ctx(e), SG_STAGE_ASCEND, (uint64_t) k, (uint64_t) a->steps);
        if (a->spectral && !code)
            step.extra = spectral_descent(a, step.from, values);
        step.continues = k > 0 && !a->spectral;
        step.continued = k + 1 < a->steps && !a->spectral;
        if (!code)
            code = sg_engine_ascend(e, &step);
        if (code)
            return code;
        float *next = k % 2 ? scratch : x;
        step.from = step.to;
        step.to = next;
    }
    if (a->steps % 2)
        memcpy(x, scratch, values * sizeof(float));
    return SG_OK;
}
