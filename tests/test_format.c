/* SPDX-License-Identifier: Apache-2.0 */
/* Model files of other programs: what a round trip keeps, files made by hand, and damaged ones. */
#include "scene_files.h"

#include "format/codec.h"
#include "models.h"

#include <zlib.h>

/* The most that a value may change: |difference| <= absolute + relative |value|. */
struct slack {
    float position, position_relative, log_scale, opacity, dc, sh, turn;
};

static void assert_near(float found, float expected, float slack, const char *what, size_t i)
{
    if (!(fabsf(found - expected) <= slack))
        fail_msg("Gaussian %zu: %s: found %g, expected %g +- %g", i, what, (double) found,
                 (double) expected, (double) slack);
}

/* Of the rotation from one quaternion to another: 1 - |cos| of half its angle. */
static float turn(const struct sg_model *a, const struct sg_model *b, size_t i)
{
    float p[4], q[4], dot = 0;
    sg_unit_quaternion(a, i, p);
    sg_unit_quaternion(b, i, q);
    for (int k = 0; k < 4; k++)
        dot += p[k] * q[k];
    return 1 - fabsf(dot);
}

static void compare(const struct sg_model *a, const struct sg_model *b, const struct slack *s)
{
    const int degree = a->sh_degree < b->sh_degree ? a->sh_degree : b->sh_degree;
    assert_int_equal(a->count, b->count);
    for (size_t i = 0; i < a->count; i++) {
        for (int k = 0; k < 3; k++) {
            const float x = *sg_model_at(a, i, SG_P_XYZ + k);
            assert_near(*sg_model_at(b, i, SG_P_XYZ + k), x,
                        s->position + s->position_relative * fabsf(x), "position", i);
            assert_near(*sg_model_at(b, i, SG_P_SCALE + k), *sg_model_at(a, i, SG_P_SCALE + k),
                        s->log_scale, "scale", i);
            assert_near(*sg_model_at(b, i, SG_P_SH + k), *sg_model_at(a, i, SG_P_SH + k), s->dc,
                        "sh_dc", i);
        }
        assert_near(sg_logistic(*sg_model_at(b, i, SG_P_OPACITY)),
                    sg_logistic(*sg_model_at(a, i, SG_P_OPACITY)), s->opacity, "opacity", i);
        assert_near(turn(a, b, i), 0, s->turn, "rotation", i);
        for (int k = 3; k < 3 * (degree + 1) * (degree + 1) && s->sh < 9; k++)
            assert_near(*sg_model_at(b, i, SG_P_SH + k), *sg_model_at(a, i, SG_P_SH + k), s->sh,
                        "sh_rest", i);
    }
}

/* Colours within what bytes can hold: 0..1. */
static struct sg_model *make(sg_ctx *ctx, size_t n, int degree)
{
    struct sg_model *m = make_model(ctx, n, degree, 5);
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_SH + k) = draw(9, 3 * i + (size_t) k, -1.7f, 1.7f);
    return m;
}

/* The tolerances that docs/formats.md tells. Positions of the model are within 1 of the origin, so
 * that ranges of chunks are at most 2 wide. */
static const struct {
    const char *file;
    int version;
    struct slack slack;
} trips[] = {
    {"m.ply", 2, {0, 0, 0, 0, 0, 0, 1e-6f}},
    {"m.splat", 2, {0, 0, 1e-6f, 0.5f / 255, 0.51f / 255 / SG_SH_C0, 9, 2e-4f}},
    {"m.spz", 2, {0.51f / 4096, 0, 0.51f / 16, 0.5f / 255, 0.51f / 255 / 0.15f, 0.0665f, 8e-3f}},
    {"m.spz", 3, {0.51f / 4096, 0, 0.51f / 16, 0.5f / 255, 0.51f / 255 / 0.15f, 0.0665f, 3e-6f}},
    {"m.spz", 4, {0.51f / 4096, 0, 0.51f / 16, 0.5f / 255, 0.51f / 255 / 0.15f, 0.0665f, 3e-6f}},
    {"m.compressed.ply",
     2,
     {2 * 0.51f / 1023, 0, 3.5f * 0.51f / 1023, 0.5f / 255, 4 * 0.51f / 255, 1.0f / 64 + 1e-4f,
      2e-6f}},
};

