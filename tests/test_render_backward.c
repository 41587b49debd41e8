/* SPDX-License-Identifier: Apache-2.0 */
/* sg_render_backward against central differences of sg_render, on every engine. */
#include "models.h"
#include "scene/reader.h"
#include "splatguard/render.h"

enum { SIDE = 24, VALUES = 3 * SIDE * SIDE };

/* L = sum of weight x image. */
static double loss(sg_ctx *ctx, const struct engine_case *c, const struct sg_model *m,
                   const struct sg_camera *camera, const float *weight)
{
    static float rgb[VALUES];
    const struct sg_render_params params = {.background = {0.2f, 0.5f, 0.1f},
                                            .max_instances = 1 << 20};
    sg_renderer *r;
    double sum = 0;
    assert_int_equal(sg_renderer_create(ctx, c->engine, c->variant, m, &params, &r), SG_OK);
    assert_int_equal(sg_render(r, camera, rgb, NULL, NULL, NULL), SG_OK);
    for (int k = 0; k < VALUES; k++)
        sum += (double) weight[k] * (double) rgb[k];
    sg_renderer_destroy(&r);
    return sum;
}

static void test_differences(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    static float weight[VALUES], rgb[VALUES];
    for (size_t k = 0; k < VALUES; k++)
        weight[k] = draw(4, k, -1, 1);
    for (int c = 0, n = engine_cases(cases); c < n; c++) {
        sg_ctx *ctx = make_context(1);
        struct sg_model *m = make_model(ctx, 5, 2, 8), *gradients;
        const struct sg_camera camera = make_camera(SIDE, SIDE, 3);
        const struct sg_render_params params = {.background = {0.2f, 0.5f, 0.1f},
                                                .max_instances = 1 << 20};
        sg_renderer *r;
        for (size_t i = 0; i < m->count; i++) /* wide and smooth: few pixels cross a cut-off */
            for (int k = 0; k < 3; k++)
                *sg_model_at(m, i, SG_P_SCALE + k) = -0.7f + 0.1f * (float) k;
        assert_int_equal(sg_model_create(ctx, 5, 2, &gradients), SG_OK);
        assert_int_equal(sg_renderer_create(ctx, cases[c].engine, cases[c].variant, m, &params, &r),
                         SG_OK);
        assert_int_equal(sg_render_backward(r, weight, gradients), SG_ERR_USAGE); /* not drawn */
        assert_int_equal(sg_render(r, &camera, rgb, NULL, NULL, NULL), SG_OK);
        assert_int_equal(sg_render_backward(r, weight, gradients), SG_OK);
        sg_renderer_destroy(&r);
        int outliers = 0, checked = 0;
        double largest = 0;
        for (size_t i = 0; i < m->count; i++)
            for (int p = 0; p < sg_param_count(2); p++, checked++) {
                float *value = sg_model_at(m, i, p), kept = *value, step = 4e-3f;
                *value = kept + step;
                const double above = loss(ctx, &cases[c], m, &camera, weight);
                *value = kept - step;
                const double below = loss(ctx, &cases[c], m, &camera, weight);
                *value = kept;
                const double found = (double) *sg_model_at(gradients, i, p),
                             expected = (above - below) / (2 * (double) step);
                largest = fmax(largest, fabs(expected));
                outliers += fabs(found - expected) > 0.02 + 0.03 * fabs(expected);
            }
        assert_true(largest > 1);
        if (outliers * 20 > checked) /* a pixel that crosses a cut-off makes a jump */
            fail_msg("%s: %d of %d gradients differ", case_name(cases[c]), outliers, checked);
        sg_model_destroy(&m);
        sg_model_destroy(&gradients);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
}

static void test_refusals(void **state)
{
    (void) state;
    static float rgb[VALUES];
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 5, 1, 8), *other;
    const struct sg_camera camera = make_camera(SIDE, SIDE, 3);
    sg_renderer *r;
    assert_int_equal(sg_renderer_create(ctx, NULL, NULL, m, NULL, &r), SG_OK);
    assert_int_equal(sg_render(r, &camera, rgb, NULL, NULL, NULL), SG_OK);
    assert_int_equal(sg_model_create(ctx, 5, 2, &other), SG_OK);
    assert_int_equal(sg_render_backward(r, rgb, other), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "expected 5 of degree 1"));
    sg_model_destroy(&other);
    sg_renderer_destroy(&r);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_cameras(void **state)
{
    (void) state;
    static float rgb[VALUES];
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 5, 1, 8);
    const struct sg_camera good = make_camera(SIDE, SIDE, 3);
    sg_renderer *r;
    static const float backgrounds[] = {-0.01f, 1.01f, NAN, INFINITY};
    for (size_t i = 0; i < sizeof(backgrounds) / sizeof(backgrounds[0]); i++) {
        struct sg_render_params params = sg_render_params_default();
        params.background[2] = backgrounds[i];
        assert_int_equal(sg_renderer_create(ctx, NULL, NULL, m, &params, &r), SG_ERR_USAGE);
        assert_null(r);
        assert_non_null(strstr(sg_last_error(ctx), "background[2]: found"));
    }
    assert_int_equal(sg_renderer_create(ctx, NULL, NULL, m, NULL, &r), SG_OK);
    for (int wrong = 0; wrong < 4; wrong++) {
        struct sg_camera c = good;
        for (int k = 0; k < 9; k++)
            c.R[k] = wrong == 0   ? 0
                     : wrong == 1 ? 2 * c.R[k]
                     : wrong == 2 ? -c.R[k]
                     : k == 4     ? (double) NAN
                                  : c.R[k];
        assert_int_equal(sg_render(r, &c, rgb, NULL, NULL, NULL), SG_ERR_USAGE);
        assert_non_null(strstr(sg_last_error(ctx), "R that is off a rotation by"));
    }
    for (int wrong = 0; wrong < 7; wrong++) {
        struct sg_camera c = good;
        double *const value[] = {&c.fx, &c.fy, &c.cx, &c.cy, &c.t[0], &c.t[1], &c.t[2]};
        for (int k = 0; k < 3; k++) {
            *value[wrong] = (const double[]){(double) NAN, (double) -INFINITY, 1e13}[k];
            assert_int_equal(sg_render(r, &c, rgb, NULL, NULL, NULL), SG_ERR_USAGE);
            assert_memory_equal(sg_last_error(ctx), "render: camera.", 15);
        }
    }
    /* What a scene's file may have is drawn: poses that are off by nearly 1e-2 in all places. */
    for (int signs = 0; signs < 8; signs++) {
        const double a = signs & 1 ? 4.9e-3 : -4.9e-3, b = signs & 2 ? 4.9e-3 : -4.9e-3,
                     d = signs & 4 ? 4.9e-3 : -4.9e-3;
        const double pose[16] = {1, a, b, 0, a, 1, d, 0, b, d, 1, 3, 0, 0, 0, 1};
        struct sg_camera c = good;
        assert_int_equal(sg_pose_from_opengl(ctx, pose, "pose", c.R, c.t), SG_OK);
        assert_int_equal(sg_render(r, &c, rgb, NULL, NULL, NULL), SG_OK);
    }
    sg_renderer_destroy(&r);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_differences),
                                       cmocka_unit_test(test_refusals),
                                       cmocka_unit_test(test_cameras)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
