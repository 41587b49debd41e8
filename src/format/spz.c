/* SPDX-License-Identifier: Apache-2.0 */
/* .spz of Niantic, versions 2 and 3: a gzip stream of a header of 16 bytes, then an array of each
 * attribute: positions, opacities, colours, scales, rotations, SH. Axes are right, up, back. */
#include "codec.h"
#include "gzip.h"

#define HEADER 16
#define FRACTION 12        /* bits of a position behind the point, fewer where that does not fit */
#define COLOUR_SCALE 0.15f /* of degree 0, so that colours beyond 0..1 fit */
#define ROWS 1024          /* at once */
#define ROTATION_MAX 511   /* magnitude of a component, for 1 / sqrt 2 */
#define EXTENSIONS 2       /* bit of the flags */

static const struct sg_axes axes = {1, -1, -1};

struct header {
    uint32_t version, count;
    int sh_degree, fraction;
};

static int read_header(sg_ctx *ctx, const struct sg_source *in, struct sg_gunzip *g,
                       struct header *h)
{
    char b[HEADER];
    const int code = sg_gunzip_read(g, b, HEADER);
    if (code)
        return code;
    *h = (struct header){.version = sg_u32(b + 4),
                         .count = sg_u32(b + 8),
                         .sh_degree = (uint8_t) b[12],
                         .fraction = (uint8_t) b[13]};
    if (memcmp(b, "NGSP", 4))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found gzip of something else, expected .spz",
                       in->path);
    if (h->version != 2 && h->version != 3)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found version %u, expected 2 or 3", in->path,
                       h->version);
    if (h->sh_degree > 3)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found SH degree %d, expected 0 to 3",
                       in->path, h->sh_degree);
    if (h->fraction > 23)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %d bits behind the point, expected 0 to 23", in->path,
                       h->fraction);
    if (b[14] & EXTENSIONS)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found extensions, expected none", in->path);
    const uint64_t row =
        (uint64_t) (9 + 1 + 3 + 3 + (h->version == 2 ? 3 : 4) + sg_sh_rest(h->sh_degree));
    if (h->count > in->size * SG_DEFLATE_RATIO / row)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %u Gaussians in %llu bytes, which cannot hold them",
                       in->path, h->count, (unsigned long long) in->size);
    return SG_OK;
}

/* An array of the file; decode takes one Gaussian's bytes. */
static int read_array(struct sg_gunzip *g, struct sg_model *m, size_t width, const struct header *h,
                      void (*decode)(struct sg_model *m, size_t i, const uint8_t *bytes,
                                     const struct header *h))
{
    uint8_t rows[ROWS * SG_SH_REST_MAX];
    int code = SG_OK;
    for (size_t i = 0; i < m->count && !code; i += ROWS) {
        const size_t n = m->count - i < ROWS ? m->count - i : ROWS;
        code = sg_gunzip_read(g, rows, n * width);
        for (size_t k = 0; k < n && !code; k++)
            decode(m, i + k, rows + k * width, h);
    }
    return code;
}

static void decode_position(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    const int sign[3] = {axes.x, axes.y, axes.z};
    for (int k = 0; k < 3; k++, b += 3) {
        const int32_t fixed = (b[0] | b[1] << 8 | b[2] << 16) - (b[2] & 0x80 ? 1 << 24 : 0);
        *sg_model_at(m, i, SG_P_XYZ + k) = ldexpf((float) (sign[k] * fixed), -h->fraction);
    }
}

static void decode_opacity(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    (void) h;
    *sg_model_at(m, i, SG_P_OPACITY) = sg_logit_of_byte(b[0]);
}

static void decode_colour(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    (void) h;
    for (int k = 0; k < 3; k++)
        *sg_model_at(m, i, SG_P_SH + k) = ((float) b[k] / 255 - 0.5f) / COLOUR_SCALE;
}

static void decode_scale(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    (void) h;
    for (int k = 0; k < 3; k++)
        *sg_model_at(m, i, SG_P_SCALE + k) = (float) b[k] / 16 - 10;
}

/* Version 2 has x y z, and w >= 0 follows from them. Version 3 has the three smaller components of
 * x y z w, each with a sign and 9 bits, below the number of the largest, which is positive. */