/* Whether a code is that of a build without zstd. */
static bool without_zstd(sg_ctx *ctx, int code)
{
    return code == SG_ERR_USAGE && strstr(sg_last_error(ctx), "needs zstd");
}

/* The Gaussians of a model in the order in which a file has them. */
static struct sg_model *sorted(sg_ctx *ctx, const struct sg_model *m)
{
    uint32_t *order;
    struct sg_model *out;
    bool *found = calloc(m->count, 1);
    assert_int_equal(sg_model_order(ctx, m, &order), SG_OK);
    assert_int_equal(sg_model_create(ctx, m->count, m->sh_degree, &out), SG_OK);
    for (size_t i = 0; i < m->count; i++) {
        assert_true(order[i] < m->count && !found[order[i]]);
        found[order[i]] = true;
        sg_model_copy_row(m, order[i], out, i);
    }
    free(found);
    sg_free(order);
    return out;
}

static void test_round_trips(void **state)
{
    struct fixture *f = *state;
    for (size_t t = 0; t < sizeof(trips) / sizeof(trips[0]); t++)
        for (int degree = 0; degree <= 3; degree++)
            for (size_t n = 1; n <= 700; n = n == 1 ? 256 : n == 256 ? 700 : 701) {
                struct sg_model *m = make(f->ctx, n, degree), *back;
                const struct sg_model_file file = {.spz_version = trips[t].version};
                const int code = sg_model_write(f->ctx, m, at(f, trips[t].file), &file);
                if (without_zstd(f->ctx, code)) {
                    sg_model_destroy(&m);
                    continue;
                }
                assert_int_equal(code, SG_OK);
                if (sg_model_read(f->ctx, f->path, n, &back))
                    fail_msg("%s", sg_last_error(f->ctx));
                assert_int_equal(back->sh_degree, strstr(f->path, ".splat") ? 0 : degree);
                struct sg_model *as_written =
                    strstr(f->path, ".compressed") ? sorted(f->ctx, m) : NULL;
                compare(as_written ? as_written : m, back, &trips[t].slack);
                sg_model_destroy(&as_written);
                sg_model_destroy(&back);
                /* One more is refused, by a message with both numbers. */
                if (n > 1) {
                    assert_int_equal(sg_model_read(f->ctx, f->path, n - 1, &back), SG_ERR_INPUT);
                    assert_null(back);
                }
                sg_model_destroy(&m);
            }
}

/* What was read is written as the same bytes again: no drift over many conversions. */
static void test_second_trip_is_exact(void **state)
{
    struct fixture *f = *state;
    static const char *const names[] = {"a.splat", "a.spz"};
    for (int k = 0; k < 2; k++) {
        struct sg_model *m = make(f->ctx, 300, 3), *once, *twice;
        assert_int_equal(sg_model_write(f->ctx, m, at(f, names[k]), NULL), SG_OK);
        assert_int_equal(sg_model_read(f->ctx, f->path, 300, &once), SG_OK);
        assert_int_equal(sg_model_write(f->ctx, once, f->path, NULL), SG_OK);
        assert_int_equal(sg_model_read(f->ctx, f->path, 300, &twice), SG_OK);
        compare(once, twice, &(struct slack){0, 0, 2e-7f, 1e-6f, 1e-6f, 1e-6f, 2e-4f});
        sg_model_destroy(&m);
        sg_model_destroy(&once);
        sg_model_destroy(&twice);
    }
}

