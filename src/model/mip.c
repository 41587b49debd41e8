/* SPDX-License-Identifier: Apache-2.0 */
#include "mip.h"

#include <math.h>
#include <string.h>

#include "columns.h"

/* ln of the standard deviation of the sum, from both logarithms: no square overflows. */
static float widened(float log_scale, float log_filter)
{
    const float most = fmaxf(log_scale, log_filter);
    return most + 0.5f * log1pf(expf(-2 * fabsf(log_scale - log_filter)));
}

static float log_sigmoid(float x)
{
    return x < 0 ? x - log1pf(expf(x)) : -log1pf(expf(-x));
}

#define AT(p) ((p) *SG_LANES + lane)

void sg_mip_forward(const void *unused, const float *params, const float *filter, int planes,
                    float *shaped)
{
    (void) unused;
    memcpy(shaped, params, (size_t) planes * SG_LANES * sizeof(float));
    for (int lane = 0; lane < SG_LANES; lane++) {
        if (!(filter[lane] > 0))
            continue;
        float coefficient = 0; /* its logarithm */
        for (int p = SG_P_SCALE; p < SG_P_SCALE + 3; p++) {
            shaped[AT(p)] = widened(params[AT(p)], logf(filter[lane]));
            coefficient += params[AT(p)] - shaped[AT(p)];
        }
        const float log_opacity = log_sigmoid(params[AT(SG_P_OPACITY)]) + coefficient,
                    opacity = fminf(expf(log_opacity), 1 - 0x1p-24f);
        shaped[AT(SG_P_OPACITY)] = log_opacity - log1pf(-opacity);
    }
}

void sg_mip_backward(const void *unused, const float *params, const float *filter, int planes,
                     float *gradients)
{
    (void) unused, (void) planes;
    for (int lane = 0; lane < SG_LANES; lane++) {
        if (!(filter[lane] > 0))
            continue;
        float kept[3], coefficient = 0; /* kept: s^2 / (s^2 + f^2) */
        for (int k = 0; k < 3; k++) {
            const float s = params[AT(SG_P_SCALE + k)], wide = widened(s, logf(filter[lane]));
            kept[k] = expf(2 * (s - wide));
            coefficient += s - wide;
        }
        const float own = log_sigmoid(params[AT(SG_P_OPACITY)]);
        const float transparent = 1 - fminf(expf(own + coefficient), 1 - 0x1p-24f);
        /* of the logarithm of the drawn opacity */
        const float gradient = gradients[AT(SG_P_OPACITY)] / transparent;
        gradients[AT(SG_P_OPACITY)] = gradient * (1 - expf(own));
        for (int k = 0; k < 3; k++)
            gradients[AT(SG_P_SCALE + k)] =
                gradients[AT(SG_P_SCALE + k)] * kept[k] + gradient * (1 - kept[k]);
    }
}

int sg_mip_fold(sg_ctx *ctx, struct sg_model *m, const char *path)
{
    float *filter = m->columns ? m->columns->at[SG_C_FILTER] : NULL;
    const int planes = sg_param_count(m->sh_degree);
    float shaped[SG_PARAMS_MAX * SG_LANES];
    for (size_t i = 0; i < m->count && filter; i++)
        if (!(filter[i] >= 0 && isfinite(filter[i])))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: Gaussian %zu: filter_3D: found %g, expected a finite number of at "
                           "least 0",
                           path, i, (double) filter[i]);
    for (size_t i = 0; i < m->count && filter; i += SG_LANES) {
        float *params = m->params + sg_param_index(planes, i, 0);
        sg_mip_forward(NULL, params, filter + i, planes, shaped);
        memcpy(params, shaped, (size_t) planes * SG_LANES * sizeof(float));
    }
    if (filter) {
        sg_free(filter);
        m->columns->at[SG_C_FILTER] = NULL;
    }
    return SG_OK;
}
