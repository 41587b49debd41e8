/* SPDX-License-Identifier: Apache-2.0 */
/* The Gaussian store: its start from points, its statistics, and models that go through files. */
#include "scene_files.h"

#include "model/nearest.h"
#include "models.h"

/* ---- nearest neighbours ---- */

static float brute_force(const float *xyz, size_t n, size_t i)
{
    float best[3] = {INFINITY, INFINITY, INFINITY};
    for (size_t j = 0; j < n; j++) {
        float d = 0;
        for (size_t k = 0; k < 3; k++) {
            const float e = xyz[3 * i + k] - xyz[3 * j + k];
            d += e * e;
        }
        if (j == i)
            continue;
        for (int k = 0; k < 3; k++)
            if (d < best[k]) {
                const float pushed = best[k];
                best[k] = d, d = pushed;
            }
    }
    return (best[0] + best[1] + best[2]) / 3;
}

static void check_nearest(sg_ctx *ctx, const float *xyz, size_t n)
{
    float *out = malloc(n * sizeof(*out));
    assert_int_equal(sg_nearest3(ctx, xyz, n, out), SG_OK);
    for (size_t i = 0; i < n; i++) {
        const float expected = brute_force(xyz, n, i);
        if (!(fabsf(out[i] - expected) <= 1e-5f * expected))
            fail_msg("point %zu of %zu: %g, expected %g", i, n, (double) out[i], (double) expected);
    }
    free(out);
}

/* More points than an index can tell apart, which are refused before one is read. */
static void test_too_many(void **state)
{
    struct fixture *f = *state;
    float out;
    if (SIZE_MAX > UINT32_MAX)
        assert_int_equal(sg_nearest3(f->ctx, NULL, (size_t) UINT32_MAX + 1, &out), SG_ERR_INPUT);
}

/* Clouds, lines, heaps of equal points, an order that defeats a middle pivot's choice, and a grid
 * whose searches have a line of as many points in reach of every plane that splits it. */
static void test_nearest(void **state)
{
    struct fixture *f = *state;
    enum { N = 3000 };
    static float xyz[3 * N];
    static const size_t sizes[] = {4, 5, 16, 17, 33, 1000, N};
    for (int shape = 0; shape < 6; shape++) {
        for (size_t i = 0; i < N; i++) {
            const float u = draw(1, i, -5, 5), v = draw(2, i, -5, 5), w = draw(3, i, -5, 5);
            const float organ = (float) (i < N / 2 ? i : N - i);
            const float p[6][3] = {{u, v, w},
                                   {u, 0, 0},
                                   {floorf(u), floorf(v), floorf(w)},
                                   {organ, organ, organ},
                                   {u * 1e-20f, v * 1e15f, w},
                                   {i == 0  ? 1e7f
                                    : i % 2 ? -1e-3f * (float) i / N
                                            : 1,
                                    i % 2 ? 0 : 1e3f * (float) (i / 2 % 40),
                                    i % 2 ? 0 : 1e3f * (float) (i / 80)}};
            memcpy(&xyz[3 * i], p[shape], sizeof(p[shape]));
        }
        for (size_t s = 0; s < sizeof(sizes) / sizeof(*sizes); s++)
            check_nearest(f->ctx, xyz, sizes[s]);
    }
}

