/* SPDX-License-Identifier: Apache-2.0 */
/* The low-pass term of the photometric loss, on every engine and variant, and the last
 * iterations of a training with tolerances, in which it teaches the colours. */
#include "training.h"

#include <unistd.h>

#include "engine_cases.h"
#include "races.h"

#define WIDTH 45
#define HEIGHT 37
#define PIXELS ((size_t) WIDTH * HEIGHT)
#define VALUES (3 * PIXELS)
#define GAUSSIANS 60
#define RADIUS 5
#define STEP 1e-3f
#define TOLERANCE 0.1f

static const struct sg_render_params black = {.max_instances = 1 << 20};

/* Draws a model whose colours are moved by `shift` in channel `ch`. */
static struct sg_engine *draw_with(sg_ctx *ctx, struct engine_case c, int ch, float shift)
{
    const struct sg_camera camera = make_camera(WIDTH, HEIGHT, 3);
    struct sg_model *m = make_model(ctx, GAUSSIANS, 1, 11);
    for (size_t i = 0; i < GAUSSIANS; i++)
        *sg_model_at(m, i, SG_P_SH + ch) += shift;
    struct sg_engine *e = make_engine(ctx, c.engine, c.variant, m, NULL);
    assert_int_equal(sg_engine_draw(e, &camera, 1, &black, false), SG_OK);
    sg_model_destroy(&m);
    return e;
}

/* Photos on both sides of the render: dark and bright ones, within the tolerance and beyond it. */
static void make_targets(float *planes, uint8_t *bytes, uint8_t *mask)
{
    for (size_t i = 0; i < VALUES; i++) {
        const float v = draw(5, i, 0, 1), spread = draw(6, i, 0, 1);
        planes[i] = spread < 0.3f ? v * TOLERANCE : spread < 0.5f ? 1 - v * TOLERANCE : v;
        bytes[i] = (uint8_t) (planes[i] * 255.0f);
        mask[i % PIXELS] = i % 7 ? 255 : 0;
    }
}

/* By its definition, in double precision with the whole window. */
static double define(const float *rgb, const struct loss_case *c)
{
    static double d[VALUES];
    double window[2 * RADIUS + 1], total = 0, sum = 0;
    for (int k = -RADIUS; k <= RADIUS; k++)
        total += window[k + RADIUS] = exp(-k * k / 4.5);
    for (size_t i = 0; i < VALUES; i++) {
        const size_t ch = i / PIXELS, pixel = i % PIXELS;
        const double photo = c->target ? c->target[3 * pixel + ch] / 255.0 : (double) c->planes[i];
        const double tolerance = (double) c->tolerance;
        d[i] = (double) rgb[i] - photo;
        if ((photo < tolerance && d[i] < 0) || (photo > 1 - tolerance && d[i] > 0) ||
            (c->mask && !c->mask[pixel]))
            d[i] = 0;
    }
    for (int ch = 0; ch < 3; ch++)
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) {
                double v = 0;
                for (int j = -RADIUS; j <= RADIUS; j++)
                    for (int i = -RADIUS; i <= RADIUS; i++)
                        if (x + i >= 0 && x + i < WIDTH && y + j >= 0 && y + j < HEIGHT)
                            v += window[i + RADIUS] * window[j + RADIUS] *
                                 d[(ch * HEIGHT + y + j) * WIDTH + x + i];
                sum += v * v / pow(total, 4);
            }
    return sum / VALUES;
}