static void decode_rotation(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    float q[4]; /* x y z w */
    float rest = 1;
    int sign[4], sh[15], largest = 3;
    uint32_t bits = 0;
    if (h->version == 3) {
        bits = sg_u32((const char *) b);
        largest = (int) (bits >> 30);
    }
    for (int k = 3; k >= 0; k--) {
        if (k == largest)
            continue;
        if (h->version == 3) {
            q[k] = (float) (bits & ROTATION_MAX) / ROTATION_MAX * (float) M_SQRT1_2;
            q[k] = bits & (ROTATION_MAX + 1) ? -q[k] : q[k];
            bits >>= 10;
        } else
            q[k] = (float) b[k] / 127.5f - 1;
        rest -= q[k] * q[k];
    }
    q[largest] = sqrtf(fmaxf(rest, 0));
    sg_axes_signs(axes, sign, sh);
    for (int k = 0; k < 4; k++)
        *sg_model_at(m, i, SG_P_ROT + k) = (float) sign[k] * q[(k + 3) % 4];
}

static void decode_sh(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    int quaternion[4], sign[15];
    sg_axes_signs(axes, quaternion, sign);
    for (int k = 0; k < sg_sh_rest(h->sh_degree); k++)
        *sg_model_at(m, i, SG_P_SH + 3 + k) = (float) (sign[k / 3] * (b[k] - 128)) / 128;
}

int sg_spz_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out)
{
    struct sg_gunzip *g;
    struct header h;
    *out = NULL;
    int code = sg_gunzip_open(ctx, in, &g);
    if (!code)
        code = read_header(ctx, in, g, &h);
    if (!code)
        code = sg_claimed_model(ctx, in, h.count, h.sh_degree, max_gaussians, out);
    if (!code)
        code = read_array(g, *out, 9, &h, decode_position);
    if (!code)
        code = read_array(g, *out, 1, &h, decode_opacity);
    if (!code)
        code = read_array(g, *out, 3, &h, decode_colour);
    if (!code)
        code = read_array(g, *out, 3, &h, decode_scale);
    if (!code)
        code = read_array(g, *out, h.version == 2 ? 3 : 4, &h, decode_rotation);
    if (!code && h.sh_degree)
        code = read_array(g, *out, (size_t) sg_sh_rest(h.sh_degree), &h, decode_sh);
    if (!code)
        code = sg_gunzip_finish(g);
    sg_gunzip_close(&g);
    if (code)
        sg_model_destroy(out);
    return code;
}

/* The most bits behind the point, up to FRACTION, with which all positions fit 24 bits. */
static int choose_fraction(sg_ctx *ctx, const struct sg_model *m, const char *path, int *fraction)
{
    float most = 0;
    for (size_t i = 0; i < m->count; i++)
        for (int k = 0; k < 3; k++)
            most = fmaxf(most, fabsf(*sg_model_at(m, i, SG_P_XYZ + k)));
    for (*fraction = FRACTION; *fraction > 0 && ldexpf(most, *fraction) > 8388607;)
        --*fraction;
    return ldexpf(most, *fraction) <= 8388607
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT,
                         "%s: found a position of %g, expected at most 8388607 in .spz", path,
                         (double) most);
}

/* The low bytes of a number, the lowest first. */
static void put_bytes(uint8_t *to, uint32_t v, int bytes)
{
    for (int k = 0; k < bytes; k++)
        to[k] = (uint8_t) (v >> 8 * k);
}

static void encode_position(const struct sg_model *m, size_t i, uint8_t *b, const struct header *h)
{
    const int sign[3] = {axes.x, axes.y, axes.z};
    for (int k = 0; k < 3; k++) {
        const int32_t fixed = (int32_t) lrintf(
            ldexpf((float) sign[k] * *sg_model_at(m, i, SG_P_XYZ + k), h->fraction));
        put_bytes(b + 3 * k, (uint32_t) fixed, 3);
    }
}

static void encode_opacity(const struct sg_model *m, size_t i, uint8_t *b, const struct header *h)
{
    (void) h;
    b[0] = sg_byte(255 * sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)));
}

static void encode_colour(const struct sg_model *m, size_t i, uint8_t *b, const struct header *h)
{
    (void) h;
    for (int k = 0; k < 3; k++)
        b[k] = sg_byte(255 * (COLOUR_SCALE * *sg_model_at(m, i, SG_P_SH + k) + 0.5f));
}

