/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "core/context.h"
#include "core/rng.h"
#include "math/constants.h"
#include "nearest.h"
#include "splatguard/model.h"

#define MIN_SQUARED_SCALE 1e-7f   /* of coincident points */
#define INITIAL_LOGIT -2.1972246f /* opacity 0.1 */

int sg_model_init_points(sg_ctx *ctx, const float *xyz, const uint8_t *rgb, size_t n, int sh_degree,
                         struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    if (n < 4)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "points: found %zu, expected at least 4: scales come from 3 neighbours", n);
    for (size_t i = 0; i < 3 * n; i++)
        if (!isfinite(xyz[i]))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "points: point %zu: found a coordinate that is not finite", i / 3);
    struct sg_model *m = NULL;
    float *d2 = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*d2));
    int code = d2 ? sg_model_create(ctx, n, sh_degree, &m) : SG_ERR_BUDGET;
    if (code || (code = sg_nearest3(ctx, xyz, n, d2)))
        goto done;
    m->active_sh_degree = 0;
    for (size_t i = 0; i < n; i++) {
        /* An overflowing distance must not become an infinite Gaussian. */
        const float clamped = fminf(fmaxf(d2[i], MIN_SQUARED_SCALE), 1e30f);
        for (size_t k = 0; k < 3; k++) {
            *sg_model_at(m, i, SG_P_XYZ + (int) k) = xyz[3 * i + k];
            *sg_model_at(m, i, SG_P_SCALE + (int) k) = 0.5f * logf(clamped);
            *sg_model_at(m, i, SG_P_SH + (int) k) =
                ((float) rgb[3 * i + k] / 255.0f - 0.5f) / SG_SH_C0;
        }
        *sg_model_at(m, i, SG_P_OPACITY) = INITIAL_LOGIT;
        *sg_model_at(m, i, SG_P_ROT) = 1;
    }
    *out = m;
    m = NULL;
done:
    sg_free(d2);
    sg_model_destroy(&m);
    return code;
}

int sg_model_init_random(sg_ctx *ctx, size_t n, float half_side, uint64_t seed, int sh_degree,
                         struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    float *xyz = sg_alloc_raw(ctx, SG_MEM_MISC, n, 3 * sizeof(*xyz));
    uint8_t *rgb = sg_alloc_raw(ctx, SG_MEM_MISC, n, 3);
    int code = SG_ERR_BUDGET;
    if (xyz && rgb) {
        for (size_t i = 0; i < 3 * n; i++) {
            xyz[i] = 2 * half_side * sg_rng_uniform(seed, SG_RNG_INIT, 0, i) - half_side;
            rgb[i] = 127; /* what the reference's random colours become once stored as bytes */
        }
        code = sg_model_init_points(ctx, xyz, rgb, n, sh_degree, out);
    }
    sg_free(xyz);
    sg_free(rgb);
    return code;
}
