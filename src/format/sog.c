/* SPDX-License-Identifier: Apache-2.0 */
/* .sog of PlayCanvas, version 2: a zip archive of meta.json and images without loss, in which each
 * pixel is a Gaussian. Its values are bytes of 16-bit positions, of a rotation's three smallest
 * components, or places in a table of meta.json. SH of degree 1 and above come from a palette. */
#include <jansson.h>

#include "cluster.h"
#include "codec.h"
#include "core/json_text.h"
#include "core/zip.h"
#include "image/image.h"
#include "sog.h"

#define META_MAX ((size_t) 1 << 18)
#define IMAGE_MAX ((size_t) 1 << 30) /* bytes of one that is packed */

struct file {
    sg_ctx *ctx;
    struct sg_source *in;
    struct sg_zip zip;
    json_t *meta;
    void *room; /* for it, in the ledger */
    size_t count;
    int sh_degree;
    struct sg_model *m;
};

/* ---- meta.json ---- */

static int wrong(const struct file *f, const char *where, const json_t *found, const char *expected)
{
    char shown[SG_JSON_SHOWN];
    return sg_fail(f->ctx, SG_ERR_INPUT, "%s: meta.json: %s: found %s, expected %s", f->in->path,
                   where, sg_json_show(found, shown), expected);
}

/* n numbers of a list that is a member of a part. */
static int read_numbers(const struct file *f, const char *part, const char *name, size_t n,
                        float *out)
{
    const json_t *list = json_object_get(json_object_get(f->meta, part), name);
    char where[64];
    snprintf(where, sizeof(where), "%s.%s", part, name);
    if (json_array_size(list) != n)
        return wrong(f, where, list, n == 3 ? "3 numbers" : "256 numbers");
    for (size_t i = 0; i < n; i++) {
        const json_t *v = json_array_get(list, i);
        out[i] = (float) json_number_value(v);
        if (!json_is_number(v) || !isfinite(out[i]))
            return wrong(f, where, v, "a number");
    }
    return SG_OK;
}

/* A file of the archive: sg_free(*data). */
static int unpack(const struct file *f, const char *name, uint64_t max_bytes, char **data,
                  size_t *size)
{
    struct sg_source in = {0};
    const struct sg_zip_entry *entry = sg_zip_find(&f->zip, name);
    *data = NULL;
    if (!entry)
        return sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: zip: found no %s, expected it in a model of PlayCanvas (.sog); the "
                       "name of a scene's archive ends in .zip",
                       f->in->path, name);
    char *path = sg_strf(f->ctx, "%s/%s", f->in->path, name);
    int code = path ? sg_zip_source(&f->zip, entry, path, max_bytes, &in) : SG_ERR_BUDGET;
    if (!code)
        code = sg_source_read(f->ctx, &in, data, size);
    sg_source_close(&in);
    sg_free(path);
    return code;
}

static int read_meta(struct file *f)
{
    char *text;
    size_t size;
    json_error_t error;
    int code = unpack(f, "meta.json", META_MAX, &text, &size);
    if (!code)
        code = sg_json_reserve(f->ctx, text, size, &f->room);
    if (!code && !(f->meta = json_loadb(text, size, JSON_REJECT_DUPLICATES, &error)))
        code = sg_fail(f->ctx, SG_ERR_INPUT, "%s: meta.json: line %d, column %d: %s", f->in->path,
                       error.line, error.column, error.text);
    sg_free(text);
    if (code)
        return code;
    const json_t *version = json_object_get(f->meta, "version"),
                 *count = json_object_get(f->meta, "count"),
                 *rest = json_object_get(f->meta, "shN"), *bands = json_object_get(rest, "bands");
    if (json_integer_value(version) != 2)
        return wrong(f, "version", version, "2");
    if (!json_is_integer(count) || json_integer_value(count) < 0)
        return wrong(f, "count", count, "the number of Gaussians");
    if ((uint64_t) json_integer_value(count) / SG_GAUSSIANS_A_BYTE > f->in->size)
        return sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: meta.json: count: found %lld Gaussians in a file of %llu bytes",
                       f->in->path, (long long) json_integer_value(count),
                       (unsigned long long) f->in->size);
    f->count = (size_t) json_integer_value(count);
    if (rest && (json_integer_value(bands) < 1 || json_integer_value(bands) > 3))
        return wrong(f, "shN.bands", bands, "1 to 3");
    f->sh_degree = (int) json_integer_value(bands);
    return SG_OK;
}

