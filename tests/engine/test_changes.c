/* SPDX-License-Identifier: Apache-2.0 */
/* What changes Gaussians in place or what is drawn of them, on every engine and variant of this
 * machine. */
#include "model/mip.h"
#include "operations.h"

/* ---- the 3D filter of Mip-Splatting ---- */

static const struct sg_shape mip = {
    .name = "mip", .column = SG_C_FILTER, .forward = sg_mip_forward, .backward = sg_mip_backward};

static struct sg_columns filter_of(sg_ctx *ctx, struct sg_engine *e)
{
    struct sg_columns o;
    assert_int_equal(
        sg_columns_create(ctx, sg_engine_count(e), 0, SG_COLUMN_SAVED | SG_COLUMN_MIP, &o), SG_OK);
    assert_int_equal(sg_engine_download(e, NULL, &o), SG_OK);
    return o;
}

/* Of many widths, and none in every fifth place. */
static struct sg_columns some_filters(sg_ctx *ctx, size_t n, int degree)
{
    struct sg_columns o;
    assert_int_equal(sg_columns_create(ctx, n, degree, SG_COLUMN_SAVED | SG_COLUMN_MIP, &o), SG_OK);
    for (size_t i = 0; i < n; i++)
        o.at[SG_C_FILTER][i] = 0.1f * (float) (i % 5) * draw(83, i, 0, 1);
    return o;
}

/* What is drawn through the filter, its gradients and a step by these are the oracle's; and what is
 * drawn is not what is drawn without. */
