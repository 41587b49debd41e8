/* SPDX-License-Identifier: Apache-2.0 */
/* Point clouds as PLY: x y z nx ny nz float, red green blue uchar, as the 3DGS release caches
 * them. */
#include <math.h>
#include <stdio.h>

#include "core/file.h"
#include "ply.h"
#include "points.h"
#include "splatguard/model.h"

int sg_points_read_source(sg_ctx *ctx, struct sg_source *in, uint64_t max_points, float **xyz,
                          uint8_t **rgb, size_t *n)
{
    struct ply p;
    float row[PLY_MAX_PROPERTIES];
    *xyz = NULL, *rgb = NULL, *n = 0;
    int code = sg_ply_open(ctx, &p, in, max_points);
    if (code)
        goto done;
    const int at[3] = {sg_ply_find(&p, "x"), sg_ply_find(&p, "y"), sg_ply_find(&p, "z")};
    const int colour[3] = {sg_ply_find(&p, "red"), sg_ply_find(&p, "green"),
                           sg_ply_find(&p, "blue")};
    const bool coloured = colour[0] >= 0 && colour[1] >= 0 && colour[2] >= 0;
    if (at[0] < 0 || at[1] < 0 || at[2] < 0) {
        code =
            sg_fail(ctx, SG_ERR_INPUT,
                    "%s: header: found no properties x, y and z, expected a point cloud", in->path);
        goto done;
    }
    const uint64_t count = p.rows;
    *xyz = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) count, 3 * sizeof(float));
    *rgb = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) count, 3);
    if (!*xyz || !*rgb) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    for (uint64_t i = 0; i < count && !code && !(code = sg_ply_row(ctx, &p, i, row)); i++)
        for (int k = 0; k < 3; k++) {
            (*xyz)[3 * i + (uint64_t) k] = row[at[k]];
            if (!isfinite(row[at[k]]) && !code)
                code = sg_fail(ctx, SG_ERR_INPUT,
                               "%s: row %llu: found a coordinate that is not finite", in->path,
                               (unsigned long long) i);
            float c = coloured ? row[colour[k]] : 127;
            if (coloured && p.property[colour[k]].type >= PLY_F32) /* 0..1 */
                c = c * 255 + 0.5f;
            else if (c > 255 && !code) /* of 16 bits */
                code = sg_fail(
                    ctx, SG_ERR_INPUT,
                    "%s: row %llu: found %s %g, expected 0 to 255, or floats from 0 to 1", in->path,
                    (unsigned long long) i, p.property[colour[k]].name, (double) c);
            (*rgb)[3 * i + (uint64_t) k] = (uint8_t) (c > 0 ? c < 255 ? c : 255 : 0); /* NaN: 0 */
        }
    if (!code)
        code = sg_ply_finish(ctx, &p);
    *n = code ? 0 : (size_t) count;
done:
    if (code)
        sg_points_destroy(xyz, rgb);
    return code;
}

int sg_points_read_ply(sg_ctx *ctx, const char *path, uint64_t max_points, float **xyz,
                       uint8_t **rgb, size_t *n)
{
    struct sg_source in;
    sg_clear_error(ctx);
    *xyz = NULL, *rgb = NULL, *n = 0;
    int code = sg_source_open(ctx, &in, path, PLY_MAX_BYTES);
    if (!code)
        code = sg_points_read_source(ctx, &in, max_points, xyz, rgb, n);
    sg_source_close(&in);
    return code;
}

int sg_points_write_ply(sg_ctx *ctx, const char *path, const float *xyz, const uint8_t *rgb,
                        size_t n)
{
    sg_clear_error(ctx);
    struct sg_file_writer w;
    int code = sg_file_create(ctx, &w, path);
    if (code)
        return code;
    fprintf(w.stream,
            "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty float x\nproperty "
            "float y\n"
            "property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty "
            "uchar red\n"
            "property uchar green\nproperty uchar blue\nend_header\n",
            n);
    for (size_t i = 0; i < n; i++) {
        const float row[6] = {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2], 0, 0, 0};
        fwrite(row, sizeof(row), 1, w.stream);
        fwrite(rgb + 3 * i, 3, 1, w.stream);
    }
    return sg_file_commit(ctx, &w);
}

void sg_points_destroy(float **xyz, uint8_t **rgb)
{
    if (xyz)
        sg_free(*xyz), *xyz = NULL;
    if (rgb)
        sg_free(*rgb), *rgb = NULL;
}
