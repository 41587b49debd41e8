/* SPDX-License-Identifier: Apache-2.0 */
#include "exposure.h"

#include "math/constants.h"
#include "schedule.h"

#define EPSILON 1e-8 /* of Adam: not that of the Gaussians */

int sg_exposures_create(sg_ctx *ctx, size_t n, float **out)
{
    *out = sg_alloc(ctx, SG_MEM_OPTIMISER, n, SG_EXPOSURE_FLOATS * sizeof(**out));
    for (size_t i = 0; *out && i < n; i++)
        for (int c = 0; c < 3; c++)
            (*out)[i * SG_EXPOSURE + (size_t) (5 * c)] = 1;
    return *out ? SG_OK : SG_ERR_BUDGET;
}

void sg_exposures_step(float *exposures, size_t n, size_t view, const double *gradient,
                       const struct sg_train_params *params, int it, uint64_t steps)
{
    const double b1 = (double) SG_ADAM_BETA1, b2 = (double) SG_ADAM_BETA2;
    const double rate = sg_exposure_lr(params, it) / (1 - pow(b1, (double) steps)),
                 root = 1 / sqrt(1 - pow(b2, (double) steps));
    const size_t values = n * SG_EXPOSURE;
    float *m = exposures + values, *v = m + values;
    for (size_t i = 0; i < values; i++) {
        const double g = i / SG_EXPOSURE == view ? gradient[i % SG_EXPOSURE] : 0;
        m[i] = (float) (b1 * (double) m[i] + (1 - b1) * g);
        v[i] = (float) (b2 * (double) v[i] + (1 - b2) * g * g);
        exposures[i] -= (float) (rate * (double) m[i] / (sqrt((double) v[i]) * root + EPSILON));
    }
}