/* ---- images ---- */

/* The image that a part of meta.json names, with a pixel for each of n. */
static int read_image(const struct file *f, const char *part, size_t index, size_t n,
                      struct sg_image *out)
{
    const json_t *name =
        json_array_get(json_object_get(json_object_get(f->meta, part), "files"), index);
    char *data;
    size_t size;
    *out = (struct sg_image){0};
    if (!json_is_string(name))
        return wrong(f, part, name, "names of its images");
    int code = unpack(f, json_string_value(name), IMAGE_MAX, &data, &size);
    if (code)
        return code;
    /* Images are nearly square: twice the pixels, and some for small ones, are enough. */
    char *path = sg_strf(f->ctx, "%s/%s", f->in->path, json_string_value(name));
    code = path ? sg_image_decode(f->ctx, path, data, size, 2 * (uint64_t) n + (1 << 20), out)
                : SG_ERR_BUDGET;
    sg_free(path);
    sg_free(data);
    if (!code && ((size_t) out->width * (size_t) out->height < n || out->channels < 3))
        code = sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: %s: found an image of %d x %d pixels, expected colour for %zu",
                       f->in->path, json_string_value(name), out->width, out->height, n);
    if (code)
        sg_image_clear(out);
    return code;
}

static const uint8_t *pixel(const struct sg_image *image, size_t i)
{
    return image->pixels + i * (size_t) image->channels;
}

static uint8_t alpha(const struct sg_image *image, size_t i)
{
    return image->channels == 4 ? pixel(image, i)[3] : 255;
}

static int read_positions(const struct file *f)
{
    struct sg_image low, high = {0};
    float least[3], most[3];
    int code = read_image(f, "means", 0, f->count, &low);
    if (!code)
        code = read_image(f, "means", 1, f->count, &high);
    if (!code)
        code = read_numbers(f, "means", "mins", 3, least);
    if (!code)
        code = read_numbers(f, "means", "maxs", 3, most);
    for (size_t i = 0; i < f->count && !code; i++)
        for (int k = 0; k < 3; k++) {
            const double t = (pixel(&low, i)[k] | pixel(&high, i)[k] << 8) / 65535.0,
                         v = (double) least[k] * (1 - t) + (double) most[k] * t;
            *sg_model_at(f->m, i, SG_P_XYZ + k) = (float) copysign(expm1(fabs(v)), v);
        }
    sg_image_clear(&low);
    sg_image_clear(&high);
    return code;
}

/* Three components; alpha says which one, of w x y z, is the largest and left out. */
static int read_rotations(const struct file *f)
{
    struct sg_image image;
    int code = read_image(f, "quats", 0, f->count, &image);
    for (size_t i = 0; i < f->count && !code; i++) {
        const int largest = alpha(&image, i) - SG_SOG_LARGEST;
        double sum = 0;
        if (largest < 0) {
            code = sg_fail(f->ctx, SG_ERR_INPUT,
                           "%s: rotation %zu: found alpha %d, expected 252 to 255", f->in->path, i,
                           alpha(&image, i));
            break;
        }
        for (int k = 0, from = 0; k < 4; k++)
            if (k != largest) {
                const double v = (pixel(&image, i)[from++] / 255.0 - 0.5) * sqrt(2);
                *sg_model_at(f->m, i, SG_P_ROT + k) = (float) v;
                sum += v * v;
            }
        *sg_model_at(f->m, i, SG_P_ROT + largest) = (float) sqrt(fmax(0, 1 - sum));
    }
    sg_image_clear(&image);
    return code;
}

