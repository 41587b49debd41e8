/* SPDX-License-Identifier: Apache-2.0 */
/* Writes what sog.c reads. Gaussians are in the order of a space-filling curve, so that neighbours
 * in the images are alike. */
#include <jansson.h>
#include <stdlib.h>

#include "cluster.h"
#include "codec.h"
#include "core/zip.h"
#include "image/image.h"
#include "sog.h"

struct writer {
    sg_ctx *ctx;
    const struct sg_model *m;
    const char *path;
    struct sg_zip_writer zip;
    uint32_t *order;   /* Gaussian of each pixel */
    int width, height; /* of images with a pixel for each Gaussian */
    uint8_t *rgba;     /* the image that is made */
    json_t *meta;
};

/* ---- meta.json ---- */

/* A member of meta.json and its images, the last of which may be NULL. */
static int add_part(struct writer *w, const char *name, json_t *part, const char *file,
                    const char *other)
{
    json_t *files = json_array();
    const bool made = part && files && !json_array_append_new(files, json_string(file)) &&
                      (!other || !json_array_append_new(files, json_string(other))) &&
                      !json_object_set(part, "files", files) &&
                      !json_object_set(w->meta, name, part);
    json_decref(files);
    json_decref(part);
    return made ? SG_OK : sg_fail(w->ctx, SG_ERR_BUDGET, "%s: no memory for meta.json", w->path);
}

static json_t *number_list(const float *values, size_t n)
{
    json_t *list = json_array();
    for (size_t i = 0; i < n && list; i++)
        if (json_array_append_new(list, json_real((double) values[i]))) {
            json_decref(list);
            list = NULL;
        }
    return list;
}

/* Takes over the lists. */
static json_t *part_of(const char *name, json_t *list, const char *other_name, json_t *other)
{
    json_t *part = json_object();
    const bool made = part && list && !json_object_set(part, name, list) &&
                      (!other_name || (other && !json_object_set(part, other_name, other)));
    json_decref(list);
    json_decref(other);
    if (!made) {
        json_decref(part);
        part = NULL;
    }
    return part;
}

static int write_meta(struct writer *w)
{
    char generator[64];
    snprintf(generator, sizeof(generator), "splatguard %s", sg_version());
    int code = SG_ERR_BUDGET;
    char *text = NULL;
    if (!json_object_set_new(w->meta, "version", json_integer(2)) &&
        !json_object_set_new(w->meta, "count", json_integer((json_int_t) w->m->count)) &&
        !json_object_set_new(w->meta, "asset", json_pack("{s:s}", "generator", generator)))
        text = json_dumps(w->meta, JSON_COMPACT | JSON_REAL_PRECISION(9));
    if (text)
        code = sg_zip_add(&w->zip, "meta.json", text, strlen(text));
    else
        sg_fail(w->ctx, code, "%s: no memory for meta.json", w->path);
    free(text);
    return code;
}

/* ---- images ---- */

static int start_image(struct writer *w, int width, int height)
{
    const size_t pixels = (size_t) width * (size_t) height;
    w->rgba = sg_alloc(w->ctx, SG_MEM_MISC, pixels, 4);
    for (size_t i = 0; i < pixels && w->rgba; i++)
        w->rgba[4 * i + 3] = 255;
    return w->rgba ? SG_OK : SG_ERR_BUDGET;
}

static int finish_image(struct writer *w, const char *name, int width, int height)
{
    void *data = NULL;
    size_t size;
    int code = sg_progress(w->ctx, SG_STAGE_WRITE, 0, 1);
    if (!code)
        code = sg_image_encode_webp(w->ctx, w->rgba, width, height, &data, &size);
    sg_free(w->rgba);
    w->rgba = NULL;
    if (!code)
        code = sg_zip_add(&w->zip, name, data, size);
    sg_free(data);
    return code;
}

static double log_of_position(const struct writer *w, size_t i, int axis)
{
    const double v = (double) *sg_model_at(w->m, i, SG_P_XYZ + axis);
    return copysign(log1p(fabs(v)), v);
}

