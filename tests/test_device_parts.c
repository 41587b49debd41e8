/* SPDX-License-Identifier: Apache-2.0 */
/* What the benchmark does to a device: it leaves out parts of kernels, each of which does what its
 * name says, and measures rates and kernels. SG_TEST_ENGINE names the device. */
#include "models.h"

#include "device.h"

#define WIDTH 40
#define HEIGHT 24
#define VALUES (3 * WIDTH * HEIGHT)
#define DEGREE 2

struct bench {
    sg_ctx *ctx;
    struct sg_model *model;
    struct sg_engine *engine;
    sg_photo photo;
    uint8_t rgb[VALUES];
    float image[VALUES];
    struct sg_model *gradients;
};

static struct bench begin(void)
{
    struct bench b = {.ctx = make_context(1)};
    b.model = make_model(b.ctx, 300, DEGREE, 5);
    b.engine = make_engine(b.ctx, main_engine(), NULL, b.model, NULL);
    assert_int_equal(sg_model_create(b.ctx, b.model->count, DEGREE, &b.gradients), SG_OK);
    return b;
}

static void end(struct bench *b)
{
    assert_int_equal(device_leave_out(b->engine, 0), SG_OK); /* engines share the kernels */
    sg_engine_destroy(&b->engine);
    sg_model_destroy(&b->gradients);
    sg_model_destroy(&b->model);
    sg_ctx_destroy(&b->ctx);
}

static void leave_out(struct bench *b, const char *name)
{
    const struct device_part *parts;
    int n = device_parts(&parts), k = 0;
    while (k < n && strcmp(parts[k].name, name))
        k++;
    assert_true(k < n);
    assert_int_equal(device_leave_out(b->engine, 1u << k), SG_OK);
}

static void draw_view(struct bench *b, int degree, float background)
{
    const struct sg_camera camera = make_camera(WIDTH, HEIGHT, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS,
                                            .background = {background, background, background}};
    assert_int_equal(sg_engine_draw(b->engine, &camera, degree, &params, false), SG_OK);
    assert_int_equal(sg_engine_read_image(b->engine, b->image, NULL, NULL), SG_OK);
}

