/* SPDX-License-Identifier: Apache-2.0 */
#include "codec.h"
#include "model/columns.h"
#include "model/morton.h"

int sg_model_order(sg_ctx *ctx, const struct sg_model *m, uint32_t **order)
{
    const struct sg_places places = {m->params, m->count, NULL, sg_param_count(m->sh_degree), 0};
    *order = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, sizeof(**order));
    return *order ? sg_morton_order(ctx, &places, NULL, m->count, *order) : SG_ERR_BUDGET;
}
