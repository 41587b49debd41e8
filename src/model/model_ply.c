/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians as PLY: the property names and order of the 3DGS release (Kerbl et al. 2023). In the
 * file f_rest is channel-major, in the store SH is coefficient-major. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/file.h"
#include "ply.h"
#include "splatguard/model.h"

/* Store plane of a column of a file with `rest` f_rest properties; -1: always 0 (normals). */
static int column_plane(int column, int rest)
{
    if (column < 3)
        return SG_P_XYZ + column;
    if (column < 6)
        return -1;
    if (column < 9)
        return SG_P_SH + column - 6;
    if (column < 9 + rest) {
        const int k = (column - 9) % (rest / 3) + 1, channel = (column - 9) / (rest / 3);
        return SG_P_SH + 3 * k + channel;
    }
    column -= 9 + rest;
    return column == 0  ? SG_P_OPACITY
           : column < 4 ? SG_P_SCALE + column - 1
                        : SG_P_ROT + column - 4;
}

int sg_model_write_ply(sg_ctx *ctx, const struct sg_model *m, const char *path)
{
    sg_clear_error(ctx);
    struct sg_file_writer w;
    int code = sg_file_create(ctx, &w, path);
    if (code)
        return code;
    FILE *f = w.stream;
    fprintf(f, "ply\nformat binary_little_endian 1.0\ncomment splatguard %s\nelement vertex %zu\n",
            sg_version(), m->count);
    static const char *const fixed[] = {"x", "y", "z", "nx", "ny", "nz"};
    for (int i = 0; i < 6; i++)
        fprintf(f, "property float %s\n", fixed[i]);
    for (int i = 0; i < 3; i++)
        fprintf(f, "property float f_dc_%d\n", i);
    const int planes = sg_param_count(m->sh_degree), rest = planes - SG_P_SH - 3;
    for (int i = 0; i < rest; i++)
        fprintf(f, "property float f_rest_%d\n", i);
    fprintf(f, "property float opacity\n");
    for (int i = 0; i < 3; i++)
        fprintf(f, "property float scale_%d\n", i);
    for (int i = 0; i < 4; i++)
        fprintf(f, "property float rot_%d\n", i);
    fprintf(f, "end_header\n");
    const int columns = 17 + rest;
    for (size_t i = 0; i < m->count; i++) {
        float row[17 + SG_PARAMS_MAX];
        for (int c = 0; c < columns; c++) {
            const int plane = column_plane(c, rest);
            row[c] = plane >= 0 ? *sg_model_at(m, i, plane) : 0;
        }
        fwrite(row, sizeof(float), (size_t) columns,
               f); /* little endian hosts only, as the store itself */
    }
    return sg_file_commit(ctx, &w);
}

void sg_plane_name(int plane, int sh_degree, char name[24])
{
    if (plane < SG_P_OPACITY)
        snprintf(name, 24, "%c", 'x' + plane);
    else if (plane == SG_P_OPACITY)
        snprintf(name, 24, "opacity");
    else if (plane < SG_P_ROT)
        snprintf(name, 24, "scale_%d", plane - SG_P_SCALE);
    else if (plane < SG_P_SH)
        snprintf(name, 24, "rot_%d", plane - SG_P_ROT);
    else if (plane < SG_P_SH + 3)
        snprintf(name, 24, "f_dc_%d", plane - SG_P_SH);
    else {
        const int k = (plane - SG_P_SH) / 3, channel = (plane - SG_P_SH) % 3;
        snprintf(name, 24, "f_rest_%d", channel * ((sh_degree + 1) * (sh_degree + 1) - 1) + k - 1);
    }
}

/* Property index of every plane, and the degree, from the names. */
static int map_columns(sg_ctx *ctx, const struct ply *p, int *degree, int *column)
{
    char name[24];
    int rest = 0;
    for (int i = 0; i < p->properties; i++)
        rest += !strncmp(p->property[i].name, "f_rest_", 7);
    for (*degree = 0; *degree <= 3 && 3 * ((*degree + 1) * (*degree + 1) - 1) != rest;)
        ++*degree;
    if (*degree > 3)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %d f_rest properties, expected 0, 9, 24 or 45",
                       p->in->path, rest);
    for (int plane = 0; plane < sg_param_count(*degree); plane++) {
        sg_plane_name(plane, *degree, name);
        column[plane] = sg_ply_find(p, name);
        if (column[plane] < 0)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: header: found no property %s, expected a 3D Gaussian model",
                           p->in->path, name);
    }
    return SG_OK;
}

int sg_model_read_ply(sg_ctx *ctx, const char *path, uint64_t max_gaussians, struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    struct sg_source in;
    struct ply p;
    struct sg_model *m = NULL;
    int degree, column[SG_PARAMS_MAX];
    float row[PLY_MAX_PROPERTIES];
    int code = sg_source_open(ctx, &in, path, PLY_MAX_BYTES);
    if (code || (code = sg_ply_open(ctx, &p, &in, max_gaussians)) ||
        (code = map_columns(ctx, &p, &degree, column)))
        goto done;
    if (!p.rows) {
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: header: found 0 Gaussians, expected at least one",
                       path);
        goto done;
    }
    const uint64_t count = p.rows;
    if ((code = sg_model_create(ctx, (size_t) count, degree, &m))) {
        if (code == SG_ERR_BUDGET && sg_mem_limit(ctx)) { /* say which file */
            sg_clear_error(ctx);
            sg_fail(
                ctx, code,
                "%s: memory: found %llu Gaussians of %zu bytes, the limit for all is %llu bytes",
                path, (unsigned long long) count, (size_t) sg_param_count(degree) * sizeof(float),
                (unsigned long long) sg_mem_limit(ctx));
        }
        goto done;
    }
    for (uint64_t i = 0; i < count; i++) {
        if ((code = sg_ply_row(ctx, &p, i, row)))
            goto done;
        for (int plane = 0; plane < sg_param_count(degree); plane++)
            *sg_model_at(m, (size_t) i, plane) = row[column[plane]];
    }
    if ((code = sg_ply_finish(ctx, &p)))
        goto done;
    *out = m;
    m = NULL;
done:
    sg_model_destroy(&m);
    sg_source_close(&in);
    return code;
}
