/* SPDX-License-Identifier: Apache-2.0 */
#include "regulariser.h"

#include <math.h>

#include "core/clock.h"
#include "total_variation.h"

int sg_regularise(sg_ctx *ctx, struct sg_regulariser *r, const struct sg_regulariser_params *p, const float *planes,
                  int width, int height, float *gradient, struct sg_regulariser_value *out)
{
    struct sg_anisotropy *plan;
    *out = (struct sg_regulariser_value){.anisotropy = NAN, .total_variation = NAN};
    const double start = sg_seconds();
    if (p->anisotropy != 0) {
        const int code = sg_plans_find(ctx, &r->plans, &p->spectrum, width, height, &plan);
        if (code)
            return code;
        out->anisotropy = sg_anisotropy_loss(plan, planes, p->anisotropy, gradient);
    }
    const double between = sg_seconds();
    if (p->total_variation != 0) {
        if (sg_grow(ctx, SG_MEM_FRAME, &r->rows, &r->cap_rows, 6 * (size_t) height, 0, sizeof(double)))
            return SG_ERR_BUDGET;
        out->total_variation = sg_tv_loss(ctx, planes, width, height, p->tv, p->total_variation, gradient, r->rows);
    }
    const size_t pixels = p->mask ? (size_t) width * (size_t) height : 0;
    for (size_t i = 0; i < pixels; i++)
        if (!p->mask[i])
            gradient[i] = gradient[pixels + i] = gradient[2 * pixels + i] = 0;
    out->anisotropy_seconds = between - start, out->total_variation_seconds = sg_seconds() - between;
    return SG_OK;
}

void sg_regulariser_clear(struct sg_regulariser *r)
{
    sg_plans_clear(&r->plans);
    sg_free(r->rows);
    *r = (struct sg_regulariser){0};
}
