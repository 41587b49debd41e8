/* SPDX-License-Identifier: Apache-2.0 */
#include "codec.h"
#include "model/anchors.h"
#include "model/columns.h"
#include "model/morton.h"

int sg_model_order(sg_ctx *ctx, const struct sg_model *m, uint32_t **order)
{
    const struct sg_places places = {m->params, m->count, NULL, sg_param_count(m->sh_degree), 0};
    *order = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, sizeof(**order));
    return *order ? sg_morton_order(ctx, &places, NULL, m->count, *order) : SG_ERR_BUDGET;
}

int sg_model_sort(sg_ctx *ctx, const struct sg_model *m, struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    uint32_t *order = NULL;
    int code = sg_model_refuse_anchors(ctx, m);
    if (!code)
        code = sg_model_order(ctx, m, &order);
    if (!code)
        code = sg_model_create_like(ctx, m, m->count, m->sh_degree, out);
    for (size_t i = 0; i < m->count && !code; i++)
        sg_model_copy_row(m, order[i], *out, i);
    sg_free(order);
    return code;
}