/* A .splat of two rows, byte by byte. */
static void test_splat_bytes(void **state)
{
    struct fixture *f = *state;
    const float numbers[6] = {1, -2, 3, 1, expf(-2), 0};
    uint8_t row[64] = {0};
    struct sg_model *m;
    memcpy(row, numbers, 24);
    memcpy(row + 24, (uint8_t[]){255, 0, 128, 0, 255, 128, 0, 128}, 8);
    put(f, "s.splat", row, 64);
    assert_int_equal(sg_model_read(f->ctx, at(f, "s.splat"), 2, &m), SG_OK);
    assert_int_equal(m->count, 2);
    assert_near(*sg_model_at(m, 0, SG_P_XYZ + 1), -2, 0, "y", 0);
    assert_near(*sg_model_at(m, 0, SG_P_SCALE), 0, 0, "scale_0", 0);
    assert_near(*sg_model_at(m, 0, SG_P_SCALE + 1), -2, 1e-6f, "scale_1", 0);
    assert_near(*sg_model_at(m, 0, SG_P_SCALE + 2), -20, 0, "scale_2 of 0", 0);
    assert_near(*sg_model_at(m, 0, SG_P_SH), 1.7724539f, 1e-5f, "red", 0);
    assert_near(*sg_model_at(m, 0, SG_P_SH + 1), -1.7724539f, 1e-5f, "green", 0);
    assert_near(*sg_model_at(m, 0, SG_P_OPACITY), logf(0.25f / 254.75f), 1e-5f, "opacity 0", 0);
    assert_near(*sg_model_at(m, 0, SG_P_ROT), 127 / 128.0f, 0, "w", 0);
    assert_near(*sg_model_at(m, 0, SG_P_ROT + 2), -1, 0, "y of the rotation", 0);
    sg_model_destroy(&m);
}

/* Files that begin with a float are not taken for others by their first bytes. */
static void test_splat_marks(void **state)
{
    struct fixture *f = *state;
    static const char *const marks[] = {"\x1f\x8b\x00\x3f", "ply\x3f", "glTF"};
    for (int k = 0; k < 3; k++) {
        struct sg_model *m = make(f->ctx, 3, 0), *back;
        for (size_t i = 0; i < 3; i++)
            memcpy(sg_model_at(m, i, SG_P_XYZ), marks[k], 4);
        assert_int_equal(sg_model_write(f->ctx, m, at(f, "s.splat"), NULL), SG_OK);
        if (sg_model_read_drawable(f->ctx, f->path, 3, &back))
            fail_msg("%s", sg_last_error(f->ctx));
        assert_memory_equal(sg_model_at(back, 0, SG_P_XYZ), marks[k], 4);
        sg_model_destroy(&m);
        sg_model_destroy(&back);
    }
}

/* Equal Gaussians: what is written can be read. */
static void test_equal(void **state)
{
    struct fixture *f = *state;
    enum { N = 200000 };
    struct sg_model *m, *back;
    assert_int_equal(sg_model_create(f->ctx, N, 0, &m), SG_OK);
    for (size_t i = 0; i < N; i++)
        *sg_model_at(m, i, SG_P_ROT) = 1;
    for (int k = 0; k < 3; k++) {
        struct sg_model_file file = sg_model_file_default();
        file.spz_version = k == 1 ? 4 : 3;
        const int code = sg_model_write(f->ctx, m, at(f, k == 2 ? "e.sog" : "e.spz"), &file);
        assert_int_equal(code, k ? SG_ERR_INPUT : SG_OK);
        if (k) {
            assert_non_null(strstr(sg_last_error(f->ctx), "200000 Gaussians"));
            continue;
        }
        assert_int_equal(sg_model_read(f->ctx, f->path, N, &back), SG_OK);
        sg_model_destroy(&back);
    }
    sg_model_destroy(&m);
}

