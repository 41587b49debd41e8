/* SPDX-License-Identifier: Apache-2.0 */
/* .spz of Niantic: a header, then an array of each attribute: positions, opacities, colours,
 * scales, rotations, SH. Versions 2 and 3 are one gzip stream of these. Version 4 begins with a
 * header of 32 bytes and a table of the arrays' sizes, then there is a zstd frame for each of them.
 * Axes are right, up, back. */
#include "codec.h"
#include "gzip.h"
#include "zstd_frame.h"

#define HEADER 16
#define HEADER_4 32        /* of version 4 */
#define TABLE_ROW 16       /* of its table: packed bytes, bytes */
#define ARRAYS 6           /* without SH one less */
#define FRACTION 12        /* bits of a position behind the point, fewer where that does not fit */
#define COLOUR_SCALE 0.15f /* of degree 0, so that colours beyond 0..1 fit */
#define ROWS 1024          /* at once */
#define ROTATION_MAX 511   /* magnitude of a component, for 1 / sqrt 2 */
#define ANTIALIASED 1      /* bits of the flags */
#define EXTENSIONS 2

static const struct sg_axes axes = {1, -1, -1};

struct header {
    uint32_t version, count;
    int sh_degree, fraction;
};

struct array {
    size_t width; /* bytes of a Gaussian */
    void (*decode)(struct sg_model *m, size_t i, const uint8_t *bytes, const struct header *h);
    void (*encode)(const struct sg_model *m, size_t i, uint8_t *bytes, const struct header *h);
};

/* What the headers of all versions have in common. */
static int parse_header(sg_ctx *ctx, const char *path, const char *b, struct header *h)
{
    *h = (struct header){.version = sg_u32(b + 4),
                         .count = sg_u32(b + 8),
                         .sh_degree = (uint8_t) b[12],
                         .fraction = (uint8_t) b[13]};
    if (h->sh_degree > 3)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found SH degree %d, expected 0 to 3", path,
                       h->sh_degree);
    if (h->fraction > 23)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %d bits behind the point, expected 0 to 23", path,
                       h->fraction);
    if (b[14] & ANTIALIASED)
        sg_log(ctx, SG_LOG_WARN,
               "%s: the model was trained with antialiasing, which is not kept: it is drawn as "
               "other models",
               path);
    if (b[14] & EXTENSIONS)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found extensions, expected none", path);
    return SG_OK;
}

static int cannot_hold(sg_ctx *ctx, const struct sg_source *in, const struct header *h)
{
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: header: found %u Gaussians in %llu bytes, which cannot hold them", in->path,
                   h->count, (unsigned long long) in->size);
}

static int read_header(sg_ctx *ctx, const struct sg_source *in, struct sg_gunzip *g,
                       struct header *h)
{
    char b[HEADER];
    int code = sg_gunzip_read(g, b, HEADER);
    if (code)
        return code;
    if (memcmp(b, "NGSP", 4))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found gzip of something else, expected .spz",
                       in->path);
    if (sg_u32(b + 4) != 2 && sg_u32(b + 4) != 3)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found version %u, expected 2 or 3", in->path,
                       sg_u32(b + 4));
    if ((code = parse_header(ctx, in->path, b, h)))
        return code;
    const uint64_t row =
        (uint64_t) (9 + 1 + 3 + 3 + (h->version == 2 ? 3 : 4) + sg_sh_rest(h->sh_degree));
    return h->count > in->size * SG_DEFLATE_RATIO / row ? cannot_hold(ctx, in, h) : SG_OK;
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

/* Version 2 has x y z, and w >= 0 follows from them. Later ones have the three smaller components
 * of x y z w, each with a sign and 9 bits, below the number of the largest, which is positive. */
