/* SPDX-License-Identifier: Apache-2.0 */
/* Densification: which Gaussians grow and which are removed, without and with a limit. */
#include "engine/engine.h"
#include "math/constants.h"
#include "models.h"
#include "train/densify.h"

/* Six Gaussians, each a case of the rules. */
static void test_densify(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m, *after;
    struct sg_columns o;
    struct sg_engine *b;
    const float tau = 0.0002f,
                limit = 0.0625f; /* a scale whose logarithm is exact enough to come back */
    assert_int_equal(sg_model_create(ctx, 6, 0, &m), SG_OK);
    assert_int_equal(sg_columns_create(ctx, 6, 0, SG_COLUMN_SAVED, &o), SG_OK);
    /* 0 clones (gradient exactly tau), 1 stays (just below), 2 splits, 3 is too transparent, 4 too
     * large, 5 clones but dies */
    const float gradient[] = {tau, 0.00019999f, 0.001f, 0, 0, 0.01f};
    const float scale[] = {0.01f, 0.01f, 0.5f, 0.01f, 3.0f, 0.01f};
    const float opacity[] = {0.5f, 0.5f, 0.9f, 0.001f, 0.5f, 0.004f};
    for (size_t i = 0; i < 6; i++) {
        o.at[SG_C_GRAD_SUM][i] = 2 * gradient[i], o.at[SG_C_GRAD_COUNT][i] = 2;
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_SCALE + k) = logf(scale[i]);
        *sg_model_at(m, i, SG_P_XYZ) = (float) i;
        *sg_model_at(m, i, SG_P_ROT) = 1;
        *sg_model_at(m, i, SG_P_OPACITY) = logf(opacity[i] / (1 - opacity[i]));
        o.at[SG_C_MOMENT1][sg_param_index(sg_param_count(0), i, 0)] = 7;
    }
    b = make_engine(ctx, "cpu", NULL, m, &o);
    struct sg_densify_result r;
    struct sg_densify_params p = {
        .gradient = tau, .split_scale = limit, .prune_scale = 1, .seed = 1, .stream = 600};
    assert_int_equal(sg_densify(b, &p, &r), SG_OK);
    assert_int_equal(r.cloned, 2);
    assert_int_equal(r.split, 1);
    assert_int_equal(r.pruned, 4); /* 3, 4, 5 and 5's clone */
    assert_int_equal(sg_engine_count(b), 5);
    struct sg_columns moments;
    assert_int_equal(sg_model_create(ctx, 5, 0, &after), SG_OK);
    assert_int_equal(sg_columns_create(ctx, 5, 0, SG_COLUMN_SAVED, &moments), SG_OK);
    assert_int_equal(sg_engine_download(b, after, &moments), SG_OK);
    /* survivors 0, 1; the clone of 0; two children of 2 */
    assert_float_equal(*sg_model_at(after, 0, 0), 0, 0);
    assert_float_equal(*sg_model_at(after, 1, 0), 1, 0);
    assert_float_equal(*sg_model_at(after, 2, 0), 0, 0);
    for (size_t i = 3; i < 5; i++) {
        assert_float_equal(*sg_model_at(after, i, SG_P_SCALE), logf(0.5f / SG_SPLIT_SHRINK), 1e-5);
        assert_true(fabsf(*sg_model_at(after, i, 0) - 2) < 2.5f && *sg_model_at(after, i, 0) != 2);
    }
    assert_true(*sg_model_at(after, 3, 0) != *sg_model_at(after, 4, 0));
    for (size_t i = 0; i < 5; i++) {
        assert_float_equal(moments.at[SG_C_MOMENT1][sg_param_index(sg_param_count(0), i, 0)],
                           i < 2 ? 7 : 0, 0);
        assert_float_equal(moments.at[SG_C_GRAD_COUNT][i], 0, 0);
    }
    sg_engine_destroy(&b);
    sg_columns_clear(&o);
    sg_columns_clear(&moments);
    sg_model_destroy(&m);
    sg_model_destroy(&after);
    sg_ctx_destroy(&ctx);
}

/* Each of a few alike wants to grow or not, is large or not: what becomes of them where all of them
 * die, only children stay, or a limit stops them. */