static void put_gzip(struct fixture *f, const char *name, const void *data, size_t size)
{
    uint8_t packed[4096];
    z_stream z = {0};
    assert_int_equal(deflateInit2(&z, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
    z.next_in = (unsigned char *) (uintptr_t) data, z.avail_in = (unsigned) size;
    z.next_out = packed, z.avail_out = sizeof(packed);
    assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
    put(f, name, packed, z.total_out);
    deflateEnd(&z);
}

/* Headers of .spz that are refused, each with what is wrong in the message. */
static void test_spz_headers(void **state)
{
    struct fixture *f = *state;
    const uint8_t good[16 + 20] = {'N', 'G', 'S', 'P', 2, 0, 0, 0, 1, 0, 0, 0, 0, 12};
    static const struct {
        int at, value;
        const char *says;
    } cases[] = {{0, 'M', "something else"}, {4, 1, "version 1"},       {4, 4, "version 4"},
                 {8, 0, "0 Gaussians"},      {8, 2, "too little data"}, {11, 200, "cannot hold"},
                 {12, 4, "SH degree 4"},     {13, 24, "24 bits"},       {14, 2, "extensions"}};
    struct sg_model *m;
    put_gzip(f, "good.spz", good, 16 + 19);
    assert_int_equal(sg_model_read(f->ctx, at(f, "good.spz"), 9, &m), SG_OK);
    sg_model_destroy(&m);
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        uint8_t bytes[16 + 19];
        memcpy(bytes, good, sizeof(bytes));
        bytes[cases[k].at] = (uint8_t) cases[k].value;
        put_gzip(f, "bad.spz", bytes, sizeof(bytes));
        assert_int_equal(sg_model_read(f->ctx, at(f, "bad.spz"), 9, &m), SG_ERR_INPUT);
        if (!strstr(sg_last_error(f->ctx), cases[k].says))
            fail_msg("\"%s\" does not say \"%s\"", sg_last_error(f->ctx), cases[k].says);
    }
    uint8_t flagged[16 + 19];
    memcpy(flagged, good, sizeof(flagged));
    flagged[14] = 1;
    put_gzip(f, "flagged.spz", flagged, sizeof(flagged));
    assert_int_equal(f->warnings, 0);
    assert_int_equal(sg_model_read(f->ctx, at(f, "flagged.spz"), 9, &m), SG_OK);
    assert_non_null(strstr(f->said, "flagged.spz: the model was trained with antialiasing"));
    sg_model_destroy(&m);
    put_gzip(f, "long.spz", good, 16 + 20);
    assert_int_equal(sg_model_read(f->ctx, at(f, "long.spz"), 9, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "behind the last Gaussian"));
}

/* Version 4: its header and table, which say how large each frame is. */
static void test_spz_4(void **state)
{
    struct fixture *f = *state;
    static const struct {
        int at, value;
        const char *says;
    } cases[] = {{4, 5, "version 5, expected 4"},
                 {8, 99, "array 0: found 2700 bytes"},
                 {11, 200, "cannot hold"},
                 {12, 4, "SH degree 4"},
                 {12, 0, "found 6 arrays, expected 5"},
                 {13, 24, "24 bits"},
                 {14, 2, "extensions"},
                 {15, 5, "found 5 arrays, expected 6"},
                 {16, 31, "table at byte 31"},
                 {18, 1, "table at byte 65568"},
                 {16, 33, "array 0: found"},
                 {33, 200, "array 0: found 2700 bytes packed in"},
                 {32, 3, "array 5: found"},
                 {127, 1, "array 5: found"},
                 {128, 0, "damaged data"},
                 {133, 0, "damaged data"}};
    struct sg_model *m = make(f->ctx, 300, 1), *back;
    char *bytes;
    size_t size;
    const int code =
        sg_model_write(f->ctx, m, at(f, "m.spz"), &(struct sg_model_file){.spz_version = 4});
    sg_model_destroy(&m);
    if (without_zstd(f->ctx, code))
        skip();
    assert_int_equal(code, SG_OK);
    assert_int_equal(sg_file_read(f->ctx, f->path, 1 << 20, &bytes, &size), SG_OK);
    assert_memory_equal(bytes, "NGSP\4\0\0\0\54\1\0\0\1\14\0\6\40\0\0\0", 20);
    static const int widths[] = {9, 1, 3, 3, 4, 9};
    size_t sum = 32 + 6 * 16;
    for (int k = 0; k < 6; k++) {
        sum += sg_u32(bytes + 32 + 16 * k);
        assert_int_equal(sg_u32(bytes + 40 + 16 * k), 300 * widths[k]);
    }
    assert_int_equal(sum, size);
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const char kept = bytes[cases[k].at];
        bytes[cases[k].at] = (char) cases[k].value;
        put(f, "bad.spz", bytes, size);
        bytes[cases[k].at] = kept;
        assert_int_equal(sg_model_read(f->ctx, at(f, "bad.spz"), 1 << 30, &back), SG_ERR_INPUT);
        assert_null(back);
        if (!strstr(sg_last_error(f->ctx), cases[k].says))
            fail_msg("\"%s\" does not say \"%s\"", sg_last_error(f->ctx), cases[k].says);
    }
    for (size_t cut = 1; cut < size; cut += 13) {
        put(f, "bad.spz", bytes, size - cut);
        assert_int_equal(sg_model_read(f->ctx, at(f, "bad.spz"), 1 << 30, &back), SG_ERR_INPUT);
    }
    sg_free(bytes);
}

