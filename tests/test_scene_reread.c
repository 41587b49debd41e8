/* SPDX-License-Identifier: Apache-2.0 */
/* Photos of a folder under a limit on memory: as many as fit stay, the others are read again from
 * their files, which must not have changed. The bytes are those of a scene whose photos all stay.
 */
#include "races.h"
#include "scene_files.h"

#include "core/context.h"
#include "scene/photo.h"
#include "train/trainer.h"

#define PHOTOS 16
#define W 160
#define H 120

/* Distorted photos with masks and alpha, reduced and smoothed on loading: all that reading can do.
 */
static void put_scene(struct fixture *f)
{
    char text[8192], name[64];
    int n =
        snprintf(text, sizeof(text),
                 "{\"fl_x\": 250, \"fl_y\": 250, \"cx\": 118, \"cy\": 81, \"w\": %d, \"h\": %d, "
                 "\"k1\": -0.1, \"k2\": 0.01, \"frames\": [",
                 W, H);
    for (int k = 0; k < PHOTOS; k++) {
        snprintf(name, sizeof(name), "images/%02d.png", k);
        put_png(f, name, W, H, k % 2 ? 3 : 4, k);
        if (k % 3 == 0) {
            snprintf(name, sizeof(name), "masks/%02d.png", k);
            put_png(f, name, W, H, 1, k + 100);
        }
        n += snprintf(text + n, sizeof(text) - (size_t) n,
                      "%s{\"file_path\": \"images/%02d.png\", \"transform_matrix\": "
                      "[[1,0,0,%g],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}",
                      k ? "," : "", k, 0.1 * k);
    }
    snprintf(text + n, sizeof(text) - (size_t) n, "]}");
    put_text(f, "transforms.json", text);
}

static const struct sg_scene_params *scene_params(void)
{
    static struct sg_scene_params p;
    p = *sg_scene_params(.resolution = 130, .eval = true, .smooth = SG_SMOOTH_GAUSSIAN);
    return &p;
}

static void count_notices(void *priv, enum sg_log_level level, const char *message)
{
    if (level == SG_LOG_WARN && strstr(message, "are read again"))
        ++*(int *) priv;
}

static int notices; /* that photos are read again */

static sg_ctx *limited(int threads, uint64_t max_memory)
{
    sg_ctx *ctx;
    const struct sg_ctx_params p = {
        .threads = threads, .max_memory = max_memory, .log = count_notices, .log_priv = &notices};
    assert_int_equal(sg_ctx_create(&ctx, &p), SG_OK);
    return ctx;
}

static struct sg_scene *load_in(sg_ctx *ctx, const struct fixture *f)
{
    struct sg_scene *scene;
    if (sg_scene_load(ctx, f->dir, scene_params(), &scene))
        fail_msg("%s", sg_last_error(ctx));
    return scene;
}

static struct sg_train_params train_params(uint64_t max_gaussians)
{
    struct sg_train_params p = sg_train_params_default();
    p.iterations = 20, p.init_points = 300, p.max_gaussians = max_gaussians;
    p.densify_from_iter = 4, p.densification_interval = 6;
    return p;
}

/* The model as bytes of a file, or the code of an error. */
static int train(sg_ctx *ctx, const struct sg_scene *scene, const char *path)
{
    const struct sg_train_params p = train_params(900);
    struct sg_model *m = NULL;
    sg_trainer *t;
    int code = sg_trainer_create(ctx, scene, NULL, &p, &t);
    for (int i = 0; i < p.iterations && !code; i++)
        code = sg_trainer_step(t, NULL);
    if (!code)
        code = sg_trainer_model(t, &m);
    if (!code)
        code = sg_model_write_ply(ctx, m, path);
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    return code;
}

static void same_file(struct fixture *f, const char *a, const char *b)
{
    char *data[2];
    size_t size[2];
    assert_int_equal(sg_file_read(f->ctx, at(f, a), UINT64_MAX, &data[0], &size[0]), SG_OK);
    assert_int_equal(sg_file_read(f->ctx, at(f, b), UINT64_MAX, &data[1], &size[1]), SG_OK);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(data[0], data[1], size[0]);
    sg_free(data[0]);
    sg_free(data[1]);
}

/* The number behind "at least" in the last error. */
static uint64_t least(const sg_ctx *ctx)
{
    const char *number = strstr(sg_last_error(ctx), "at least ");
    assert_non_null(number);
    return strtoull(number + 9, NULL, 10);
}

/* The least limit that a training of the scene asks for. */
static uint64_t least_for_training(struct fixture *f, int threads)
{
    const struct sg_train_params p = train_params(900);
    sg_trainer *t;
    sg_ctx *ctx = limited(threads, 8 << 20);
    struct sg_scene *scene = load_in(ctx, f);
    assert_int_equal(sg_trainer_create(ctx, scene, NULL, &p, &t), SG_ERR_BUDGET);
    const uint64_t bytes = least(ctx);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
    return bytes;
}

