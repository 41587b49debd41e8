/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP's binary files: little-endian, unpadded, counts first. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "scene/colmap.h"

struct cursor {
    const char *file;
    const uint8_t *start, *at, *end;
};

static size_t left(const struct cursor *c)
{
    return (size_t) (c->end - c->at);
}

static uint64_t get(struct cursor *c, int bytes)
{
    uint64_t v = 0;
    for (int i = 0; i < bytes; i++)
        v |= (uint64_t) c->at[i] << 8 * i;
    c->at += bytes;
    return v;
}

static double get_f64(struct cursor *c)
{
    uint64_t bits = get(c, 8);
    double v;
    memcpy(&v, &bits, sizeof(v));
    return v;
}

static int cut_short(sg_ctx *ctx, const struct cursor *c, const char *what, uint64_t i)
{
    return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu: found the end of the file inside %s %llu, expected more data",
                   c->file, (size_t) (c->end - c->start), what, (unsigned long long) i);
}

/* The count at the start, which the rest of the file must be able to hold. */
static int get_count(sg_ctx *ctx, struct cursor *c, const char *what, size_t least_bytes, uint64_t max, uint64_t *count)
{
    if (left(c) < 8)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %zu bytes, expected a count of %ss in the first 8", c->file,
                       left(c), what);
    *count = get(c, 8);
    if (*count > max)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: byte 0: found a count of %llu %ss, the limit is %llu", c->file,
                       (unsigned long long) *count, what, (unsigned long long) max);
    if (*count > left(c) / least_bytes)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: byte 0: found a count of %llu %ss, expected at most the %zu that fit",
                       c->file, (unsigned long long) *count, what, left(c) / least_bytes);
    return SG_OK;
}

static int at_end(sg_ctx *ctx, const struct cursor *c, const char *what, uint64_t count)
{
    if (!left(c))
        return SG_OK;
    return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu: found %zu bytes after the last of %llu %ss, expected none",
                   c->file, (size_t) (c->at - c->start), left(c), (unsigned long long) count, what);
}

int sg_colmap_cameras_bin(sg_ctx *ctx, const char *file, const void *data, size_t size, struct sg_colmap_cameras *out)
{
    struct cursor c = {file, data, data, (const uint8_t *) data + size};
    uint64_t count;
    int code = get_count(ctx, &c, "camera", 24 + 3 * 8, UINT32_MAX, &count);
    for (uint64_t i = 0; i < count && !code; i++) {
        char where[512];
        if (left(&c) < 24)
            return cut_short(ctx, &c, "camera", i);
        uint32_t id = (uint32_t) get(&c, 4), model = (uint32_t) get(&c, 4);
        uint64_t width = get(&c, 8), height = get(&c, 8);
        snprintf(where, sizeof(where), "%s: camera id %u", file, id);
        int n = model <= INT32_MAX ? sg_colmap_model_params((int) model) : -1;
        if (n < 0)
            return sg_fail(ctx, SG_ERR_INPUT, "%s: found model number %u, expected 0..10", where, model);
        if (left(&c) < (size_t) n * 8)
            return cut_short(ctx, &c, "camera", i);
        double params[SG_COLMAP_PARAMS_MAX];
        for (int k = 0; k < n; k++)
            params[k] = get_f64(&c);
        code = sg_colmap_add_camera(ctx, out, where, id, (int) model, width, height, params);
    }
    if (!code)
        code = at_end(ctx, &c, "camera", count);
    return code ? code : sg_colmap_sort_cameras(ctx, out, file);
}

int sg_colmap_images_bin(sg_ctx *ctx, const char *file, const void *data, size_t size, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out)
{
    struct cursor c = {file, data, data, (const uint8_t *) data + size};
    uint64_t count;
    int code = get_count(ctx, &c, "image", 64 + 2 + 8, max_images, &count);
    for (uint64_t i = 0; i < count && !code; i++) {
        char where[512];
        double q[4], t[3];
        if (left(&c) < 64)
            return cut_short(ctx, &c, "image", i);
        uint32_t id = (uint32_t) get(&c, 4);
        for (int k = 0; k < 4; k++)
            q[k] = get_f64(&c);
        for (int k = 0; k < 3; k++)
            t[k] = get_f64(&c);
        uint32_t camera = (uint32_t) get(&c, 4);
        const char *name = (const char *) c.at;
        const uint8_t *zero = memchr(c.at, 0, left(&c));
        if (!zero || c.end - zero < 9)
            return cut_short(ctx, &c, "image", i);
        c.at = zero + 1;
        uint64_t observations = get(&c, 8);
        if (observations > left(&c) / 24)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: image id %u: found a count of %llu observations, expected at most the %zu that fit",
                           file, id, (unsigned long long) observations, left(&c) / 24);
        c.at += observations * 24;
        snprintf(where, sizeof(where), "%s: image id %u", file, id);
        code = sg_colmap_add_image(ctx, out, max_images, cameras, where, camera, q, t, name);
    }
    return code ? code : at_end(ctx, &c, "image", count);
}

int sg_colmap_points_bin(sg_ctx *ctx, const char *file, const void *data, size_t size, uint64_t max_points,
                         struct sg_points *out)
{
    struct cursor c = {file, data, data, (const uint8_t *) data + size};
    uint64_t count;
    int code = get_count(ctx, &c, "point", 51, max_points, &count);
    if (code || !count)
        return code;
    out->xyz = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) count, 3 * sizeof(float));
    out->rgb = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) count, 3);
    if (!out->xyz || !out->rgb)
        return SG_ERR_BUDGET;
    for (uint64_t i = 0; i < count; i++) {
        if (left(&c) < 51)
            return cut_short(ctx, &c, "point", i);
        uint64_t id = get(&c, 8);
        for (int k = 0; k < 3; k++) {
            double v = get_f64(&c);
            if (!(fabs(v) < 1e30))
                return sg_fail(ctx, SG_ERR_INPUT, "%s: point id %llu: found coordinate %g, expected a finite number",
                               file, (unsigned long long) id, v);
            out->xyz[3 * i + (uint64_t) k] = (float) v;
        }
        for (int k = 0; k < 3; k++)
            out->rgb[3 * i + (uint64_t) k] = (uint8_t) get(&c, 1);
        c.at += 8; /* reprojection error */
        uint64_t track = get(&c, 8);
        if (track > left(&c) / 8)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: point id %llu: found a track of %llu entries, expected at most the %zu that fit", file,
                           (unsigned long long) id, (unsigned long long) track, left(&c) / 8);
        c.at += track * 8;
    }
    out->count = (size_t) count;
    return at_end(ctx, &c, "point", count);
}