static void put_u32(uint8_t *to, uint32_t v)
{
    memcpy(to, &v, 4);
}

static uint16_t to_half(float v) /* smaller ones than normal halves become 0 */
{
    int exponent;
    const float m = frexpf(fabsf(v), &exponent);
    return v == 0 || exponent < -13 ? 0
                                    : (uint16_t) ((v < 0 ? 0x8000 : 0) | (exponent + 14) << 10 |
                                                  ((int) lrintf(m * 2048) - 1024));
}

/* A .ksplat of a model as the level of compression says; returns its size. Buckets of 4. */
static size_t make_ksplat(const struct sg_model *m, int level, uint8_t *file)
{
    const uint32_t n = (uint32_t) m->count, full = n / 4, partial = n % 4 != 0,
                   buckets = level ? full + partial : 0;
    const float block = 5, low = -1, high = 1;
    uint8_t *s = file + 4096, *to = s + 1024;
    memset(file, 0, 4096 + 1024);
    file[1] = 1, file[20] = (uint8_t) level;
    put_u32(file + 4, 1), put_u32(file + 8, 1), put_u32(file + 12, n), put_u32(file + 16, n);
    memcpy(file + 36, &low, 4), memcpy(file + 40, &high, 4);
    put_u32(s, n), put_u32(s + 4, n + 1), put_u32(s + 8, 4), put_u32(s + 12, buckets);
    memcpy(s + 16, &block, 4);
    s[20] = level ? 12 : 0;
    put_u32(s + 32, level ? full : 0), put_u32(s + 36, level ? partial : 0);
    s[40] = (uint8_t) m->sh_degree;
    if (level && partial)
        put_u32(to, n % 4), to += 4;
    for (uint32_t b = 0; b < buckets; b++) /* its centre is its number */
        for (int k = 0; k < 3; k++, to += 4)
            memcpy(to, &(float){0.01f * (float) b}, 4);
    const int order[] = {SG_P_SCALE,   SG_P_SCALE + 1, SG_P_SCALE + 2, SG_P_ROT,
                         SG_P_ROT + 1, SG_P_ROT + 2,   SG_P_ROT + 3};
    for (uint32_t i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++) {
            const float x = *sg_model_at(m, i, SG_P_XYZ + k);
            const int q = (int) lrintf((x - 0.01f * (float) (i / 4)) / (block / 2) * 32767) + 32767;
            if (level)
                memcpy(to, &(uint16_t){(uint16_t) q}, 2), to += 2;
            else
                memcpy(to, &x, 4), to += 4;
        }
        for (int k = 0; k < 7; k++) {
            float v = *sg_model_at(m, i, order[k]);
            v = k < 3 ? expf(v) : v;
            if (level)
                memcpy(to, &(uint16_t){to_half(v)}, 2), to += 2;
            else
                memcpy(to, &v, 4), to += 4;
        }
        for (int k = 0; k < 3; k++)
            *to++ = sg_byte_of_dc(*sg_model_at(m, i, SG_P_SH + k));
        *to++ = sg_byte(255 * sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)));
        for (int d = 1, first = 1; d <= m->sh_degree; first += 2 * d + 1, d++)
            for (int c = 0; c < 3; c++)
                for (int k = first; k < first + 2 * d + 1; k++) {
                    const float v = *sg_model_at(m, i, SG_P_SH + 3 * k + c);
                    if (level == 0)
                        memcpy(to, &v, 4), to += 4;
                    else if (level == 1)
                        memcpy(to, &(uint16_t){to_half(v)}, 2), to += 2;
                    else
                        *to++ = (uint8_t) lrintf((v + 1) / 2 * 255);
                }
    }
    const size_t row = (size_t) (to - s - 1024) / (n ? n : 1) + 64; /* room for one more */
    memset(to, 0, row);
    return (size_t) (to - file) + row;
}