static void encode_scale(const struct sg_model *m, size_t i, uint8_t *b, const struct header *h)
{
    (void) h;
    for (int k = 0; k < 3; k++)
        b[k] = sg_byte(16 * (*sg_model_at(m, i, SG_P_SCALE + k) + 10));
}

static void encode_rotation(const struct sg_model *m, size_t i, uint8_t *b, const struct header *h)
{
    float unit[4], q[4];
    int sign[4], sh[15], largest = 0;
    sg_unit_quaternion(m, i, unit);
    sg_axes_signs(axes, sign, sh);
    for (int k = 0; k < 4; k++)
        q[(k + 3) % 4] = (float) sign[k] * unit[k];
    if (h->version == 2) {
        for (int k = 0; k < 3; k++)
            b[k] = sg_byte((q[3] < 0 ? -127.5f : 127.5f) * q[k] + 127.5f);
        return;
    }
    for (int k = 1; k < 4; k++)
        largest = fabsf(q[k]) > fabsf(q[largest]) ? k : largest;
    uint32_t bits = (uint32_t) largest;
    for (int k = 0; k < 4; k++) {
        if (k == largest)
            continue;
        const uint32_t magnitude =
            (uint32_t) (fabsf(q[k]) / (float) M_SQRT1_2 * ROTATION_MAX + 0.5f);
        const bool negative = (q[k] < 0) != (q[largest] < 0);
        bits = bits << 10 | (negative ? ROTATION_MAX + 1 : 0) |
               (magnitude < ROTATION_MAX ? magnitude : ROTATION_MAX);
    }
    put_bytes(b, bits, 4);
}

/* Rounded to 5 bits in degree 1 and to 4 bits above, which gzip then finds. */
static void encode_sh(const struct sg_model *m, size_t i, uint8_t *b, const struct header *h)
{
    int quaternion[4], sign[15];
    sg_axes_signs(axes, quaternion, sign);
    for (int k = 0; k < sg_sh_rest(h->sh_degree); k++) {
        const int step = k < 9 ? 8 : 16;
        const float value = (float) sign[k / 3] * *sg_model_at(m, i, SG_P_SH + 3 + k);
        const int q = (int) lrintf(128 * fminf(fmaxf(value, -1), 1)) + 128,
                  rounded = (q + step / 2) / step * step;
        b[k] = (uint8_t) (rounded > 255 ? 255 : rounded);
    }
}

static void write_array(struct sg_gzip *g, const struct sg_model *m, size_t width,
                        const struct header *h,
                        void (*encode)(const struct sg_model *m, size_t i, uint8_t *bytes,
                                       const struct header *h))
{
    uint8_t rows[ROWS * SG_SH_REST_MAX];
    for (size_t i = 0; i < m->count; i += ROWS) {
        const size_t n = m->count - i < ROWS ? m->count - i : ROWS;
        for (size_t k = 0; k < n; k++)
            encode(m, i + k, rows + k * width, h);
        sg_gzip_write(g, rows, n * width);
    }
}

int sg_spz_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path, int version)
{
    struct header h = {
        .version = (uint32_t) version, .count = (uint32_t) m->count, .sh_degree = m->sh_degree};
    struct sg_gzip *g;
    int code = choose_fraction(ctx, m, path, &h.fraction);
    if (!code)
        code = sg_gzip_open(ctx, f, &g);
    if (code)
        return code;
    uint8_t bytes[HEADER] = {'N', 'G', 'S', 'P', (uint8_t) version};
    put_bytes(bytes + 8, h.count, 4);
    bytes[12] = (uint8_t) h.sh_degree, bytes[13] = (uint8_t) h.fraction;
    sg_gzip_write(g, bytes, HEADER);
    write_array(g, m, 9, &h, encode_position);
    write_array(g, m, 1, &h, encode_opacity);
    write_array(g, m, 3, &h, encode_colour);
    write_array(g, m, 3, &h, encode_scale);
    write_array(g, m, version == 2 ? 3 : 4, &h, encode_rotation);
    if (h.sh_degree)
        write_array(g, m, (size_t) sg_sh_rest(h.sh_degree), &h, encode_sh);
    sg_gzip_finish(&g);
    return SG_OK;
}