static void decode_rotation(struct sg_model *m, size_t i, const uint8_t *b, const struct header *h)
{
    float q[4]; /* x y z w */
    float rest = 1;
    int sign[4], sh[15], largest = 3;
    uint32_t bits = 0;
    if (h->version >= 3) {
        bits = sg_u32((const char *) b);
        largest = (int) (bits >> 30);
    }
    for (int k = 3; k >= 0; k--) {
        if (k == largest)
            continue;
        if (h->version >= 3) {
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

/* The most bits behind the point, up to FRACTION, with which all positions fit 24 bits. */
static int choose_fraction(sg_ctx *ctx, const struct sg_model *m, const char *path, int *fraction)
{
    float most = 0;
    for (size_t i = 0; i < m->count; i++)
        for (int k = 0; k < 3; k++)
            most = fmaxf(most, fabsf(*sg_model_at(m, i, SG_P_XYZ + k)));
    for (*fraction = FRACTION; *fraction > 0 && ldexpf(most, *fraction) > 8388607;)
        --*fraction;
    if (ldexpf(most, *fraction) > 8388607)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a position of %g, expected at most 8388607 in .spz", path,
                       (double) most);
    if (*fraction < FRACTION)
        sg_log(ctx, SG_LOG_WARN,
               "%s: positions are rounded to multiples of %g, since one of them is %g; convert "
               "--crop leaves far Gaussians out",
               path, ldexp(1, -*fraction), (double) most);
    return SG_OK;
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

/* Returns how many. */
static int list_arrays(const struct header *h, struct array list[ARRAYS])
{
    const struct array all[ARRAYS] = {
        {9, decode_position, encode_position},
        {1, decode_opacity, encode_opacity},
        {3, decode_colour, encode_colour},
        {3, decode_scale, encode_scale},
        {h->version == 2 ? 3 : 4, decode_rotation, encode_rotation},
        {(size_t) sg_sh_rest(h->sh_degree), decode_sh, encode_sh},
    };
    memcpy(list, all, sizeof(all));
    return h->sh_degree ? ARRAYS : ARRAYS - 1;
}

/* ---- versions 2 and 3 ---- */

static int read_array(struct sg_gunzip *g, struct sg_model *m, const struct array *a,
                      const struct header *h)
{
    uint8_t rows[ROWS * SG_SH_REST_MAX];
    int code = SG_OK;
    for (size_t i = 0; i < m->count && !code; i += ROWS) {
        const size_t n = m->count - i < ROWS ? m->count - i : ROWS;
        code = sg_gunzip_read(g, rows, n * a->width);
        for (size_t k = 0; k < n && !code; k++)
            a->decode(m, i + k, rows + k * a->width, h);
    }
    return code;
}

static int read_gzip(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                     struct sg_model **out)
{
    struct array list[ARRAYS];
    struct sg_gunzip *g;
    struct header h;
    int code = sg_gunzip_open(ctx, in, &g);
    if (!code)
        code = read_header(ctx, in, g, &h);
    if (!code)
        code = sg_claimed_model(ctx, in, h.count, h.sh_degree, max_gaussians, out);
    for (int k = 0, n = code ? 0 : list_arrays(&h, list); k < n && !code; k++)
        code = read_array(g, *out, &list[k], &h);
    if (!code)
        code = sg_gunzip_finish(g);
    sg_gunzip_close(&g);
    return code;
}

static void write_array(struct sg_gzip *g, const struct sg_model *m, const struct array *a,
                        const struct header *h)
{
    uint8_t rows[ROWS * SG_SH_REST_MAX];
    for (size_t i = 0; i < m->count; i += ROWS) {
        const size_t n = m->count - i < ROWS ? m->count - i : ROWS;
        for (size_t k = 0; k < n; k++)
            a->encode(m, i + k, rows + k * a->width, h);
        sg_gzip_write(g, rows, n * a->width);
    }
}

/* The fields that all versions have. */
static void put_header(uint8_t to[HEADER], const struct header *h)
{
    memset(to, 0, HEADER);
    memcpy(to, "NGSP", 4);
    put_bytes(to + 4, h->version, 4);
    put_bytes(to + 8, h->count, 4);
    to[12] = (uint8_t) h->sh_degree, to[13] = (uint8_t) h->fraction;
}

static int write_gzip(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path,
                      const struct header *h)
{
    struct array list[ARRAYS];
    uint8_t bytes[HEADER];
    struct sg_gzip *g;
    const int code = sg_gzip_open(ctx, path, f, &g);
    if (code)
        return code;
    put_header(bytes, h);
    sg_gzip_write(g, bytes, HEADER);
    for (int k = 0, n = list_arrays(h, list); k < n; k++)
        write_array(g, m, &list[k], h);
    sg_gzip_finish(&g);
    return SG_OK;
}

/* ---- version 4 ---- */

static uint64_t u64(const char *b)
{
    return sg_u32(b) | (uint64_t) sg_u32(b + 4) << 32;
}

/* Packed bytes of each array. The file must end with the last one. */
static int read_table(sg_ctx *ctx, struct sg_source *in, struct header *h, uint64_t packed[ARRAYS])
{
    struct array list[ARRAYS];
    const char *b = sg_source_peek(in, HEADER_4);
    if (!b)
        return sg_short_file(ctx, in);
    if (sg_u32(b + 4) != 4)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found version %u, expected 4", in->path,
                       sg_u32(b + 4));
    const int code = parse_header(ctx, in->path, b, h);
    if (code)
        return code;
    const int arrays = list_arrays(h, list), found = (uint8_t) b[15];
    const uint64_t at = sg_u32(b + 16);
    if (found != arrays)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found %d arrays, expected %d", in->path,
                       found, arrays);
    if (h->count / SG_GAUSSIANS_A_BYTE > in->size)
        return cannot_hold(ctx, in, h);
    if (at < HEADER_4 || at > in->size)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found its table at byte %llu of %llu",
                       in->path, (unsigned long long) at, (unsigned long long) in->size);
    sg_source_skip(in, at);
    if (!(b = sg_source_peek(in, (size_t) arrays * TABLE_ROW)))
        return sg_short_file(ctx, in);
    uint64_t left = sg_source_left(in) - (uint64_t) arrays * TABLE_ROW;
    for (int k = 0; k < arrays; k++) {
        packed[k] = u64(b + k * TABLE_ROW);
        const uint64_t bytes = u64(b + k * TABLE_ROW + 8), expected = h->count * list[k].width;
        if (bytes != expected || packed[k] > left || (k == arrays - 1 && packed[k] != left))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: table: array %d: found %llu bytes packed in %llu, expected %llu in "
                           "%s%llu",
                           in->path, k, (unsigned long long) bytes, (unsigned long long) packed[k],
                           (unsigned long long) expected, k == arrays - 1 ? "" : "at most ",
                           (unsigned long long) left);
        left -= packed[k];
    }
    sg_source_skip(in, (uint64_t) arrays * TABLE_ROW);
    return SG_OK;
}