static void test_ksplat(void **state)
{
    struct fixture *f = *state;
    uint8_t *file = malloc(1 << 20);
    const struct slack slack[3] = {
        {0, 0, 1e-6f, 0.5f / 255, 0.51f / 255 / SG_SH_C0, 0, 1e-6f},
        {1e-4f, 0, 1e-3f, 0.5f / 255, 0.51f / 255 / SG_SH_C0, 2e-4f, 1e-5f},
        {1e-4f, 0, 1e-3f, 0.5f / 255, 0.51f / 255 / SG_SH_C0, 0.51f * 2 / 255, 1e-5f}};
    for (int level = 0; level <= 2; level++)
        for (int degree = 0; degree <= 3; degree++) {
            struct sg_model *m = make(f->ctx, 23, degree), *back;
            put(f, "m.ksplat", file, make_ksplat(m, level, file));
            if (sg_model_read(f->ctx, at(f, "m.ksplat"), 100, &back))
                fail_msg("%s", sg_last_error(f->ctx));
            assert_int_equal(back->sh_degree, degree);
            compare(m, back, &slack[level]);
            sg_model_destroy(&m);
            sg_model_destroy(&back);
        }
    free(file);
}

/* A random change or end of each kind of file is read or refused, but harms nothing. */
static void test_damage(void **state)
{
    struct fixture *f = *state;
    static const char *const names[] = {"d.splat", "d.spz", "d.compressed.ply", "d.ksplat",
                                        "4.spz"};
    uint8_t *made = malloc(1 << 20);
    for (int n = 0; n < 5; n++) {
        struct sg_model *m = make(f->ctx, 300, 1), *back;
        char *data;
        size_t size;
        const struct sg_model_file file = {.spz_version = n == 4 ? 4 : 3};
        int code = SG_OK;
        if (n == 3)
            put(f, names[n], made, make_ksplat(m, 1, made));
        else
            code = sg_model_write(f->ctx, m, at(f, names[n]), &file);
        if (without_zstd(f->ctx, code)) {
            sg_model_destroy(&m);
            break;
        }
        assert_int_equal(code, SG_OK);
        assert_int_equal(sg_file_read(f->ctx, at(f, names[n]), 1 << 20, &data, &size), SG_OK);
        int refused = 0;
        for (uint64_t k = 0; k < 400; k++) {
            const uint64_t random = sg_rng_u64(3, SG_RNG_SYNTH, (uint64_t) n, k);
            /* Most of what can go wrong is in the headers. */
            const size_t where = (size_t) (random >> 8) % (random & 1   ? size
                                                           : size < 200 ? size
                                                                        : 200);
            const bool header = n == 3 && random & 2;
            const size_t place = header ? 4096 + where % 64 : where;
            const char kept = data[place];
            const bool cut = k % 4 == 0;
            data[place] = (char) (random >> 40);
            put(f, names[n], data, cut ? place : size);
            data[place] = kept;
            code = sg_model_read(f->ctx, at(f, names[n]), 1000, &back);
            assert_true(code == SG_OK || code == SG_ERR_INPUT);
            assert_true((code == SG_OK) == (back != NULL));
            assert_true(code == SG_OK || strstr(sg_last_error(f->ctx), names[n]));
            refused += code != SG_OK;
            sg_model_destroy(&back);
        }
        assert_true(refused > 90); /* those that were cut */
        sg_free(data);
        sg_model_destroy(&m);
    }
    free(made);
}

