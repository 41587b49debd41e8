/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes from memory: the same results as from a folder, and refusals that name the field. */
#include "core/context.h"
#include "synth_scene.h"

#define WIDTH 40
#define HEIGHT 32
#define PAD 7 /* bytes between rows */

static char folder[] = "/tmp/sg_memory_XXXXXX", colmap[64], copy[64], checkpoint[64];

static int make_scene(void **state)
{
    (void) state;
    const int code =
        make_synth_scene(folder, sg_synth_params(.width = WIDTH, .height = HEIGHT, .train_views = 9,
                                                 .test_views = 1, .points = 60, .samples = 1));
    snprintf(colmap, sizeof(colmap), "%s/scene/colmap", folder);
    snprintf(copy, sizeof(copy), "%s/copy", folder);
    snprintf(checkpoint, sizeof(checkpoint), "%s/checkpoint", folder);
    return code;
}

static int remove_scene(void **state)
{
    (void) state;
    return remove_synth_scene(folder);
}

/* Rows with something between them. */
static uint8_t *spread(const uint8_t *rows, size_t row, int height)
{
    uint8_t *to = malloc((row + PAD) * (size_t) height);
    memset(to, 0xa5, (row + PAD) * (size_t) height);
    for (size_t y = 0; y < (size_t) height; y++)
        memcpy(to + y * (row + PAD), rows + y * row, row);
    return to;
}

static void add_views(sg_scene_builder *b, const struct sg_view *views, size_t n,
                      enum sg_view_split split, bool padded)
{
    for (size_t i = 0; i < n; i++) {
        const struct sg_view *v = &views[i];
        const size_t row = 3 * (size_t) v->camera.width;
        uint8_t *rgb = spread(v->rgb, row, v->camera.height);
        const struct sg_view_desc d = {.name = v->name,
                                       .camera = v->camera,
                                       .rgb = padded ? rgb : v->rgb,
                                       .rgb_stride = padded ? row + PAD : 0,
                                       .split = split};
        assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
        free(rgb);
    }
}

/* The views of a scene, in two parts of points. */
static struct sg_scene *rebuild(sg_ctx *ctx, const struct sg_scene *from, bool padded)
{
    sg_scene_builder *b;
    struct sg_scene *scene;
    assert_int_equal(sg_scene_builder_create(ctx, NULL, &b), SG_OK);
    const size_t half = from->n_points / 2;
    assert_int_equal(sg_scene_builder_add_points(b, from->points, from->point_colors, half), SG_OK);
    add_views(b, from->train, from->n_train, SG_SPLIT_TRAIN, padded);
    add_views(b, from->test, from->n_test, SG_SPLIT_TEST, padded);
    assert_int_equal(sg_scene_builder_add_points(b, from->points + 3 * half,
                                                 from->point_colors + 3 * half,
                                                 from->n_points - half),
                     SG_OK);
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_OK);
    assert_null(b);
    return scene;
}

static struct sg_model *train(sg_ctx *ctx, const struct sg_scene *scene, int from, int to)
{
    struct sg_train_params p = sg_train_params_default();
    p.iterations = 30, p.densify_from_iter = 4, p.densification_interval = 5, p.sh_degree = 1;
    sg_trainer *t;
    struct sg_model *m;
    assert_int_equal(from ? sg_trainer_resume(ctx, scene, checkpoint, &p, &t)
                          : sg_trainer_create(ctx, scene, NULL, &p, &t),
                     SG_OK);
    while (sg_trainer_iteration(t) < to)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_save(t, checkpoint), SG_OK);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    sg_trainer_destroy(&t);
    return m;
}

static void same_model(const struct sg_model *a, const struct sg_model *b)
{
    assert_int_equal(a->count, b->count);
    assert_int_equal(a->capacity, b->capacity);
    assert_memory_equal(a->params, b->params,
                        a->capacity * (size_t) sg_param_count(a->sh_degree) * sizeof(float));
}

static struct sg_scene *load(sg_ctx *ctx, const char *path, bool eval)
{
    struct sg_scene_params p = sg_scene_params_default();
    struct sg_scene *scene;
    p.eval = eval;
    assert_int_equal(sg_scene_load(ctx, path, &p, &scene), SG_OK);
    return scene;
}

/* Training, resuming and audit give the same bytes for a folder and for its contents from memory;
 * a checkpoint of one continues with the other. */