/* 16 bits between the least and the most of the logarithms: byte 0 or 1 of them. */
static int write_positions(struct writer *w, int byte, const char *name, const float *least,
                           const float *most)
{
    const int code = start_image(w, w->width, w->height);
    for (size_t i = 0; i < w->m->count && !code; i++)
        for (int k = 0; k < 3; k++) {
            const double span = (double) most[k] - (double) least[k],
                         t = span > 0
                                 ? (log_of_position(w, w->order[i], k) - (double) least[k]) / span
                                 : 0;
            const unsigned steps = (unsigned) (fmin(fmax(t, 0), 1) * 65535 + 0.5);
            w->rgba[4 * i + (size_t) k] = (uint8_t) (steps >> 8 * byte);
        }
    return code ? code : finish_image(w, name, w->width, w->height);
}

static int write_means(struct writer *w)
{
    float least[3], most[3];
    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < w->m->count; i++) {
            const double v = log_of_position(w, i, k);
            low = fmin(low, v), high = fmax(high, v);
        }
        least[k] = (float) low, most[k] = (float) high;
    }
    int code = write_positions(w, 0, "means_l.webp", least, most);
    if (!code)
        code = write_positions(w, 1, "means_u.webp", least, most);
    if (!code)
        code = add_part(w, "means",
                        part_of("mins", number_list(least, 3), "maxs", number_list(most, 3)),
                        "means_l.webp", "means_u.webp");
    return code;
}

static int write_rotations(struct writer *w)
{
    int code = start_image(w, w->width, w->height);
    for (size_t i = 0; i < w->m->count && !code; i++) {
        float q[4];
        int largest = 0;
        uint8_t *to = w->rgba + 4 * i;
        sg_unit_quaternion(w->m, w->order[i], q);
        for (int k = 1; k < 4; k++)
            largest = fabsf(q[k]) > fabsf(q[largest]) ? k : largest;
        for (int k = 0; k < 4; k++)
            if (k != largest)
                *to++ = sg_byte(255 * ((q[largest] < 0 ? -q[k] : q[k]) * (float) M_SQRT1_2 + 0.5f));
        *to = (uint8_t) (SG_SOG_LARGEST + largest);
    }
    if (!code)
        code = finish_image(w, "quats.webp", w->width, w->height);
    return code ? code : add_part(w, "quats", json_object(), "quats.webp", NULL);
}

/* Three planes by a table of their values; alpha is the opacity if that is asked for. */
static int write_tabled(struct writer *w, const char *part, const char *file, int plane,
                        bool opacity)
{
    const size_t n = w->m->count;
    float table[SG_TABLE_SIZE], *values = sg_alloc_raw(w->ctx, SG_MEM_MISC, n, 3 * sizeof(*values));
    int code = values ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < n && !code; i++)
        for (int k = 0; k < 3; k++)
            values[3 * i + (size_t) k] = *sg_model_at(w->m, i, plane + k);
    if (!code)
        code = sg_make_table(w->ctx, values, 3 * n, table);
    sg_free(values);
    if (!code)
        code = start_image(w, w->width, w->height);
    for (size_t i = 0; i < n && !code; i++) {
        for (int k = 0; k < 3; k++)
            w->rgba[4 * i + (size_t) k] =
                sg_nearest_number(table, *sg_model_at(w->m, w->order[i], plane + k));
        if (opacity)
            w->rgba[4 * i + 3] =
                sg_byte(255 * sg_logistic(*sg_model_at(w->m, w->order[i], SG_P_OPACITY)));
    }
    if (!code)
        code = finish_image(w, file, w->width, w->height);
    return code ? code
                : add_part(w, part,
                           part_of("codebook", number_list(table, SG_TABLE_SIZE), NULL, NULL), file,
                           NULL);
}

/* ---- SH of degree 1 and above ---- */