static void test_writing_refusals(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make(f->ctx, 3, 0);
    assert_int_equal(sg_model_write(f->ctx, m, at(f, "m.ksplat"), NULL), SG_ERR_USAGE);
    assert_int_equal(sg_model_write(f->ctx, m, at(f, "m.xyz"), NULL), SG_ERR_USAGE);
    assert_int_equal(
        sg_model_write(f->ctx, m, at(f, "m.spz"), &(struct sg_model_file){.spz_version = 5}),
        SG_ERR_USAGE);
    *sg_model_at(m, 1, SG_P_XYZ) = 9e6f;
    assert_int_equal(sg_model_write(f->ctx, m, at(f, "m.spz"), NULL), SG_ERR_INPUT);
    *sg_model_at(m, 1, SG_P_XYZ) = 8e6f; /* whole numbers fit */
    assert_int_equal(sg_model_write(f->ctx, m, at(f, "m.spz"), NULL), SG_OK);
    *sg_model_at(m, 1, SG_P_XYZ) = NAN;
    unlink(at(f, "m.spz"));
    static const char *const names[] = {"m.spz", "m.splat", "m.compressed.ply", "m.sog", "m.glb"};
    for (int k = 0; k < 5; k++) {
        assert_int_equal(sg_model_write(f->ctx, m, at(f, names[k]), NULL), SG_ERR_INPUT);
        assert_false(sg_file_exists(f->path));
    }
    sg_model_destroy(&m);
}

static void test_select(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make(f->ctx, 400, 3), *kept;
    struct sg_model_selection s = {.sh_degree = 1,
                                   .crop = true,
                                   .low = {-0.5, -1, -1},
                                   .high = {0.5, 1, 1},
                                   .min_opacity = 0.5};
    assert_int_equal(sg_model_select(f->ctx, m, &s, &kept), SG_OK);
    assert_int_equal(kept->sh_degree, 1);
    size_t to = 0;
    for (size_t i = 0; i < m->count; i++) {
        if (fabsf(*sg_model_at(m, i, 0)) > 0.5f || *sg_model_at(m, i, SG_P_OPACITY) < 0)
            continue;
        assert_true(to < kept->count);
        for (int p = 0; p < sg_param_count(1); p++)
            assert_memory_equal(sg_model_at(kept, to, p), sg_model_at(m, i, p), 4);
        to++;
    }
    assert_int_equal(to, kept->count);
    assert_in_range(to, 50, 200);
    sg_model_destroy(&kept);
    s.low[0] = s.high[0] = 7;
    assert_int_equal(sg_model_select(f->ctx, m, &s, &kept), SG_ERR_INPUT);
    s.low[0] = 8;
    assert_int_equal(sg_model_select(f->ctx, m, &s, &kept), SG_ERR_USAGE);
    s.crop = false, s.min_opacity = NAN;
    assert_int_equal(sg_model_select(f->ctx, m, &s, &kept), SG_ERR_USAGE);
    assert_null(kept);
    sg_model_destroy(&m);
}

/* The sum of the extents of 256 Gaussians at a time. */
static double extents(const struct sg_model *m)
{
    double sum = 0;
    for (size_t first = 0; first < m->count; first += 256)
        for (int k = 0; k < 3; k++) {
            float low = INFINITY, high = -INFINITY;
            for (size_t i = first; i < m->count && i < first + 256; i++) {
                low = fminf(low, *sg_model_at(m, i, k));
                high = fmaxf(high, *sg_model_at(m, i, k));
            }
            sum += (double) (high - low);
        }
    return sum;
}

