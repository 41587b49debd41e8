/* SPDX-License-Identifier: Apache-2.0 */
/* Views that are more than a camera and a photo: exposures, the low-pass term against what a
 * photo's change adds, and the 2D filter of Mip-Splatting, on every engine and variant. */
#include "operations.h"

/* Gives an engine one exposure, unless NULL; returns what a target with it says. */
static size_t give_exposure(struct sg_engine *e, const float *exposure)
{
    static float values[SG_EXPOSURE_FLOATS];
    if (!exposure)
        return 0;
    memcpy(values, exposure, SG_EXPOSURE * sizeof(*exposure));
    assert_int_equal(sg_engine_set_exposures(e, values, 1), SG_OK);
    return 1;
}

/* The loss of a dark photo on a model that is drawn anew. */
static struct sg_step exposed_loss(struct sg_engine *e, const struct sg_model *m,
                                   const uint8_t *mask, const float *exposure)
{
    assert_int_equal(sg_engine_upload(e, m, NULL), SG_OK);
    return losses_against(e, m, mask, give_exposure(e, exposure), 40, 1);
}

/* What it makes of a render is brighter than the photo everywhere: the loss has no kink. */
static const float some_exposure[SG_EXPOSURE] = {0.9f, 0.1f, -0.05f, 0.3f,   0.08f, 1.1f,
                                                 0.2f, 0.3f, -0.1f,  -0.03f, 0.75f, 0.35f};

/* The gradients with respect to an exposure and, through it, to colours, by differences of the
 * loss. */
static void test_exposure_gradient(void **state)
{
    (void) state;
    enum { N = 30 };
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, N, 0, 38);
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, m, NULL);
        const struct sg_step at = exposed_loss(e, m, NULL, some_exposure);
        struct sg_model *g = gradients_of(ctx, e, m);
        float moved[SG_EXPOSURE];
        for (int i = 0; i < SG_EXPOSURE; i++) {
            double change = 0;
            for (int side = -1; side <= 1; side += 2) {
                memcpy(moved, some_exposure, sizeof(moved));
                moved[i] += 0.01f * (float) side;
                change += side * exposed_loss(e, m, NULL, moved).loss[SG_LOSS_PHOTOMETRIC] / 0.02;
            }
            if (!(fabs(change - at.exposure[i]) < 0.02 * fabs(change) + 5e-4))
                fail_msg("%s: number %d: gradient %g, expected %g", case_name(cases[k]), i,
                         at.exposure[i], change);
        }
        float largest = 0;
        for (size_t i = 0; i < N; i++)
            largest = fmaxf(largest, fabsf(*sg_model_at(g, i, SG_P_SH + 1)));
        for (size_t i = 0; i < N; i++) {
            float *green = sg_model_at(m, i, SG_P_SH + 1);
            const float kept = *green;
            double change = 0;
            for (int side = -1; side <= 1; side += 2) {
                *green = kept + 0.05f * (float) side;
                change += side * exposed_loss(e, m, NULL, some_exposure).loss[0] / 0.1;
            }
            *green = kept;
            const float found = *sg_model_at(g, i, SG_P_SH + 1);
            if (!(fabs(change - (double) found) < 0.08 * (double) largest))
                fail_msg("%s: Gaussian %zu: gradient %g, expected %g", case_name(cases[k]), i,
                         (double) found, change);
        }
        sg_model_destroy(&g);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void assert_exposure(int k, const struct sg_step *found, const struct sg_step *expected)
{
    double most = 0, largest = 0;
    for (int i = 0; i < SG_EXPOSURE; i++) {
        most = fmax(most, fabs(found->exposure[i] - expected->exposure[i]));
        largest = fmax(largest, fabs(expected->exposure[i]));
    }
    assert_within(case_name(cases[k]), "gradient of an exposure", most / largest, 1e-4);
}

