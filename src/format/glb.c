/* SPDX-License-Identifier: Apache-2.0 */
/* Binary glTF 2.0 with KHR_gaussian_splatting: a mesh of points whose attributes are arrays of
 * floats. Axes are left, up, forward; scales and opacities are as they are drawn. */
#include <jansson.h>
#include <stdlib.h>

#include "codec.h"

#define EXTENSION "KHR_gaussian_splatting"
#define ATTRIBUTES_MAX 24
#define FLOAT 5126 /* component types of glTF */
#define UNSIGNED_BYTE 5121
#define ARRAY_BUFFER 34962

static const struct sg_axes axes = {-1, -1, 1};

struct attribute {
    char name[64];
    int width; /* values */
    int type;
    /* Values of a Gaussian; k: the number of an SH coefficient. */
    void (*get)(const struct sg_model *m, size_t i, int k, void *to);
    int k;
};

static void get_position(const struct sg_model *m, size_t i, int k, void *to)
{
    const int sign[3] = {axes.x, axes.y, axes.z};
    for (k = 0; k < 3; k++)
        ((float *) to)[k] = (float) sign[k] * *sg_model_at(m, i, SG_P_XYZ + k);
}

/* For programs that show points only. */
static void get_colour(const struct sg_model *m, size_t i, int k, void *to)
{
    uint8_t *b = to;
    for (k = 0; k < 3; k++)
        b[k] = sg_byte_of_dc(*sg_model_at(m, i, SG_P_SH + k));
    b[3] = sg_byte(255 * sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)));
}

static void get_rotation(const struct sg_model *m, size_t i, int k, void *to)
{
    float q[4];
    int sign[4], sh[15];
    sg_unit_quaternion(m, i, q);
    sg_axes_signs(axes, sign, sh);
    for (k = 0; k < 4; k++) /* x y z w */
        ((float *) to)[(k + 3) % 4] = (float) sign[k] * q[k];
}

static void get_scale(const struct sg_model *m, size_t i, int k, void *to)
{
    for (k = 0; k < 3; k++)
        ((float *) to)[k] = sg_finite_scale(*sg_model_at(m, i, SG_P_SCALE + k));
}

static void get_opacity(const struct sg_model *m, size_t i, int k, void *to)
{
    (void) k;
    *(float *) to = sg_logistic(*sg_model_at(m, i, SG_P_OPACITY));
}

static void get_sh(const struct sg_model *m, size_t i, int k, void *to)
{
    int quaternion[4], sign[15];
    sg_axes_signs(axes, quaternion, sign);
    for (int c = 0; c < 3; c++)
        ((float *) to)[c] = (float) (k ? sign[k - 1] : 1) * *sg_model_at(m, i, SG_P_SH + 3 * k + c);
}

static int list_attributes(int sh_degree, struct attribute a[ATTRIBUTES_MAX])
{
    static const struct attribute basic[] = {
        {"POSITION", 3, FLOAT, get_position, 0},
        {"COLOR_0", 4, UNSIGNED_BYTE, get_colour, 0},
        {EXTENSION ":ROTATION", 4, FLOAT, get_rotation, 0},
        {EXTENSION ":SCALE", 3, FLOAT, get_scale, 0},
        {EXTENSION ":OPACITY", 1, FLOAT, get_opacity, 0},
    };
    int n = sizeof(basic) / sizeof(basic[0]);
    memcpy(a, basic, sizeof(basic));
    for (int degree = 0, k = 0; degree <= sh_degree; degree++)
        for (int c = 0; c < 2 * degree + 1; c++, k++) {
            a[n] = (struct attribute){"", 3, FLOAT, get_sh, k};
            snprintf(a[n++].name, sizeof(a[0].name), EXTENSION ":SH_DEGREE_%d_COEF_%d", degree, c);
        }
    return n;
}

static uint64_t attribute_bytes(const struct sg_model *m, const struct attribute *a)
{
    return (uint64_t) m->count * (uint64_t) a->width * (a->type == FLOAT ? 4 : 1);
}

static json_t *vector(const double *values)
{
    return json_pack("[f,f,f]", values[0], values[1], values[2]);
}

