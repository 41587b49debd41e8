/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters of a model as plain arrays, one row a Gaussian. */
#include <string.h>

#include "columns.h"

const char *sg_model_field_name(int index)
{
    return index >= 0 && index < SG_COLUMNS && sg_column_is_parameter(index)
               ? sg_columns[index].name
               : NULL;
}

/* A parameter's column, or -1. */
static int find(const char *field)
{
    const char *name;
    for (int c = 0; (name = sg_model_field_name(c)); c++)
        if (!strcmp(name, field))
            return c;
    return -1;
}

int sg_model_field_width(const char *field, int sh_degree)
{
    const int c = find(field);
    return c < 0 || sh_degree < 0 || sh_degree > 3 ? -1 : sg_column_planes(c, sh_degree);
}

/* The values of a field, into `out` or from `in`. */
static int copy_field(sg_ctx *ctx, const struct sg_model *m, const char *field, size_t row_stride,
                      float *out, const float *in)
{
    sg_clear_error(ctx);
    const int c = find(field);
    if (c < 0)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "model: found field \"%s\", expected position, scale, rotation, opacity, "
                       "sh_dc or sh_rest",
                       field);
    const size_t width = (size_t) sg_column_planes(c, m->sh_degree);
    const size_t stride = row_stride ? row_stride : width;
    if (stride < width)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "model: %s: row_stride: found %zu floats, expected 0 or at least %zu", field,
                       stride, width);
    for (size_t i = 0; i < m->count; i++)
        for (size_t p = 0; p < width; p++) {
            float *value = sg_model_at(m, i, sg_columns[c].first + (int) p);
            if (out)
                out[i * stride + p] = *value;
            else
                *value = in[i * stride + p];
        }
    return SG_OK;
}

int sg_model_get_array(sg_ctx *ctx, const struct sg_model *m, const char *field, float *out,
                       size_t row_stride)
{
    return copy_field(ctx, m, field, row_stride, out, NULL);
}

int sg_model_set_array(sg_ctx *ctx, struct sg_model *m, const char *field, const float *values,
                       size_t row_stride)
{
    return copy_field(ctx, m, field, row_stride, NULL, values);
}
