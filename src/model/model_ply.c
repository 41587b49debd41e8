/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians as PLY: the property names and order of the 3DGS release (Kerbl et al. 2023). In the
 * file f_rest is channel-major, in the store SH is coefficient-major. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "anchors.h"
#include "core/file.h"
#include "mip.h"
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

/* A float of a row of the file: a plane of a column, or of no column. */
struct property {
    int column, plane; /* column -1: a normal */
    char name[24];
};

/* The most properties of a file; of columns with an array of their own there are few. */
#define PROPERTIES_MAX (SG_PARAMS_MAX + NORMALS + 32)

/* The properties of a column behind the first n; returns their number with its own. */
static int add_properties(int c, int sh_degree, struct property *out, int n)
{
    const int planes = sg_column_planes(c, sh_degree);
    for (int p = 0; p < planes; p++) {
        struct property *to = &out[n + number_of(c, p, sh_degree)];
        *to = (struct property){.column = c, .plane = p};
        property_name(c, p, sh_degree, to->name);
    }
    n += planes;
    for (int k = 0; c == SG_C_POSITION && k < NORMALS; k++) {
        out[n] = (struct property){.column = -1};
        snprintf(out[n++].name, sizeof(out->name), "n%c", 'x' + k);
    }
    return n;
}

/* The array of a model that a column's values are in; NULL: it has none. */
static float *array_of(const struct sg_model *m, int c)
{
    return sg_column_is_parameter(c) ? m->params : m->columns ? m->columns->at[c] : NULL;
}

/* The values of a property in a model: the first, and the planes of their array. */
struct values {
    float *first;
    int planes;
};

static void find_values(const struct sg_model *m, const struct property *property, int n,
                        struct values *out)
{
    for (int k = 0; k < n; k++) {
        const int c = property[k].column;
        if (c < 0)
            continue;
        out[k].planes = sg_column_array_planes(c, m->sh_degree);
        out[k].first = array_of(m, c) +
                       sg_param_index(out[k].planes, 0, sg_columns[c].first + property[k].plane);
    }
}

static float *value_at(const struct values *v, size_t i)
{
    return v->first + sg_param_index(v->planes, i, 0);
}

/* What a model has for a file, in its order; returns the number of properties. */
static int file_order(const struct sg_model *m, struct property *out)
{
    int n = 0;
    for (int place = 1; place <= SG_COLUMNS; place++)
        for (int c = 0; c < SG_COLUMNS; c++)
            if (sg_columns[c].place == place && array_of(m, c))
                n = add_properties(c, m->sh_degree, out, n);
    return n;
}

int sg_model_write_ply(sg_ctx *ctx, const struct sg_model *m, const char *path)
{
    sg_clear_error(ctx);
    if (!m->count) /* nothing could read the file */
        return sg_model_check(ctx, m, "model");
    if (sg_model_has_anchors(m))
        return sg_anchors_write(ctx, m, path);
    struct sg_file_writer w;
    int code = sg_file_create(ctx, &w, path);
    if (code)
        return code;
    FILE *f = w.stream;
    struct property property[PROPERTIES_MAX];
    struct values values[PROPERTIES_MAX];
    const int properties = file_order(m, property);
    find_values(m, property, properties, values);
    fprintf(f, "ply\nformat binary_little_endian 1.0\ncomment splatguard %s\nelement vertex %zu\n",
            sg_version(), m->count);
    for (int k = 0; k < properties; k++)
        fprintf(f, "property float %s\n", property[k].name);
    fprintf(f, "end_header\n");
    for (size_t i = 0; i < m->count; i++) {
        float row[PROPERTIES_MAX];
        for (int k = 0; k < properties; k++)
            row[k] = property[k].column < 0 ? 0 : *value_at(&values[k], i);
        fwrite(row, sizeof(float), (size_t) properties,
               f); /* little endian hosts only, as the store itself */
    }
    return sg_file_commit(ctx, &w);
}

/* What a file has for a model: its degree, from the names, and the properties to read with their
 * indices in the file. */
struct map {
    int degree, count;
    struct property property[PROPERTIES_MAX];
    int index[PROPERTIES_MAX];
};

