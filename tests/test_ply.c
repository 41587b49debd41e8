/* SPDX-License-Identifier: Apache-2.0 */
/* PLY files of other trainers, and malformed ones. */
#include "scene_files.h"

#include "models.h"

enum encoding { ASCII, LITTLE, BIG };

struct text {
    char *bytes;
    size_t size, room;
};

static __attribute__((noinline)) void append(struct text *t, const void *bytes, size_t n)
{
    if (t->size + n + 1 > t->room) /* doubled: a sanitizer moves the text each time */
        t->bytes = realloc(t->bytes, t->room = 2 * (t->size + n + 1));
    memcpy(t->bytes + t->size, bytes, n);
    t->bytes[t->size += n] = 0;
}

static void number(struct text *t, enum encoding e, bool is_double, float value)
{
    char bytes[64];
    size_t n = is_double ? 8 : 4;
    const double d = (double) value;
    if (e == ASCII)
        n = (size_t) snprintf(bytes, sizeof(bytes), "%.9g ", d);
    else {
        memcpy(bytes, is_double ? (const void *) &d : (const void *) &value, n);
        for (size_t i = 0; e == BIG && i < n / 2; i++) {
            const char kept = bytes[i];
            bytes[i] = bytes[n - 1 - i], bytes[n - 1 - i] = kept;
        }
    }
    append(t, bytes, n);
}

static void property_name(int plane, int degree, char name[24])
{
    const int per_channel = (degree + 1) * (degree + 1) - 1, sh = plane - SG_P_SH;
    if (plane < SG_P_OPACITY)
        snprintf(name, 24, "%c", 'x' + plane);
    else if (plane == SG_P_OPACITY)
        snprintf(name, 24, "opacity");
    else if (plane < SG_P_ROT)
        snprintf(name, 24, "scale_%d", plane - SG_P_SCALE);
    else if (plane < SG_P_SH)
        snprintf(name, 24, "rot_%d", plane - SG_P_ROT);
    else if (sh < 3)
        snprintf(name, 24, "f_dc_%d", sh);
    else
        snprintf(name, 24, "f_rest_%d", sh % 3 * per_channel + sh / 3 - 1);
}

/* A model as a stranger's exporter might write it: properties shuffled, some doubles, a list, other
 * elements around. */