static void test_same_as_folder(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_scene *a = load(ctx, colmap, true), *b = rebuild(ctx, a, true);
    assert_int_equal(b->format, SG_FORMAT_MEMORY);
    assert_int_equal(b->n_train, a->n_train);
    assert_int_equal(b->n_test, a->n_test);
    assert_true(b->extent == a->extent);
    for (size_t i = 0; i < a->n_train; i++) {
        assert_true(a->train[i].hash && b->train[i].hash == a->train[i].hash);
        assert_memory_equal(a->train[i].rgb, b->train[i].rgb, 3 * WIDTH * HEIGHT);
    }
    struct sg_model *of_a = train(ctx, a, 0, 12), *of_b = train(ctx, b, 0, 12);
    same_model(of_a, of_b);
    sg_model_destroy(&of_a);
    sg_model_destroy(&of_b);
    of_a = train(ctx, a, 12, 20); /* from the checkpoint of b */
    of_b = train(ctx, b, 0, 20);
    same_model(of_a, of_b);
    sg_model_destroy(&of_a);
    sg_model_destroy(&of_b);

    struct sg_audit *audit_a, *audit_b;
    assert_int_equal(sg_audit_scene(ctx, a, &audit_a), SG_OK);
    assert_int_equal(sg_audit_scene(ctx, b, &audit_b), SG_OK);
    assert_true(audit_a->score == audit_b->score);
    assert_string_equal(audit_a->images[2].name, audit_b->images[2].name);
    sg_audit_destroy(&audit_a);
    sg_audit_destroy(&audit_b);
    sg_scene_destroy(&a);
    sg_scene_destroy(&b);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Written as images with a transforms.json, and read again. */
static void test_written(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_scene *a = load(ctx, colmap, false), *b = rebuild(ctx, a, false), *again;
    const struct sg_poison_files files = sg_poison_files_default();
    assert_int_equal(sg_poisoned_scene_begin(ctx, b, &files, copy), SG_OK);
    for (size_t i = 0; i < b->n_train; i++)
        assert_int_equal(
            sg_poisoned_scene_image(ctx, b, &b->train[i], &files, copy, b->train[i].rgb, NULL),
            SG_OK);
    assert_int_equal(sg_poisoned_scene_finish(ctx, b, &files, copy), SG_OK);
    again = load(ctx, copy, false);
    assert_int_equal(again->n_train, b->n_train);
    assert_int_equal(again->n_points, b->n_points);
    for (size_t i = 0; i < b->n_train; i++) {
        assert_string_equal(again->train[i].name, b->train[i].name);
        assert_memory_equal(again->train[i].rgb, b->train[i].rgb, 3 * WIDTH * HEIGHT);
    }
    sg_scene_destroy(&a);
    sg_scene_destroy(&b);
    sg_scene_destroy(&again);
    sg_ctx_destroy(&ctx);
}

static uint8_t pixels[3 * 8 * 6], mask[8 * 6];

static struct sg_view_desc sound_view(const char *name)
{
    return (struct sg_view_desc){.name = name,
                                 .camera = {.width = 8,
                                            .height = 6,
                                            .fx = 9,
                                            .fy = 9,
                                            .cx = 4,
                                            .cy = 3,
                                            .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                                 .rgb = pixels};
}

static void expect_refused(sg_scene_builder *b, sg_ctx *ctx, const struct sg_view_desc *d,
                           const char *field)
{
    const uint64_t before = sg_mem_current(ctx, SG_MEM_TAGS);
    assert_int_equal(sg_scene_builder_add_view(b, d), SG_ERR_USAGE);
    char expected[64];
    snprintf(expected, sizeof(expected), ": %s: found ", field);
    if (!strstr(sg_last_error(ctx), expected) || strncmp(sg_last_error(ctx), "view 1", 6))
        fail_msg("found \"%s\", expected it to name view 1 and %s", sg_last_error(ctx), field);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), before);
}

static void test_refused_views(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    sg_scene_builder *b;
    struct sg_scene *scene;
    char longest[257];
    memset(longest, 'n', sizeof(longest));
    longest[256] = 0;
    assert_int_equal(sg_scene_builder_create(ctx, NULL, &b), SG_OK);
    struct sg_view_desc d = sound_view("first");
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
#define REFUSED(change, field)                                                                     \
    d = sound_view("second");                                                                      \
    change;                                                                                        \
    expect_refused(b, ctx, &d, field)
    REFUSED(d.name = NULL, "name");
    REFUSED(d.name = "", "name");
    REFUSED(d.name = "a/b", "name");
    REFUSED(d.name = "a\033[2J", "name");
    REFUSED(d.name = longest, "name");
    REFUSED(d.camera.width = 0, "camera.width");
    REFUSED(d.camera.width = 16385, "camera.width");
    REFUSED(d.camera.height = -1, "camera.height");
    REFUSED(d.camera.fx = NAN, "camera.fx");
    REFUSED(d.camera.fx = 0, "camera.fx");
    REFUSED(d.camera.fy = INFINITY, "camera.fy");
    REFUSED(d.camera.cx = NAN, "camera.cx");
    REFUSED(d.camera.cy = -1e9, "camera.cy");
    REFUSED(d.camera.t[0] = NAN, "camera.t[0]");
    REFUSED(d.camera.t[2] = 1e13, "camera.t[2]");
    REFUSED(d.camera.R[4] = NAN, "camera.R");
    REFUSED(d.camera.R[0] = 1.03, "camera.R");
    REFUSED(d.camera.R[0] = -1, "camera.R"); /* a mirror */
    REFUSED(memset(d.camera.R, 0, sizeof(d.camera.R)), "camera.R");
    REFUSED(d.rgb = NULL, "rgb");
    REFUSED(d.rgb_stride = 23, "rgb_stride");
    REFUSED((d.mask = mask, d.mask_stride = 7), "mask_stride");
    REFUSED(d.split = (enum sg_view_split) 3, "split");

    /* The builder is as before: the scene has the sound views alone. */
    d = sound_view("second");
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_OK);
    assert_int_equal(scene->n_train, 2);
    sg_scene_destroy(&scene);

    struct sg_scene_params p = sg_scene_params_default();
    p.max_pixels = 47;
    assert_int_equal(sg_scene_builder_create(ctx, &p, &b), SG_OK);
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "max_pixels"));
    sg_scene_builder_destroy(&b);
    p.max_images = 0;
    assert_int_equal(sg_scene_builder_create(ctx, &p, &b), SG_OK);
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "max_images"));
    sg_scene_builder_destroy(&b);
    p.test_every = 0;
    assert_int_equal(sg_scene_builder_create(ctx, &p, &b), SG_ERR_USAGE);
    assert_null(b);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