/* Draws, and takes the gradients of a photo of one grey. */
static void learn_from(struct bench *b, uint8_t grey)
{
    const struct sg_loss loss = {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
    struct sg_target target = {0};
    memset(b->rgb, grey, sizeof(b->rgb));
    draw_view(b, DEGREE, 0.5f);
    assert_int_equal(sg_engine_photo_add(b->engine, WIDTH, HEIGHT, b->rgb, NULL, &target.photo),
                     SG_OK);
    assert_int_equal(sg_engine_losses(b->engine, &target, &loss, 1), SG_OK);
    assert_int_equal(sg_engine_raster_backward(b->engine), SG_OK);
    assert_int_equal(sg_engine_read_gradients(b->engine, b->gradients), SG_OK);
    assert_int_equal(sg_engine_photo_drop(b->engine, target.photo), SG_OK);
}

/* Of planes first to end - 1: how many are not 0. */
static int count_gradients(const struct bench *b, int first, int past)
{
    int n = 0;
    for (size_t i = 0; i < b->gradients->count; i++)
        for (int p = first; p < past; p++)
            n += *sg_model_at(b->gradients, i, p) != 0;
    return n;
}

static void test_project_raster(void **state)
{
    (void) state;
    struct bench b = begin();
    float whole[VALUES];
    draw_view(&b, 0, 0.5f); /* a kernel has parts once it has run */
    draw_view(&b, DEGREE, 0.5f);
    memcpy(whole, b.image, sizeof(whole));

    leave_out(&b, "raster.writes");
    draw_view(&b, DEGREE, 0.25f);
    assert_memory_equal(b.image, whole, sizeof(whole)); /* as it was */

    leave_out(&b, "raster.pairs");
    draw_view(&b, DEGREE, 0.25f);
    for (int i = 0; i < VALUES; i++)
        assert_true(b.image[i] == 0.25f);

    leave_out(&b, "project.splats");
    draw_view(&b, 0, 0.5f);
    assert_memory_equal(b.image, whole, sizeof(whole)); /* with the colours that were there */

    leave_out(&b, "project.colours");
    draw_view(&b, DEGREE, 0.5f);
    for (int i = 0; i < VALUES; i++)
        assert_float_equal(b.image[i], 0.5, 1e-6); /* grey before grey */

    assert_int_equal(device_leave_out(b.engine, 0), SG_OK);
    draw_view(&b, DEGREE, 0.5f);
    assert_memory_equal(b.image, whole, sizeof(whole));
    end(&b);
}

static void test_backward(void **state)
{
    (void) state;
    struct bench b = begin();
    const int planes = sg_param_count(DEGREE);
    const size_t bytes = b.gradients->capacity * (size_t) planes * sizeof(float);
    float *whole = malloc(bytes);
    learn_from(&b, 200);
    memcpy(whole, b.gradients->params, bytes);
    assert_true(count_gradients(&b, SG_P_OPACITY, SG_P_OPACITY + 1) > 200);
    assert_true(count_gradients(&b, SG_P_SH, planes) > 600);

    leave_out(&b, "raster_backward.slots");
    learn_from(&b, 20);
    assert_memory_equal(b.gradients->params, whole, bytes); /* those of the other photo */

    leave_out(&b, "raster_backward.sums");
    learn_from(&b, 200);
    assert_int_equal(count_gradients(&b, SG_P_SH, planes), 0);
    assert_true(count_gradients(&b, SG_P_OPACITY, SG_P_OPACITY + 1) > 10); /* of one pixel */

    leave_out(&b, "raster_backward.pairs");
    learn_from(&b, 200);
    assert_int_equal(count_gradients(&b, 0, planes), 0);

    leave_out(&b, "learn.gradients");
    learn_from(&b, 200);
    assert_int_equal(count_gradients(&b, 0, planes), 0);

    assert_int_equal(device_leave_out(b.engine, 0), SG_OK);
    learn_from(&b, 200);
    assert_memory_equal(b.gradients->params, whole, bytes);
    free(whole);
    end(&b);
}

/* Whether a step of the optimiser moves anything. */
static bool moves(struct bench *b)
{
    struct sg_update u = {.adam = true};
    struct sg_model *now;
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = 0.1f, u.root[g] = 1;
    learn_from(b, 200);
    assert_int_equal(sg_engine_optimise(b->engine, &u), SG_OK);
    assert_int_equal(sg_model_create(b->ctx, b->model->count, DEGREE, &now), SG_OK);
    assert_int_equal(sg_engine_download(b->engine, now, NULL), SG_OK);
    bool moved = false;
    for (size_t i = 0; i < now->count; i++)
        for (int p = 0; p < sg_param_count(DEGREE); p++)
            moved |= *sg_model_at(now, i, p) != *sg_model_at(b->model, i, p);
    sg_model_destroy(&now);
    return moved;
}

static void test_steps(void **state)
{
    (void) state;
    struct bench b = begin();
    learn_from(&b, 200);
    leave_out(&b, "learn.steps");
    assert_false(moves(&b));
    assert_int_equal(device_leave_out(b.engine, 0), SG_OK);
    assert_true(moves(&b));
    end(&b);
}

/* Not their values: other programs run beside this one. */
static void test_rates(void **state)
{
    (void) state;
    struct bench b = begin();
    struct rates r;
    assert_true(device_has(b.engine));
    assert_int_equal(device_rates(b.engine, &r), SG_OK);
    assert_true(r.bytes > 1e7 && r.bytes < 1e14);
    assert_true(r.operations > 1e7 && r.operations < 1e16);
    assert_true(r.dependent > 1e7 && r.dependent < 1e16);
    assert_true(r.dispatch > 1e-8 && r.dispatch < 0.1);
    const uint64_t before = device_dispatches(b.engine);
    draw_view(&b, DEGREE, 0.5f);
    assert_true(device_dispatches(b.engine) > before + 10);
    end(&b);
}

int main(void)
{
    if (!getenv("SG_TEST_ENGINE")) {
        printf("skipped: SG_TEST_ENGINE names no device\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_project_raster),
        cmocka_unit_test(test_backward),
        cmocka_unit_test(test_steps),
        cmocka_unit_test(test_rates),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