/* Every engine has the oracle's values; the identity is no exposure. */
static void test_exposure_values(void **state)
{
    (void) state;
    static const float identity[SG_EXPOSURE] = {[0] = 1, [5] = 1, [10] = 1};
    static uint8_t mask[PIXELS];
    for (size_t i = 0; i < PIXELS; i++)
        mask[i] = i % 7 ? 255 : 0;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_sure_model(ctx, 69), *right = NULL;
    struct sg_step expected = {0};
    for (int k = case_count - 1; k >= 0; k--) {
        struct sg_engine *e = begin(ctx, k, m, NULL);
        const struct sg_step none = exposed_loss(e, m, NULL, NULL);
        struct sg_model *g = gradients_of(ctx, e, m);
        const struct sg_step same = exposed_loss(e, m, NULL, identity);
        struct sg_model *h = gradients_of(ctx, e, m);
        assert_true(same.photometric.total == none.photometric.total);
        assert_memory_equal(g->params, h->params, values_of(g) * sizeof(float));
        sg_model_destroy(&g);
        sg_model_destroy(&h);
        const struct sg_step found = exposed_loss(e, m, mask, some_exposure);
        g = gradients_of(ctx, e, m);
        if (!right) {
            expected = found, right = g;
        } else {
            assert_within(case_name(cases[k]), "loss with an exposure",
                          fabs(found.photometric.total / expected.photometric.total - 1), 1e-5);
            assert_exposure(k, &found, &expected);
            assert_gradients(case_name(cases[k]), "gradient with an exposure", g, right, 1e-4);
            sg_model_destroy(&g);
        }
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&right);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

#define EXPOSED 3 /* photos */

/* Steps with two of the photos. */
static void learn_exposures(struct sg_engine *e, const struct sg_model *m,
                            float values[EXPOSED * SG_EXPOSURE_FLOATS])
{
    static const size_t photos[] = {2, 0, 2, 2};
    memset(values, 0, EXPOSED * SG_EXPOSURE_FLOATS * sizeof(*values));
    for (size_t photo = 0; photo < EXPOSED; photo++)
        memcpy(values + photo * SG_EXPOSURE, some_exposure, sizeof(some_exposure));
    assert_int_equal(sg_engine_set_exposures(e, values, EXPOSED), SG_OK);
    for (int step = 0; step < 4; step++) {
        const double beta1 = pow(0.9, step + 1), beta2 = pow(0.999, step + 1);
        const struct sg_exposure_update update = {0.01 / (1 - beta1), 1 / sqrt(1 - beta2)};
        assert_int_equal(sg_engine_upload(e, m, NULL), SG_OK);
        losses_against(e, m, NULL, photos[step] + 1, 40, 1);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        assert_int_equal(sg_engine_learn_exposures(e, &update), SG_OK);
        assert_int_equal(sg_engine_optimise(e, &(struct sg_update){0}), SG_OK);
        assert_int_equal(sg_engine_learn_exposures(e, &update), SG_ERR_INTERNAL); /* too late */
        sg_clear_error(sg_engine_ctx(e));
    }
    assert_int_equal(sg_engine_read_exposures(e), SG_OK);
}

/* Every engine learns exposures as the oracle does, and the same bytes each time. */
static void test_exposure_steps(void **state)
{
    (void) state;
    static float right[EXPOSED * SG_EXPOSURE_FLOATS], found[EXPOSED * SG_EXPOSURE_FLOATS],
        again[EXPOSED * SG_EXPOSURE_FLOATS];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 43);
    for (int k = case_count - 1; k >= 0; k--) {
        struct sg_engine *e = begin(ctx, k, m, NULL);
        learn_exposures(e, m, found);
        learn_exposures(e, m, again);
        assert_memory_equal(found, again, sizeof(found));
        if (k == case_count - 1)
            memcpy(right, found, sizeof(right));
        for (int plane = 0; plane < 3; plane++) {
            const size_t first = (size_t) plane * EXPOSED * SG_EXPOSURE;
            float largest = 0;
            for (size_t i = first; i < first + EXPOSED * SG_EXPOSURE; i++)
                largest = fmaxf(largest, fabsf(right[i]));
            assert_true(largest > 0);
            for (size_t i = first; i < first + EXPOSED * SG_EXPOSURE; i++)
                if (!(fabsf(found[i] - right[i]) <= 1e-4f * largest))
                    fail_msg("%s: number %zu of plane %d: %g, expected %g", case_name(cases[k]),
                             i - first, plane, (double) found[i], (double) right[i]);
        }
        assert_memory_equal(found + SG_EXPOSURE, some_exposure, sizeof(some_exposure));
        assert_true(fabsf(found[0] - some_exposure[0]) > 0.005f);
        assert_true(fabsf(found[2 * SG_EXPOSURE] - some_exposure[0]) > 0.02f);
        losses_against(e, m, NULL, 0, 40, 1);
        assert_int_equal(sg_engine_learn_exposures(e, &(struct sg_exposure_update){0}),
                         SG_ERR_INTERNAL);
        sg_clear_error(ctx);
        assert_int_equal(sg_engine_losses(e, &(struct sg_target){.exposure = EXPOSED + 1}, NULL, 0),
                         SG_ERR_USAGE);
        sg_clear_error(ctx);
        assert_int_equal(sg_engine_set_exposures(e, NULL, 0), SG_OK);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* A case of the low-pass term: of a photo or of planes, with what there is beside it. */
struct low_pass_case {
    bool planes, masked, exposed;
    float tolerance;
};

static struct sg_step low_pass_loss(struct sg_engine *e, const struct sg_model *m,
                                    const struct low_pass_case *c, float low_pass)
{
    static uint8_t photo[3 * PIXELS], mask[PIXELS];
    static float planes[3 * PIXELS];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_loss loss = {
        SG_LOSS_PHOTOMETRIC,
        1,
        {.photometric = {.lambda_dssim = 0.2f, .tolerance = c->tolerance, .low_pass = low_pass}}};
    struct sg_target target = {.exposure = give_exposure(e, c->exposed ? some_exposure : NULL)};
    for (size_t i = 0; i < 3 * PIXELS; i++) { /* many within the tolerance of black or white */
        const float side = draw(31, i, 0, 1), v = draw(30, i, 0, 1);
        planes[i] = side < 0.3f ? 0.1f * v : side < 0.5f ? 1 - 0.1f * v : v;
        photo[i] = (uint8_t) (255 * planes[i]);
        mask[i % PIXELS] = i % 7 ? 255 : 0;
    }
    if (c->planes)
        target.planes = planes;
    else
        assert_int_equal(
            sg_engine_photo_add(e, W, H, photo, c->masked ? mask : NULL, &target.photo), SG_OK);
    return step_against(e, m, &camera, &target, &loss, 1);
}

/* The low-pass term has the oracle's value and gradient, which are the same bytes the second time.
 */
static void test_low_pass_values(void **state)
{
    (void) state;
    static const struct low_pass_case of[] = {
        {.tolerance = 0.1f},
        {.masked = true, .tolerance = 0.1f},
        {.planes = true, .tolerance = 0.6f}, /* most values are near black and near white */
        {.planes = true},
        {.masked = true, .exposed = true, .tolerance = 0.1f},
    };
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_sure_model(ctx, 145);
    for (size_t c = 0; c < sizeof(of) / sizeof(of[0]); c++) {
        struct sg_model *right = NULL;
        struct sg_step expected = {0};
        for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
            struct sg_engine *e = begin(ctx, k, m, NULL);
            const struct sg_step without = low_pass_loss(e, m, &of[c], 0);
            const struct sg_step found = low_pass_loss(e, m, &of[c], 40);
            struct sg_model *g = gradients_of(ctx, e, m);
            assert_true(found.photometric.total > 1.01 * without.photometric.total);
            const struct sg_step again = low_pass_loss(e, m, &of[c], 40);
            struct sg_model *h = gradients_of(ctx, e, m);
            assert_memory_equal(g->params, h->params, values_of(g) * sizeof(float));
            assert_true(again.photometric.total == found.photometric.total);
            sg_model_destroy(&h);
            if (!right) {
                expected = found, right = g;
            } else {
                assert_within(case_name(cases[k]), "loss with the low-pass term",
                              fabs(found.photometric.total / expected.photometric.total - 1), 1e-5);
                if (of[c].exposed)
                    assert_exposure(k, &found, &expected);
                assert_gradients(case_name(cases[k]), "gradient with the low-pass term", g, right,
                                 1e-4);
                sg_model_destroy(&g);
            }
            sg_engine_destroy(&e);
        }
        sg_model_destroy(&right);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* With the 2D filter of Mip-Splatting images, gradients and hits are the oracle's, and others than
 * without. */
static void check_mip_filter(float kernel, uint64_t seed)
{
    static float weight[3 * PIXELS], rgb[3 * PIXELS], right[3 * PIXELS], plain[3 * PIXELS];
    static double hits[GAUSSIANS], right_hits[GAUSSIANS];
    sg_ctx *ctx = make_context(2);
    const struct sg_camera camera = make_camera(W, H, 3), *views[] = {&camera};
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, seed), *expected = NULL;
    for (size_t i = 0; i < 3 * PIXELS; i++)
        weight[i] = draw(20, i, -1, 1);
    for (size_t i = 0; i < GAUSSIANS; i += 2) /* of about a pixel */
        for (int axis = 0; axis < 3; axis++)
            *sg_model_at(m, i, SG_P_SCALE + axis) = draw(21, i, -5, -3);
    assert_int_equal(
        find_edges(m, &camera, &(struct sg_render_params){SG_RENDER_DEFAULTS, .mip_kernel = kernel},
                   1e-3, NULL),
        0);
    for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
        struct sg_render_params params = {SG_RENDER_DEFAULTS};
        struct sg_engine *e = begin(ctx, k, m, NULL);
        assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, false), SG_OK);
        assert_int_equal(sg_engine_read_image(e, plain, NULL, NULL), SG_OK);
        params.mip_kernel = kernel;
        assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, false), SG_OK);
        assert_int_equal(sg_engine_read_image(e, rgb, NULL, NULL), SG_OK);
        assert_int_equal(sg_engine_write_image_gradient(e, weight), SG_OK);
        struct sg_model *g = gradients_of(ctx, e, m);
        assert_int_equal(sg_engine_count_hits(e, views, 1, &params, SG_HIT_WEIGHT, hits), SG_OK);
        if (!expected) {
            expected = g;
            memcpy(right, rgb, sizeof(rgb));
            memcpy(right_hits, hits, sizeof(hits));
        } else {
            double most = 0;
            for (size_t i = 0; i < GAUSSIANS; i++)
                most = fmax(most, fabs(hits[i] - right_hits[i]) / (1 + right_hits[i]));
            assert_within(case_name(cases[k]), "hits through the 2D filter: weight", most, 2e-5);
            assert_within(case_name(cases[k]), "image through the 2D filter",
                          difference_of(rgb, right, 3 * PIXELS, NULL, 1), 1e-5);
            assert_gradients(case_name(cases[k]), "gradient through the 2D filter", g, expected,
                             1e-4);
            sg_model_destroy(&g);
        }
        size_t differ = 0;
        for (size_t i = 0; i < 3 * PIXELS; i++)
            differ += fabsf(rgb[i] - plain[i]) > 0.01f;
        assert_true(differ > PIXELS / 4);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&expected);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_mip_filter(void **state)
{
    (void) state;
    check_mip_filter(0.1f, 42);
    check_mip_filter(0.45f, 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_exposure_gradient), cmocka_unit_test(test_exposure_values),
        cmocka_unit_test(test_exposure_steps),    cmocka_unit_test(test_low_pass_values),
        cmocka_unit_test(test_mip_filter),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