static void test_mip(void **state)
{
    (void) state;
    static float expected[3 * PIXELS], found[3 * PIXELS], plain[3 * PIXELS];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 84), *right = NULL, *moved = NULL;
    struct sg_columns o = some_filters(ctx, GAUSSIANS, DEGREE);
    struct sg_update u = {.adam = true};
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = 0.01f, u.root[g] = 30;
    for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
        struct sg_model *g, *after;
        struct sg_engine *e = begin(ctx, k, m, &o);
        assert_int_equal(sg_model_create(ctx, GAUSSIANS, DEGREE, &after), SG_OK);
        losses_against(e, m, NULL, NULL, 255.9f, 1);
        assert_int_equal(sg_engine_read_image(e, plain, NULL, NULL), SG_OK);
        assert_int_equal(sg_engine_set_shape(e, &mip), SG_OK);
        losses_against(e, m, NULL, NULL, 255.9f, 1);
        assert_int_equal(sg_engine_read_image(e, right ? found : expected, NULL, NULL), SG_OK);
        g = gradients_of(ctx, e, m);
        assert_int_equal(sg_engine_optimise(e, &u), SG_OK);
        assert_int_equal(sg_engine_download(e, after, NULL), SG_OK);
        sg_engine_destroy(&e);
        if (!right) {
            right = g, moved = after;
            continue;
        }
        size_t off = 0, changed = 0;
        for (size_t i = 0; i < 3 * PIXELS; i++) {
            off += !(fabsf(found[i] - expected[i]) <= 1e-4f);
            changed += fabsf(found[i] - plain[i]) > 1e-2f;
        }
        if (off > PIXELS / 200 || changed < PIXELS / 10)
            fail_msg("%s: %zu pixels are off, %zu changed", case_name(cases[k]), off, changed);
        assert_near(k, "gradient", g, right, 2e-3f, 0.03);
        assert_near(k, "step", after, moved, 1e-3f, 0.03);
        sg_model_destroy(&g);
        sg_model_destroy(&after);
    }
    sg_model_destroy(&right);
    sg_model_destroy(&moved);
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* It follows from the nearest camera that sees a Gaussian; what none sees gets the largest. */
static void test_filter(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m;
    struct sg_camera close_by = {.width = 800,
                                 .height = 600,
                                 .fx = 1000,
                                 .fy = 1000,
                                 .cx = 400,
                                 .cy = 300,
                                 .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                     far = close_by;
    const struct sg_camera *both[] = {&close_by, &far};
    far.t[2] = 3;
    assert_int_equal(sg_model_create(ctx, 5, 0, &m), SG_OK);
    const float at[5][3] = {{0, 0, 2}, {0, 0, 0.2f}, {0, 0, -9}, {0, 0, 4}, {0, 0.779f, 2}};
    for (size_t i = 0; i < 5; i++) {
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_XYZ + k) = at[i][k];
        *sg_model_at(m, i, SG_P_ROT) = 1;
    }
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, m, NULL);
        struct sg_columns o;
        const double unit = 0.4472136 / 1000;
        assert_int_equal(sg_engine_filter(e, both, 2), SG_OK);
        o = filter_of(ctx, e);
        /* 0.2 is too near for the first, and 3.2 from the second; -9 is behind both. The last lies
         * 14.9 % below the edge. */
        const double depth[5] = {2, 3.2, 4, 4, 2};
        for (size_t i = 0; i < 5; i++) {
            const double expected = unit * depth[i];
            if (fabs((double) o.at[SG_C_FILTER][i] / expected - 1) > 1e-5)
                fail_msg("%s: Gaussian %zu: filter %g, expected %g", case_name(cases[k]), i,
                         (double) o.at[SG_C_FILTER][i], expected);
        }
        sg_columns_clear(&o);
        /* further away, the far camera changes nothing that the near one sees; larger focal lengths
         * make all smaller */
        far.t[2] = 60, far.fx = 2000;
        assert_int_equal(sg_engine_filter(e, both, 2), SG_OK);
        o = filter_of(ctx, e);
        assert_true(fabs((double) o.at[SG_C_FILTER][0] / (2 * unit / 2) - 1) < 1e-5);
        assert_true(fabs((double) o.at[SG_C_FILTER][1] / (60.2 * unit / 2) - 1) < 1e-5);
        /* none is seen at all: the filter stays */
        const float kept = o.at[SG_C_FILTER][1];
        sg_columns_clear(&o);
        close_by.t[2] = far.t[2] = -100;
        assert_int_equal(sg_engine_filter(e, both, 2), SG_OK);
        o = filter_of(ctx, e);
        assert_true(o.at[SG_C_FILTER][1] == kept);
        sg_columns_clear(&o);
        close_by.t[2] = 0, far.t[2] = 3, far.fx = 1000;
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* A reset limits what is drawn, not what is stored. */
static void test_reset(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 40, 0, 82), *after;
    struct sg_columns o = some_filters(ctx, 40, 0);
    const size_t stride = (size_t) sg_param_count(0) * SG_LANES;
    assert_int_equal(sg_model_create(ctx, 40, 0, &after), SG_OK);
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, m, &o);
        int limited = 0;
        assert_int_equal(sg_engine_set_shape(e, &mip), SG_OK);
        assert_int_equal(sg_engine_reset_opacity(e, 0.01f), SG_OK);
        assert_int_equal(sg_engine_download(e, after, NULL), SG_OK);
        for (size_t i = 0; i < 40; i++) {
            float shaped[SG_PARAMS_MAX * SG_LANES];
            double drawn[2];
            for (int which = 0; which < 2; which++) {
                sg_mip_forward(NULL, (which ? after : m)->params + i / SG_LANES * stride,
                               o.at[SG_C_FILTER] + i / SG_LANES * SG_LANES, sg_param_count(0),
                               shaped);
                drawn[which] =
                    1 / (1 + exp(-(double) shaped[SG_P_OPACITY * SG_LANES + i % SG_LANES]));
            }
            limited += drawn[0] > 0.01;
            if (!(fabs(drawn[1] - fmin(drawn[0], 0.01)) < 1e-5))
                fail_msg("%s: Gaussian %zu: %g after %g", case_name(cases[k]), i, drawn[1],
                         drawn[0]);
        }
        assert_in_range(limited, 10, 39); /* some are, some are not */
        sg_engine_destroy(&e);
    }
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    sg_model_destroy(&after);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mip),
        cmocka_unit_test(test_filter),
        cmocka_unit_test(test_reset),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