/* A cube's corner has three neighbours at the edge's length. */
static void check_cube(struct fixture *f, float edge)
{
    float xyz[24];
    uint8_t rgb[24];
    for (int i = 0; i < 8; i++)
        for (int k = 0; k < 3; k++) {
            xyz[3 * i + k] = edge * (float) (i >> k & 1) + 7;
            rgb[3 * i + k] = (uint8_t) (31 * i + k);
        }
    struct sg_model *m;
    assert_int_equal(sg_model_init_points(f->ctx, xyz, rgb, 8, 3, &m), SG_OK);
    assert_int_equal(m->count, 8);
    assert_int_equal(m->sh_degree, 3);
    assert_int_equal(m->active_sh_degree, 0);
    for (size_t i = 0; i < 8; i++) {
        for (int k = 0; k < 3; k++) {
            assert_float_equal(*sg_model_at(m, i, SG_P_XYZ + k), xyz[3 * (int) i + k], 0);
            assert_float_equal(*sg_model_at(m, i, SG_P_SCALE + k), logf(edge), 1e-6);
            const float colour = (float) rgb[3 * (int) i + k] / 255;
            assert_float_equal(*sg_model_at(m, i, SG_P_SH + k), (colour - 0.5f) / 0.28209479f,
                               1e-5);
        }
        assert_float_equal(1 / (1 + expf(-*sg_model_at(m, i, SG_P_OPACITY))), 0.1, 1e-6);
        assert_float_equal(*sg_model_at(m, i, SG_P_ROT), 1, 0);
        for (int p = SG_P_ROT + 1; p < SG_P_SH; p++)
            assert_float_equal(*sg_model_at(m, i, p), 0, 0);
        for (int p = SG_P_SH + 3; p < sg_param_count(3); p++)
            assert_float_equal(*sg_model_at(m, i, p), 0, 0);
    }
    sg_model_destroy(&m);
    assert_null(m);
}

static void test_init_points(void **state)
{
    check_cube(*state, 1);
    check_cube(*state, 0.4f);
}

static void test_init_refusals(void **state)
{
    struct fixture *f = *state;
    float xyz[12] = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
    const uint8_t rgb[12] = {0};
    struct sg_model *m;
    assert_int_equal(sg_model_init_points(f->ctx, xyz, rgb, 3, 3, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "found 3"));
    assert_null(m);
    assert_int_equal(sg_model_init_points(f->ctx, xyz, rgb, 4, 4, &m), SG_ERR_USAGE);
    xyz[7] = NAN;
    assert_int_equal(sg_model_init_points(f->ctx, xyz, rgb, 4, 3, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "point 2"));
    /* All at one place, and as far apart as floats go: finite all the same. */
    float far[12] = {0};
    for (int big = 0; big < 2; big++) {
        for (int i = 0; i < 12; i++)
            far[i] = big ? (i % 2 ? 3e38f : -3e38f) : 5;
        assert_int_equal(sg_model_init_points(f->ctx, far, rgb, 4, 0, &m), SG_OK);
        for (size_t i = 0; i < 4; i++)
            for (int p = 0; p < sg_param_count(0); p++)
                assert_true(isfinite(*sg_model_at(m, i, p)));
        sg_model_destroy(&m);
    }
}

static void test_init_random(void **state)
{
    struct fixture *f = *state;
    struct sg_model *a, *b, *other;
    assert_int_equal(sg_model_init_random(f->ctx, 5000, 1.3f, 3, 3, &a), SG_OK);
    assert_int_equal(sg_model_init_random(f->ctx, 5000, 1.3f, 3, 3, &b), SG_OK);
    assert_int_equal(sg_model_init_random(f->ctx, 5000, 1.3f, 4, 3, &other), SG_OK);
    const size_t bytes = a->capacity * (size_t) sg_param_count(3) * sizeof(float);
    assert_memory_equal(a->params, b->params, bytes);
    assert_memory_not_equal(a->params, other->params, bytes);
    float low = 9, high = -9;
    for (size_t i = 0; i < a->count; i++)
        for (int k = 0; k < 3; k++)
            low = fminf(low, *sg_model_at(a, i, k)), high = fmaxf(high, *sg_model_at(a, i, k));
    assert_true(low >= -1.3f && low < -1.29f && high <= 1.3f && high > 1.29f);
    sg_model_destroy(&a);
    sg_model_destroy(&b);
    sg_model_destroy(&other);
}

/* ---- statistics ---- */

