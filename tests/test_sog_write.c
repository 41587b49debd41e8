/* SPDX-License-Identifier: Apache-2.0 */
/* .sog files that are written: what a round trip keeps, the tables and palettes behind it. */
#include "scene_files.h"

#include "model/morton.h"
#include "format/cluster.h"
#include "format/codec.h"
#include "models.h"
#include "whole_file.h"

static float highest(const struct sg_model *m, int plane, bool least)
{
    float most = -INFINITY;
    for (size_t i = 0; i < m->count; i++) {
        const float v = *sg_model_at(m, i, plane);
        most = fmaxf(most, least ? -v : v);
    }
    return least ? -most : most;
}

/* The Gaussians of m in the order of the file. */
static uint32_t *order_of(sg_ctx *ctx, const struct sg_model *m)
{
    const struct sg_places places = {m->params, m->count, NULL, sg_param_count(m->sh_degree), 0};
    uint32_t *all = malloc(m->count * sizeof(*all)), *order = malloc(m->count * sizeof(*order));
    for (size_t i = 0; i < m->count; i++)
        all[i] = (uint32_t) i;
    assert_int_equal(sg_morton_order(ctx, &places, all, m->count, order), SG_OK);
    free(all);
    return order;
}

static struct sg_model *write_and_read(struct fixture *f, const struct sg_model *m)
{
    struct sg_model *back = NULL;
    if (sg_model_write(f->ctx, m, at(f, "m.sog"), NULL) ||
        sg_model_read(f->ctx, f->path, m->count, &back))
        fail_msg("%s", sg_last_error(f->ctx));
    assert_int_equal(back->count, m->count);
    assert_int_equal(back->sh_degree, m->sh_degree);
    return back;
}

static void near_to(float found, float expected, double slack, const char *what, size_t i)
{
    if (!(fabs((double) found - (double) expected) <= slack))
        fail_msg("Gaussian %zu: %s: found %g, expected %g +- %g", i, what, (double) found,
                 (double) expected, slack);
}

/* The tolerances that docs/formats.md has: values are drawn evenly, so that a table of 256 has
 * steps of about 1/256 of their range. */
static void test_round_trip(void **state)
{
    struct fixture *f = *state;
    for (int degree = 0; degree <= 3; degree++)
        for (size_t n = 1; n <= 1500; n = n == 1 ? 90 : n == 90 ? 1500 : 1501) {
            struct sg_model *m = make_model(f->ctx, n, degree, 5), *back = write_and_read(f, m);
            uint32_t *order = order_of(f->ctx, m);
            double error = 0, square = 0;
            for (size_t j = 0; j < n; j++) {
                const size_t i = order[j];
                float p[4], q[4], dot = 0;
                for (int k = 0; k < 3; k++) {
                    const float x = *sg_model_at(m, i, SG_P_XYZ + k);
                    near_to(*sg_model_at(back, j, SG_P_XYZ + k), x,
                            2 * log(2) / 65535 * 0.51 * (1 + fabs((double) x)) + 1e-6, "position",
                            i);
                    near_to(*sg_model_at(back, j, SG_P_SCALE + k),
                            *sg_model_at(m, i, SG_P_SCALE + k), 3.5 / 256, "scale", i);
                    near_to(*sg_model_at(back, j, SG_P_SH + k), *sg_model_at(m, i, SG_P_SH + k),
                            4.3 / 256, "sh_dc", i);
                }
                near_to(sg_logistic(*sg_model_at(back, j, SG_P_OPACITY)),
                        sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)), 0.51 / 255, "opacity", i);
                sg_unit_quaternion(m, i, p);
                sg_unit_quaternion(back, j, q);
                for (int k = 0; k < 4; k++)
                    dot += p[k] * q[k];
                near_to(fabsf(dot), 1, 3e-5, "rotation", i);
                for (int k = 3; k < 3 * (degree + 1) * (degree + 1); k++) {
                    const double v = (double) *sg_model_at(m, i, SG_P_SH + k),
                                 d = (double) *sg_model_at(back, j, SG_P_SH + k) - v;
                    error += d * d, square += v * v;
                }
            }
            /* 1024 vectors stand for 1500 that have nothing in common, 64 for 90. */
            assert_true(error <= 0.4 * square);
            assert_true(n > 1 || error <= 1e-6 * square);
            free(order);
            sg_model_destroy(&m);
            sg_model_destroy(&back);
        }
}

