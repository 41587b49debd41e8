/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP's binary files: little-endian, unpadded, counts first. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "scene/colmap.h"

#define NAME_BYTES 4096 /* of a photo's name with its final zero, as a path allows */

/* Skips the next bytes and returns them; NULL if the file ends before. */
static const uint8_t *take(struct sg_source *in, size_t n)
{
    const char *bytes = sg_source_peek(in, n);
    if (bytes)
        sg_source_skip(in, n);
    return (const uint8_t *) bytes;
}

static uint64_t get(const uint8_t **at, int bytes)
{
    uint64_t v = 0;
    for (int i = 0; i < bytes; i++)
        v |= (uint64_t) (*at)[i] << 8 * i;
    *at += bytes;
    return v;
}

static double get_f64(const uint8_t **at)
{
    uint64_t bits = get(at, 8);
    double v;
    memcpy(&v, &bits, sizeof(v));
    return v;
}

static int cut_short(sg_ctx *ctx, const struct sg_source *in, const char *what, uint64_t i)
{
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: byte %llu: found the end of the file inside %s %llu, expected more data",
                   in->path, (unsigned long long) in->size, what, (unsigned long long) i);
}

/* The count at the start, which the rest of the file must be able to hold. */
static int get_count(sg_ctx *ctx, struct sg_source *in, const char *what, size_t least_bytes,
                     uint64_t max, uint64_t *count)
{
    const uint8_t *at = take(in, 8);
    *count = 0;
    if (!at)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %llu bytes, expected a count of %ss in the first 8", in->path,
                       (unsigned long long) in->size, what);
    *count = get(&at, 8);
    const uint64_t most = sg_source_left(in) / least_bytes;
    if (*count > max)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte 0: found a count of %llu %ss, the limit is %llu", in->path,
                       (unsigned long long) *count, what, (unsigned long long) max);
    if (*count > most)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte 0: found a count of %llu %ss, expected at most the %llu that fit",
                       in->path, (unsigned long long) *count, what, (unsigned long long) most);
    return SG_OK;
}

static int at_end(sg_ctx *ctx, const struct sg_source *in, const char *what, uint64_t count)
{
    if (!sg_source_left(in))
        return SG_OK;
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: byte %llu: found %llu bytes after the last of %llu %ss, expected none",
                   in->path, (unsigned long long) in->at, (unsigned long long) sg_source_left(in),
                   (unsigned long long) count, what);
}

int sg_colmap_cameras_bin(sg_ctx *ctx, struct sg_source *in, struct sg_colmap_cameras *out)
{
    uint64_t count;
    int code = get_count(ctx, in, "camera", 24 + 3 * 8, UINT32_MAX, &count);
    for (uint64_t i = 0; i < count && !code; i++) {
        char where[512];
        const uint8_t *at = take(in, 24);
        if (!at)
            return cut_short(ctx, in, "camera", i);
        uint32_t id = (uint32_t) get(&at, 4), model = (uint32_t) get(&at, 4);
        uint64_t width = get(&at, 8), height = get(&at, 8);
        snprintf(where, sizeof(where), "%s: camera id %u", in->path, id);
        int n = model <= INT32_MAX ? sg_colmap_model_params((int) model) : -1;
        if (n < 0) {
            char number[24];
            snprintf(number, sizeof(number), "number %u", model);
            return sg_colmap_refuse_model(ctx, where, number);
        }
        at = take(in, (size_t) n * 8);
        if (!at)
            return cut_short(ctx, in, "camera", i);
        double params[SG_COLMAP_PARAMS_MAX];
        for (int k = 0; k < n; k++)
            params[k] = get_f64(&at);
        code = sg_colmap_add_camera(ctx, out, where, id, (int) model, width, height, params);
    }
    if (!code)
        code = at_end(ctx, in, "camera", count);
    return code ? code : sg_colmap_sort_cameras(ctx, out, in->path);
}

int sg_colmap_images_bin(sg_ctx *ctx, struct sg_source *in, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out)
{
    uint64_t count;
    int code = get_count(ctx, in, "image", 64 + 2 + 8, max_images, &count);
    for (uint64_t i = 0; i < count && !code; i++) {
        char where[512], name[NAME_BYTES];
        double q[4], t[3];
        const uint8_t *at = take(in, 64);
        if (!at)
            return cut_short(ctx, in, "image", i);
        uint32_t id = (uint32_t) get(&at, 4);
        for (int k = 0; k < 4; k++)
            q[k] = get_f64(&at);
        for (int k = 0; k < 3; k++)
            t[k] = get_f64(&at);
        uint32_t camera = (uint32_t) get(&at, 4);
        snprintf(where, sizeof(where), "%s: image id %u", in->path, id);
        const size_t ready = sg_source_fill(in, NAME_BYTES),
                     most = ready < NAME_BYTES ? ready : NAME_BYTES;
        const char *zero = most ? memchr(in->window, 0, most) : NULL;
        if (!zero && most == NAME_BYTES)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found a name of %d bytes or more, expected the name of a file",
                           where, NAME_BYTES);
        if (!zero)
            return cut_short(ctx, in, "image", i);
        const size_t length = (size_t) (zero - in->window) + 1;
        memcpy(name, in->window, length);
        const struct sg_colmap_name image = {name, in->at, NAME_BYTES - length};
        sg_source_skip(in, length);
        at = take(in, 8);
        if (!at)
            return cut_short(ctx, in, "image", i);
        const uint64_t observations = get(&at, 8), room = sg_source_left(in) / 24;
        if (observations > room)
            return sg_fail(
                ctx, SG_ERR_INPUT,
                "%s: found a count of %llu observations, expected at most the %llu that fit", where,
                (unsigned long long) observations, (unsigned long long) room);
        sg_source_skip(in, observations * 24);
        code = sg_colmap_add_image(ctx, out, max_images, cameras, where, camera, q, t, &image);
    }
    return code ? code : at_end(ctx, in, "image", count);
}

int sg_colmap_points_bin(sg_ctx *ctx, struct sg_source *in, uint64_t max_points,
                         struct sg_points *out)
{
    uint64_t count;
    int code = get_count(ctx, in, "point", 51, max_points, &count);
    if (code)
        return code;
    if (!count)
        return at_end(ctx, in, "point", 0);
    out->xyz = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) count, 3 * sizeof(float));
    out->rgb = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) count, 3);
    if (!out->xyz || !out->rgb)
        return SG_ERR_BUDGET;
    for (uint64_t i = 0; i < count; i++) {
        const uint8_t *at = take(in, 51);
        if (!at)
            return cut_short(ctx, in, "point", i);
        uint64_t id = get(&at, 8);
        for (int k = 0; k < 3; k++) {
            double v = get_f64(&at);
            if (!(fabs(v) < 1e30))
                return sg_fail(ctx, SG_ERR_INPUT,
                               "%s: point id %llu: found coordinate %g, expected a finite number",
                               in->path, (unsigned long long) id, v);
            out->xyz[3 * i + (uint64_t) k] = (float) v;
        }
        for (int k = 0; k < 3; k++)
            out->rgb[3 * i + (uint64_t) k] = (uint8_t) get(&at, 1);
        at += 8; /* reprojection error */
        const uint64_t track = get(&at, 8), room = sg_source_left(in) / 8;
        if (track > room)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: point id %llu: found a track of %llu entries, expected at most the "
                           "%llu that fit",
                           in->path, (unsigned long long) id, (unsigned long long) track,
                           (unsigned long long) room);
        sg_source_skip(in, track * 8);
    }
    out->count = (size_t) count;
    return at_end(ctx, in, "point", count);
}
