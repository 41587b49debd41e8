/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians as PLY: the property names and order of the 3DGS release (Kerbl et al. 2023). In the
 * file f_rest is channel-major, in the store SH is coefficient-major. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "columns.h"
#include "core/file.h"
#include "ply.h"
#include "splatguard/model.h"

/* The number in the name of a plane's property: SH is channel-major in the file. */
static int number_of(int c, int plane, int sh_degree)
{
    const int rest = sg_column_planes(c, sh_degree) / 3;
    return c == SG_C_SH_REST ? plane % 3 * rest + plane / 3 : plane;
}

static void property_name(int c, int plane, int sh_degree, char name[24])
{
    if (c == SG_C_POSITION)
        snprintf(name, 24, "%c", 'x' + plane);
    else if (sg_column_planes(c, sh_degree) == 1)
        snprintf(name, 24, "%s", sg_columns[c].property);
    else
        snprintf(name, 24, "%s%d", sg_columns[c].property, number_of(c, plane, sh_degree));
}

void sg_plane_name(int plane, int sh_degree, char name[24])
{
    int c = 0;
    while (plane >= sg_column_end(c, sg_param_count(sh_degree)))
        c++;
    property_name(c, plane - sg_columns[c].first, sh_degree, name);
}

#define NORMALS 3 /* properties behind the position, always 0 */
#define NO_PLANE (-1)

/* The store's planes in the order of the file; returns their number. */
static int file_order(int sh_degree, int plane[SG_PARAMS_MAX + NORMALS])
{
    int n = 0;
    for (int place = 1; place <= SG_COLUMNS; place++)
        for (int c = 0; c < SG_COLUMNS; c++) {
            if (sg_columns[c].place != place)
                continue;
            const int planes = sg_column_planes(c, sh_degree);
            for (int p = 0; p < planes; p++)
                plane[n + number_of(c, p, sh_degree)] = sg_columns[c].first + p;
            n += planes;
            for (int k = 0; c == SG_C_POSITION && k < NORMALS; k++)
                plane[n++] = NO_PLANE;
        }
    return n;
}

int sg_model_write_ply(sg_ctx *ctx, const struct sg_model *m, const char *path)
{
    sg_clear_error(ctx);
    struct sg_file_writer w;
    int code = sg_file_create(ctx, &w, path);
    if (code)
        return code;
    FILE *f = w.stream;
    int plane[SG_PARAMS_MAX + NORMALS];
    const int properties = file_order(m->sh_degree, plane);
    fprintf(f, "ply\nformat binary_little_endian 1.0\ncomment splatguard %s\nelement vertex %zu\n",
            sg_version(), m->count);
    for (int k = 0, normal = 0; k < properties; k++) {
        char name[24];
        if (plane[k] == NO_PLANE)
            snprintf(name, sizeof(name), "n%c", 'x' + normal++);
        else
            sg_plane_name(plane[k], m->sh_degree, name);
        fprintf(f, "property float %s\n", name);
    }
    fprintf(f, "end_header\n");
    for (size_t i = 0; i < m->count; i++) {
        float row[SG_PARAMS_MAX + NORMALS];
        for (int k = 0; k < properties; k++)
            row[k] = plane[k] == NO_PLANE ? 0 : *sg_model_at(m, i, plane[k]);
        fwrite(row, sizeof(float), (size_t) properties,
               f); /* little endian hosts only, as the store itself */
    }
    return sg_file_commit(ctx, &w);
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