static int take(sg_ctx *ctx, struct sg_source *in, uint8_t *to, size_t n)
{
    while (n) {
        const size_t ready = sg_source_fill(in, 1), some = ready < n ? ready : n;
        if (!ready)
            return sg_short_file(ctx, in);
        memcpy(to, in->window, some);
        sg_source_skip(in, some);
        to += some, n -= some;
    }
    return SG_OK;
}

static int read_frame(sg_ctx *ctx, struct sg_source *in, uint64_t packed, struct sg_model *m,
                      const struct array *a, const struct header *h)
{
    uint8_t *bytes = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, a->width),
            *frame = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) packed + 1, 1);
    int code = bytes && frame ? take(ctx, in, frame, (size_t) packed) : SG_ERR_BUDGET;
    if (!code)
        code = sg_zstd_unpack(ctx, in->path, frame, (size_t) packed, bytes, m->count * a->width);
    for (size_t i = 0; i < m->count && !code; i++)
        a->decode(m, i, bytes + i * a->width, h);
    sg_free(bytes);
    sg_free(frame);
    return code;
}

static int read_zstd(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                     struct sg_model **out)
{
    struct array list[ARRAYS];
    uint64_t packed[ARRAYS];
    struct header h;
    int code = read_table(ctx, in, &h, packed);
    if (!code)
        code = sg_claimed_model(ctx, in, h.count, h.sh_degree, max_gaussians, out);
    for (int k = 0, n = code ? 0 : list_arrays(&h, list); k < n && !code; k++)
        code = read_frame(ctx, in, packed[k], *out, &list[k], &h);
    return code;
}

static int write_zstd(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path,
                      const struct header *h)
{
    struct array list[ARRAYS];
    void *frame[ARRAYS] = {NULL};
    size_t size[ARRAYS];
    uint8_t header[HEADER_4 + ARRAYS * TABLE_ROW] = {0};
    const int arrays = list_arrays(h, list);
    int code = SG_OK;
    put_header(header, h);
    header[15] = (uint8_t) arrays;
    put_bytes(header + 16, HEADER_4, 4);
    for (int k = 0; k < arrays && !code; k++) {
        const size_t n = m->count * list[k].width;
        uint8_t *bytes = sg_alloc_raw(ctx, SG_MEM_MISC, n, 1),
                *row = header + HEADER_4 + k * TABLE_ROW;
        for (size_t i = 0; i < m->count && bytes; i++)
            list[k].encode(m, i, bytes + i * list[k].width, h);
        code = bytes ? sg_zstd_pack(ctx, path, bytes, n, &frame[k], &size[k]) : SG_ERR_BUDGET;
        sg_free(bytes);
        for (int half = 0; half < 2 && !code; half++) {
            put_bytes(row + 4 * half, (uint32_t) ((uint64_t) size[k] >> 32 * half), 4);
            put_bytes(row + 8 + 4 * half, (uint32_t) ((uint64_t) n >> 32 * half), 4);
        }
    }
    if (!code)
        fwrite(header, 1, (size_t) (HEADER_4 + arrays * TABLE_ROW), f);
    for (int k = 0; k < arrays; k++) {
        if (!code)
            fwrite(frame[k], 1, size[k], f);
        sg_free(frame[k]);
    }
    return code;
}

/* ---- all ---- */

int sg_spz_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out)
{
    const char *start = sg_source_peek(in, 4);
    *out = NULL;
    const int code = start && !memcmp(start, "NGSP", 4) ? read_zstd(ctx, in, max_gaussians, out)
                                                        : read_gzip(ctx, in, max_gaussians, out);
    if (code)
        sg_model_destroy(out);
    return code;
}

int sg_spz_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path, int version)
{
    struct header h = {
        .version = (uint32_t) version, .count = (uint32_t) m->count, .sh_degree = m->sh_degree};
    const int code = choose_fraction(ctx, m, path, &h.fraction);
    return code          ? code
           : version < 4 ? write_gzip(ctx, m, f, path, &h)
                         : write_zstd(ctx, m, f, path, &h);
}
