/* SPDX-License-Identifier: Apache-2.0 */
/* The tolerance of the photometric loss, on every engine and variant: what lies within it
 * of a photo has no gradient, what lies outside has that of the nearest image within it. */
#include "engine_cases.h"

#define WIDTH 45
#define HEIGHT 37
#define PIXELS ((size_t) WIDTH * HEIGHT)
#define VALUES (3 * PIXELS)
#define GAUSSIANS 60
#define MODELS 4

/* A model, drawn. */
struct drawn {
    sg_ctx *ctx;
    struct sg_engine *engine;
    float rgb[VALUES];
};

static struct drawn *draw_with(struct engine_case c, uint64_t seed)
{
    static struct drawn d;
    const struct sg_camera camera = make_camera(WIDTH, HEIGHT, 3);
    const struct sg_render_params params = {.max_instances = 1 << 20,
                                            .background = {0.2f, 0.1f, 0.3f}};
    d.ctx = make_context(2);
    struct sg_model *m = make_model(d.ctx, GAUSSIANS, 1, seed);
    d.engine = make_engine(d.ctx, c.engine, c.variant, m, NULL);
    assert_int_equal(sg_engine_draw(d.engine, &camera, 1, &params, false), SG_OK);
    assert_int_equal(sg_engine_read_image(d.engine, d.rgb, NULL, NULL), SG_OK);
    sg_model_destroy(&m);
    return &d;
}

static void finish(struct drawn *d)
{
    sg_engine_destroy(&d->engine);
    sg_ctx_destroy(&d->ctx);
}

/* The loss and the gradient of each parameter. The caller destroys *gradient. */
static struct sg_photometric_value lose_and_pull(struct drawn *d, const struct loss_case *p,
                                                 struct sg_model **gradient)
{
    const struct sg_photometric_value value = lose(d->engine, p);
    if (gradient) {
        assert_int_equal(sg_engine_raster_backward(d->engine), SG_OK);
        assert_int_equal(sg_model_create(d->ctx, GAUSSIANS, 1, gradient), SG_OK);
        assert_int_equal(sg_engine_read_gradients(d->engine, *gradient), SG_OK);
    }
    return value;
}

static size_t non_zero(const struct sg_model *m)
{
    size_t n = 0;
    for (size_t i = 0; i < m->capacity * (size_t) sg_param_count(m->sh_degree); i++)
        n += m->params[i] != 0;
    return n;
}

/* Poisons at the ball's faces, inside it, smooth ones and those of one sign. */
static float poison(int form, uint64_t seed, size_t i)
{
    switch (form) {
    case 0:
        return draw(seed, i, 0, 1) < 0.5f ? -1.0f : 1.0f;
    case 1:
        return draw(seed, i, -1, 1);
    case 2:
        return sinf((float) (i % WIDTH) * 0.3f + (float) seed);
    default:
        return 1;
    }
}

/* A model whose renders are the clean photos keeps its parameters, whatever a poison within the
 * tolerance does. */
static void no_gradient_within(void **state)
{
    (void) state;
    static float photo[VALUES];
    static uint8_t bytes[VALUES], mask[PIXELS], shown[PIXELS];
    for (size_t i = 0; i < PIXELS; i++)
        mask[i] = i % 5 ? 255 : 0;
    for (int k = 0; k < case_count; k++)
        for (uint64_t seed = 1; seed <= MODELS; seed++)
            for (int form = 0; form < 4; form++) {
                const float levels = 8.0f * (float) seed, tau = levels / 255;
                struct drawn *d = draw_with(cases[k], seed);
                for (size_t i = 0; i < VALUES; i++)
                    photo[i] = d->rgb[i] + tau * poison(form, seed, i);
                /* Bytes lie up to half a level from the value that they stand for, and show 0 to
                 * 255 only. */
                for (size_t i = 0; i < PIXELS; i++) {
                    shown[i] = 255;
                    for (size_t ch = 0; ch < 3; ch++) {
                        const float x = d->rgb[ch * PIXELS + i] * 255;
                        const float t = x + (levels - 0.5f) * poison(form, seed, 3 * i + ch);
                        bytes[3 * i + ch] = (uint8_t) fminf(fmaxf(t + 0.5f, 0), 255);
                        if (x < 0 || x > 255)
                            shown[i] = 0;
                    }
                }
                const struct loss_case targets[] = {
                    {.lambda_dssim = 0.2f, .tolerance = sg_loss_tolerance(levels), .planes = photo},
                    {.lambda_dssim = 1,
                     .tolerance = sg_loss_tolerance(levels),
                     .planes = photo,
                     .mask = mask},
                    {.lambda_dssim = 0.2f,
                     .tolerance = sg_loss_tolerance(levels),
                     .target = bytes,
                     .mask = shown},
                };
                for (size_t t = 0; t < sizeof(targets) / sizeof(targets[0]); t++) {
                    struct loss_case p = targets[t];
                    struct sg_model *g;
                    struct sg_photometric_value value = lose_and_pull(d, &p, &g);
                    assert_true(value.total == 0 && value.l1 == 0 && value.mse == 0 &&
                                value.ssim == 1);
                    assert_int_equal(non_zero(g), 0);
                    sg_model_destroy(&g);
                    p.tolerance = 0; /* the same photo moves the model otherwise */
                    value = lose_and_pull(d, &p, &g);
                    assert_true(value.total > 0 && non_zero(g) > GAUSSIANS);
                    sg_model_destroy(&g);
                }
                finish(d);
            }
}