static void test_inspect(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m;
    enum { N = 101 };
    assert_int_equal(sg_model_create(f->ctx, N + 3, 0, &m), SG_OK);
    for (size_t i = 0; i < N + 3; i++) {
        *sg_model_at(m, i, SG_P_XYZ) = (float) i;
        *sg_model_at(m, i, SG_P_XYZ + 1) = -(float) i;
        *sg_model_at(m, i, SG_P_ROT) = 1;
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_SCALE + k) = k == 1 ? logf((float) (i + 1)) : -20;
        *sg_model_at(m, i, SG_P_OPACITY) = i % 2 ? 0 : -10;
    }
    *sg_model_at(m, N, SG_P_SH) = NAN;
    *sg_model_at(m, N + 1, SG_P_SCALE) = INFINITY;
    *sg_model_at(m, N + 2, SG_P_XYZ) = NAN;
    *sg_model_at(m, 4, SG_P_ROT) = 0;
    struct sg_model_info info;
    assert_int_equal(sg_model_inspect(f->ctx, m, &info), SG_OK);
    assert_int_equal(info.count, N + 3);
    assert_int_equal(info.nonfinite, 3);
    assert_int_equal(info.first_nonfinite, N);
    assert_string_equal(info.first_property, "f_dc_0");
    assert_int_equal(sg_model_check(f->ctx, m, "m.ply"), SG_ERR_INPUT);
    assert_string_equal(sg_last_error(f->ctx),
                        "m.ply: Gaussian 101: found f_dc_0 nan, expected a finite number");
    assert_int_equal(info.zero_rotation, 1);
    assert_int_equal(info.transparent, 51);
    assert_float_equal(info.min[0], 0, 0);
    assert_float_equal(info.max[0], N + 1, 0); /* positions count though other planes are broken */
    assert_float_equal(info.min[1], -(N + 1), 0);
    static const double expected[5] = {2, 26, 51, 76, 100};
    for (int i = 0; i < 5; i++)
        assert_float_equal(info.scale_percentile[i], expected[i], 1.001);
    assert_float_equal(info.opacity_percentile[0], 1 / (1 + exp(10)), 1e-6);
    assert_float_equal(info.opacity_percentile[4], 0.5, 1e-6);
    sg_model_destroy(&m);
}

/* ---- files ---- */

static void same_model(const struct sg_model *a, const struct sg_model *b)
{
    assert_int_equal(a->count, b->count);
    for (size_t i = 0; i < a->count; i++)
        for (int p = 0; p < SG_PARAMS_MAX; p++) {
            const float none = 0;
            const float *x = p < sg_param_count(a->sh_degree) ? sg_model_at(a, i, p) : &none;
            const float *y = p < sg_param_count(b->sh_degree) ? sg_model_at(b, i, p) : &none;
            if (memcmp(x, y, sizeof(*x)))
                fail_msg("Gaussian %zu, plane %d: %a, expected %a", i, p, (double) *y, (double) *x);
        }
}

/* Every parameter is different, so that an exchange of any two columns shows; and every bit
 * arrives. */
static void test_round_trip(void **state)
{
    struct fixture *f = *state;
    for (int degree = 0; degree <= 3; degree++) {
        struct sg_model *m = make_model(f->ctx, 37, degree, (uint64_t) degree + 1), *back;
        const uint32_t odd[] = {0x7f800001, 0x7fc12345, 0x80000000, 0x00000001, 0xff800000};
        for (size_t i = 0; i < 5; i++)
            memcpy(sg_model_at(m, i, (int) (2 * i)), &odd[i], 4);
        assert_int_equal(sg_model_write_ply(f->ctx, m, at(f, "m.ply")), SG_OK);
        assert_int_equal(sg_model_read_ply(f->ctx, at(f, "m.ply"), 1000, &back), SG_OK);
        assert_int_equal(back->sh_degree, degree);
        assert_int_equal(back->active_sh_degree, degree);
        same_model(m, back);
        sg_model_destroy(&back);
        sg_model_destroy(&m);
    }
}