static void matches_its_definition(void **state)
{
    (void) state;
    static float planes[VALUES], rgb[VALUES];
    static uint8_t bytes[VALUES], mask[PIXELS];
    make_targets(planes, bytes, mask);
    const struct loss_case losses[] = {{.planes = planes, .tolerance = TOLERANCE},
                                       {.planes = planes, .mask = mask, .tolerance = TOLERANCE},
                                       {.target = bytes, .mask = mask},
                                       {.target = bytes, .tolerance = TOLERANCE}};
    for (size_t k = 0; k < sizeof(losses) / sizeof(losses[0]); k++) {
        static float oracle[GAUSSIANS][3]; /* gradients of the colours */
        for (int v = case_count - 1; v >= 0; v--) {
            sg_ctx *ctx = make_context(3);
            struct sg_engine *e = draw_with(ctx, cases[v], 0, 0);
            struct loss_case with = losses[k];
            struct sg_model *g;
            with.low_pass = 40;
            assert_int_equal(sg_engine_read_image(e, rgb, NULL, NULL), SG_OK);
            const double without = lose(e, &losses[k]).total, total = lose(e, &with).total;
            const double expected = define(rgb, &losses[k]);
            assert_true(expected > 1e-3);
            assert_true(fabs(total - without - 40 * expected) < 1e-4 * 40 * expected);
            assert_int_equal(sg_engine_raster_backward(e), SG_OK);
            assert_int_equal(sg_model_create(ctx, GAUSSIANS, 1, &g), SG_OK);
            assert_int_equal(sg_engine_read_gradients(e, g), SG_OK);
            sg_engine_destroy(&e);
            float largest = 0, off = 0;
            for (size_t i = 0; i < GAUSSIANS; i++)
                for (int c = 0; c < 3; c++) {
                    const float found = *sg_model_at(g, i, SG_P_SH + c);
                    if (v == case_count - 1) /* the oracle's own */
                        oracle[i][c] = found;
                    largest = fmaxf(largest, fabsf(oracle[i][c]));
                    off = fmaxf(off, fabsf(oracle[i][c] - found));
                }
            assert_true(largest > 0 && off <= 1e-4f * largest);
            sg_model_destroy(&g);
            sg_ctx_destroy(&ctx);
        }
    }
}

/* The gradient of the whole loss by central differences of all colours of a channel. L1 has no kink
 * at these photos: values are half a level or more from it. */
static void gradient_by_differences(void **state)
{
    (void) state;
    static float planes[VALUES], rgb[VALUES];
    for (int v = 0; v < case_count; v++) {
        sg_ctx *ctx = make_context(2);
        struct sg_engine *e = draw_with(ctx, cases[v], 0, 0);
        struct sg_model *g;
        assert_int_equal(sg_engine_read_image(e, rgb, NULL, NULL), SG_OK);
        for (size_t i = 0; i < VALUES; i++) {
            const float away = draw(6, i, 0.01f, 0.2f);
            planes[i] = rgb[i] + (i % 3 ? away : -away);
            if (fabsf(away - TOLERANCE) < 3 * STEP)
                planes[i] = rgb[i];
        }
        const struct loss_case c = {.planes = planes, .tolerance = TOLERANCE, .low_pass = 30};
        lose(e, &c);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        assert_int_equal(sg_model_create(ctx, GAUSSIANS, 1, &g), SG_OK);
        assert_int_equal(sg_engine_read_gradients(e, g), SG_OK);
        sg_engine_destroy(&e);
        for (int ch = 0; ch < 3; ch++) {
            double expected = 0, loss[2];
            for (size_t i = 0; i < GAUSSIANS; i++)
                expected += (double) *sg_model_at(g, i, SG_P_SH + ch);
            for (int side = 0; side < 2; side++) {
                e = draw_with(ctx, cases[v], ch, side ? STEP : -STEP);
                loss[side] = lose(e, &c).total;
                sg_engine_destroy(&e);
            }
            const double found = (loss[1] - loss[0]) / (2 * (double) STEP);
            assert_true(fabs(expected) > 1e-3);
            if (fabs(found - expected) > 3e-3 * fabs(expected) + 2e-5)
                fail_msg("%s, channel %d: %g, expected %g", case_name(cases[v]), ch, expected,
                         found);
        }
        sg_model_destroy(&g);
        sg_ctx_destroy(&ctx);
    }
}

/* ---- training ---- */

/* Photos of +-EPSILON noise, and of contrast below it that all views share. */
#define EPSILON 12

static struct fixture make_poisoned(int threads)
{
    struct fixture f = make_fixture(threads);
    for (int v = 0; v < VIEWS; v++)
        for (size_t i = 0; i < 3 * SIDE * SIDE; i++) {
            const int changed = f.views[v].rgb[i] +
                                (draw(9, (size_t) v * 100000 + i, -1, 1) < 0 ? -EPSILON : EPSILON);
            f.views[v].rgb[i] = (uint8_t) (changed < 0 ? 0 : changed > 255 ? 255 : changed);
        }
    return f;
}

static struct sg_train_params tolerant_params(void)
{
    struct sg_train_params p = short_params();
    p.iterations = 100; /* the low-pass term and falling rates from 91 on */
    p.tolerance = EPSILON;
    return p;
}