/* At any model, poisoned photos within the tolerance have at most the L1 of the clean ones without
 * it. */
static void l1_at_most_that_of_clean_photos(void **state)
{
    (void) state;
    static float clean[VALUES], photo[VALUES];
    for (int k = 0; k < case_count; k++)
        for (uint64_t seed = 1; seed <= MODELS; seed++) {
            struct drawn *d = draw_with(cases[k], seed);
            for (size_t i = 0; i < VALUES; i++) {
                clean[i] = draw(seed + 30, i, 0, 1);
                photo[i] = clean[i] + 16.0f / 255 * poison((int) (seed % 4), seed, i);
            }
            const struct sg_photometric_value without =
                lose_and_pull(d, &(struct loss_case){.planes = clean}, NULL);
            const struct sg_photometric_value with = lose_and_pull(
                d, &(struct loss_case){.planes = photo, .tolerance = sg_loss_tolerance(16)}, NULL);
            assert_true(with.l1 <= without.l1 && with.l1 > 0.5 * without.l1);
            finish(d);
        }
}

/* The target is a constant: loss and gradient are those of the nearest image within the tolerance,
 * to the byte. A value that is its own target has no gradient, so where all are, neither has a
 * parameter. */
static void target_is_the_nearest_image(void **state)
{
    (void) state;
    static float photo[VALUES], nearest[VALUES];
    static uint8_t outside[PIXELS];
    const float tolerance = sg_loss_tolerance(20);
    for (int k = 0; k < case_count; k++) {
        struct drawn *d = draw_with(cases[k], 7);
        /* The left half is far from the photo, the right half near it. */
        for (size_t i = 0; i < VALUES; i++) {
            const bool far = i % WIDTH < WIDTH / 2;
            photo[i] =
                far ? d->rgb[i] + (i % 3 ? 0.3f : -0.3f) : d->rgb[i] + draw(5, i, -0.07f, 0.07f);
            nearest[i] = fminf(fmaxf(d->rgb[i], photo[i] - tolerance), photo[i] + tolerance);
            outside[i % PIXELS] = far ? 255 : 0;
        }
        struct sg_model *with, *without;
        const struct sg_photometric_value a = lose_and_pull(
            d, &(struct loss_case){.lambda_dssim = 0.2f, .tolerance = tolerance, .planes = photo},
            &with);
        const struct sg_photometric_value b = lose_and_pull(
            d, &(struct loss_case){.lambda_dssim = 0.2f, .planes = nearest, .mask = outside},
            &without);
        assert_true(a.total == b.total && a.l1 == b.l1 && a.mse == b.mse && a.ssim == b.ssim);
        assert_memory_equal(with->params, without->params,
                            with->capacity * (size_t) sg_param_count(1) * sizeof(float));
        assert_true(non_zero(with) > 0);
        sg_model_destroy(&with);
        sg_model_destroy(&without);
        finish(d);
    }
}

/* Of L1 alone the gradient of the whole loss, its target moving along, by central differences of
 * the colours of all Gaussians: away from the faces of the ball. */
static void l1_by_differences(void **state)
{
    (void) state;
    static float photo[VALUES];
    const struct sg_camera camera = make_camera(WIDTH, HEIGHT, 3);
    const float step = 1e-3f;
    for (int k = 0; k < case_count; k++) {
        struct drawn *d = draw_with(cases[k], 11);
        for (size_t i = 0; i < VALUES; i++) {
            const float away = draw(6, i, 0.005f, 0.2f);
            photo[i] = d->rgb[i] + (i % 2 ? away : -away);
            if (fabsf(away - 0.1f) < 2 * step) /* a face of the ball */
                photo[i] = d->rgb[i];
        }
        const struct loss_case p = {.tolerance = 0.1f, .planes = photo};
        struct sg_model *g;
        lose_and_pull(d, &p, &g);
        for (int ch = 0; ch < 3; ch++) { /* a change of all the colours of a channel */
            double expected = 0, loss[2];
            for (size_t i = 0; i < GAUSSIANS; i++)
                expected += (double) *sg_model_at(g, i, SG_P_SH + ch);
            for (int side = 0; side < 2; side++) {
                struct sg_model *moved = make_model(d->ctx, GAUSSIANS, 1, 11);
                for (size_t i = 0; i < GAUSSIANS; i++)
                    *sg_model_at(moved, i, SG_P_SH + ch) += side ? step : -step;
                const struct sg_render_params params = {.max_instances = 1 << 20,
                                                        .background = {0.2f, 0.1f, 0.3f}};
                assert_int_equal(sg_engine_upload(d->engine, moved, NULL), SG_OK);
                assert_int_equal(sg_engine_draw(d->engine, &camera, 1, &params, false), SG_OK);
                loss[side] = lose_and_pull(d, &p, NULL).l1;
                sg_model_destroy(&moved);
            }
            const double found = (loss[1] - loss[0]) / (2 * (double) step);
            assert_true(fabs(expected) > 1e-4);
            assert_true(fabs(found - expected) <= 2e-3 * fabs(expected) + 2e-5);
        }
        sg_model_destroy(&g);
        finish(d);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_gradient_within),
        cmocka_unit_test(l1_at_most_that_of_clean_photos),
        cmocka_unit_test(target_is_the_nearest_image),
        cmocka_unit_test(l1_by_differences),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