/* The layout other tools rely on: 62 floats in the reference's order, f_rest channel by channel. */
static void test_layout(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make_model(f->ctx, 2, 3, 9);
    char *data;
    size_t size;
    assert_int_equal(sg_model_write_ply(f->ctx, m, at(f, "m.ply")), SG_OK);
    assert_int_equal(sg_file_read(f->ctx, at(f, "m.ply"), 1 << 20, (void *) &data, &size), SG_OK);
    assert_memory_equal(data, "ply\nformat binary_little_endian 1.0\n", 36);
    const char *begin =
        "element vertex 2\nproperty float x\nproperty float y\n"
        "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
        "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float "
        "f_rest_0\n";
    const char *end =
        "property float f_rest_44\nproperty float opacity\nproperty float scale_0\nproperty float "
        "scale_1\n"
        "property float scale_2\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n"
        "property float rot_3\nend_header\n";
    assert_non_null(strstr(data, begin));
    const char *body = strstr(data, end);
    assert_non_null(body);
    body += strlen(end);
    assert_int_equal((size_t) (data + size - body), 2 * 62 * sizeof(float));
    float row[62];
    memcpy(row, body + sizeof(row), sizeof(row));
    for (int c = 0; c < 3; c++)
        for (int k = 1; k < 16; k++)
            assert_float_equal(row[9 + 15 * c + k - 1], *sg_model_at(m, 1, SG_P_SH + 3 * k + c), 0);
    assert_float_equal(row[54], *sg_model_at(m, 1, SG_P_OPACITY), 0);
    assert_float_equal(row[3], 0, 0);
    sg_free(data);
    sg_model_destroy(&m);
}

static void test_write_refusals(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make_model(f->ctx, 3, 0, 1);
    assert_int_equal(sg_model_write_ply(f->ctx, m, at(f, "missing/m.ply")), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "missing/m.ply"));
    put(f, "folder/x", "", 0);
    assert_int_equal(sg_model_write_ply(f->ctx, m, at(f, "folder")), SG_ERR_INPUT);
    sg_model_destroy(&m);
    assert_int_equal(sg_model_create(f->ctx, 0, 0, &m), SG_OK);
    assert_int_equal(sg_model_write_ply(f->ctx, m, at(f, "none.ply")), SG_ERR_INPUT);
    assert_false(sg_file_exists(at(f, "none.ply")));
    sg_model_destroy(&m);
}

static void test_points(void **state)
{
    struct fixture *f = *state;
    const float xyz[12] = {1, 2, 3, -1, 1e-30f, 4, 5, 6, 7, 8, 9, 10};
    const uint8_t rgb[12] = {0, 1, 2, 3, 255, 5, 6, 7, 8, 9, 10, 127};
    float *back;
    uint8_t *colours;
    size_t n;
    assert_int_equal(sg_points_write_ply(f->ctx, at(f, "p.ply"), xyz, rgb, 4), SG_OK);
    assert_int_equal(sg_points_read_ply(f->ctx, at(f, "p.ply"), 4, &back, &colours, &n), SG_OK);
    assert_int_equal(n, 4);
    assert_memory_equal(back, xyz, sizeof(xyz));
    assert_memory_equal(colours, rgb, sizeof(rgb));
    sg_points_destroy(&back, &colours);
    assert_int_equal(sg_points_read_ply(f->ctx, at(f, "p.ply"), 3, &back, &colours, &n),
                     SG_ERR_INPUT);
    put_text(f, "q.ply",
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty double z\nproperty double "
             "x\nproperty double y\n"
             "property float red\nproperty float green\nproperty float blue\nend_header\n"
             "3 1 2 0 0.5 1\n6 4 5 -1 nan 7\n");
    assert_int_equal(sg_points_read_ply(f->ctx, at(f, "q.ply"), 9, &back, &colours, &n), SG_OK);
    static const float expected[6] = {1, 2, 3, 4, 5, 6};
    static const uint8_t shades[6] = {0, 128, 255, 0, 0, 255};
    assert_memory_equal(back, expected, sizeof(expected));
    assert_memory_equal(colours, shades, sizeof(shades));
    sg_points_destroy(&back, &colours);
    put_text(f, "r.ply",
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
             "property float z\nproperty uchar red\nproperty ushort green\nproperty uchar blue\n"
             "end_header\n1 2 3 4 65535 6\n");
    assert_int_equal(sg_points_read_ply(f->ctx, at(f, "r.ply"), 9, &back, &colours, &n),
                     SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "row 0: found green 65535, expected 0 to 255"));
}