static void test_alike(void **state)
{
    (void) state;
    enum { N = 6 };
    const float opaque = 2, transparent = -9; /* scales are 1, children's 1 / 1.6 */
    const struct {
        float opacity, gradient;
        struct sg_densify_params p;
        size_t count, cloned, split;
        bool limited;
    } cases[] = {
        {transparent, 0, {.split_scale = 2}, 0, 0, 0, false}, /* an error */
        {opaque, 1, {.split_scale = 0.5f}, 2 * N, 0, N, false},
        {opaque, 1, {.split_scale = 0.5f, .prune_scale = 0.7f}, 2 * N, 0, N, false},
        {opaque, 0, {.split_scale = 2, .max_gaussians = 4}, 4, 0, 0, false}, /* no score: the last
                                                                                ones go */
        {opaque, 1, {.split_scale = 2, .max_gaussians = N + 2}, N + 2, 2, 0, true},
        {opaque,
         1,
         {.split_scale = 1, .max_gaussians = N + 1},
         N + 1,
         1,
         0,
         true}, /* exactly there: cloned */
        {opaque, 1, {.split_scale = 2, .max_gaussians = 2 * N}, 2 * N, N, 0, false}, /* just room
                                                                                        enough */
    };
    sg_ctx *ctx = make_context(1);
    const size_t n_cases = sizeof(cases) / sizeof(cases[0]);
    for (size_t k = 0; k < 2 * n_cases; k++) {
        const size_t c = k / 2;
        struct sg_densify_params p = cases[c].p;
        struct sg_densify_result r;
        struct sg_columns o;
        struct sg_model *m, *after;
        struct sg_engine *b;
        assert_int_equal(sg_model_create(ctx, N, 0, &m), SG_OK);
        assert_int_equal(sg_columns_create(ctx, N, 0, SG_COLUMN_SAVED, &o), SG_OK);
        for (size_t i = 0; i < N; i++) {
            o.at[SG_C_GRAD_SUM][i] = cases[c].gradient, o.at[SG_C_GRAD_COUNT][i] = 1;
            *sg_model_at(m, i, SG_P_XYZ) = (float) i; /* a name */
            *sg_model_at(m, i, SG_P_ROT) = 1;
            *sg_model_at(m, i, SG_P_OPACITY) = cases[c].opacity;
        }
        p.gradient = 0.5f;
        b = make_engine(ctx, k % 2 ? "ref" : "cpu", NULL, m, &o);
        if (cases[c].count) {
            assert_int_equal(sg_densify(b, &p, &r), SG_OK);
            assert_int_equal(sg_engine_count(b), cases[c].count);
            assert_true(r.cloned == cases[c].cloned && r.split == cases[c].split &&
                        r.limited == cases[c].limited);
            assert_int_equal(sg_model_create(ctx, cases[c].count, 0, &after), SG_OK);
            assert_int_equal(sg_engine_download(b, after, NULL), SG_OK);
            for (size_t i = 0; i < cases[c].count && !r.split; i++)
                assert_true(*sg_model_at(after, i, SG_P_XYZ) == (float) (i % N));
            sg_model_destroy(&after);
        } else { /* a model has at least one: it stays as it was */
            assert_int_equal(sg_densify(b, &p, &r), SG_ERR_INPUT);
            assert_non_null(strstr(sg_last_error(ctx), "transparent"));
            assert_int_equal(sg_engine_count(b), N);
        }
        sg_engine_destroy(&b);
        sg_columns_clear(&o);
        sg_model_destroy(&m);
    }
    sg_ctx_destroy(&ctx);
}

#define FULL 100

static int by_index(void *arg, struct sg_scores *out)
{
    sg_ctx *ctx = arg;
    *out = (struct sg_scores){.count = FULL,
                              .score = sg_alloc_raw(ctx, SG_MEM_MISC, FULL, sizeof(double)),
                              .log_smallest = sg_alloc(ctx, SG_MEM_MISC, FULL, sizeof(float)),
                              .keys = sg_alloc_raw(ctx, SG_MEM_MISC, FULL, sizeof(uint64_t))};
    for (size_t i = 0; i < FULL; i++)
        out->score[i] = (double) i;
    return SG_OK;
}

/* At the limit as many give way as want to grow, up to the share that may be replaced at a time. */
static void test_replaced(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    for (size_t wish = 1; wish <= 40; wish += 13) {
        struct sg_model *m = make_model(ctx, FULL, 0, 3);
        const struct sg_densify_params p = {.gradient = 0.5f,
                                            .split_scale = 9,
                                            .max_gaussians = FULL,
                                            .score = by_index,
                                            .arg = ctx,
                                            .replace = 0.2f,
                                            .seed = 1};
        struct sg_densify_result r;
        struct sg_columns o;
        struct sg_engine *b;
        assert_int_equal(sg_columns_create(ctx, FULL, 0, SG_COLUMN_SAVED, &o), SG_OK);
        for (size_t i = 0; i < FULL; i++) {
            o.at[SG_C_GRAD_SUM][i] = i + wish >= FULL, o.at[SG_C_GRAD_COUNT][i] = 1;
            *sg_model_at(m, i, SG_P_OPACITY) = 2;
        }
        b = make_engine(ctx, "cpu", NULL, m, &o);
        assert_int_equal(sg_densify(b, &p, &r), SG_OK);
        assert_int_equal(r.replaced, wish < 20 ? wish : 20);
        assert_int_equal(r.cloned, r.replaced);
        assert_int_equal(r.limited, wish > 20);
        assert_int_equal(sg_engine_count(b), FULL);
        sg_engine_destroy(&b);
        sg_columns_clear(&o);
        sg_model_destroy(&m);
    }
    sg_ctx_destroy(&ctx);
}

