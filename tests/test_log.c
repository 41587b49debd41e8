/* SPDX-License-Identifier: Apache-2.0 */
/* The messages of each log level. */
#include "models.h"

#define SIDE 40

struct log {
    int messages[3];
    char text[8192];
};

static void keep(void *priv, enum sg_log_level level, const char *message)
{
    struct log *l = priv;
    assert_true((unsigned) level <= SG_LOG_DEBUG);
    l->messages[level]++;
    const size_t used = strlen(l->text);
    snprintf(l->text + used, sizeof(l->text) - used, "%s\n", message);
}

/* Trains from a model that is thinned out, in few instances at once, with a filter. */
static void train(struct log *l, enum sg_log_level level)
{
    sg_ctx *ctx;
    sg_scene_builder *builder;
    struct sg_scene *scene;
    sg_trainer *t;
    static uint8_t rgb[3 * SIDE * SIDE];
    for (size_t i = 0; i < sizeof(rgb); i++)
        rgb[i] = (uint8_t) (i * 7);
    const struct sg_ctx_params c = {
        .threads = 1, .max_memory = 64 << 20, .log = keep, .log_priv = l, .log_level = level};
    assert_int_equal(sg_ctx_create(&ctx, &c), SG_OK);
    assert_int_equal(sg_scene_builder_create(ctx, NULL, &builder), SG_OK);
    for (int i = 0; i < 3; i++) {
        const struct sg_view_desc view = {.name = (const char *[]){"a", "b", "c"}[i],
                                          .camera = make_camera(SIDE, SIDE, 3 + i),
                                          .rgb = rgb};
        assert_int_equal(sg_scene_builder_add_view(builder, &view), SG_OK);
    }
    assert_int_equal(sg_scene_builder_finish(&builder, &scene), SG_OK);
    struct sg_model *m = make_model(ctx, 400, 0, 3);
    struct sg_train_params p = sg_train_params_default();
    p.iterations = 10, p.densify_from_iter = 1, p.densification_interval = 4;
    p.max_instances = 300, p.max_gaussians = 390;
    p.defense.on = true, p.defense.interval = 2, p.defense.from = 1, p.defense.views = 2;
    assert_int_equal(sg_trainer_create(ctx, scene, m, &p, &t), SG_OK);
    sg_model_destroy(&m);
    for (int i = 0; i < 6; i++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    sg_trainer_destroy(&t);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
}

static void test_levels(void **state)
{
    (void) state;
    static struct log l[3];
    for (int level = SG_LOG_WARN; level <= SG_LOG_DEBUG; level++) {
        train(&l[level], (enum sg_log_level) level);
        for (int k = SG_LOG_WARN; k <= SG_LOG_DEBUG; k++)
            assert_true((l[level].messages[k] > 0) == (k <= level));
    }
    assert_int_equal(l[0].messages[SG_LOG_WARN], l[2].messages[SG_LOG_WARN]);
}

static void test_decisions(void **state)
{
    (void) state;
    static struct log l;
    train(&l, SG_LOG_DEBUG);
    static const char *const expected[] = {
        "400 initial Gaussians are more than fit: training starts from 390 of them",
        "scene from memory: memory scene, 3 train",
        "engine: cpu, kernels ",
        "memory: limit 67108864 bytes",
        "engine: 40 x 40 pixels in ",
        "iteration 4: of 379 Gaussians ",
        "the filter removed ",
    };
    for (size_t i = 0; i < sizeof(expected) / sizeof(*expected); i++)
        if (!strstr(l.text, expected[i]))
            fail_msg("found no \"%s\" in\n%s", expected[i], l.text);
    assert_null(strstr(l.text, "in 1 bands"));
}

static void test_unknown_level(void **state)
{
    (void) state;
    sg_ctx *ctx;
    const struct sg_ctx_params p = {.log_level = (enum sg_log_level) 3};
    assert_int_equal(sg_ctx_create(&ctx, &p), SG_ERR_USAGE);
    assert_null(ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels),
        cmocka_unit_test(test_decisions),
        cmocka_unit_test(test_unknown_level),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
