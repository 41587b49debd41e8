/* SPDX-License-Identifier: Apache-2.0 */
/* Progress functions: on the caller's thread, in order; cancelling at each of their calls ends with
 * SG_ERR_INTERRUPTED and leaves nothing. */
#include <pthread.h>
#include <sys/stat.h>

#include "splatguard/format.h"
#include "synth_scene.h"

static char folder[] = "/tmp/sg_progress_XXXXXX", colmap[64], made[64];

struct watch {
    pthread_t caller;
    unsigned stages; /* bits of those that were seen */
    int calls, cancel_at;
    uint64_t done[SG_STAGES], total[SG_STAGES];
};

static int watch(void *priv, enum sg_stage stage, uint64_t done, uint64_t total)
{
    struct watch *w = priv;
    assert_true(pthread_equal(pthread_self(), w->caller));
    assert_true((unsigned) stage < SG_STAGES && done <= total && total > 0);
    if (w->stages & 1u << stage && done) /* one count at a time: 0 begins another */
        assert_true(total == w->total[stage] && done >= w->done[stage]);
    w->stages |= 1u << stage;
    w->done[stage] = done, w->total[stage] = total;
    return ++w->calls == w->cancel_at;
}

static sg_ctx *watched(int threads, struct watch *w)
{
    sg_ctx *ctx;
    w->caller = pthread_self();
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads,
                                                                 .progress = watch,
                                                                 .progress_priv = w}),
                     SG_OK);
    return ctx;
}

static int make_scene(void **state)
{
    (void) state;
    const int code =
        make_synth_scene(folder, sg_synth_params(.width = 24, .height = 20, .train_views = 4,
                                                 .test_views = 1, .points = 40, .samples = 1));
    snprintf(colmap, sizeof(colmap), "%s/scene/colmap", folder);
    snprintf(made, sizeof(made), "%s/made", folder);
    return code;
}

static int remove_scene(void **state)
{
    (void) state;
    return remove_synth_scene(folder);
}

static int load(sg_ctx *ctx)
{
    struct sg_scene *scene;
    const int code = sg_scene_load(ctx, colmap, NULL, &scene);
    assert_true(!code == (scene != NULL));
    sg_scene_destroy(&scene);
    return code;
}

static int audit(sg_ctx *ctx)
{
    struct sg_scene *scene;
    struct sg_audit *found = NULL;
    int code = sg_scene_load(ctx, colmap, NULL, &scene);
    if (!code)
        code = sg_audit_scene(ctx, scene, &found);
    sg_audit_destroy(&found);
    sg_scene_destroy(&scene);
    return code;
}

static int synth(sg_ctx *ctx)
{
    const struct sg_synth_params *p = sg_synth_params(.width = 16, .height = 16, .train_views = 4,
                                                      .test_views = 1, .points = 40, .samples = 1);
    char command[128];
    const int code = sg_synth_write(ctx, made, p);
    snprintf(command, sizeof(command), "test -z \"$(find %s -type f)\"", made);
    assert_true((system(command) == 0) == (code != SG_OK)); /* all files or none */
    snprintf(command, sizeof(command), "rm -rf %s", made);
    assert_int_equal(system(command), 0);
    return code;
}

/* Creation from points, steps with densification and filter, evaluation with timing. */
static int train_model(sg_ctx *ctx, enum sg_train_model model)
{
    struct sg_scene *scene;
    sg_trainer *trainer = NULL;
    sg_renderer *renderer = NULL;
    struct sg_eval eval = {0};
    struct sg_train_params p = sg_train_params_default();
    p.iterations = 6, p.densify_from_iter = 1, p.densification_interval = 3, p.sh_degree = 0;
    p.defense.on = true, p.defense.interval = 2, p.defense.views = 2;
    p.model = model, p.scaffold.from = 1;
    int code = sg_scene_load(ctx, colmap, NULL, &scene);
    if (!code)
        code = sg_trainer_create(ctx, scene, NULL, &p, &trainer);
    while (!code && sg_trainer_iteration(trainer) < p.iterations)
        code = sg_trainer_step(trainer, NULL);
    if (!code)
        code = sg_trainer_renderer(trainer, &renderer);
    if (!code)
        code = sg_evaluate(ctx, renderer, scene->train, 2, &(struct sg_eval_params){.fps = true},
                           &eval);
    assert_true(!code == (eval.per_view != NULL));
    sg_eval_clear(&eval);
    sg_renderer_destroy(&renderer);
    sg_trainer_destroy(&trainer);
    sg_scene_destroy(&scene);
    return code;
}