/* Values of a table; of the colours' image, alpha is the opacity. */
static int read_tabled(const struct file *f, const char *part, int plane, bool opacity)
{
    struct sg_image image;
    float table[SG_TABLE_SIZE];
    int code = read_image(f, part, 0, f->count, &image);
    if (!code)
        code = read_numbers(f, part, "codebook", SG_TABLE_SIZE, table);
    for (size_t i = 0; i < f->count && !code; i++) {
        for (int k = 0; k < 3; k++)
            *sg_model_at(f->m, i, plane + k) = table[pixel(&image, i)[k]];
        if (opacity)
            *sg_model_at(f->m, i, SG_P_OPACITY) = sg_logit_of_byte(alpha(&image, i));
    }
    sg_image_clear(&image);
    return code;
}

static int read_sh(const struct file *f)
{
    struct sg_image palette, labels = {0};
    float table[SG_TABLE_SIZE];
    const json_t *count = json_object_get(json_object_get(f->meta, "shN"), "count");
    const json_int_t n = json_integer_value(count);
    const size_t coefficients = (size_t) sg_sh_rest(f->sh_degree) / 3;
    if (!json_is_integer(count) || n < 1 || n > SG_SOG_PALETTE_MAX)
        return wrong(f, "shN.count", count, "1 to 65536");
    const size_t rows = ((size_t) n + SG_SOG_PALETTE_ROW - 1) / SG_SOG_PALETTE_ROW,
                 across = SG_SOG_PALETTE_ROW * coefficients;
    int code = read_image(f, "shN", 0, rows * across, &palette);
    if (!code && (size_t) palette.width != across)
        code =
            sg_fail(f->ctx, SG_ERR_INPUT, "%s: shN: found a palette %d pixels wide, expected %zu",
                    f->in->path, palette.width, across);
    if (!code)
        code = read_image(f, "shN", 1, f->count, &labels);
    if (!code)
        code = read_numbers(f, "shN", "codebook", SG_TABLE_SIZE, table);
    for (size_t i = 0; i < f->count && !code; i++) {
        const size_t label = pixel(&labels, i)[0] | (size_t) pixel(&labels, i)[1] << 8;
        if (label >= (size_t) n) {
            code = sg_fail(f->ctx, SG_ERR_INPUT,
                           "%s: shN: Gaussian %zu: found label %zu of a palette of %lld",
                           f->in->path, i, label, (long long) n);
            break;
        }
        const size_t first =
            label / SG_SOG_PALETTE_ROW * across + label % SG_SOG_PALETTE_ROW * coefficients;
        for (size_t k = 0; k < coefficients; k++)
            for (int c = 0; c < 3; c++)
                *sg_model_at(f->m, i, SG_P_SH + 3 * (int) (k + 1) + c) =
                    table[pixel(&palette, first + k)[c]];
    }
    sg_image_clear(&palette);
    sg_image_clear(&labels);
    return code;
}

int sg_sog_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out)
{
    struct file f = {.ctx = ctx, .in = in};
    int code = sg_zip_open(ctx, in->path, fileno(in->file), in->size, &f.zip);
    if (!code)
        code = read_meta(&f);
    if (!code)
        code = sg_claimed_model(ctx, in, f.count, f.sh_degree, max_gaussians, &f.m);
    if (!code)
        code = read_positions(&f);
    if (!code)
        code = read_rotations(&f);
    if (!code)
        code = read_tabled(&f, "scales", SG_P_SCALE, false);
    if (!code)
        code = read_tabled(&f, "sh0", SG_P_SH, true);
    if (!code && f.sh_degree)
        code = read_sh(&f);
    json_decref(f.meta);
    sg_free(f.room);
    sg_zip_close(&f.zip);
    if (code)
        sg_model_destroy(&f.m);
    *out = f.m;
    return code;
}
