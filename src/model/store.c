/* SPDX-License-Identifier: Apache-2.0 */
#include "core/internal.h"
#include "splatguard/model.h"

int sg_model_create(sg_ctx *ctx, size_t count, int sh_degree, struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    if (sh_degree < 0 || sh_degree > 3)
        return sg_fail(ctx, SG_ERR_USAGE, "model: found SH degree %d, expected 0 to 3", sh_degree);
    if (count > UINT32_MAX)
        return sg_fail(ctx, SG_ERR_BUDGET, "model: found %zu Gaussians, at most %u are supported",
                       count, UINT32_MAX);
    struct sg_model *m = sg_alloc(ctx, SG_MEM_MODEL, 1, sizeof(*m));
    if (!m)
        return SG_ERR_BUDGET;
    *m = (struct sg_model){.count = count,
                           .capacity = (count + SG_LANES - 1) / SG_LANES * SG_LANES,
                           .sh_degree = sh_degree,
                           .active_sh_degree = sh_degree};
    m->params = sg_alloc(ctx, SG_MEM_MODEL, m->capacity,
                         (size_t) sg_param_count(sh_degree) * sizeof(float));
    if (!m->params) {
        sg_free(m);
        return SG_ERR_BUDGET;
    }
    *out = m;
    return SG_OK;
}

void sg_model_destroy(struct sg_model **model)
{
    if (!model || !*model)
        return;
    sg_free((*model)->params);
    sg_free(*model);
    *model = NULL;
}
