/* SPDX-License-Identifier: Apache-2.0 */
/* The attack's steps on images, on every engine and variant of this machine. */
#include "attack/ascent.h"
#include "image/total_variation.h"
#include "models.h"

static const char *const form_names[] = {"vertical2", "aniso", "iso"};

/* For every image and number of steps: the poison is within the bound and the range, has more total
 * variation, is the same for any number of threads, and agrees with the oracle. */
static void test_ascent(void **state)
{
    (void) state;
    enum { W = 37, H = 23, VALUES = 3 * W * H };
    static float photo[VALUES], start[VALUES], x[2][VALUES], oracle[VALUES], scratch[VALUES];
    static float bound[W * H];
    static double rows[3 * H];
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases) - 1;
    sg_ctx *ctx = make_context(2);
    struct sg_engine *engines[ENGINE_CASES], *ref;
    for (int v = 0; v <= n; v++)
        assert_int_equal(sg_engine_create(ctx, cases[v].engine, cases[v].variant, &engines[v]),
                         SG_OK);
    ref = engines[n];
    for (int form = SG_ATTACK_TV_VERTICAL2; form <= SG_ATTACK_TV_ISO; form++)
        for (uint64_t seed = 0; seed < 12; seed++) {
            const float epsilon = seed % 4 == 3 ? INFINITY : (float) (8 * (seed % 4)) / 255;
            for (uint64_t i = 0; i < VALUES; i++) {
                photo[i] = floorf(draw(seed, i, 0, 255.99f)) / 255;
                start[i] = seed % 2 ? draw(seed + 100, i, 0, 1) : photo[i];
            }
            for (uint64_t i = 0; i < W * H; i++)
                bound[i] = draw(seed + 200, i, 0, 12 / 255.0f);
            struct ascent a = {.epsilon = epsilon,
                               .step = 2 / 255.0f,
                               .steps = (int) (seed * 3),
                               .form = (enum sg_attack_tv) form,
                               .bound = seed % 3 == 2 ? bound : NULL};
            memcpy(x[0], start, sizeof(start));
            assert_int_equal(sg_ascend(ref, &a, photo, W, H, x[0], scratch), SG_OK);
            for (int v = 0; v < n; v++) {
                memcpy(x[1], start, sizeof(start));
                a.steps = form == SG_ATTACK_TV_ISO && seed
                              ? 1
                              : (int) (seed * 3); /* rounding decides signs of nearly 0 */
                assert_int_equal(sg_ascend(engines[v], &a, photo, W, H, x[1], scratch), SG_OK);
                if (form != SG_ATTACK_TV_ISO)
                    assert_memory_equal(x[0], x[1], sizeof(start));
                memcpy(oracle, start, sizeof(start));
                assert_int_equal(sg_ascend(ref, &a, photo, W, H, oracle, scratch), SG_OK);
                int differ = 0;
                for (int i = 0; i < VALUES; i++)
                    differ += fabsf(oracle[i] - x[1][i]) > 1e-6f;
                if (differ > VALUES / 500)
                    fail_msg("%s, %s, seed %llu: %d of %d values differ", case_name(cases[v]),
                             form_names[form], (unsigned long long) seed, differ, VALUES);
            }
            a.steps = (int) (seed * 3);
            for (int k = 0; k < 2; k++) {
                sg_ctx *other = make_context(k ? 3 : 1);
                memcpy(x[k], start, sizeof(start));
                struct sg_engine *e;
                assert_int_equal(sg_engine_create(other, "cpu", NULL, &e), SG_OK);
                assert_int_equal(sg_ascend(e, &a, photo, W, H, x[k], scratch), SG_OK);
                sg_engine_destroy(&e);
                sg_ctx_destroy(&other);
            }
            assert_memory_equal(x[0], x[1], sizeof(start));
            for (int i = 0; i < VALUES && a.steps; i++)
                if (!(x[0][i] >= 0 && x[0][i] <= 1 &&
                      fabsf(x[0][i] - photo[i]) <=
                          (a.bound ? bound[i % (W * H)] : epsilon) + 1e-6f))
                    fail_msg("%s, seed %llu: %g from %g", form_names[form],
                             (unsigned long long) seed, (double) x[0][i], (double) photo[i]);
            if (a.steps && epsilon > 0 && !(seed % 2))
                assert_true(sg_tv_planes(ctx, x[0], W, H, a.form, rows) >
                            sg_tv_planes(ctx, photo, W, H, a.form, rows));
        }
    for (int v = 0; v <= n; v++)
        sg_engine_destroy(&engines[v]);
    sg_ctx_destroy(&ctx);
}

