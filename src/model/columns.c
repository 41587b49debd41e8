/* SPDX-License-Identifier: Apache-2.0 */
#include "columns.h"

const struct sg_column sg_columns[SG_COLUMNS] = {
#define C(id, ...) [SG_C_##id] = {__VA_ARGS__},
    SG_COLUMN_TABLE(C)
#undef C
};

int sg_column_planes(int c, int sh_degree)
{
    const int planes = sg_columns[c].planes;
    return planes == SG_PLANES_PARAMETERS ? sg_param_count(sh_degree)
           : planes == SG_PLANES_REST     ? sg_param_count(sh_degree) - SG_P_SH - 3
                                          : planes;
}

int sg_column_array_planes(int c, int sh_degree)
{
    return sg_column_is_parameter(c) ? sg_param_count(sh_degree) : sg_column_planes(c, sh_degree);
}

int sg_columns_create(sg_ctx *ctx, size_t count, int sh_degree, unsigned bits,
                      struct sg_columns *out)
{
    *out = (struct sg_columns){.capacity = (count + SG_LANES - 1) / SG_LANES * SG_LANES};
    for (int c = 0; c < SG_COLUMNS; c++)
        if (!sg_column_is_parameter(c) && sg_column_of(c, bits) &&
            !(out->at[c] = sg_alloc(ctx, SG_MEM_OPTIMISER, out->capacity,
                                    (size_t) sg_column_planes(c, sh_degree) * sizeof(float)))) {
            sg_columns_clear(out);
            return SG_ERR_BUDGET;
        }
    return SG_OK;
}

void sg_columns_clear(struct sg_columns *columns)
{
    for (int c = 0; c < SG_COLUMNS; c++)
        sg_free(columns->at[c]);
    sg_free(columns->networks);
    *columns = (struct sg_columns){0};
}
