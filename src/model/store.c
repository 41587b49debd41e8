/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "anchors.h"

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
    if ((*model)->columns)
        sg_columns_clear((*model)->columns);
    sg_free((*model)->columns);
    sg_free(*model);
    *model = NULL;
}

size_t sg_model_appearances(const struct sg_model *m)
{
    return m->columns && m->columns->networks ? m->columns->networks->photos : 0;
}

uint64_t sg_model_gaussians(const struct sg_model *m)
{
    return (uint64_t) m->count * (sg_model_has_anchors(m) ? SG_ANCHOR_GAUSSIANS : 1);
}

static bool is_exported(int c)
{
    return sg_columns[c].place && !sg_column_is_parameter(c);
}

int sg_model_add_columns(sg_ctx *ctx, struct sg_model *m, const struct sg_model *like)
{
    for (int c = 0; c < SG_COLUMNS; c++) {
        if (!is_exported(c) || (like ? !(like->columns && like->columns->at[c])
                                     : !sg_column_of(c, ~(unsigned) SG_COLUMN_MIP)))
            continue;
        if (!m->columns && !(m->columns = sg_alloc(ctx, SG_MEM_MODEL, 1, sizeof(*m->columns))))
            return SG_ERR_BUDGET;
        m->columns->capacity = m->capacity;
        if (!m->columns->at[c] &&
            !(m->columns->at[c] =
                  sg_alloc(ctx, SG_MEM_MODEL, m->capacity,
                           (size_t) sg_column_planes(c, m->sh_degree) * sizeof(float))))
            return SG_ERR_BUDGET;
    }
    return SG_OK;
}

int sg_model_create_like(sg_ctx *ctx, const struct sg_model *like, size_t count, int sh_degree,
                         struct sg_model **out)
{
    const int degree = sh_degree < like->sh_degree ? sh_degree : like->sh_degree;
    int code = sg_model_create(ctx, count, degree, out);
    if (code)
        return code;
    if (like->active_sh_degree < degree)
        (*out)->active_sh_degree = like->active_sh_degree;
    if (like->columns)
        code = sg_model_add_columns(ctx, *out, like);
    if (!code && sg_model_has_anchors(like)) {
        const struct sg_networks *networks = like->columns->networks;
        if (!(code = sg_anchors_add(ctx, *out, networks->photos)))
            sg_networks_copy((*out)->columns->networks, networks);
    }
    if (code)
        sg_model_destroy(out);
    return code;
}

int sg_model_refused(sg_ctx *ctx, int code, const char *path, uint64_t count, size_t bytes)
{
    if (code != SG_ERR_BUDGET || !sg_mem_limit(ctx))
        return code;
    sg_clear_error(ctx);
    return sg_fail(ctx, code,
                   "%s: memory: found %llu Gaussians of %zu bytes, the limit for all is %llu bytes",
                   path, (unsigned long long) count, bytes, (unsigned long long) sg_mem_limit(ctx));
}

void sg_model_copy_row(const struct sg_model *from, size_t i, struct sg_model *to, size_t k)
{
    for (int p = 0; p < sg_param_count(to->sh_degree); p++)
        *sg_model_at(to, k, p) = *sg_model_at(from, i, p);
    for (int c = 0; c < SG_COLUMNS && from->columns; c++) {
        const int planes = from->columns->at[c] ? sg_column_planes(c, from->sh_degree) : 0,
                  kept = from->columns->at[c] ? sg_column_planes(c, to->sh_degree) : 0;
        for (int p = 0; p < kept; p++)
            to->columns->at[c][sg_param_index(kept, k, p)] =
                from->columns->at[c][sg_param_index(planes, i, p)];
    }
}

bool sg_model_find_nonfinite(const struct sg_model *m, size_t *gaussian, int *plane)
{
    const int planes = sg_param_count(m->sh_degree);
    for (*gaussian = 0; *gaussian < m->count; ++*gaussian)
        for (*plane = 0; *plane < planes; ++*plane)
            if (!isfinite(*sg_model_at(m, *gaussian, *plane)))
                return true;
    return false;
}
