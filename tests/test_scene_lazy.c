/* SPDX-License-Identifier: Apache-2.0 */
/* Photos that a function reads when they are needed: the same bytes as with photos in memory, for
 * any limit; what is dropped is read again, and must not have changed. */
#include "core/context.h"
#include "models.h"
#include "train/trainer.h"

#define SIDE 64
#define VIEWS 10
#define BYTES (3 * SIDE * SIDE)

struct source {
    uint8_t rgb[BYTES];
    int reads, result;
};

static struct source sources[VIEWS];

static int read_source(void *priv, uint8_t *rgb)
{
    struct source *s = priv;
    s->reads++;
    memcpy(rgb, s->rgb, BYTES);
    return s->result;
}

/* Smooth, different photos. */
static void fill_sources(void)
{
    for (int k = 0; k < VIEWS; k++) {
        sources[k].reads = sources[k].result = 0;
        for (int i = 0; i < BYTES; i++)
            sources[k].rgb[i] = (uint8_t) (127.5 + 100 * sin(0.02 * (i / 3 % SIDE) * (k + 1) +
                                                             i / (3 * SIDE) * 0.1));
    }
}

static int reads(void)
{
    int sum = 0;
    for (int k = 0; k < VIEWS; k++)
        sum += sources[k].reads;
    return sum;
}

static sg_ctx *limited(uint64_t max_memory)
{
    sg_ctx *ctx;
    const struct sg_ctx_params p = {.threads = 2, .max_memory = max_memory};
    assert_int_equal(sg_ctx_create(&ctx, &p), SG_OK);
    return ctx;
}

#define KEEP_DEFAULT UINT64_MAX

static struct sg_scene *make_scene(sg_ctx *ctx, bool lazy, uint64_t keep)
{
    sg_scene_builder *b;
    struct sg_scene *scene;
    static const uint8_t mask[SIDE * SIDE] = {[40] = 1, [41] = 1, [SIDE * 30] = 1};
    assert_int_equal(sg_scene_builder_create(ctx, NULL, &b), SG_OK);
    if (keep != KEEP_DEFAULT)
        sg_scene_builder_keep_photos(b, keep);
    for (int k = 0; k < VIEWS; k++) {
        char name[12];
        snprintf(name, sizeof(name), "%d", k);
        struct sg_view_desc d = {.name = name,
                                 .camera = make_camera(SIDE, SIDE, 3 + 0.1 * k),
                                 .mask = k == 2 ? mask : NULL};
        d.camera.t[0] += 0.1 * k;
        if (lazy)
            d.read = read_source, d.read_priv = &sources[k];
        else
            d.rgb = sources[k].rgb;
        assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    }
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_OK);
    return scene;
}

/* smooth_after: iterations after which the photos with a tolerance are smoothed. */
static struct sg_model *train_smoothed(sg_ctx *ctx, const struct sg_scene *scene, int iterations,
                                       int smooth_after)
{
    struct sg_model *start, *m;
    sg_trainer *t;
    struct sg_train_params p = sg_train_params_default();
    p.iterations = 40, p.densify_from_iter = 4, p.densification_interval = 10;
    p.defense.on = true, p.defense.interval = 10, p.defense.views = 3, p.defense.from = 5;
    p.max_gaussians = 900;
    static const float tolerances[VIEWS] = {[4] = 6, [7] = 6};
    p.tolerances = tolerances, p.tolerance_look = 12; /* which reads both photos once more */
    p.tolerance_smooth = 1;                           /* not before smooth_after */
    assert_int_equal(sg_model_init_random(ctx, 300, 1.3f, 7, 1, &start), SG_OK);
    assert_int_equal(sg_trainer_create(ctx, scene, start, &p, &t), SG_OK);
    sg_model_destroy(&start);
    for (int i = 0; i < iterations; i++)
        if (sg_trainer_step(t, NULL) || (i + 1 == smooth_after && sg_trainer_smooth(t)))
            fail_msg("step %d: %s", i, sg_last_error(ctx));
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    sg_trainer_destroy(&t);
    return m;
}

static struct sg_model *train(sg_ctx *ctx, const struct sg_scene *scene, int iterations)
{
    return train_smoothed(ctx, scene, iterations, iterations + 1);
}