static void same_views(sg_ctx *ctx, const struct sg_view *a, const struct sg_view *b, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const uint8_t *rgb;
        assert_non_null(a[i].rgb);
        assert_null(b[i].rgb);
        assert_memory_equal(&a[i].camera, &b[i].camera, sizeof(a[i].camera));
        assert_true(a[i].hash == b[i].hash);
        if (sg_view_pixels(ctx, &b[i], &rgb))
            fail_msg("%s", sg_last_error(ctx));
        assert_memory_equal(a[i].rgb, rgb,
                            3 * (size_t) a[i].camera.width * (size_t) a[i].camera.height);
        sg_view_release(&b[i]);
    }
}

/* From the least limit to one with room for everything. */
static void test_same_bytes(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    struct sg_scene *plain = load_in(f->ctx, f);
    assert_int_equal(plain->n_train, PHOTOS - PHOTOS / 8);
    if (train(f->ctx, plain, at(f, "plain.ply")))
        fail_msg("%s", sg_last_error(f->ctx));
    const uint64_t lowest = least_for_training(f, 2);
    notices = 0;
    for (int i = 0; i < 3; i++) {
        const uint64_t limit = lowest + (uint64_t) i * (200 << 10);
        sg_ctx *ctx = limited(2, i < 2 ? limit : 1 << 30);
        struct sg_scene *scene = load_in(ctx, f);
        same_views(ctx, plain->train, scene->train, scene->n_train);
        same_views(ctx, plain->test, scene->test, scene->n_test);
        if (train(ctx, scene, at(f, "limited.ply")))
            fail_msg("limit %llu: %s", (unsigned long long) limit, sg_last_error(ctx));
        same_file(f, "plain.ply", "limited.ply");
        const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
        if (i < 2)
            assert_true(photos.held < photos.total);
        else
            assert_true(photos.held == photos.total);
        assert_int_equal(notices, i < 2 ? i + 1 : 2);
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    sg_scene_destroy(&plain);
}

/* The photo of the next iteration is read while an iteration runs, at each limit below that for all
 * photos, with the same bytes. */
static void test_read_ahead(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    struct sg_scene *plain = load_in(f->ctx, f);
    if (train(f->ctx, plain, at(f, "plain.ply")))
        fail_msg("%s", sg_last_error(f->ctx));
    const uint64_t lowest = least_for_training(f, 2);
    for (uint64_t i = 0; i < 3; i++) {
        sg_ctx *ctx = limited(2, lowest + i * (100 << 10));
        struct sg_scene *scene = load_in(ctx, f);
        if (train(ctx, scene, at(f, "limited.ply")))
            fail_msg("%s", sg_last_error(ctx));
        same_file(f, "plain.ply", "limited.ply");
        const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
        assert_true(photos.reads > 5 && photos.held < photos.total);
        /* All but the first one, and one that is the last of an epoch and the first of the next. */
        assert_in_range(photos.reads - photos.reads_ahead, 0, 2);
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    sg_scene_destroy(&plain);
}

/* Photos that all stay go where another allocation needs their memory, but not those in use. */
static void test_make_room(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    const uint64_t limit = 16 << 20;
    sg_ctx *ctx = limited(2, limit);
    struct sg_scene *plain = load_in(f->ctx, f), *scene = load_in(ctx, f);
    struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
    assert_true(photos.held == photos.total && !photos.dropped);

    assert_null(sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) limit + 1, 1)); /* no room could do */
    photos = sg_lazy_photos_bytes(scene->lazy);
    assert_true(photos.held == photos.total && !photos.dropped);

    const uint8_t *used;
    assert_int_equal(sg_view_pixels(ctx, &scene->train[0], &used), SG_OK);
    const uint64_t others = sg_mem_current(ctx, SG_MEM_TAGS) - photos.held;
    void *most = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) (limit - others - photos.held / 2), 1);
    assert_non_null(most);
    photos = sg_lazy_photos_bytes(scene->lazy);
    assert_true(photos.held > 0 && photos.held <= photos.total / 2 && photos.dropped);
    const size_t size =
        3 * (size_t) scene->train[0].camera.width * (size_t) scene->train[0].camera.height;
    assert_memory_equal(used, plain->train[0].rgb, size);
    assert_null(sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) (limit - others), 1));
    assert_memory_equal(used, plain->train[0].rgb, size);
    sg_view_release(&scene->train[0]);
    sg_free(most);
    same_views(ctx, plain->train, scene->train, scene->n_train);
    sg_scene_destroy(&scene);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    assert_true(sg_mem_peak(ctx, SG_MEM_TAGS) <= limit);
    sg_ctx_destroy(&ctx);
    sg_scene_destroy(&plain);
}