/* Neighbours share a chunk of a compressed PLY, wherever they are in the model. */
static void test_chunks(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make(f->ctx, 4000, 1), *back;
    assert_int_equal(sg_model_write(f->ctx, m, at(f, "c.compressed.ply"), NULL), SG_OK);
    assert_int_equal(sg_model_read(f->ctx, f->path, 4000, &back), SG_OK);
    assert_true(extents(back) < 0.7 * extents(m));
    sg_model_destroy(&back);
    sg_model_destroy(&m);
}

/* A model without Gaussians can be made, but no format has it. */
static void test_empty(void **state)
{
    struct fixture *f = *state;
    static const char *const names[] = {"m.ply", "m.compressed.ply", "m.splat", "m.spz", "m.sog",
                                        "m.glb"};
    struct sg_model *m;
    assert_int_equal(sg_model_create(f->ctx, 0, 1, &m), SG_OK);
    for (int k = 0; k < 6; k++) {
        assert_int_equal(sg_model_write(f->ctx, m, at(f, names[k]), NULL), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(f->ctx), "found no Gaussians"));
        assert_false(sg_file_exists(f->path));
    }
    sg_model_destroy(&m);
}

/* Gaussians seen by a camera are those of the mirrored axes seen by a mirrored camera: signs of
 * rotations and SH belong together. */
static void test_axes(void **state)
{
    struct fixture *f = *state;
    static const struct sg_axes axes[] = {{1, -1, -1}, {-1, -1, 1}, {-1, 1, -1}};
    enum { SIDE = 32, VALUES = 3 * SIDE * SIDE };
    float *images = malloc(2 * VALUES * sizeof(float));
    for (int t = 0; t < 3; t++) {
        struct sg_model *m = make(f->ctx, 40, 3);
        struct sg_camera camera = make_camera(SIDE, SIDE, 4);
        sg_renderer *r;
        for (int pass = 0; pass < 2; pass++) {
            assert_int_equal(sg_renderer_create(f->ctx, "ref", NULL, m, NULL, &r), SG_OK);
            assert_int_equal(sg_render(r, &camera, images + pass * VALUES, NULL, NULL, NULL),
                             SG_OK);
            sg_renderer_destroy(&r);
            const int sign[3] = {axes[t].x, axes[t].y, axes[t].z};
            int quaternion[4], sh[15];
            sg_axes_signs(axes[t], quaternion, sh);
            for (size_t i = 0; i < m->count; i++) {
                for (int k = 0; k < 3; k++)
                    *sg_model_at(m, i, SG_P_XYZ + k) *= (float) sign[k];
                for (int k = 0; k < 4; k++)
                    *sg_model_at(m, i, SG_P_ROT + k) *= (float) quaternion[k];
                for (int k = 0; k < 45; k++)
                    *sg_model_at(m, i, SG_P_SH + 3 + k) *= (float) sh[k / 3];
            }
            for (int k = 0; k < 9; k++)
                camera.R[k] *= sign[k % 3];
        }
        for (int k = 0; k < VALUES; k++)
            assert_near(images[VALUES + k], images[k], 1e-5f, "pixel", (size_t) k);
        sg_model_destroy(&m);
    }
    free(images);
}

/* Files hold scales where models hold their logarithms. */
static void test_large_scales(void **state)
{
    (void) state;
    assert_true(isfinite(sg_finite_scale(1e30f)));
    assert_true(sg_finite_scale(80) == expf(80) && sg_finite_scale(-200) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_round_trips),  scene_test(test_second_trip_is_exact),
        scene_test(test_splat_bytes),  scene_test(test_splat_marks),
        scene_test(test_equal),        scene_test(test_spz_headers),
        scene_test(test_spz_4),        scene_test(test_ksplat),
        scene_test(test_damage),       scene_test(test_writing_refusals),
        scene_test(test_select),       scene_test(test_chunks),
        scene_test(test_empty),        scene_test(test_axes),
        scene_test(test_large_scales),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