static int train(sg_ctx *ctx)
{
    return train_model(ctx, SG_MODEL_3DGS);
}

static int train_anchors(sg_ctx *ctx)
{
    return train_model(ctx, SG_MODEL_SCAFFOLD);
}

static int attack(sg_ctx *ctx)
{
    static uint8_t rgb[3 * 24 * 20];
    struct sg_scene *scene;
    struct sg_model *proxy = NULL;
    sg_attack *a = NULL;
    struct sg_attack_params p = sg_attack_params_default();
    p.iterations = 4, p.inner = 2, p.densification_interval = 3, p.spectral_weight = 1;
    p.victim_tolerance = 2, p.victim_gaussians = 50;
    int code = sg_scene_load(ctx, colmap, NULL, &scene);
    if (!code)
        code = sg_model_init_random(ctx, 50, 1.3f, 1, 1, &proxy);
    if (!code)
        code = sg_attack_create(ctx, scene, proxy, &p, &a);
    while (!code && sg_attack_iteration(a) < p.iterations)
        code = sg_attack_step(a, NULL);
    if (!code)
        code = sg_attack_poison(a, 0, rgb);
    sg_attack_destroy(&a);
    sg_model_destroy(&proxy);
    sg_scene_destroy(&scene);
    return code;
}

/* Of .sog, all or nothing. */
static int write_sog(sg_ctx *ctx)
{
    char path[96];
    struct sg_model *model;
    snprintf(path, sizeof(path), "%s/model.sog", folder);
    int code = sg_model_init_random(ctx, 1100, 1.3f, 1, 1, &model);
    for (size_t i = 0; i < 1100 && !code; i++)
        for (int k = 3; k < 12; k++)
            *sg_model_at(model, i, SG_P_SH + k) = (float) ((i * (size_t) k * 7919) % 1000) / 1000;
    if (!code)
        code = sg_model_write(ctx, model, path, NULL);
    sg_model_destroy(&model);
    assert_true(!remove(path) == (code == SG_OK));
    return code;
}

#ifdef SG_SANITIZE_THREAD /* nothing can race in one thread */
#define FEWEST 3
#else
#define FEWEST 1
#endif

static void cancel_each(int (*work)(sg_ctx *), unsigned stages)
{
    for (int threads = FEWEST; threads <= 3; threads += 2) {
        int code = SG_ERR_INTERRUPTED, k = 0;
        while (code) {
            struct watch w = {.cancel_at = ++k};
            sg_ctx *ctx = watched(threads, &w);
            code = work(ctx);
            assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
            if (w.calls < k) {
                assert_int_equal(code, SG_OK);
                assert_int_equal(w.stages & stages, stages);
            } else {
                assert_int_equal(code, SG_ERR_INTERRUPTED);
                assert_non_null(strstr(sg_last_error(ctx), ": cancelled after "));
                assert_int_equal(w.calls, k); /* not asked again */
                w.cancel_at = 0;
                assert_int_equal(work(ctx), SG_OK);
            }
            sg_ctx_destroy(&ctx);
        }
        assert_true(k > 2);
    }
}

#define TEST(work, stages)                                                                         \
    static void test_##work(void **state)                                                          \
    {                                                                                              \
        (void) state;                                                                              \
        cancel_each(work, stages);                                                                 \
    }
TEST(load, 1u << SG_STAGE_LOAD)
TEST(audit, 1u << SG_STAGE_LOAD | 1u << SG_STAGE_AUDIT)
TEST(synth, 1u << SG_STAGE_SYNTH)
TEST(train,
     1u << SG_STAGE_INIT | 1u << SG_STAGE_TRAIN | 1u << SG_STAGE_COUNT | 1u << SG_STAGE_EVALUATE)
TEST(train_anchors, 1u << SG_STAGE_TRAIN | 1u << SG_STAGE_COUNT | 1u << SG_STAGE_EVALUATE)

static void test_write_sog(void **state)
{
    sg_ctx *ctx;
    (void) state;
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    const int code = write_sog(ctx);
    sg_ctx_destroy(&ctx);
    if (code == SG_ERR_USAGE) /* a build without zlib */
        skip();
    cancel_each(write_sog, 1u << SG_STAGE_WRITE);
}
TEST(attack, 1u << SG_STAGE_ATTACK | 1u << SG_STAGE_ASCEND | 1u << SG_STAGE_COUNT)

