/* SPDX-License-Identifier: Apache-2.0 */
#include "ascent.h"

#include <string.h>

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
                             .spectral = a->spectral,
                             .spectral_weight = a->spectral_weight,
                             .extra = a->spectral ? a->extra : NULL,
                             .from = x,
                             .to = scratch};
    for (int k = 0; k < a->steps; k++) {
        int code =
            sg_progress(sg_engine_ctx(e), SG_STAGE_ASCEND, (uint64_t) k, (uint64_t) a->steps);
        step.continues = k > 0;
        step.continued = k + 1 < a->steps;
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