/* Poison-splat's universal threshold: all grow, also beyond it, or none does, and then statistics
 * go on. */
static void test_overshoot(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    for (int full = 0; full < 2; full++) {
        struct sg_model *m = make_model(ctx, FULL, 0, 3);
        const struct sg_densify_params p = {.gradient = 0.5f,
                                            .split_scale = 9,
                                            .max_gaussians = FULL + 1 - (size_t) full,
                                            .overshoot = true,
                                            .seed = 1};
        struct sg_densify_result r;
        struct sg_columns o, after;
        struct sg_engine *b;
        assert_int_equal(sg_columns_create(ctx, FULL, 0, SG_COLUMN_SAVED, &o), SG_OK);
        assert_int_equal(sg_columns_create(ctx, 2 * FULL, 0, SG_COLUMN_SAVED, &after), SG_OK);
        for (size_t i = 0; i < FULL; i++) {
            o.at[SG_C_GRAD_SUM][i] = i < 30, o.at[SG_C_GRAD_COUNT][i] = 1;
            *sg_model_at(m, i, SG_P_OPACITY) = i < FULL - 5 ? 2 : -8; /* the last are pruned */
        }
        b = make_engine(ctx, "cpu", NULL, m, &o);
        assert_int_equal(sg_densify(b, &p, &r), SG_OK);
        assert_int_equal(r.cloned, full ? 0 : 30);
        assert_int_equal(r.pruned, 5);
        assert_int_equal(r.limited, full);
        assert_int_equal(sg_engine_count(b), FULL - 5 + r.cloned);
        assert_int_equal(sg_engine_download(b, NULL, &after), SG_OK);
        for (size_t i = 0; i < FULL - 5; i++)
            assert_true(after.at[SG_C_GRAD_COUNT][i] == (full ? 1 : 0));
        sg_engine_destroy(&b);
        sg_columns_clear(&o);
        sg_columns_clear(&after);
        sg_model_destroy(&m);
    }
    sg_ctx_destroy(&ctx);
}

/* Where growth is blocked, what was large on the screen since the last clearing goes, after the
 * first reset only; each engine counts the same radii. */
static void test_screen(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    const struct sg_camera camera = make_camera(90, 70, 3);
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    struct engine_case cases[ENGINE_CASES];
    const int n_cases = engine_cases(cases);
    float expected[60];
    for (int k = n_cases - 1; k >= 0; k--) { /* the oracle first */
        for (int late = 0; late < 2; late++) {
            struct sg_model *m = make_model(ctx, 60, 0, 3);
            float radius[60];
            size_t large = 0;
            for (size_t i = 0; i < 60; i++)
                *sg_model_at(m, i, SG_P_OPACITY) = 2;
            struct sg_engine *b = make_engine(ctx, cases[k].engine, cases[k].variant, m, NULL);
            assert_int_equal(sg_engine_draw(b, &camera, 0, &render, false), SG_OK);
            assert_int_equal(sg_engine_count_radii(b), SG_OK);
            assert_int_equal(
                sg_engine_read_statistics(b, &(struct sg_statistics){.radius = radius}), SG_OK);
            for (size_t i = 0; i < 60; i++)
                large += radius[i] > 20;
            assert_in_range(large, 2, 55);
            if (k == n_cases - 1)
                memcpy(expected, radius, sizeof(radius));
            assert_memory_equal(radius, expected, sizeof(radius));
            const struct sg_densify_params p = {.gradient = 9,
                                                .prune_scale = late ? 1e9f : 0,
                                                .max_gaussians = 10,
                                                .overshoot = true,
                                                .seed = 1};
            struct sg_densify_result r;
            assert_int_equal(sg_densify(b, &p, &r), SG_OK);
            assert_int_equal(r.pruned, late ? large : 0);
            assert_int_equal(
                sg_engine_read_statistics(b, &(struct sg_statistics){.radius = radius}), SG_OK);
            size_t left = 0; /* the others keep what was counted */
            for (size_t i = 0; i < sg_engine_count(b); i++)
                left += radius[i] > 0;
            assert_true(left > 0);
            sg_engine_destroy(&b);
            sg_model_destroy(&m);
        }
    }
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_densify), cmocka_unit_test(test_alike),
                                       cmocka_unit_test(test_replaced),
                                       cmocka_unit_test(test_overshoot),
                                       cmocka_unit_test(test_screen)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