static void same_model(const struct sg_model *a, const struct sg_model *b)
{
    assert_int_equal(a->count, b->count);
    assert_memory_equal(a->params, b->params,
                        a->capacity * (size_t) sg_param_count(a->sh_degree) * sizeof(float));
}

/* Where all photos are kept each is read once, where none is it is read for each use. The bytes are
 * the same. */
static void test_same_for_any_limit(void **state)
{
    (void) state;
    fill_sources();
    sg_ctx *plain = limited(0);
    struct sg_scene *scene = make_scene(plain, false, KEEP_DEFAULT);
    struct sg_model *expected = train(plain, scene, 25);
    struct sg_audit *judged;
    assert_int_equal(sg_audit_scene(plain, scene, &judged), SG_OK);
    static const uint64_t limits[] = {0, 64 << 20, 0, 12 << 20, 12 << 20},
                          keeps[] = {KEEP_DEFAULT, KEEP_DEFAULT, 0, 3 * BYTES, 0};
    for (int i = 0; i < 5; i++) {
        struct sg_audit *audit;
        fill_sources();
        sg_ctx *ctx = limited(limits[i]);
        struct sg_scene *lazy = make_scene(ctx, true, keeps[i]);
        assert_int_equal(reads(), VIEWS);
        assert_null(lazy->train[0].rgb);
        assert_true(lazy->train[2].hash == scene->train[2].hash);
        struct sg_model *m = train(ctx, lazy, 25);
        same_model(m, expected);
        sg_model_destroy(&m);
        assert_int_equal(sg_audit_scene(ctx, lazy, &audit), SG_OK);
        assert_true(audit->score == judged->score);
        sg_audit_destroy(&audit);
        /* 25 steps, two photos whose noise is measured, and an audit of all */
        if (i < 2)
            assert_int_equal(reads(), VIEWS);
        else if (keeps[i])
            assert_true(reads() > 2 * VIEWS && reads() < 27 + 2 * VIEWS);
        else
            assert_int_equal(reads(), 27 + 2 * VIEWS);
        sg_scene_destroy(&lazy);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    sg_audit_destroy(&judged);
    sg_model_destroy(&expected);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&plain);
}

static void test_smoothed_for_any_limit(void **state)
{
    (void) state;
    fill_sources();
    sg_ctx *plain = limited(0);
    struct sg_scene *scene = make_scene(plain, false, KEEP_DEFAULT);
    struct sg_model *expected = train_smoothed(plain, scene, 25, 12),
                    *other = train(plain, scene, 25);
    assert_true(other->count != expected->count ||
                memcmp(other->params, expected->params, 16 * sizeof(float)));
    static const uint64_t limits[] = {0, 64 << 20, 0, 12 << 20, 12 << 20},
                          keeps[] = {KEEP_DEFAULT, KEEP_DEFAULT, 0, 3 * BYTES, 0};
    for (int i = 0; i < 5; i++) {
        fill_sources();
        sg_ctx *ctx = limited(limits[i]);
        struct sg_scene *lazy = make_scene(ctx, true, keeps[i]);
        struct sg_model *m = train_smoothed(ctx, lazy, 25, 12);
        same_model(m, expected);
        assert_true(i < 2 ? reads() == VIEWS : reads() > VIEWS); /* smoothed as it was held */
        sg_model_destroy(&m);
        sg_scene_destroy(&lazy);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    sg_model_destroy(&expected);
    sg_model_destroy(&other);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&plain);
}

/* A limit so small that its quarter keeps six of the ten photos. */
#define TIGHT (4 * 6 * (uint64_t) (BYTES + 128))

