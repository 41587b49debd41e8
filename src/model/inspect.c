/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>

#include "core/compare.h"
#include "core/context.h"
#include "math/constants.h"
#include "columns.h"
#include "ply.h"
#include "splatguard/model.h"

static bool all_finite(const struct sg_model *m, size_t i, int first, int end)
{
    for (int p = first; p < end; p++)
        if (!isfinite(*sg_model_at(m, i, p)))
            return false;
    return true;
}

int sg_model_check(sg_ctx *ctx, const struct sg_model *m, const char *name)
{
    size_t i;
    int plane;
    char property[24];
    sg_clear_error(ctx);
    if (m->count == 0)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no Gaussians, expected at least one", name);
    if (!sg_model_find_nonfinite(m, &i, &plane))
        return SG_OK;
    sg_plane_name(plane, m->sh_degree, property);
    return sg_fail(ctx, SG_ERR_INPUT, "%s: Gaussian %zu: found %s %g, expected a finite number",
                   name, i, property, (double) *sg_model_at(m, i, plane));
}

/* Nearest rank; NaN of nothing. */
static void percentiles(float *values, size_t n, double out[5])
{
    static const double at[5] = {0.01, 0.25, 0.5, 0.75, 0.99};
    qsort(values, n, sizeof(*values), sg_float_ascending);
    for (int k = 0; k < 5; k++)
        out[k] = n ? (double) values[(size_t) (at[k] * (double) (n - 1) + 0.5)] : NAN;
}

int sg_model_inspect(sg_ctx *ctx, const struct sg_model *m, struct sg_model_info *out)
{
    sg_clear_error(ctx);
    *out = (struct sg_model_info){.count = m->count, .sh_degree = m->sh_degree};
    float *scale = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, sizeof(float));
    float *opacity = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, sizeof(float));
    if (!scale || !opacity) {
        sg_free(scale);
        sg_free(opacity);
        return SG_ERR_BUDGET;
    }
    for (int k = 0; k < 3; k++)
        out->min[k] = INFINITY, out->max[k] = -INFINITY;
    const int planes = sg_param_count(m->sh_degree);
    size_t n = 0;
    for (size_t i = 0; i < m->count; i++) {
        bool turned = false;
        for (int k = 0; k < 4; k++)
            turned |= *sg_model_at(m, i, SG_P_ROT + k) !=
                      0; /* NaN is not counted as zero, but as not finite */
        out->zero_rotation += !turned;
        if (all_finite(m, i, SG_P_XYZ, SG_P_XYZ + 3))
            for (int k = 0; k < 3; k++) {
                const double x = (double) *sg_model_at(m, i, SG_P_XYZ + k);
                out->min[k] = fmin(out->min[k], x), out->max[k] = fmax(out->max[k], x);
            }
        if (!all_finite(m, i, 0, planes)) {
            out->nonfinite++;
            continue;
        }
        const float *s = sg_model_at(m, i, SG_P_SCALE);
        scale[n] = expf(fmaxf(fmaxf(s[0], s[SG_LANES]), s[2 * SG_LANES]));
        opacity[n] = 1 / (1 + expf(-*sg_model_at(m, i, SG_P_OPACITY)));
        out->transparent += opacity[n] < SG_ALPHA_MIN;
        n++;
    }
    int plane;
    if (out->nonfinite && sg_model_find_nonfinite(m, &out->first_nonfinite, &plane))
        sg_plane_name(plane, m->sh_degree, out->first_property);
    percentiles(scale, n, out->scale_percentile);
    percentiles(opacity, n, out->opacity_percentile);
    sg_free(scale);
    sg_free(opacity);
    return SG_OK;
}