/* How far parameters are apart at most. */
static double distance(const struct sg_model *a, const struct sg_model *b)
{
    double most = 0;
    for (size_t i = 0; i < a->count; i++)
        for (int k = 0; k < sg_param_count(1); k++)
            most =
                fmax(most, fabs((double) *sg_model_at(a, i, k) - (double) *sg_model_at(b, i, k)));
    return most;
}

/* In the last tenth no Gaussian is added or removed, and steps become small. */
static void the_last_tenth_settles(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_poisoned(1);
    struct sg_train_params p = tolerant_params();
    p.densify_until_iter = 200;
    struct sg_model *before = train(&f, &p, 90, NULL, NULL, NULL);
    struct sg_model *first = train(&f, &p, 91, NULL, NULL, NULL),
                    *late = train(&f, &p, 98, NULL, NULL, NULL),
                    *last = train(&f, &p, 99, NULL, NULL, NULL);
    assert_int_equal(before->count, last->count);
    assert_true(distance(late, last) > 0);
    assert_true(distance(late, last) < 0.2 * distance(before, first));
    p.tolerance_low_pass = 0; /* densification continues */
    struct sg_model *off = train(&f, &p, 99, NULL, NULL, NULL);
    assert_int_not_equal(off->count, before->count);
    sg_model_destroy(&before);
    sg_model_destroy(&first);
    sg_model_destroy(&late);
    sg_model_destroy(&last);
    sg_model_destroy(&off);
    clear_fixture(&f);
}

/* Where no photo has a tolerance, the last tenth is like the rest. */
static void nothing_changes_without_a_tolerance(void **state)
{
    (void) state;
    skip_without_races();
    static const float none[VIEWS] = {0};
    struct fixture f = make_poisoned(1);
    struct sg_train_params p = short_params();
    struct sg_model *plain = train(&f, &p, 40, NULL, NULL, NULL);
    p.tolerances = none;
    p.tolerance_look = 0;
    struct sg_model *zeros = train(&f, &p, 40, NULL, NULL, NULL);
    p.tolerance_low_pass = 0;
    struct sg_model *off = train(&f, &p, 40, NULL, NULL, NULL);
    assert_same(plain, zeros);
    assert_same(plain, off);
    sg_model_destroy(&plain);
    sg_model_destroy(&zeros);
    sg_model_destroy(&off);
    clear_fixture(&f);
}

static double squared_error(const struct sg_model *m, const struct fixture *truth)
{
    double sum = 0;
    struct sg_view views[VIEWS];
    make_photos(truth->ctx, m, SIDE, views, VIEWS);
    for (int v = 0; v < VIEWS; v++) {
        for (size_t i = 0; i < 3 * SIDE * SIDE; i++) {
            const double d = (double) views[v].rgb[i] - (double) truth->views[v].rgb[i];
            sum += d * d;
        }
        free(views[v].rgb);
    }
    return sum;
}

/* The term brings renders nearer to the clean photos, which the training does not see. */
static void renders_come_nearer_to_the_clean_photos(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_poisoned(1), clean = make_fixture(1);
    struct sg_train_params p = tolerant_params();
    p.iterations = 600;
    p.tolerance = 2 * EPSILON; /* all noise allows colours that are wrong by EPSILON */
    p.densify_until_iter = 0;
    /* The true geometry, with colours that are too bright by less than EPSILON levels. */
    for (size_t i = 0; i < f.start->count; i++)
        for (int k = 0; k < sg_param_count(1); k++)
            *sg_model_at(f.start, i, k) =
                *sg_model_at(f.truth, i, k) + (k >= SG_P_SH && k < SG_P_SH + 3 ? 0.12f : 0);
    struct sg_model *before = train(&f, &p, 540, NULL, NULL, NULL);
    struct sg_model *after = train(&f, &p, 600, NULL, NULL, NULL);
    const double first = squared_error(before, &clean), last = squared_error(after, &clean);
    if (!(last < 0.9 * first))
        fail_msg("squared error %g, expected below 0.9 of %g", last, first);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    clear_fixture(&f);
    clear_fixture(&clean);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(matches_its_definition),
        cmocka_unit_test(gradient_by_differences),
        cmocka_unit_test(the_last_tenth_settles),
        cmocka_unit_test(nothing_changes_without_a_tolerance),
        cmocka_unit_test(renders_come_nearer_to_the_clean_photos),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