/* Columns that are no parameters are read where the file has all of their properties. */
static int map_columns(sg_ctx *ctx, const struct ply *p, struct map *map)
{
    int rest = 0;
    for (int i = 0; i < p->properties; i++)
        rest += !strncmp(p->property[i].name, "f_rest_", 7);
    for (map->degree = 0; map->degree <= 3 && sg_param_count(map->degree) - SG_P_SH - 3 != rest;)
        map->degree++;
    if (map->degree > 3)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %d f_rest properties, expected 0, 9, 24 or 45",
                       p->in->path, rest);
    map->count = 0;
    for (int c = 0; c < SG_COLUMNS; c++) {
        const int end =
            sg_columns[c].place ? add_properties(c, map->degree, map->property, map->count) : 0;
        int found = map->count;
        for (int k = map->count; k < end; k++) {
            const struct property *wanted = &map->property[k];
            if (wanted->column < 0)
                continue;
            const int index = sg_ply_find(p, wanted->name);
            if (index < 0 && sg_column_is_parameter(c) && sg_ply_find(p, "f_anchor_feat_0") >= 0)
                return sg_fail(ctx, SG_ERR_INPUT,
                               "%s: header: found anchors of Scaffold-GS, whose Gaussians exist "
                               "only in a view, expected a 3D Gaussian model",
                               p->in->path);
            if (index < 0 && sg_column_is_parameter(c))
                return sg_fail(ctx, SG_ERR_INPUT,
                               "%s: header: found no property %s, expected a 3D Gaussian model",
                               p->in->path, wanted->name);
            if (index < 0)
                break;
            map->property[found] = *wanted, map->index[found++] = index;
        }
        if (found == map->count + sg_column_planes(c, map->degree))
            map->count = found;
    }
    return SG_OK;
}

/* An empty model with the columns that will be read. */
static int create_mapped(sg_ctx *ctx, const struct map *map, uint64_t count, const char *path,
                         struct sg_model **out)
{
    struct sg_columns found = {0};
    float any;
    int code = sg_model_create(ctx, (size_t) count, map->degree, out);
    for (int k = 0; k < map->count; k++)
        if (!sg_column_is_parameter(map->property[k].column))
            found.at[map->property[k].column] = &any;
    if (!code && (code = sg_model_add_columns(ctx, *out, &(struct sg_model){.columns = &found})))
        sg_model_destroy(out);
    return sg_model_refused(ctx, code, path, count, (size_t) map->count * sizeof(float));
}

int sg_ply_read_model(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                      struct sg_model **out)
{
    *out = NULL;
    struct ply p;
    struct sg_model *m = NULL;
    struct map map;
    struct values values[PROPERTIES_MAX];
    float row[PLY_MAX_PROPERTIES];
    int code = sg_ply_open(ctx, &p, in, max_gaussians);
    if (code || (code = map_columns(ctx, &p, &map)))
        goto done;
    if (!p.rows) {
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: header: found 0 Gaussians, expected at least one",
                       in->path);
        goto done;
    }
    if ((code = create_mapped(ctx, &map, p.rows, in->path, &m)))
        goto done;
    find_values(m, map.property, map.count, values);
    for (uint64_t i = 0; i < p.rows; i++) {
        if ((code = sg_ply_row(ctx, &p, i, row)))
            goto done;
        for (int k = 0; k < map.count; k++)
            *value_at(&values[k], (size_t) i) = row[map.index[k]];
    }
    if ((code = sg_ply_finish(ctx, &p)) || (code = sg_mip_fold(ctx, m, in->path)))
        goto done;
    *out = m;
    m = NULL;
done:
    sg_model_destroy(&m);
    return code;
}

int sg_model_read_ply(sg_ctx *ctx, const char *path, uint64_t max_gaussians, struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    struct sg_source in;
    int code = sg_source_open(ctx, &in, path, PLY_MAX_BYTES);
    if (!code)
        code = sg_ply_read_model(ctx, &in, max_gaussians, out);
    sg_source_close(&in);
    return code;
}
