/* SPDX-License-Identifier: Apache-2.0 */
#include "image_losses.h"

#include <math.h>
#include <string.h>

#include "engine/engine.h"
#include "image/total_variation.h"

int sg_image_loss_anisotropy(sg_ctx *ctx, struct sg_image_losses *s, const struct sg_loss *loss,
                             const float *planes, int width, int height, float *gradient,
                             double *out)
{
    struct sg_anisotropy *plan;
    const int code = sg_plans_find(ctx, &s->plans, &loss->anisotropy, s->fft, width, height, &plan);
    if (!code)
        *out = sg_anisotropy_loss(plan, planes, loss->weight, gradient);
    return code;
}

int sg_image_loss_total_variation(sg_ctx *ctx, struct sg_image_losses *s,
                                  const struct sg_loss *loss, const float *planes, int width,
                                  int height, float *gradient, double *out)
{
    if (sg_grow(ctx, SG_MEM_FRAME, &s->rows, &s->cap_rows, 6 * (size_t) height, 0, sizeof(double)))
        return SG_ERR_BUDGET;
    *out = sg_tv_loss(ctx, planes, width, height, loss->total_variation, loss->weight, gradient,
                      s->rows);
    return SG_OK;
}

static void mask_gradient(const uint8_t *mask, size_t pixels, float *gradient)
{
    for (size_t i = 0; mask && i < pixels; i++)
        if (!mask[i])
            gradient[i] = gradient[pixels + i] = gradient[2 * pixels + i] = 0;
}

int sg_image_loss(sg_ctx *ctx, struct sg_image_losses *s, const struct sg_loss *loss,
                  const float *planes, int width, int height, const uint8_t *mask, float *gradient,
                  double *out)
{
    static int (*const kinds[SG_LOSSES])(sg_ctx *, struct sg_image_losses *, const struct sg_loss *,
                                         const float *, int, int, float *, double *) = {
#define L(kind, name, type) [SG_LOSS_##kind] = sg_image_loss_##name,
        SG_IMAGE_LOSSES(L)
#undef L
    };
    const int code = kinds[loss->kind](ctx, s, loss, planes, width, height, gradient, out);
    if (!code)
        mask_gradient(mask, (size_t) width * (size_t) height, gradient);
    return code;
}

void sg_host_descend(const struct sg_ascend *a)
{
    const size_t values = 3 * (size_t) a->width * (size_t) a->height;
    double sum = 0;
    memset(a->extra, 0, values * sizeof(float));
    sg_anisotropy_loss(a->spectral, a->from, 1, a->extra);
    for (size_t i = 0; i < values; i++)
        sum += (double) fabsf(a->extra[i]);
    const float scale =
        sum > 0 ? (float) (-(double) a->spectral_weight * (double) values / sum) : 0;
    for (size_t i = 0; i < values; i++)
        a->extra[i] *= scale;
}

void sg_image_losses_clear(struct sg_image_losses *s)
{
    sg_plans_clear(&s->plans);
    sg_free(s->rows);
    *s = (struct sg_image_losses){.fft = s->fft};
}