/* A model whose values repeat loses nothing but the rounding of positions, rotations and
 * opacities. */
static void test_repeated_values(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m = make_model(f->ctx, 3000, 3, 8);
    for (size_t i = 0; i < m->count; i++)
        for (int p = SG_P_SCALE; p < sg_param_count(3); p++)
            if (p < SG_P_ROT || p >= SG_P_SH)
                *sg_model_at(m, i, p) = draw(4, 64 * (i % 5) + (uint64_t) p % 50, -2, 2);
    struct sg_model *back = write_and_read(f, m);
    uint32_t *order = order_of(f->ctx, m);
    for (size_t j = 0; j < m->count; j++)
        for (int p = SG_P_SCALE; p < sg_param_count(3); p++)
            if (p < SG_P_ROT || p >= SG_P_SH)
                near_to(*sg_model_at(back, j, p), *sg_model_at(m, order[j], p), 1e-6, "value", j);
    free(order);
    sg_model_destroy(&m);
    sg_model_destroy(&back);
}

static void test_same_bytes(void **state)
{
    struct fixture *f = *state;
    char *bytes[2];
    size_t size[2];
    for (int k = 0; k < 2; k++) {
        sg_ctx *ctx = make_context(k ? 5 : 1);
        struct sg_model *m = make_model(ctx, 5000, 2, 3);
        assert_int_equal(sg_model_write(ctx, m, at(f, "m.sog"), NULL), SG_OK);
        bytes[k] = slurp(f->path, &size[k]);
        sg_model_destroy(&m);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    free(bytes[0]);
    free(bytes[1]);
}

/* Values at the end of the float's range, all equal, and of 0. */
static void test_extremes(void **state)
{
    struct fixture *f = *state;
    static const float values[] = {0, 7, 1e30f, -3e38f};
    for (int k = 0; k < 5; k++) {
        struct sg_model *m = make_model(f->ctx, 300, 1, 2);
        for (size_t i = 0; i < m->count; i++)
            for (int p = 0; p < sg_param_count(1); p++)
                *sg_model_at(m, i, p) = k < 4 ? values[k] : i % 2 ? 3e38f : -3e38f;
        struct sg_model *back = write_and_read(f, m);
        for (int p = 0; p < SG_P_OPACITY && k < 4; p++)
            near_to(*sg_model_at(back, 9, p), values[k], 2e-4 * fabs((double) values[k]),
                    "position", 9);
        assert_true(highest(back, SG_P_SH, false) == highest(m, SG_P_SH, false));
        assert_true(highest(back, SG_P_SH, true) == highest(m, SG_P_SH, true));
        sg_model_destroy(&m);
        sg_model_destroy(&back);
    }
}

/* A Gaussian with numbers that no scene has changes no other one. */
static void test_outliers(void **state)
{
    struct fixture *f = *state;
    static const float values[] = {-3e38f, -1e20f, -1e12f, 1e20f};
    for (int k = 0; k < 4; k++) {
        struct sg_model *m = make_model(f->ctx, 300, 1, 2);
        for (int p = SG_P_SCALE; p < SG_P_SCALE + 3; p++)
            *sg_model_at(m, 7, p) = values[k];
        for (int p = SG_P_SH; p < sg_param_count(1); p++)
            *sg_model_at(m, 7, p) = values[k];
        struct sg_model *back = write_and_read(f, m);
        uint32_t *order = order_of(f->ctx, m);
        for (size_t j = 0; j < m->count; j++)
            for (int c = 0; c < 3 && order[j] != 7; c++) {
                near_to(*sg_model_at(back, j, SG_P_SCALE + c),
                        *sg_model_at(m, order[j], SG_P_SCALE + c), 4.0 / 256, "scale", order[j]);
                near_to(*sg_model_at(back, j, SG_P_SH + c), *sg_model_at(m, order[j], SG_P_SH + c),
                        5.0 / 256, "sh_dc", order[j]);
            }
        free(order);
        sg_model_destroy(&m);
        sg_model_destroy(&back);
    }
}

/* Tables of few numbers are exact; of many, near the best: of a normal distribution, 256 levels
 * leave an error of 2.72 / 256^2 of the variance (Panter and Dite 1951). */
static void test_tables(void **state)
{
    struct fixture *f = *state;
    enum { N = 40000 };
    float *values = malloc(N * sizeof(*values)), *sorted = malloc(N * sizeof(*sorted));
    float table[SG_TABLE_SIZE];
    for (int i = 0; i < N; i++)
        values[i] = sorted[i] = (float) (i * 7919 % 256) - 100;
    assert_int_equal(sg_make_table(f->ctx, sorted, N, table), SG_OK);
    for (int i = 0; i < SG_TABLE_SIZE; i++)
        assert_true(table[i] == (float) i - 100 && sg_nearest_number(table, table[i]) == i);
    double error = 0, square = 0;
    for (int i = 0; i < N; i++) {
        const double u = (double) draw(1, 2 * (uint64_t) i, 1e-6f, 1),
                     v = (double) draw(1, 2 * (uint64_t) i + 1, 0, 1);
        values[i] = sorted[i] = (float) (sqrt(-2 * log(u)) * cos(2 * 3.14159265358979 * v));
    }
    assert_int_equal(sg_make_table(f->ctx, sorted, N, table), SG_OK);
    for (int i = 0; i < N; i++) {
        uint8_t best = 0;
        for (int k = 1; k < SG_TABLE_SIZE; k++)
            if (fabsf(values[i] - table[k]) < fabsf(values[i] - table[best]))
                best = (uint8_t) k;
        const float found = table[sg_nearest_number(table, values[i])];
        assert_true(fabsf(values[i] - found) <= fabsf(values[i] - table[best]));
        error += pow((double) values[i] - (double) found, 2);
        square += pow((double) values[i], 2);
    }
    if (!(error / square < 1.2 * 2.72 / 65536))
        fail_msg("error %g of the variance, expected %g", error / square, 2.72 / 65536);
    free(values);
    free(sorted);
}

/* Vectors in 200 clouds, for a palette of 256: some clouds share a vector, but most have one. */
static void test_palette(void **state)
{
    struct fixture *f = *state;
    enum { N = 20000, CLOUDS = 200, MOST = 256 };
    struct sg_model *m = make_model(f->ctx, N, 3, 1);
    const struct sg_vectors vectors = {m, SG_P_SH + 3, 45};
    uint32_t *labels = malloc(N * sizeof(*labels));
    float *palette;
    size_t count;
    double error = 0, all = 0;
    for (size_t i = 0; i < N; i++)
        for (int k = 0; k < 45; k++) {
            const float noise = draw(6, 45 * i + (uint64_t) k, -0.05f, 0.05f),
                        centre = draw(
                            7, 45 * (sg_rng_u64(5, SG_RNG_SYNTH, 0, i) % CLOUDS) + (uint64_t) k, -1,
                            1);
            *sg_model_at(m, i, vectors.first + k) = centre + noise;
            all += (double) centre * (double) centre;
        }
    assert_int_equal(sg_make_palette(f->ctx, &vectors, MOST, &palette, &count, labels), SG_OK);
    assert_in_range(count, 100, MOST);
    bool *used = calloc(count, sizeof(*used));
    for (size_t i = 0; i < N; i++) {
        assert_true(labels[i] < count);
        used[labels[i]] = true;
        for (int k = 0; k < 45; k++)
            error += pow((double) *sg_model_at(m, i, vectors.first + k) -
                             (double) palette[labels[i] * 45 + (size_t) k],
                         2);
    }
    for (size_t p = 0; p < count; p++)
        assert_true(used[p]);
    assert_true(error < 0.15 * all);
    free(used);
    free(labels);
    sg_free(palette);
    sg_model_destroy(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_round_trip), scene_test(test_repeated_values), scene_test(test_same_bytes),
        scene_test(test_extremes),   scene_test(test_outliers),        scene_test(test_tables),
        scene_test(test_palette),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