static void test_refused_scenes(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    sg_scene_builder *b;
    struct sg_scene *scene;
    struct sg_scene_params p = sg_scene_params_default();
    p.max_points = 3;
    assert_int_equal(sg_scene_builder_create(ctx, &p, &b), SG_OK);
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "no views"));
    assert_null(scene);

    float xyz[] = {1, 2, 3, 4, 5, NAN, 7, 8, 9};
    assert_int_equal(sg_scene_builder_add_points(b, xyz, NULL, 2), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "points: xyz[5]: found nan"));
    assert_int_equal(sg_scene_builder_add_points(b, NULL, NULL, 1), SG_ERR_USAGE);
    assert_int_equal(sg_scene_builder_add_points(b, NULL, NULL, 0), SG_OK);
    xyz[5] = 6;
    assert_int_equal(sg_scene_builder_add_points(b, xyz, NULL, 2), SG_OK);
    assert_int_equal(sg_scene_builder_add_points(b, xyz, NULL, 2), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "max_points"));

    struct sg_view_desc d = sound_view("twice");
    d.split = SG_SPLIT_TEST;
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "no view to train on"));
    d.split = SG_SPLIT_TRAIN; /* a name may be there once among each */
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    d.split = SG_SPLIT_AUTO;
    assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "view 2: name: found \"twice\", which view 1"));
    sg_scene_builder_destroy(&b);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Every third by name of those that are SG_SPLIT_AUTO, in the order of adding. */
static void test_split(void **state)
{
    (void) state;
    static const char *const names[] = {"e", "b", "d", "x", "a", "c", "w"};
    sg_ctx *ctx = make_context(1);
    struct sg_scene_params p = sg_scene_params_default();
    p.eval = true, p.test_every = 3, p.white_background = true;
    sg_scene_builder *b;
    struct sg_scene *scene;
    assert_int_equal(sg_scene_builder_create(ctx, &p, &b), SG_OK);
    mask[3] = 7; /* anything but 0 is used */
    for (int i = 0; i < 7; i++) {
        struct sg_view_desc d = sound_view(names[i]);
        d.split = *names[i] == 'x'   ? SG_SPLIT_TEST
                  : *names[i] == 'w' ? SG_SPLIT_TRAIN
                                     : SG_SPLIT_AUTO;
        d.mask = i == 1 ? mask : NULL;
        assert_int_equal(sg_scene_builder_add_view(b, &d), SG_OK);
    }
    assert_int_equal(sg_scene_builder_finish(&b, &scene), SG_OK);
    static const char *const train_names[] = {"e", "b", "c", "w"}, *const test_names[] = {"d", "x",
                                                                                          "a"};
    assert_int_equal(scene->n_train, 4);
    assert_int_equal(scene->n_test, 3);
    for (int i = 0; i < 4; i++)
        assert_string_equal(scene->train[i].name, train_names[i]);
    for (int i = 0; i < 3; i++)
        assert_string_equal(scene->test[i].name, test_names[i]);
    assert_true(scene->white_background);
    for (size_t i = 0; i < 4; i++)
        assert_int_equal(sg_scene_photo(scene, &scene->train[i]), i);
    assert_true(sg_scene_photo(scene, &scene->test[0]) == SIZE_MAX);
    const uint8_t *kept = scene->train[1].mask;
    assert_true(kept[3] == 255 && kept[2] == 0 && kept[4] == 0);
    assert_null(scene->train[0].mask);
    assert_true(scene->train[0].hash != scene->train[1].hash);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_as_folder), cmocka_unit_test(test_written),
        cmocka_unit_test(test_refused_views),  cmocka_unit_test(test_refused_scenes),
        cmocka_unit_test(test_split),
    };
    return cmocka_run_group_tests(tests, make_scene, remove_scene);
}