/* A file of lines without a record is given up when the caller cancels. */
static void test_long_text(void **state)
{
    (void) state;
    struct watch w = {.cancel_at = 1};
    struct sg_scene *scene;
    char path[96], line[4096];
    static const char *const folders[] = {"long", "long/sparse"}, *const files[] = {"images.txt",
                                                                                    "cameras.txt"};
    memset(line, '\n', sizeof(line));
    for (int k = 0; k < 2; k++) {
        snprintf(path, sizeof(path), "%s/%s", folder, folders[k]);
        assert_int_equal(mkdir(path, 0777), 0);
    }
    for (int k = 0; k < 2; k++) {
        snprintf(path, sizeof(path), "%s/long/sparse/%s", folder, files[k]);
        FILE *f = fopen(path, "w");
        assert_non_null(f);
        for (int n = 0; n < 5000 * k; n++)
            fwrite(line, 1, sizeof(line), f);
        fclose(f);
    }
    snprintf(path, sizeof(path), "%s/long", folder);
    sg_ctx *ctx = watched(1, &w);
    assert_int_equal(sg_scene_load(ctx, path, NULL, &scene), SG_ERR_INTERRUPTED);
    assert_int_equal(w.calls, 1);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* A training and an attack that were cancelled between iterations continue to the same bytes. */
static void test_goes_on(void **state)
{
    (void) state;
    struct watch w = {0};
    sg_ctx *ctx = watched(2, &w);
    struct sg_scene *scene;
    struct sg_train_params p = sg_train_params_default();
    struct sg_attack_params q = sg_attack_params_default();
    struct sg_model *model[2], *decoy[2];
    p.iterations = 12, p.densify_from_iter = 1, p.densification_interval = 5, p.sh_degree = 0;
    q.iterations = 6, q.inner = 3;
    assert_int_equal(sg_scene_load(ctx, colmap, NULL, &scene), SG_OK);
    for (int i = 0; i < 2; i++) {
        sg_trainer *t;
        sg_attack *a;
        w.cancel_at = 0;
        assert_int_equal(sg_trainer_create(ctx, scene, NULL, &p, &t), SG_OK);
        for (int before; (before = sg_trainer_iteration(t)) < p.iterations;) {
            w.cancel_at = i ? w.calls + 1 : 0;
            assert_int_equal(sg_trainer_step(t, NULL), i ? SG_ERR_INTERRUPTED : SG_OK);
            assert_int_equal(sg_trainer_iteration(t), i ? before : before + 1);
            w.cancel_at = 0;
            if (i)
                assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        }
        assert_int_equal(sg_trainer_model(t, &model[i]), SG_OK);
        assert_int_equal(sg_attack_create(ctx, scene, model[0], &q, &a), SG_OK);
        while (sg_attack_iteration(a) < q.iterations) {
            w.cancel_at = i ? w.calls + 3 : 0; /* within the ascent */
            assert_int_equal(sg_attack_step(a, NULL), i ? SG_ERR_INTERRUPTED : SG_OK);
            w.cancel_at = 0;
            if (i)
                assert_int_equal(sg_attack_step(a, NULL), SG_OK);
        }
        assert_int_equal(sg_attack_decoy(a, &decoy[i]), SG_OK);
        sg_attack_destroy(&a);
        sg_trainer_destroy(&t);
    }
    for (int i = 0; i < 2; i++) {
        struct sg_model **m = i ? decoy : model;
        assert_int_equal(m[0]->count, m[1]->count);
        assert_memory_equal(m[0]->params, m[1]->params,
                            m[0]->capacity * (size_t) sg_param_count(m[0]->sh_degree) * 4);
        sg_model_destroy(&m[0]);
        sg_model_destroy(&m[1]);
    }
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
}

static void test_names(void **state)
{
    (void) state;
    for (int i = 0; i < SG_STAGES; i++)
        assert_true(sg_stage_name((enum sg_stage) i)[0]);
    assert_string_equal(sg_stage_name(SG_STAGES), "unknown");
    assert_string_equal(sg_mem_tag_name(SG_MEM_TAGS), "total");
    assert_string_equal(sg_mem_tag_name((enum sg_mem_tag)(SG_MEM_TAGS + 1)), "unknown");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_load),   cmocka_unit_test(test_long_text),
        cmocka_unit_test(test_audit),  cmocka_unit_test(test_synth),
        cmocka_unit_test(test_train),  cmocka_unit_test(test_train_anchors),
        cmocka_unit_test(test_attack), cmocka_unit_test(test_goes_on),
        cmocka_unit_test(test_names),  cmocka_unit_test(test_write_sog),
    };
    return cmocka_run_group_tests(tests, make_scene, remove_scene);
}