static void test_dropped(void **state)
{
    (void) state;
    fill_sources();
    sg_ctx *ctx = limited(TIGHT);
    struct sg_scene *scene = make_scene(ctx, true, KEEP_DEFAULT);
    assert_true(sg_mem_current(ctx, SG_MEM_IMAGES) <= TIGHT / 4 + SIDE * SIDE + 128);
    const uint64_t before = sg_mem_current(ctx, SG_MEM_TAGS);
    const uint8_t *rgb, *again;
    for (int round = 0; round < 3; round++)
        for (int k = 0; k < VIEWS; k++) {
            assert_int_equal(sg_view_pixels(ctx, &scene->train[k], &rgb), SG_OK);
            assert_memory_equal(rgb, sources[k].rgb, BYTES);
            assert_int_equal(sg_view_pixels(ctx, &scene->train[k], &again), SG_OK);
            assert_ptr_equal(rgb, again);
            sg_view_release(&scene->train[k]);
            assert_memory_equal(rgb, sources[k].rgb, BYTES);
            sg_view_release(&scene->train[k]);
        }
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), before);
    assert_int_equal(sources[0].reads, 1);         /* kept */
    assert_int_equal(sources[VIEWS - 1].reads, 4); /* once to add, once a round */

    sources[VIEWS - 1].rgb[17] ^= 1;
    assert_int_equal(sg_view_pixels(ctx, &scene->train[VIEWS - 1], &rgb), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "view \"9\": read: found other pixels"));
    assert_null(rgb);
    struct sg_audit *audit;
    assert_int_equal(sg_audit_scene(ctx, scene, &audit), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found other pixels"));
    sources[VIEWS - 1].rgb[17] ^= 1;
    sources[VIEWS - 1].result = 5;
    assert_int_equal(sg_view_pixels(ctx, &scene->train[VIEWS - 1], &rgb), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "view \"9\": read: found result 5"));
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), before);
    sg_scene_destroy(&scene);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Attacks, evaluation and written copies read such photos too. */
static void test_users(void **state)
{
    (void) state;
    fill_sources();
    static uint8_t poison[2][BYTES], noise[2][BYTES];
    double psnr[2];
    for (int i = 0; i < 2; i++) {
        sg_ctx *ctx = limited(0);
        struct sg_scene *scene = make_scene(ctx, i, 0);
        struct sg_model *proxy;
        sg_attack *a;
        sg_renderer *r;
        struct sg_eval eval;
        struct sg_attack_params p = sg_attack_params_default();
        p.iterations = 4, p.inner = 2, p.texture = 3;
        assert_int_equal(sg_model_init_random(ctx, 200, 1.3f, 1, 1, &proxy), SG_OK);
        assert_int_equal(sg_attack_create(ctx, scene, proxy, &p, &a), SG_OK);
        for (int k = 0; k < 4; k++)
            assert_int_equal(sg_attack_step(a, NULL), SG_OK);
        assert_int_equal(sg_attack_poison(a, 3, poison[i]), SG_OK);
        assert_int_equal(sg_attack_naive(ctx, &scene->train[1], 1, &p, SG_NAIVE_NOISE, noise[i]),
                         SG_OK);
        assert_int_equal(sg_renderer_create(ctx, NULL, NULL, proxy, NULL, &r), SG_OK);
        assert_int_equal(sg_evaluate(ctx, r, scene->train, VIEWS, NULL, &eval), SG_OK);
        psnr[i] = eval.psnr;
        sg_eval_clear(&eval);
        sg_renderer_destroy(&r);
        sg_attack_destroy(&a);
        sg_model_destroy(&proxy);
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    assert_memory_equal(poison[0], poison[1], BYTES);
    assert_memory_equal(noise[0], noise[1], BYTES);
    assert_true(psnr[0] == psnr[1]);
}

/* What cannot be read is refused when it is added, and the builder is as before. */
static void test_refused(void **state)
{
    (void) state;
    fill_sources();
    sg_ctx *ctx = limited(0);
    sg_scene_builder *b;
    struct sg_scene *scene;
    assert_int_equal(sg_scene_builder_create(ctx, NULL, &b), SG_OK);
    struct sg_view_desc d = {.name = "v",
                             .camera = make_camera(SIDE, SIDE, 3),
                             .read = read_source,
                             .read_priv = &sources[0]};
    sources[0].result = -1;
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "view \"v\": read: found result -1"));
    d.rgb = sources[0].rgb;
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "rgb: found both pixels and read"));
    d.rgb = NULL;
    sources[0].result = 0;
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_OK);
    assert_int_equal(scene->n_train, 1);
    sg_scene_destroy(&scene);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_for_any_limit),
        cmocka_unit_test(test_smoothed_for_any_limit),
        cmocka_unit_test(test_dropped),
        cmocka_unit_test(test_users),
        cmocka_unit_test(test_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