static void put_model(struct fixture *f, const struct sg_model *m, enum encoding e, uint64_t seed)
{
    static const char *const formats[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    const int planes = sg_param_count(m->sh_degree);
    int order[SG_PARAMS_MAX];
    for (int i = 0; i < planes; i++)
        order[i] = i;
    for (int i = planes - 1; i > 0; i--) {
        const int j = (int) (sg_rng_u64(seed, SG_RNG_SYNTH, 5, (uint64_t) i) % (uint64_t) (i + 1)),
                  kept = order[i];
        order[i] = order[j], order[j] = kept;
    }
    struct text t = {0};
    char line[128];
    int n =
        snprintf(line, sizeof(line),
                 "ply\r\nformat %s 1.0\r\ncomment by nobody\r\nelement camera 2\r\n", formats[e]);
    append(&t, line, (size_t) n);
    const char *camera = "property list uchar float ignored\r\nproperty float y\r\n";
    append(&t, camera, strlen(camera));
    n = snprintf(line, sizeof(line), "element vertex %zu\r\nproperty list uint short tags\r\n",
                 m->count);
    append(&t, line, (size_t) n);
    for (int i = 0; i < planes; i++) {
        char name[24];
        property_name(order[i], m->sh_degree, name);
        n = snprintf(line, sizeof(line), "property %s %s\r\n", order[i] % 5 ? "float" : "float64",
                     name);
        append(&t, line, (size_t) n);
    }
    const char *last = "element face 1\r\nproperty list int int corners\r\nend_header\r\n";
    append(&t, last, strlen(last));
    for (int row = 0; row < 2; row++) {
        append(&t, e == ASCII ? "2 " : "\2", e == ASCII ? 2 : 1);
        for (int k = 0; k < 3; k++)
            number(&t, e, false, (float) k);
    }
    for (size_t i = 0; i < m->count; i++) {
        const char *tags[] = {"1 -7 ", "\1\0\0\0\xf9\xff", "\0\0\0\1\xff\xf9"};
        append(&t, tags[e], e == ASCII ? strlen(tags[e]) : 6);
        for (int k = 0; k < planes; k++)
            number(&t, e, !(order[k] % 5), *sg_model_at(m, i, order[k]));
        if (e == ASCII)
            append(&t, "\n", 1);
    }
    static const char little[] = "\2\0\0\0\0\0\0\0\1\0\0\0", big[] = "\0\0\0\2\0\0\0\0\0\0\0\1";
    append(&t, e == ASCII ? "2 0 1 " : e == LITTLE ? little : big, e == ASCII ? 6 : 12);
    put(f, "m.ply", t.bytes, t.size);
    free(t.bytes);
}

static void test_encodings(void **state)
{
    struct fixture *f = *state;
    uint64_t seed = 0;
    for (enum encoding e = ASCII; e <= BIG; e++)
        for (int degree = 0; degree <= 3; degree++) {
            struct sg_model *m = make_model(f->ctx, 19, degree, ++seed), *back;
            put_model(f, m, e, seed);
            if (sg_model_read_ply(f->ctx, at(f, "m.ply"), 100, &back))
                fail_msg("%s", sg_last_error(f->ctx));
            assert_int_equal(back->sh_degree, degree);
            for (size_t i = 0; i < m->count; i++)
                for (int p = 0; p < sg_param_count(degree); p++)
                    if (memcmp(sg_model_at(m, i, p), sg_model_at(back, i, p), 4))
                        fail_msg("encoding %d, degree %d, Gaussian %zu, plane %d: %a, expected %a",
                                 (int) e, degree, i, p, (double) *sg_model_at(back, i, p),
                                 (double) *sg_model_at(m, i, p));
            sg_model_destroy(&m);
            sg_model_destroy(&back);
        }
}

/* Wherever the file ends, reading fails by name; nothing is left behind. One byte more is refused
 * too. */
static void test_every_cut(void **state)
{
    struct fixture *f = *state;
    for (enum encoding e = ASCII; e <= BIG; e++) {
        struct sg_model *m = make_model(f->ctx, 3, 1, 8), *back;
        char *data;
        size_t size;
        put_model(f, m, e, 5);
        assert_int_equal(sg_file_read(f->ctx, at(f, "m.ply"), 1 << 20, (void *) &data, &size),
                         SG_OK);
        const size_t lax = e == ASCII ? 1 : 0; /* the last number needs no separator */
        for (size_t cut = 0; cut + lax < size; cut++) {
            put(f, "cut.ply", data, cut);
            assert_int_equal(sg_model_read_ply(f->ctx, at(f, "cut.ply"), 100, &back), SG_ERR_INPUT);
            assert_null(back);
            assert_non_null(strstr(sg_last_error(f->ctx), "cut.ply: "));
        }
        put(f, "cut.ply", data, size + 1); /* with the zero byte that ends it in memory */
        assert_int_equal(sg_model_read_ply(f->ctx, at(f, "cut.ply"), 100, &back), SG_ERR_INPUT);
        assert_null(back);
        assert_non_null(strstr(sg_last_error(f->ctx), "1 bytes after the last row"));
        sg_free(data);
        sg_model_destroy(&m);
    }
}

/* What some editors put before a text. */
static void test_marks(void **state)
{
    struct fixture *f = *state;
    static const char *const bodies[] = {"\xef\xbb\xbf", "\xff\xfe", "\xfe\xff"};
    float *xyz;
    uint8_t *rgb;
    size_t n;
    for (int i = 0; i < 3; i++) {
        char text[256];
        snprintf(text, sizeof(text),
                 "%sply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
                 "y\nproperty float z\n"
                 "end_header\n1 2 3\n\n",
                 bodies[i]);
        put_text(f, "p.ply", text);
        const int code = sg_points_read_ply(f->ctx, at(f, "p.ply"), 9, &xyz, &rgb, &n);
        assert_int_equal(code, i ? SG_ERR_INPUT : SG_OK);
        if (i)
            assert_non_null(strstr(sg_last_error(f->ctx), "UTF-16"));
        else
            assert_true(xyz[2] == 3);
        sg_points_destroy(&xyz, &rgb);
    }
}

/* Larger than the window through which a file is read: rows, lists and words lie across its
 * edges. */
static void test_long_files(void **state)
{
    struct fixture *f = *state;
    for (enum encoding e = ASCII; e <= BIG; e++) {
        struct sg_model *m = make_model(f->ctx, 5003, 1, 77), *back;
        put_model(f, m, e, 3);
        if (sg_model_read_ply(f->ctx, at(f, "m.ply"), 10000, &back))
            fail_msg("%s", sg_last_error(f->ctx));
        for (size_t i = 0; i < m->count; i++)
            for (int p = 0; p < sg_param_count(1); p++)
                assert_memory_equal(sg_model_at(m, i, p), sg_model_at(back, i, p), 4);
        sg_model_destroy(&m);
        sg_model_destroy(&back);
    }
    assert_true(sg_mem_peak(f->ctx, SG_MEM_MISC) <
                1 << 20); /* the model is the only thing that grows */
}

#define GOOD                                                                                       \
    "property float x\nproperty float y\nproperty float z\nproperty float opacity\nproperty "      \
    "float scale_0\n"                                                                              \
    "property float scale_1\nproperty float scale_2\nproperty float rot_0\nproperty float rot_1\n" \
    "property float rot_2\nproperty float rot_3\nproperty float f_dc_0\nproperty float f_dc_1\n"   \
    "property float f_dc_2\n"

static void test_hostile_headers(void **state)
{
    struct fixture *f = *state;
    static const struct {
        const char *text, *word;
        int code;
    } cases[] = {
        {"", "line 1", SG_ERR_INPUT},
        {"ply", "line 1", SG_ERR_INPUT},
        {"plyx\n", "line 1", SG_ERR_INPUT},
        {"ply\nformat ascii 2.0\n", "line 2", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nformat ascii 1.0\n", "line 3", SG_ERR_INPUT},
        {"ply\nelement vertex 1\nproperty float x\nend_header\n", "no format", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nproperty float x\n", "line 3", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex -1\n", "line 3", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex\n", "line 3", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 99999999999999999999\n", "line 3", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n", "line 4", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty list float float x\n", "line 4",
         SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nnonsense\n", "line 3", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element vertex", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 4\nend_header\n", "no property", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 0\n" GOOD "end_header\n", "found 0", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\n" GOOD "property float f_rest_0\nend_header\n"
         "1 2 3 4 5 6 7 8 9 10 11 12 13 14 15\n",
         "1 f_rest", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
         "no property", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\n" GOOD
         "end_header\n1 2 3 4 5 6 7 8 9 ten 11 12 13 14\n",
         "ten", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\n" GOOD
         "end_header\n1 2 3 4 5 6 7 8 9 10 11 12 13\n",
         "end of the file", SG_ERR_INPUT},
        {"ply\nformat binary_little_endian 1.0\nelement vertex 1844674407370955161\n" GOOD
         "end_header\n1234",
         "expected 1844674407370955161 rows", SG_ERR_INPUT},
        {"ply\nformat binary_little_endian 1.0\nelement vertex 400000000000000000\n" GOOD
         "end_header\n1234",
         "rows", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement other 1\nproperty list uint float q\nelement vertex "
         "1\n" GOOD "end_header\n4000000000 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16\n",
         "list of 4e+09", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement other 1\nproperty list int float q\nelement vertex "
         "1\n" GOOD "end_header\n-1 1 2 3 4 5 6 7 8 9 10 11 12 13 14\n",
         "list of -1", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement other 1844674407370955161\nelement vertex 1\n" GOOD
         "end_header\n1 2 3\n",
         "rows", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 3\n" GOOD
         "end_header\n1 2 3 4 5 6 7 8 9 10 11 12 13 14\n1 2 3 4 5 6 7 8 9 10 11 12 13 14\n1 2 3 4 "
         "5 6 7 8 9 10 11 12 13 14\n",
         "limit is 2", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
         "int x\n",
         "line 6: found property x twice", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty list uchar int x\n",
         "line 5: found property x twice", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement vertex 1\n",
         "line 5: found element vertex twice", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1 2\n", "line 3", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x y\n", "line 4", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\n" GOOD
         "end_header\n1 2 3 4 5 6 7 8 9 10 11 12 13 14\n15\n",
         "3 bytes after the last row", SG_ERR_INPUT},
        {"ply\nformat ascii 1.0\nelement vertex 1\n" GOOD
         "element face 1\nproperty list uchar int i\nend_header\n"
         "1 2 3 4 5 6 7 8 9 10 11 12 13 14\n3 1 2\n",
         "end of the file", SG_ERR_INPUT},
        {"ply\nformat binary_little_endian 1.0\nelement vertex 1\n" GOOD
         "end_header\n01234567890123456789012345678901234567890123456789012345678",
         "3 bytes after the last row", SG_ERR_INPUT},
    };
    for (size_t i = 0; i < sizeof(cases) / sizeof(*cases); i++) {
        struct sg_model *m = (void *) f;
        put_text(f, "h.ply", cases[i].text);
        const int code = sg_model_read_ply(f->ctx, at(f, "h.ply"), 2, &m);
        const char *message = sg_last_error(f->ctx);
        if (code != cases[i].code || !strstr(message, cases[i].word) || !strstr(message, "h.ply: "))
            fail_msg("case %zu: code %d, message: %s", i, code, message);
        assert_null(m);
    }
}

/* A header that never ends, in its lines or in their number. */
static void test_endless_headers(void **state)
{
    struct fixture *f = *state;
    struct text t = {0};
    struct sg_model *m;
    append(&t, "ply\n", 4);
    for (int i = 0; i < 100000; i++)
        append(&t, "comment\n", 8);
    put(f, "e.ply", t.bytes, t.size);
    assert_int_equal(sg_model_read_ply(f->ctx, at(f, "e.ply"), 2, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "end_header"));
    memset(t.bytes + 4, 'c', t.size - 4);
    put(f, "e.ply", t.bytes, t.size);
    assert_int_equal(sg_model_read_ply(f->ctx, at(f, "e.ply"), 2, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "line 2"));
    free(t.bytes);
}

/* A number has at most 512 bytes. The rest of a longer one is not a number of its own. */
static void test_long_numbers(void **state)
{
    struct fixture *f = *state;
    const char *header = "ply\nformat ascii 1.0\nelement vertex 1\n" GOOD "end_header\n";
    for (int last = 0; last < 2; last++)
        for (int length = 512; length <= 513; length++) {
            struct text t = {0};
            struct sg_model *m;
            append(&t, header, strlen(header));
            for (int i = 0; i < (length == 512 ? 13 : 12) && last; i++)
                append(&t, "7 ", 2);
            append(&t, "1.", 2);
            for (int i = 2; i < length; i++)
                append(&t, "5", 1);
            /* Cut in two the longer one would fill the row. */
            for (int i = 0; i < (length == 512 ? 13 : 12) && !last; i++)
                append(&t, " 7", 2);
            put(f, "l.ply", t.bytes, t.size);
            const int code = sg_model_read_ply(f->ctx, at(f, "l.ply"), 2, &m);
            assert_int_equal(code, length == 512 ? SG_OK : SG_ERR_INPUT);
            assert_true(!code || (strstr(sg_last_error(f->ctx), "l.ply: byte ") &&
                                  strstr(sg_last_error(f->ctx), "at most 512 bytes")));
            sg_model_destroy(&m);
            free(t.bytes);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_encodings),       scene_test(test_every_cut),
        scene_test(test_hostile_headers), scene_test(test_endless_headers),
        scene_test(test_marks),           scene_test(test_long_files),
        scene_test(test_long_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
