/* SPDX-License-Identifier: Apache-2.0 */
#include "plans.h"

int sg_plans_find(sg_ctx *ctx, struct sg_plans *plans, const struct sg_anisotropy_params *params,
                  const struct sg_fft_kernels *fft, int width, int height,
                  struct sg_anisotropy **out)
{
    struct sg_plan *oldest = plans->sizes;
    for (struct sg_plan *s = plans->sizes; s < plans->sizes + SG_PLANS; s++) {
        if (s->plan && s->width == width && s->height == height) {
            s->used = ++plans->clock;
            *out = s->plan;
            return SG_OK;
        }
        if (s->used < oldest->used)
            oldest = s;
    }
    sg_anisotropy_destroy(&oldest->plan);
    oldest->width = width, oldest->height = height, oldest->used = ++plans->clock;
    const int code = sg_anisotropy_create(ctx, width, height, params, fft, &oldest->plan);
    *out = oldest->plan;
    return code;
}

void sg_plans_clear(struct sg_plans *plans)
{
    for (int i = 0; i < SG_PLANS; i++)
        sg_anisotropy_destroy(&plans->sizes[i].plan);
    *plans = (struct sg_plans){0};
}
