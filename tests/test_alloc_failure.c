/* SPDX-License-Identifier: Apache-2.0 */
/* Every allocation of a small load, training, audit, attack and evaluation is made to fail once.
 * Each call ends with SG_ERR_BUDGET and a message, leaks nothing, and works afterwards. */
#include <jansson.h>

#include "core/context.h"
#include "core/file.h"
#include "splatguard/format.h"
#include "splatguard/run.h"
#include "params.h"
#include "synth_scene.h"

static char folder[] = "/tmp/sg_alloc_XXXXXX", blender[64], colmap[64], ply[64], checkpoint[64],
            run_folder[64], poisoned[64], anchors[64];

static int make_scene(void **state)
{
    (void) state;
    const int code =
        make_synth_scene(folder, sg_synth_params(.width = 24, .height = 20, .train_views = 4,
                                                 .test_views = 1, .points = 40, .samples = 1));
    snprintf(blender, sizeof(blender), "%s/scene/blender", folder);
    snprintf(colmap, sizeof(colmap), "%s/scene/colmap", folder);
    snprintf(ply, sizeof(ply), "%s/model.ply", folder);
    snprintf(anchors, sizeof(anchors), "%s/anchors.ply", folder);
    snprintf(checkpoint, sizeof(checkpoint), "%s/checkpoint", folder);
    snprintf(run_folder, sizeof(run_folder), "%s/run", folder);
    snprintf(poisoned, sizeof(poisoned), "%s/poisoned", folder);
    return code;
}

static int remove_scene(void **state)
{
    (void) state;
    return remove_synth_scene(folder);
}

/* A training and a test photo have the same name. */
static int read_cameras(sg_ctx *ctx, const struct sg_scene *scene)
{
    char path[80];
    struct sg_view *views;
    size_t n;
    snprintf(path, sizeof(path), "%s/cameras.json", folder);
    int code = sg_cameras_write_json(ctx, scene, path);
    if (!code)
        code = sg_cameras_read_json(ctx, path, NULL, &views, &n);
    if (!code) {
        assert_int_equal(n, scene->n_train + scene->n_test);
        sg_cameras_destroy(&views, &n);
    }
    return code;
}

static int load(sg_ctx *ctx, const char *path)
{
    struct sg_scene *scene;
    static size_t points[2];
    const bool halves = path == colmap;
    int code =
        sg_scene_load(ctx, path, sg_scene_params(.eval = halves, .test_halves = halves), &scene);
    assert_true(!code == (scene != NULL));
    if (scene) { /* an event that was skipped for lack of memory would be missing */
        size_t *expected = &points[path == colmap];
        *expected = *expected ? *expected : scene->n_points + 1;
        assert_int_equal(scene->n_points + 1, *expected);
        assert_int_equal(scene->format, path == colmap ? SG_FORMAT_COLMAP : SG_FORMAT_BLENDER);
        code = path == colmap ? code : read_cameras(ctx, scene);
    }
    sg_scene_destroy(&scene);
    return code;
}

static int load_blender(sg_ctx *ctx)
{
    return load(ctx, blender);
}

static int load_colmap(sg_ctx *ctx)
{
    return load(ctx, colmap);
}

static int read_black(void *priv, uint8_t *rgb)
{
    (void) priv;
    memset(rgb, 0, 3 * 6 * 4);
    return 0;
}