static int write_labels(struct writer *w, const uint32_t *labels)
{
    const int code = start_image(w, w->width, w->height);
    for (size_t i = 0; i < w->m->count && !code; i++) {
        const uint32_t label = labels[w->order[i]];
        w->rgba[4 * i] = (uint8_t) label, w->rgba[4 * i + 1] = (uint8_t) (label >> 8);
    }
    return code ? code : finish_image(w, "shN_labels.webp", w->width, w->height);
}

static int write_palette(struct writer *w, const float *palette, size_t count, float *table)
{
    const size_t values = (size_t) sg_sh_rest(w->m->sh_degree), n = count * values;
    const int width = (int) (SG_SOG_PALETTE_ROW * values / 3),
              height = (int) ((count + SG_SOG_PALETTE_ROW - 1) / SG_SOG_PALETTE_ROW);
    float *sorted = sg_alloc_raw(w->ctx, SG_MEM_MISC, n, sizeof(*sorted));
    int code = sorted ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        memcpy(sorted, palette, n * sizeof(*sorted));
        code = sg_make_table(w->ctx, sorted, n, table);
    }
    sg_free(sorted);
    if (!code)
        code = start_image(w, width, height);
    for (size_t i = 0; i < n && !code; i++) /* three channels of each coefficient, row by row */
        w->rgba[i / 3 * 4 + i % 3] = sg_nearest_number(table, palette[i]);
    return code ? code : finish_image(w, "shN_centroids.webp", width, height);
}

static int write_sh(struct writer *w)
{
    const size_t n = w->m->count;
    const struct sg_vectors vectors = {w->m, SG_P_SH + 3, sg_sh_rest(w->m->sh_degree)};
    size_t count, most = SG_SOG_PALETTE_MAX;
    float *palette = NULL, table[SG_TABLE_SIZE];
    while (most > n)
        most /= 2;
    uint32_t *labels = sg_alloc_raw(w->ctx, SG_MEM_MISC, n, sizeof(*labels));
    int code =
        labels ? sg_make_palette(w->ctx, &vectors, most, &palette, &count, labels) : SG_ERR_BUDGET;
    if (!code)
        code = write_palette(w, palette, count, table);
    if (!code)
        code = write_labels(w, labels);
    if (!code) {
        json_t *part = part_of("codebook", number_list(table, SG_TABLE_SIZE), "count",
                               json_integer((json_int_t) count));
        if (part && json_object_set_new(part, "bands", json_integer(w->m->sh_degree))) {
            json_decref(part);
            part = NULL;
        }
        code = add_part(w, "shN", part, "shN_centroids.webp", "shN_labels.webp");
    }
    sg_free(palette);
    sg_free(labels);
    return code;
}

int sg_sog_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path)
{
    struct writer w = {
        .ctx = ctx, .m = m, .path = path, .zip = {.ctx = ctx, .to = f, .path = path}};
    const double side = 4 * ceil(sqrt((double) m->count) / 4);
    if (side > SG_WEBP_SIDE_MAX)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %zu Gaussians, expected at most %lld in .sog",
                       path, m->count, (long long) SG_WEBP_SIDE_MAX * SG_WEBP_SIDE_MAX);
    w.width = (int) side;
    w.height = (int) (4 * ceil((double) m->count / side / 4));
    w.meta = json_object();
    int code = w.meta ? sg_model_order(ctx, m, &w.order) : SG_ERR_BUDGET;
    if (!code)
        code = write_means(&w);
    if (!code)
        code = write_rotations(&w);
    if (!code)
        code = write_tabled(&w, "scales", "scales.webp", SG_P_SCALE, false);
    if (!code)
        code = write_tabled(&w, "sh0", "sh0.webp", SG_P_SH, true);
    if (!code && m->sh_degree)
        code = write_sh(&w);
    if (!code)
        code = write_meta(&w);
    if (!code)
        sg_zip_finish(&w.zip);
    json_decref(w.meta);
    sg_free(w.order);
    sg_free(w.rgba);
    return code;
}