static void find_bounds(const struct sg_model *m, double low[3], double high[3])
{
    for (size_t i = 0; i < m->count; i++) {
        float at[3];
        get_position(m, i, 0, at);
        for (int k = 0; k < 3; k++) {
            low[k] = i ? fmin(low[k], (double) at[k]) : (double) at[k];
            high[k] = i ? fmax(high[k], (double) at[k]) : (double) at[k];
        }
    }
}

/* NULL without memory. */
static json_t *describe(const struct sg_model *m, const struct attribute *a, int n)
{
    static const char *const types[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    json_t *views = json_array(), *accessors = json_array(), *attributes = json_object();
    char generator[64];
    double low[3] = {0}, high[3] = {0};
    uint64_t at = 0;
    bool whole = true;
    for (int k = 0; k < n; k++) {
        const uint64_t bytes = attribute_bytes(m, &a[k]);
        whole &= !json_array_append_new(
            views, json_pack("{s:i,s:I,s:I,s:i}", "buffer", 0, "byteOffset", (json_int_t) at,
                             "byteLength", (json_int_t) bytes, "target", ARRAY_BUFFER));
        json_t *accessor =
            json_pack("{s:i,s:i,s:I,s:s}", "bufferView", k, "componentType", a[k].type, "count",
                      (json_int_t) m->count, "type", types[a[k].width]);
        if (a[k].type != FLOAT)
            whole &= !json_object_set_new(accessor, "normalized", json_true());
        if (k == 0) {
            find_bounds(m, low, high);
            whole &= !json_object_set_new(accessor, "min", vector(low)) &&
                     !json_object_set_new(accessor, "max", vector(high));
        }
        whole &= !json_array_append_new(accessors, accessor) &&
                 !json_object_set_new(attributes, a[k].name, json_integer(k));
        at += bytes;
    }
    if (!whole) {
        json_decref(views);
        json_decref(accessors);
        json_decref(attributes);
        return NULL;
    }
    snprintf(generator, sizeof(generator), "splatguard %s", sg_version());
    return json_pack("{s:{s:s,s:s},s:[s],s:i,s:[{s:[i]}],s:[{s:i}],s:[{s:I}],s:o,s:o,"
                     "s:[{s:[{s:o,s:i,s:{s:{s:s,s:s,s:s,s:s}}}]}]}",
                     "asset", "version", "2.0", "generator", generator, "extensionsUsed", EXTENSION,
                     "scene", 0, "scenes", "nodes", 0, "nodes", "mesh", 0, "buffers", "byteLength",
                     (json_int_t) at, "bufferViews", views, "accessors", accessors, "meshes",
                     "primitives", "attributes", attributes, "mode", 0, "extensions", EXTENSION,
                     "kernel", "ellipse", "colorSpace", "srgb_rec709_display", "sortingMethod",
                     "cameraDistance", "projection", "perspective");
}

static void write_words(FILE *f, const uint32_t *words, size_t n)
{
    fwrite(words, sizeof(uint32_t), n, f); /* little endian hosts only, as the store itself */
}

int sg_glb_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path)
{
    struct attribute a[ATTRIBUTES_MAX];
    const int n = list_attributes(m->sh_degree, a);
    uint64_t bytes = 0;
    for (int k = 0; k < n; k++)
        bytes += attribute_bytes(m, &a[k]);
    if (bytes > UINT32_MAX - (1 << 16))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %zu Gaussians of %llu bytes, expected less "
                       "than 4 GiB in .glb",
                       path, m->count, (unsigned long long) bytes);
    json_t *root = describe(m, a, n);
    char *text = root ? json_dumps(root, JSON_COMPACT | JSON_SORT_KEYS) : NULL;
    json_decref(root);
    if (!text)
        return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory for its header", path);
    const uint32_t length = (uint32_t) strlen(text), padding = -length & 3u;
    const uint32_t head[] = {0x46546c67, 2, 12 + 8 + length + padding + 8 + (uint32_t) bytes,
                             length + padding, 0x4e4f534a},
                   body[] = {(uint32_t) bytes, 0x004e4942};
    write_words(f, head, 5);
    fwrite(text, 1, length, f);
    fwrite("   ", 1, padding, f);
    write_words(f, body, 2);
    for (int k = 0; k < n; k++)
        for (size_t i = 0; i < m->count; i++) {
            float values[4];
            a[k].get(m, i, a[k].k, values);
            fwrite(values, a[k].type == FLOAT ? 4 : 1, (size_t) a[k].width, f);
        }
    free(text);
    return SG_OK;
}