static sg_trainer *make_trainer(sg_ctx *ctx, const struct sg_scene *scene)
{
    const struct sg_train_params p = train_params(900);
    sg_trainer *t;
    if (sg_trainer_create(ctx, scene, NULL, &p, &t))
        fail_msg("%s", sg_last_error(ctx));
    assert_true(t->budget.read_ahead);
    return t;
}

/* Trainings that end while their next photo is read, the reader with them or not. */
static void test_read_ahead_ends(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    sg_ctx *ctx = limited(2, least_for_training(f, 2));
    struct sg_scene *scene = load_in(ctx, f);
    for (int steps = 0; steps < 8; steps++) {
        sg_trainer *t = make_trainer(ctx, scene);
        if (steps % 2)
            sg_lazy_photos_start_reader(scene->lazy);
        for (int i = 0; i < steps; i++)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        sg_trainer_destroy(&t);
        if (steps % 2)
            sg_lazy_photos_stop_reader(scene->lazy);
        const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
        assert_true(photos.held + photos.largest < photos.total);
    }
    sg_scene_destroy(&scene);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* A photo that cannot be read ends the iteration that needs it, not the one before, with the same
 * message as without a reader. The training can go on. */
static void test_read_ahead_fails(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    char message[2][512];
    const uint64_t limit = least_for_training(f, 2);
    for (int ahead = 0; ahead < 2; ahead++) {
        sg_ctx *ctx = limited(2, limit);
        struct sg_scene *scene = load_in(ctx, f);
        sg_trainer *t = make_trainer(ctx, scene);
        if (!ahead)
            sg_lazy_photos_stop_reader(scene->lazy);
        sg_lazy_photos_keep(scene->lazy, 0);
        const char *path = scene->train[sg_trainer_pick_view(t, 5)].path;
        assert_int_equal(rename(path, at(f, "away.png")), 0);
        for (int it = 1; it < 5; it++)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        assert_int_equal(sg_trainer_step(t, NULL), SG_ERR_INPUT);
        assert_int_equal(sg_trainer_iteration(t), 4);
        assert_non_null(strstr(sg_last_error(ctx), path));
        snprintf(message[ahead], sizeof(message[0]), "%s", sg_last_error(ctx));
        assert_int_equal(rename(at(f, "away.png"), path), 0);
        for (int it = 5; it < 10; it++)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
        assert_int_equal(photos.reads_ahead, ahead ? photos.reads - 2 : 0);
        if (!ahead)
            sg_lazy_photos_start_reader(scene->lazy);
        sg_trainer_destroy(&t);
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    assert_string_equal(message[0], message[1]);
}

/* A larger limit never allows fewer Gaussians, whether photos have to go or not. */
static void test_more_memory(void **state)
{
    skip_without_races();
    struct fixture *f = *state;
    put_scene(f);
    uint64_t before = 0;
    const uint64_t lowest = least_for_training(f, 1);
    bool dropped = false, all = false;
    for (uint64_t limit = lowest; limit < lowest + (3 << 20); limit += 512 << 10) {
        const struct sg_train_params p = train_params(0);
        struct sg_train_limits limits;
        sg_trainer *t;
        sg_ctx *ctx = limited(1, limit);
        struct sg_scene *scene = load_in(ctx, f);
        if (sg_trainer_create(ctx, scene, NULL, &p, &t))
            fail_msg("%s", sg_last_error(ctx));
        sg_trainer_limits(t, &limits);
        assert_true(limits.max_gaussians >= before && limits.max_gaussians >= 1000);
        before = limits.max_gaussians;
        const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
        dropped |= photos.held < photos.total;
        all |= photos.held == photos.total;
        sg_trainer_destroy(&t);
        sg_scene_destroy(&scene);
        sg_ctx_destroy(&ctx);
    }
    assert_true(dropped && all);
}

/* A photo that takes more memory to read than to keep stays, even where it takes more than half of
 * what photos and Gaussians can have. */
static void test_reduced_photo(void **state)
{
    skip_without_races();
    struct fixture *f = *state;
    put_png(f, "images/0.png", 1200, 1200, 3, 0);
    put_text(f, "transforms.json",
             "{\"fl_x\": 1200, \"fl_y\": 1200, \"frames\": [{\"file_path\": \"images/0.png\", "
             "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}");
    struct sg_train_params p = train_params(0);
    p.sh_degree = 0;
    uint64_t limit = 16 << 20, before = 0;
    for (int i = 0; i < 6; i++) {
        struct sg_train_limits limits;
        struct sg_scene *scene;
        sg_trainer *t;
        sg_ctx *ctx = limited(1, limit);
        if (sg_scene_load(ctx, f->dir, sg_scene_params(.resolution = 600), &scene))
            fail_msg("%s", sg_last_error(ctx));
        const int code = sg_trainer_create(ctx, scene, NULL, &p, &t);
        assert_int_equal(code, i ? SG_OK : SG_ERR_BUDGET);
        if (code) {
            limit = least(ctx);
        } else {
            sg_trainer_limits(t, &limits);
            assert_true(limits.max_gaussians >= before && limits.max_gaussians >= 1000);
            assert_true(limits.max_gaussians < 20000);
            const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
            assert_true(photos.held == photos.total && photos.read > photos.total);
            before = limits.max_gaussians;
            limit += 200 << 10;
        }
        sg_trainer_destroy(&t);
        sg_scene_destroy(&scene);
        sg_ctx_destroy(&ctx);
    }
}

/* Where there is room, no file is read twice, not even once a photo has been handed over. */
static void test_room_for_all(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    sg_ctx *ctx = limited(2, 1 << 30);
    struct sg_scene *scene = load_in(ctx, f);
    char name[64];
    for (int k = 0; k < PHOTOS; k++) {
        snprintf(name, sizeof(name), "images/%02d.png", k);
        assert_int_equal(remove(at(f, name)), 0);
    }
    if (train(ctx, scene, at(f, "model.ply")))
        fail_msg("%s", sg_last_error(ctx));
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
}

static void expect_error(sg_ctx *ctx, const struct sg_scene *scene, struct fixture *f,
                         const char *name, const char *words)
{
    assert_int_equal(train(ctx, scene, at(f, "x.ply")), SG_ERR_INPUT);
    if (!strstr(sg_last_error(ctx), name) || !strstr(sg_last_error(ctx), words))
        fail_msg("neither %s nor \"%s\" in: %s", name, words, sg_last_error(ctx));
    assert_int_not_equal(access(at(f, "x.ply"), F_OK), 0);
}

/* A photo or mask that has changed since the scene was loaded ends the training. */
static void test_changed(void **state)
{
    skip_without_races();
    struct fixture *f = *state;
    put_scene(f);
    sg_ctx *ctx = limited(1, least_for_training(f, 1));
    struct sg_scene *scene = load_in(ctx, f);
    const char *changed = "found another photo or mask than when the scene was loaded";
    put_png(f, "images/05.png", W, H, 3, 99);
    expect_error(ctx, scene, f, "images/05.png", changed);
    put_png(f, "images/05.png", W / 2, H / 2, 3, 5);
    expect_error(ctx, scene, f, "images/05.png", changed);
    put_png(f, "images/05.png", W, H, 3, 5);
    put_png(f, "masks/06.png", W, H, 1, 99);
    expect_error(ctx, scene, f, "images/06.png", changed);
    put_png(f, "masks/06.png", W, H, 1, 106);
    put_text(f, "images/07.png", "no picture");
    expect_error(ctx, scene, f, "images/07.png", "expected a PNG");
    assert_int_equal(remove(at(f, "images/07.png")), 0);
    expect_error(ctx, scene, f, "images/07.png", "No such file");
    put_png(f, "images/07.png", W, H, 3, 7);
    if (train(ctx, scene, at(f, "x.ply"))) /* as it was */
        fail_msg("%s", sg_last_error(ctx));
    sg_scene_destroy(&scene);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* A limit that not even one photo can be read under, then what the errors ask for. */
static void test_too_little(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    uint64_t limit = 200000;
    int refused = 0;
    for (struct sg_scene *scene = NULL; !scene; refused++) {
        sg_ctx *ctx = limited(4, limit);
        if (sg_scene_load(ctx, f->dir, scene_params(), &scene)) {
            assert_null(scene);
            assert_non_null(strstr(sg_last_error(ctx), "images/"));
            assert_non_null(strstr(sg_last_error(ctx), "to read this photo"));
            assert_true(least(ctx) > limit);
            limit = least(ctx);
        } else {
            const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
            assert_true(photos.held <= limit / 2);
            assert_true(photos.held < photos.total);
            struct sg_scene *again = scene;
            sg_scene_destroy(&again);
        }
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        assert_true(sg_mem_peak(ctx, SG_MEM_TAGS) <= limit);
        sg_ctx_destroy(&ctx);
        assert_true(refused < 100);
    }
    assert_true(refused > 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_same_bytes),       scene_test(test_more_memory),
        scene_test(test_reduced_photo),    scene_test(test_room_for_all),
        scene_test(test_changed),          scene_test(test_too_little),
        scene_test(test_read_ahead),       scene_test(test_read_ahead_ends),
        scene_test(test_read_ahead_fails), scene_test(test_make_room),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