static int build(sg_ctx *ctx)
{
    static const uint8_t rgb[3 * 6 * 4], mask[6 * 4];
    static const float xyz[3 * 40];
    sg_scene_builder *builder = NULL;
    struct sg_scene *scene = NULL;
    struct sg_view_desc view = {
        .camera = {.width = 6, .height = 4, .fx = 5, .fy = 5, .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
        .rgb = rgb};
    int code = sg_scene_builder_create(ctx, NULL, &builder);
    if (!code)
        sg_scene_builder_keep_photos(builder, 0);
    for (int i = 0; i < 6 && !code; i++) {
        char name[16];
        snprintf(name, sizeof(name), "%d", i);
        view.name = name;
        view.mask = i % 2 ? mask : NULL;
        view.rgb = i < 3 ? rgb : NULL;
        view.read = i < 3 ? NULL : read_black;
        view.split = i % 3 ? SG_SPLIT_TRAIN : SG_SPLIT_TEST;
        code = sg_scene_builder_add_view(builder, &view);
        if (!code)
            code = sg_scene_builder_add_points(builder, xyz, NULL, 40);
    }
    if (!code)
        code = sg_scene_builder_finish(&builder, &scene);
    assert_true(!code == (scene != NULL));
    for (size_t i = 0; scene && i < scene->n_train && !code; i++) {
        const uint8_t *pixels;
        code = sg_view_pixels(ctx, &scene->train[i], &pixels);
        if (!code)
            sg_view_release(&scene->train[i]);
    }
    sg_scene_builder_destroy(&builder);
    sg_scene_destroy(&scene);
    return code;
}

/* Creation, steps with densification, filter and losses, saving, resuming, model, PLY, renderer. */
static int train_by(sg_ctx *ctx, enum sg_train_strategy strategy, enum sg_train_model kind)
{
    struct sg_scene *scene = NULL;
    sg_trainer *trainer = NULL, *resumed = NULL;
    sg_renderer *renderer = NULL;
    struct sg_model *model = NULL, *read = NULL;
    struct sg_eval eval = {0};
    const char *path = kind == SG_MODEL_SCAFFOLD ? anchors : ply;
    struct sg_train_params p = sg_train_params_default();
    p.iterations = 8, p.densify_from_iter = 1, p.densification_interval = 3,
    p.densify_until_iter = 7;
    p.opacity_reset_interval = 5, p.sh_degree = 1, p.densify_grad_threshold = 1e-6f;
    p.defense.on = true, p.defense.interval = 2, p.defense.views = 2;
    p.strategy = strategy, p.model = kind;
    p.scaffold.from = 1, p.scaffold.voxel = 0.05f, p.scaffold.cells = 4;
    p.scaffold.appearance = true;
    if (strategy == SG_STRATEGY_MCMC)
        p.defense.rho = 0;
    int code = sg_scene_load(ctx, colmap, NULL, &scene);
    if (!code)
        code = sg_trainer_create(ctx, scene, NULL, &p, &trainer);
    for (int i = 0; i < 4 && !code; i++)
        code = sg_trainer_step(trainer, NULL);
    if (!code)
        code = sg_trainer_save(trainer, checkpoint);
    if (!code)
        code = sg_trainer_resume(ctx, scene, checkpoint, &p, &resumed);
    for (int i = 0; i < 4 && !code; i++)
        code = sg_trainer_step(resumed, NULL);
    if (!code)
        code = sg_trainer_model(resumed, &model);
    if (!code && kind != SG_MODEL_SCAFFOLD) {
        struct sg_filter_pass next;
        double *scores = calloc(model->count, 2 * sizeof(*scores));
        uint8_t *stays = calloc(model->count, 1);
        code = sg_trainer_scores(resumed, scores, scores + model->count, stays, &next);
        free(scores);
        free(stays);
    }
    if (!code)
        code = sg_model_write_ply(ctx, model, path);
    if (!code)
        code = sg_model_read_drawable(ctx, path, 1000000, &read);
    if (!code)
        code = sg_renderer_create(ctx, NULL, NULL, read, NULL, &renderer);
    if (!code)
        code = sg_evaluate(ctx, renderer, scene->train, 2, NULL, &eval);
    sg_eval_clear(&eval);
    sg_renderer_destroy(&renderer);
    sg_model_destroy(&read);
    sg_model_destroy(&model);
    sg_trainer_destroy(&resumed);
    sg_trainer_destroy(&trainer);
    sg_scene_destroy(&scene);
    return code;
}

static int train(sg_ctx *ctx)
{
    return train_by(ctx, SG_STRATEGY_DEFAULT, SG_MODEL_3DGS);
}

static int train_scaffold(sg_ctx *ctx)
{
    return train_by(ctx, SG_STRATEGY_DEFAULT, SG_MODEL_SCAFFOLD);
}

static int train_mcmc(sg_ctx *ctx)
{
    return train_by(ctx, SG_STRATEGY_MCMC, SG_MODEL_3DGS);
}

static int train_mip(sg_ctx *ctx)
{
    return train_by(ctx, SG_STRATEGY_DEFAULT, SG_MODEL_MIP);
}

/* Each score, removal, and a round of fine-tuning. */
static int prune(sg_ctx *ctx)
{
    struct sg_scene *scene = NULL;
    struct sg_model *model = NULL;
    struct sg_prune_params p = sg_prune_params_default();
    p.finetune = 2, p.ratio = 0.3;
    int code = sg_scene_load(ctx, colmap, NULL, &scene);
    if (!code)
        code = sg_model_init_random(ctx, 60, 1.3f, 1, 1, &model);
    for (int method = SG_PRUNER_LIGHTGAUSSIAN; method <= SG_PRUNER_SPECTRAL && !code; method++) {
        struct sg_model *pruned = NULL;
        p.method = (enum sg_pruner) method;
        code = sg_prune(ctx, scene, model, &p, &pruned, NULL);
        assert_true(!code == (pruned != NULL));
        sg_model_destroy(&pruned);
    }
    sg_model_destroy(&model);
    sg_scene_destroy(&scene);
    return code;
}

static int audit(sg_ctx *ctx)
{
    struct sg_scene *scene = NULL;
    struct sg_audit *found = NULL;
    int code = sg_scene_load(ctx, blender, NULL, &scene);
    if (!code)
        code = sg_audit_scene(ctx, scene, &found);
    if (!code) { /* a photo that could not be measured at first was measured again */
        static double score = -1;
        score = score < 0 ? found->score : score;
        assert_true(found->score == score);
    }
    sg_audit_destroy(&found);
    sg_scene_destroy(&scene);
    return code;
}

static int attack(sg_ctx *ctx)
{
    static uint8_t rgb[3 * 24 * 20];
    struct sg_scene *scene = NULL;
    struct sg_model *proxy = NULL, *decoy = NULL;
    sg_attack *a = NULL;
    struct sg_attack_params p = sg_attack_params_default();
    p.iterations = 6, p.inner = 2, p.densification_interval = 3, p.spectral_weight = 1;
    p.victim_gaussians = 50; /* the proxy has as many */
    int code = sg_scene_load(ctx, blender, NULL, &scene);
    if (!code)
        code = sg_model_init_random(ctx, 50, 1.3f, 1, 1, &proxy);
    if (!code)
        code = sg_attack_create(ctx, scene, proxy, &p, &a);
    for (int i = 0; i < 4 && !code; i++)
        code = sg_attack_step(a, NULL);
    if (!code)
        code = sg_attack_poison(a, 0, rgb);
    if (!code)
        code = sg_attack_decoy(a, &decoy);
    sg_model_destroy(&decoy);
    sg_attack_destroy(&a);
    sg_model_destroy(&proxy);
    sg_scene_destroy(&scene);
    return code;
}

/* A run and its folder, with audit, defense, evaluation and checkpoint. A run that lacks memory on
 * the way ends early, with what it has; so SG_OK is allowed. */
static int run(sg_ctx *ctx)
{
    sg_run *r = NULL;
    sg_run_summary *summary = NULL;
    char path[128];
    struct sg_run_params p = sg_run_params_default();
    p.source = colmap, p.folder = run_folder, p.scene.eval = true;
    p.train.iterations = 2, p.train.sh_degree = 0, p.train.defense.on = true;
    p.audit = SG_RUN_AUDIT_WARN, p.save_every = 1;
    int code = sg_run_open(ctx, &p, SG_RUN_REPLACE, &r);
    assert_true(!code == (r != NULL));
    if (!code)
        code = sg_run_train(r);
    sg_run_close(&r);
    if (!code)
        code = sg_run_find_model(ctx, run_folder, 0, path, sizeof(path));
    if (!code)
        code = sg_run_summary_read(ctx, run_folder, &summary);
    sg_run_summary_destroy(&summary);
    return code;
}

static int attack_run(sg_ctx *ctx)
{
    struct sg_attack_run_params p = sg_attack_run_params_default();
    p.source = colmap, p.folder = poisoned, p.proxy_iterations = 2;
    p.attack.iterations = 2, p.attack.inner = 1;
    return sg_attack_run(ctx, &p, SG_RUN_REPLACE, NULL);
}

/* The proxy is what train_scaffold leaves, so that it is not trained and saved each time. */
static int attack_run_scaffold(sg_ctx *ctx)
{
    struct sg_attack_run_params p = sg_attack_run_params_default();
    p.source = colmap, p.folder = poisoned, p.proxy = anchors;
    p.attack.iterations = 2, p.attack.inner = 2, p.attack.model = SG_ATTACK_SCAFFOLD;
    p.attack.scaffold.from = 1, p.attack.scaffold.cells = 4, p.attack.scaffold.appearance = true;
    p.attack.densification_interval = 1, p.attack.densify_grad_threshold = 1e-6f;
    return sg_attack_run(ctx, &p, SG_RUN_REPLACE, NULL);
}

static void fail_each(int (*work)(sg_ctx *))
{
    sg_ctx *ctx = make_context(1);
    assert_int_equal(work(ctx), SG_OK);
    uint64_t n = 0;
    int code;
    do {
        sg_fail_allocation(ctx, ++n);
        code = work(ctx);
        const bool failed = sg_fail_allocation(ctx, 0);
        if (code != SG_OK && code != SG_ERR_BUDGET)
            fail_msg("allocation %llu: found code %d (%s), expected SG_ERR_BUDGET",
                     (unsigned long long) n, code, sg_last_error(ctx));
        if (code && !sg_last_error(ctx)[0])
            fail_msg("allocation %llu: no message", (unsigned long long) n);
        if (sg_mem_current(ctx, SG_MEM_TAGS))
            fail_msg("allocation %llu: %llu bytes are left", (unsigned long long) n,
                     (unsigned long long) sg_mem_current(ctx, SG_MEM_TAGS));
        if (!failed)
            break;
    } while (n < 100000);
    assert_int_equal(code, SG_OK);
    assert_true(n > 20);
    sg_ctx_destroy(&ctx);
}

#define TEST(work)                                                                                 \
    static void test_##work(void **state)                                                          \
    {                                                                                              \
        (void) state;                                                                              \
        fail_each(work);                                                                           \
    }
/* A model to each format that is written, and from each that is read and written. */
static int convert(sg_ctx *ctx)
{
    static const char *const endings[] = {"ply", "compressed.ply", "splat", "spz", "sog", "glb"};
    struct sg_model *model = NULL, *part = NULL;
    int code = sg_model_init_random(ctx, 60, 1.3f, 1, 1, &model);
    if (!code)
        code = sg_model_select(ctx, model, NULL, &part);
    for (size_t k = 0; k < sizeof(endings) / sizeof(endings[0]) && !code; k++) {
        struct sg_model *back = NULL;
        char path[96];
        snprintf(path, sizeof(path), "%s/m.%s", folder, endings[k]);
        code = sg_model_write(ctx, part, path, NULL);
        if (!code && k < 5)
            code = sg_model_read(ctx, path, 100, &back);
        assert_true(code || k == 5 || back->count == 60);
        sg_model_destroy(&back);
    }
    sg_model_destroy(&part);
    sg_model_destroy(&model);
    return code;
}

static uint64_t json_allocations, json_fails_at;

/* Values. The text that they become has sizes that are powers of two; where it lacks memory for a
 * key, Jansson leaves the key out and goes on. */
static void *json_allocate(size_t size)
{
    const bool fails = (size & (size - 1)) && ++json_allocations == json_fails_at;
    return fails ? NULL : malloc(size);
}

/* Jansson allocates on its own. What it makes is whole or not written. */
static void fail_each_of_json(int (*write)(sg_ctx *, const char *path))
{
    sg_ctx *ctx = make_context(1);
    char path[96], *whole, *text;
    size_t n, size;
    snprintf(path, sizeof(path), "%s/json.glb", folder);
    assert_int_equal(write(ctx, path), SG_OK);
    assert_int_equal(sg_file_read(ctx, path, 1 << 20, &whole, &n), SG_OK);
    json_set_alloc_funcs(json_allocate, free);
    for (json_fails_at = 1;; json_fails_at++) {
        remove(path);
        json_allocations = 0;
        const int code = write(ctx, path);
        assert_true(code == SG_OK || code == SG_ERR_BUDGET);
        assert_true(code ? sg_last_error(ctx)[0] && !sg_file_exists(path)
                         : !sg_file_read(ctx, path, 1 << 20, &text, &size));
        if (!code) {
            assert_int_equal(size, n);
            assert_memory_equal(text, whole, n);
            sg_free(text);
        }
        if (json_allocations < json_fails_at)
            break;
    }
    json_set_alloc_funcs(malloc, free);
    assert_true(json_fails_at > 50);
    sg_free(whole);
    sg_ctx_destroy(&ctx);
}

static struct sg_scene *json_scene;
static struct sg_model *json_model;

static int write_cameras(sg_ctx *ctx, const char *path)
{
    return sg_cameras_write_json(ctx, json_scene, path);
}

static int write_glb(sg_ctx *ctx, const char *path)
{
    return sg_model_write(ctx, json_model, path, NULL);
}

static void test_json(void **state)
{
    sg_ctx *ctx = make_context(1);
    (void) state;
    assert_int_equal(sg_scene_load(ctx, colmap, NULL, &json_scene), SG_OK);
    assert_int_equal(sg_model_init_random(ctx, 5, 1.3f, 1, 1, &json_model), SG_OK);
    fail_each_of_json(write_cameras);
    fail_each_of_json(write_glb);
    sg_model_destroy(&json_model);
    sg_scene_destroy(&json_scene);
    sg_ctx_destroy(&ctx);
}

TEST(load_blender)
TEST(load_colmap)
TEST(build)
TEST(train)
TEST(train_mcmc)
TEST(train_scaffold)
TEST(train_mip)
TEST(prune)
TEST(audit)
TEST(attack)
TEST(run)
TEST(attack_run)
TEST(attack_run_scaffold)
TEST(convert)

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_load_blender),
        cmocka_unit_test(test_load_colmap),
        cmocka_unit_test(test_build),
        cmocka_unit_test(test_train),
        cmocka_unit_test(test_train_mcmc),
        cmocka_unit_test(test_train_scaffold),
        cmocka_unit_test(test_train_mip),
        cmocka_unit_test(test_prune),
        cmocka_unit_test(test_audit),
        cmocka_unit_test(test_attack),
        cmocka_unit_test(test_run),
        cmocka_unit_test(test_attack_run),
        cmocka_unit_test(test_attack_run_scaffold),
        cmocka_unit_test(test_convert),
        cmocka_unit_test(test_json),
    };
    return cmocka_run_group_tests(tests, make_scene, remove_scene);
}
