/* SPDX-License-Identifier: Apache-2.0 */
#include "exposure.h"

#include "math/constants.h"
#include "schedule.h"

int sg_exposures_create(sg_ctx *ctx, size_t n, float **out)
{
    *out = sg_alloc(ctx, SG_MEM_OPTIMISER, n, SG_EXPOSURE_FLOATS * sizeof(**out));
    for (size_t i = 0; *out && i < n; i++)
        for (int c = 0; c < 3; c++)
            (*out)[i * SG_EXPOSURE + (size_t) (5 * c)] = 1;
    return *out ? SG_OK : SG_ERR_BUDGET;
}

struct sg_exposure_update sg_exposures_update(const struct sg_train_params *params, int it,
                                              uint64_t steps)
{
    const double b1 = (double) SG_ADAM_BETA1, b2 = (double) SG_ADAM_BETA2;
    return (struct sg_exposure_update){.rate = sg_exposure_lr(params, it) /
                                               (1 - pow(b1, (double) steps)),
                                       .root = 1 / sqrt(1 - pow(b2, (double) steps))};
}
