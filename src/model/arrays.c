/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters of a model as plain arrays, one row a Gaussian. */
#include <string.h>

#include "core/internal.h"
#include "splatguard/model.h"

static const struct {
    const char *name;
    int plane, width; /* width 0: all planes from there on */
} fields[] = {
    {"position", SG_P_XYZ, 3},    {"scale", SG_P_SCALE, 3}, {"rotation", SG_P_ROT, 4},
    {"opacity", SG_P_OPACITY, 1}, {"sh_dc", SG_P_SH, 3},    {"sh_rest", SG_P_SH + 3, 0},
};
#define FIELDS ((int) (sizeof(fields) / sizeof(fields[0])))

const char *sg_model_field_name(int index)
{
    return index >= 0 && index < FIELDS ? fields[index].name : NULL;
}

static int find(const char *field)
{
    for (int i = 0; i < FIELDS; i++)
        if (!strcmp(fields[i].name, field))
            return i;
    return -1;
}

int sg_model_field_width(const char *field, int sh_degree)
{
    const int f = find(field);
    if (f < 0 || sh_degree < 0 || sh_degree > 3)
        return -1;
    return fields[f].width ? fields[f].width : sg_param_count(sh_degree) - fields[f].plane;
}

/* Which field it is; the stride becomes one in floats. */
static int look_up(sg_ctx *ctx, const struct sg_model *m, const char *field, size_t *stride, int *f)
{
    sg_clear_error(ctx);
    *f = find(field);
    if (*f < 0)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "model: found field \"%s\", expected position, scale, rotation, opacity, "
                       "sh_dc or sh_rest",
                       field);
    const size_t width = (size_t) sg_model_field_width(field, m->sh_degree);
    if (*stride && *stride < width)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "model: %s: row_stride: found %zu floats, expected 0 or at least %zu", field,
                       *stride, width);
    *stride = *stride ? *stride : width;
    return SG_OK;
}

int sg_model_get_array(sg_ctx *ctx, const struct sg_model *m, const char *field, float *out,
                       size_t row_stride)
{
    int f;
    const int code = look_up(ctx, m, field, &row_stride, &f);
    const int width = code ? 0 : sg_model_field_width(field, m->sh_degree);
    for (size_t i = 0; i < m->count && !code; i++)
        for (int p = 0; p < width; p++)
            out[i * row_stride + (size_t) p] = *sg_model_at(m, i, fields[f].plane + p);
    return code;
}

int sg_model_set_array(sg_ctx *ctx, struct sg_model *m, const char *field, const float *values,
                       size_t row_stride)
{
    int f;
    const int code = look_up(ctx, m, field, &row_stride, &f);
    const int width = code ? 0 : sg_model_field_width(field, m->sh_degree);
    for (size_t i = 0; i < m->count && !code; i++)
        for (int p = 0; p < width; p++)
            *sg_model_at(m, i, fields[f].plane + p) = values[i * row_stride + (size_t) p];
    return code;
}