/* ---- arrays ---- */

/* A model whose arrays are copied field by field, with a gap between rows, is the same one; every
 * plane belongs to one field. */
static void test_arrays(void **state)
{
    struct fixture *f = *state;
    enum { N = 37, GAP = 2 };
    for (int degree = 0; degree <= 3; degree++) {
        struct sg_model *from = make_model(f->ctx, N, degree, 5), *to;
        assert_int_equal(sg_model_create(f->ctx, N, degree, &to), SG_OK);
        int planes = 0, index = 0;
        for (const char *name; (name = sg_model_field_name(index)); index++) {
            const int width = sg_model_field_width(name, degree);
            const size_t stride = (size_t) width + GAP;
            float *rows = malloc(N * stride * sizeof(*rows));
            for (size_t i = 0; i < N * stride; i++)
                rows[i] = -99;
            assert_int_equal(sg_model_get_array(f->ctx, from, name, rows, stride), SG_OK);
            for (size_t i = 0; i < N; i++)
                for (size_t k = 0; k < GAP; k++)
                    assert_true(rows[i * stride + (size_t) width + k] == -99);
            assert_int_equal(sg_model_set_array(f->ctx, to, name, rows, stride), SG_OK);
            planes += width;
            free(rows);
        }
        assert_int_equal(index, 6);
        assert_int_equal(planes, sg_param_count(degree));
        assert_memory_equal(from->params, to->params,
                            from->capacity * (size_t) planes * sizeof(float));
        sg_model_destroy(&from);
        sg_model_destroy(&to);
    }
}

static void test_array_layout(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make_model(f->ctx, 20, 1, 5);
    float opacity[20], scale[60], rest[180];
    assert_int_equal(sg_model_get_array(f->ctx, m, "opacity", opacity, 0), SG_OK);
    assert_int_equal(sg_model_get_array(f->ctx, m, "scale", scale, 0), SG_OK);
    assert_int_equal(sg_model_get_array(f->ctx, m, "sh_rest", rest, 0), SG_OK);
    assert_true(opacity[17] == *sg_model_at(m, 17, SG_P_OPACITY));
    assert_true(scale[3 * 17 + 2] == *sg_model_at(m, 17, SG_P_SCALE + 2));
    assert_true(rest[9 * 17 + 3 * (2 - 1) + 1] == *sg_model_at(m, 17, SG_P_SH + 3 * 2 + 1));

    assert_int_equal(sg_model_get_array(f->ctx, m, "colour", rest, 0), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(f->ctx), "\"colour\""));
    assert_int_equal(sg_model_get_array(f->ctx, m, "sh_rest", rest, 8), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(f->ctx), "row_stride: found 8 floats"));
    assert_int_equal(sg_model_set_array(f->ctx, m, "scale", scale, 2), SG_ERR_USAGE);
    assert_null(sg_model_field_name(-1));
    assert_int_equal(sg_model_field_width("sh_rest", 0), 0);
    assert_int_equal(sg_model_field_width("sh_rest", 4), -1);
    assert_int_equal(sg_model_field_width("colour", 1), -1);
    sg_model_destroy(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_arrays),         scene_test(test_array_layout),
        scene_test(test_nearest),        scene_test(test_too_many),
        scene_test(test_init_points),    scene_test(test_init_refusals),
        scene_test(test_init_random),    scene_test(test_inspect),
        scene_test(test_round_trip),     scene_test(test_layout),
        scene_test(test_write_refusals), scene_test(test_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
