/* SPDX-License-Identifier: Apache-2.0 */
#include "mip.h"

#include <math.h>
#include <string.h>

#include "columns.h"
#include "math/real_f32.h"

#include "math/mip.h"

#define AT(p) ((p) *SG_LANES + lane)

/* Of the Gaussian in a lane of a block: ln of the filter's standard deviation, and its scales. */
static float load(const float *params, const float *filter, int lane, float scales[3])
{
    for (int k = 0; k < 3; k++)
        scales[k] = params[AT(SG_P_SCALE + k)];
    return logf(filter[lane]);
}

void sg_mip_forward(const void *unused, const float *params, const float *filter, int planes,
                    float *shaped)
{
    (void) unused;
    memcpy(shaped, params, (size_t) planes * SG_LANES * sizeof(float));
    for (int lane = 0; lane < SG_LANES; lane++) {
        float scales[3], drawn[3];
        if (!(filter[lane] > 0))
            continue;
        const float log_filter = load(params, filter, lane, scales);
        shaped[AT(SG_P_OPACITY)] = mip_draw(scales, params[AT(SG_P_OPACITY)], log_filter, drawn);
        for (int k = 0; k < 3; k++)
            shaped[AT(SG_P_SCALE + k)] = drawn[k];
    }
}

void sg_mip_backward(const void *unused, const float *params, const float *filter, int planes,
                     float *gradients)
{
    (void) unused, (void) planes;
    for (int lane = 0; lane < SG_LANES; lane++) {
        float scales[3], of_scales[3];
        if (!(filter[lane] > 0))
            continue;
        const float log_filter = load(params, filter, lane, scales);
        for (int k = 0; k < 3; k++)
            of_scales[k] = gradients[AT(SG_P_SCALE + k)];
        gradients[AT(SG_P_OPACITY)] = mip_draw_backward(
            scales, params[AT(SG_P_OPACITY)], log_filter, of_scales, gradients[AT(SG_P_OPACITY)]);
        for (int k = 0; k < 3; k++)
            gradients[AT(SG_P_SCALE + k)] = of_scales[k];
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