/* An attacker who knows the defense: the same ball, with less anisotropy than without the term, for
 * any variant; the same bytes each time, and a step as the oracle's. */
static void test_spectral(void **state)
{
    (void) state;
    enum { W = 48, H = 40, VALUES = 3 * W * H };
    static float photo[VALUES], x[VALUES], scratch[VALUES], extra[VALUES], again[VALUES];
    static float right[VALUES];
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    sg_ctx *ctx = make_context(2);
    struct sg_anisotropy *loss;
    assert_int_equal(sg_anisotropy_create(ctx, W, H, NULL, NULL, &loss), SG_OK);
    for (uint64_t i = 0; i < VALUES; i++)
        photo[i] = draw(11, i, 0.3f, 0.7f);
    for (int v = n - 1; v >= 0; v--) { /* the oracle is the last */
        double found[2];
        struct sg_engine *e;
        assert_int_equal(sg_engine_create(ctx, cases[v].engine, cases[v].variant, &e), SG_OK);
        for (int with = 0; with < 2; with++) {
            const struct ascent a = {16 / 255.0f, 2 / 255.0f,         10, SG_ATTACK_TV_VERTICAL2,
                                     NULL,        with ? loss : NULL, 3,  extra};
            memcpy(x, photo, sizeof(x));
            assert_int_equal(sg_ascend(e, &a, photo, W, H, x, scratch), SG_OK);
            memcpy(again, photo, sizeof(again));
            assert_int_equal(sg_ascend(e, &a, photo, W, H, again, scratch), SG_OK);
            assert_memory_equal(x, again, sizeof(x));
            found[with] = sg_anisotropy_loss(loss, x, 1, NULL);
            for (int i = 0; i < VALUES; i++)
                assert_true(fabsf(x[i] - photo[i]) <= a.epsilon + 1e-6f);
        }
        if (!(found[1] < 0.5 * found[0]))
            fail_msg("%s: anisotropy %g with the term, %g without", case_name(cases[v]), found[1],
                     found[0]);
        for (int steps = 1; steps <= 2; steps++) {
            const struct ascent a = {INFINITY, 2 / 255.0f, steps, SG_ATTACK_TV_ANISO,
                                     NULL,     loss,       3,     extra};
            size_t off = 0;
            memcpy(x, photo, sizeof(x));
            assert_int_equal(sg_ascend(e, &a, photo, W, H, x, scratch), SG_OK);
            if (v == n - 1 && steps == 2)
                memcpy(right, x, sizeof(right));
            for (int i = 0; i < VALUES && steps == 2; i++)
                off += fabsf(x[i] - right[i]) > 1e-6f;
            if (off > VALUES / 500)
                fail_msg("%s: %zu of %d values differ", case_name(cases[v]), off, VALUES);
        }
        sg_engine_destroy(&e);
    }
    sg_anisotropy_destroy(&loss);
    sg_ctx_destroy(&ctx);
}

/* The steps of a view on a device, whose result is a target of losses: loss and gradients are those
 * of the same steps taken on the image that was read. Some of that is brighter than white. */
static void test_views(void **state)
{
    (void) state;
    enum { W = 40, H = 24, PIXELS = W * H, VALUES = 3 * PIXELS, STEPS = 3 };
    static uint8_t rgb[VALUES];
    static float photo[VALUES], image[VALUES], x[VALUES], scratch[VALUES], extra[VALUES];
    static double rows[3 * H];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    const struct sg_loss loss = {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, 80, 1, 9), *found, *expected;
    struct sg_anisotropy *spectral;
    int bright = 0;
    assert_int_equal(sg_anisotropy_create(ctx, W, H, NULL, NULL, &spectral), SG_OK);
    assert_int_equal(sg_model_create(ctx, m->count, 1, &found), SG_OK);
    assert_int_equal(sg_model_create(ctx, m->count, 1, &expected), SG_OK);
    for (size_t i = 0; i < m->count; i += 2)
        for (int ch = 0; ch < 3; ch++)
            *sg_model_at(m, i, SG_P_SH + ch) += 2;
    for (uint64_t i = 0; i < VALUES; i++) {
        rgb[i] = (uint8_t) draw(12, i, 200, 255.9f);
        photo[i % 3 * PIXELS + i / 3] = (float) rgb[i] * (1.0f / 255.0f); /* as a kernel does */
    }
    for (int v = 0; v < n; v++) {
        struct sg_engine *e = make_engine(ctx, cases[v].engine, cases[v].variant, m, NULL);
        struct sg_target target = {0};
        assert_int_equal(sg_engine_photo_add(e, W, H, rgb, NULL, &target.photo), SG_OK);
        for (int k = 0; k < 12 && sg_engine_ascends_views(e); k++) {
            const enum sg_attack_tv form = (enum sg_attack_tv)(k % 3);
            const float epsilon = k / 3 % 2 ? INFINITY : 60 / 255.0f, weight = k / 6 ? 3 : 0;
            const struct sg_view_ascent of_view = {target.photo, epsilon, 2 / 255.0f,
                                                   STEPS,        form,    weight};
            const struct ascent of_image = {epsilon, 2 / 255.0f, STEPS,
                                            form,    NULL,       weight > 0 ? spectral : NULL,
                                            weight,  extra};
            struct sg_step a, b;
            assert_int_equal(sg_engine_draw(e, &camera, 1, &render, false), SG_OK);
            assert_int_equal(sg_engine_ascend_view(e, &of_view), SG_OK);
            assert_int_equal(sg_engine_losses(e, &(struct sg_target){.ascended = true}, &loss, 1),
                             SG_OK);
            assert_int_equal(sg_engine_raster_backward(e), SG_OK);
            assert_int_equal(sg_engine_read_gradients(e, found), SG_OK);
            assert_int_equal(sg_engine_read_step(e, &a), SG_OK);

            assert_int_equal(sg_engine_draw(e, &camera, 1, &render, false), SG_OK);
            assert_int_equal(sg_engine_read_image(e, image, NULL, NULL), SG_OK);
            for (int i = 0; i < VALUES; i++) {
                bright += image[i] > 1;
                x[i] = k / 3 % 2 ? image[i] : fminf(fmaxf(image[i], 0), 1);
            }
            assert_int_equal(sg_ascend(e, &of_image, photo, W, H, x, scratch), SG_OK);
            assert_int_equal(sg_engine_losses(e, &(struct sg_target){.planes = x}, &loss, 1),
                             SG_OK);
            assert_int_equal(sg_engine_raster_backward(e), SG_OK);
            assert_int_equal(sg_engine_read_gradients(e, expected), SG_OK);
            assert_int_equal(sg_engine_read_step(e, &b), SG_OK);
            const double variation = sg_tv_planes(ctx, x, W, H, form, rows) / VALUES;
            if (a.photometric.total != b.photometric.total ||
                memcmp(found->params, expected->params,
                       m->capacity * (size_t) sg_param_count(1) * sizeof(float)) != 0 ||
                !(fabs(a.variation - variation) <= 1e-5 * variation))
                fail_msg("%s, case %d: loss %.9g, variation %.9g, expected %.9g and %.9g",
                         case_name(cases[v]), k, a.photometric.total, a.variation,
                         b.photometric.total, variation);
        }
        assert_true(bright > 100 || !sg_engine_ascends_views(e));
        sg_engine_destroy(&e);
    }
    sg_anisotropy_destroy(&spectral);
    sg_model_destroy(&m);
    sg_model_destroy(&found);
    sg_model_destroy(&expected);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ascent),
        cmocka_unit_test(test_spectral),
        cmocka_unit_test(test_views),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
