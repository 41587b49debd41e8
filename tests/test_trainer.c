/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters, schedule, what a step does with a scene, determinism and checkpoints. */
#include <unistd.h>

#include "engine/engine.h"
#include "engine/cpu/dispatch.h"
#include "math/constants.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

static void test_threads(void **state)
{
    (void) state;
    static const int threads[] = {1, 2, 7};
    const struct sg_train_params p = short_params();
    struct fixture first = make_fixture(1);
    struct sg_model *expected = train(&first, &p, 40, NULL, NULL, NULL);
    assert_true(expected->count > first.start->count); /* it did densify */
    for (int i = 1; i < 3; i++) {
        struct fixture f = make_fixture(threads[i]);
        struct sg_model *m = train(&f, &p, 40, NULL, NULL, NULL);
        assert_same(m, expected);
        sg_model_destroy(&m);
        clear_fixture(&f);
    }
    sg_model_destroy(&expected);
    clear_fixture(&first);
}

/* Steps after the last change nothing, also for a longer run that goes on from there. */
static void test_beyond_the_end(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_fixture(2);
    p.iterations = 30;
    struct sg_model *whole = train(&f, &p, 30, NULL, NULL, NULL);
    p.iterations = 17;
    sg_trainer *t = begin_training(&f, &p);
    for (int more = 0; more < 2; more++) {
        if (more)
            t = resume_training(&f, &p, path);
        for (int k = more ? 2 : 21; k > 0; k--)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        sg_trainer_destroy(&t);
        p.iterations = 30;
        struct sg_model *longer = train(&f, &p, 30, NULL, path, NULL);
        assert_same(longer, whole);
        sg_model_destroy(&longer);
        p.iterations = 17;
    }
    /* With fewer iterations than it has done already nothing is idle yet. */
    p.iterations = 30;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 20; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    for (int fewer = 20; fewer >= 9; fewer -= 11) {
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        sg_trainer_destroy(&t);
        p.iterations = fewer;
        t = resume_training(&f, &p, path);
    }
    assert_int_equal(sg_trainer_save(t, path), SG_OK);
    sg_trainer_destroy(&t);
    p.iterations = 30;
    struct sg_model *longer = train(&f, &p, 30, NULL, path, NULL);
    assert_same(longer, whole);
    sg_model_destroy(&whole);
    sg_model_destroy(&longer);
    unlink(path);
    clear_fixture(&f);
}

/* A run that goes on from the file has the bytes of one that was not interrupted. */
static void assert_resumes(struct fixture *f, const struct sg_train_params *p, const char *path)
{
    struct sg_model *whole = train(f, p, 40, path, NULL, NULL);
    struct sg_model *resumed = train(f, p, 40, NULL, path, NULL);
    assert_same(resumed, whole);
    sg_model_destroy(&whole);
    sg_model_destroy(&resumed);
}

/* Numbers of each photo are parameters of a run. */
static void test_numbers_of_photos(void **state)
{
    (void) state;
    struct sg_train_params p = short_params(), other;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_fixture(2);
    float tolerances[VIEWS] = {5, 5}, weights[VIEWS] = {1, 0}, others[VIEWS] = {5, 6};
    sg_trainer *t;
    p.defense.on = true;
    p.tolerances = tolerances, p.defense.view_weights = weights;
    assert_resumes(&f, &p, path);
    for (int k = 0; k < 4; k++) {
        other = p;
        if (k < 2)
            other.tolerances = k ? others : NULL;
        else
            other.defense.view_weights = k == 2 ? others : NULL;
        assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
        assert_null(t);
    }
    unlink(path);
    clear_fixture(&f);
}

static void test_resume(void **state)
{
    (void) state;
    const struct sg_train_params p = short_params();
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_fixture(2);
    assert_resumes(&f, &p, path);

    /* Altered or cut checkpoints are refused and leave the trainer usable. */
    FILE *file = fopen(path, "rb");
    char *data = malloc(1 << 22);
    const size_t size = fread(data, 1, 1 << 22, file);
    fclose(file);
    sg_trainer *t;
    t = begin_training(&f, &p);
    for (int kind = 0; kind < 4; kind++) {
        char *bad = malloc(size);
        memcpy(bad, data, size);
        size_t n = size;
        if (kind == 0)
            bad[size / 2] ^= 1;
        else if (kind == 1)
            n = size / 3;
        else if (kind == 2)
            memset(bad + 8, 0xff, 8); /* the count */
        else
            bad[0] = 'X';
        file = fopen(path, "wb");
        assert_int_equal(fwrite(bad, 1, n, file), n);
        fclose(file);
        free(bad);
        sg_trainer *none;
        assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &p, &none), SG_ERR_INPUT);
        assert_null(none);
        assert_non_null(strstr(sg_last_error(f.ctx), path));
    }
    assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    sg_trainer_destroy(&t);
    free(data);
    unlink(path);
    clear_fixture(&f);
}

/* The variants agree over the first 20 losses, and with what the first release computed. */
static void test_golden_losses(void **state)
{
    (void) state;
    static const double golden[20] = {
        0.149084311, 0.171352502, 0.125135843, 0.213942214, 0.190587816, 0.217004532, 0.160757864,
        0.210872132, 0.114614588, 0.197553805, 0.220949767, 0.164029543, 0.244421249, 0.140668635,
        0.159918372, 0.248571060, 0.202053479, 0.229328267, 0.171610140, 0.225170305};
    struct sg_train_params p = short_params();
    struct fixture f = make_fixture(2);
    const struct cpu_kernels *variants[4];
    for (int v = 0, n = sg_cpu_variants(variants); v <= n; v++) {
        double losses[20];
        if (v < n)
            p.cpu = variants[v]->name;
        else
            p.engine = "ref";
        struct sg_model *m = train(&f, &p, 20, NULL, NULL, losses);
        sg_model_destroy(&m);
        for (int i = 0; i < 20; i++)
            if (fabs(losses[i] - golden[i]) > 5e-4 * golden[i])
                fail_msg("%s: loss %d: found %.9f, expected %.9f", v < n ? p.cpu : "ref", i + 1,
                         losses[i], golden[i]);
    }
    clear_fixture(&f);
}

static void test_loss_falls(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    p.iterations = 200, p.densify_until_iter = 0;
    struct fixture f = make_fixture(2);
    double losses[200], head = 0, tail = 0;
    struct sg_model *m = train(&f, &p, 200, NULL, NULL, losses);
    for (int i = 0; i < 20; i++)
        head += losses[i], tail += losses[180 + i];
    assert_true(tail < 0.4 * head);
    sg_model_destroy(&m);
    clear_fixture(&f);
}

static void test_schedule(void **state)
{
    (void) state;
    const struct sg_train_params p = {SG_TRAIN_DEFAULTS};
    struct sg_train_params white = p;
    white.white_background = true;
    assert_int_equal(sg_active_degree(&p, 0, 999), 0);
    assert_int_equal(sg_active_degree(&p, 0, 1000), 1);
    assert_int_equal(sg_active_degree(&p, 0, 2000), 2);
    assert_int_equal(sg_active_degree(&p, 0, 3000), 3);
    assert_int_equal(sg_active_degree(&p, 0, 30000), 3);
    assert_int_equal(sg_active_degree(&p, 2, 999), 2);
    assert_int_equal(sg_active_degree(&p, 2, 5000), 3);
    int densifications = 0, steps = 0;
    for (int it = 1; it <= 30000; it++) {
        densifications += sg_densifies(&p, it - 1, it);
        steps += it <= 600 && !sg_densifies(&p, it - 1, it);
    }
    assert_int_equal(densifications, 144); /* 600, 700, ..., 14900 */
    assert_int_equal(steps, 599);
    assert_false(sg_densifies(&p, 500 - 1, 500));
    assert_true(sg_densifies(&p, 600 - 1, 600));
    assert_false(sg_densifies(&p, 15000 - 1, 15000));
    assert_false(sg_resets_opacity(&p, 499, 500));
    assert_true(sg_resets_opacity(&white, 499, 500));
    struct sg_train_params other = p; /* that has no resets */
    other.strategy = SG_STRATEGY_MCMC;
    assert_false(sg_resets_opacity(&other, 2999, 3000));
    other.strategy = p.strategy, other.model = SG_MODEL_SCAFFOLD;
    assert_false(sg_resets_opacity(&other, 2999, 3000));
    assert_true(sg_resets_opacity(&p, 2999, 3000) && sg_resets_opacity(&p, 11999, 12000));
    assert_false(sg_resets_opacity(&p, 14999, 15000));
    const struct sg_train_params brief = {SG_TRAIN_DEFAULTS, .iterations = 12000};
    assert_false(sg_resets_opacity(&brief, 11999, 12000));
    assert_true(sg_resets_opacity(&brief, 8999, 9000));
    assert_false(sg_densifies(&brief, 11999, 12000));
    assert_true(sg_densifies(&brief, 11899, 11900));
    struct sg_train_params filtered = brief;
    filtered.defense.on = true;
    assert_false(sg_filters(&filtered, 11999, 12000));
    assert_true(sg_filters(&filtered, 11899, 11900));
    assert_float_equal(sg_position_lr(&p, 0), 1.6e-4, 1e-10);
    assert_float_equal(sg_position_lr(&p, 30000), 1.6e-6, 1e-12);
    assert_float_equal(sg_position_lr(&p, 15000), 1.6e-5, 1e-11);
    assert_float_equal(sg_position_lr(&p, 60000), 1.6e-6, 1e-12);
    int resets = 0; /* in steps over several iterations: white's own, at 500, and four */
    for (int it = 7; it < 30000; it += 7)
        resets += sg_resets_opacity(&white, it - 7, it);
    assert_int_equal(resets, 1 + 4);
    uint32_t order[50];
    bool seen[50] = {false}, moved = false;
    sg_view_order(42, 3, order, 50);
    for (int i = 0; i < 50; i++) {
        assert_false(seen[order[i]]);
        seen[order[i]] = true;
        moved |= order[i] != (uint32_t) i;
    }
    assert_true(moved);
}

/* A number just outside its range is refused by name, and so is what is none; the ends themselves
 * are not. */
static void test_ranges(void **state)
{
    (void) state;
    static const struct {
        const char *name; /* NULL: nothing wrong with it */
        struct sg_train_params p;
    } cases[] = {
        {"iterations", {SG_TRAIN_DEFAULTS, .iterations = 0}},
        {"sh_degree", {SG_TRAIN_DEFAULTS, .sh_degree = 4}},
        {"lambda_dssim", {SG_TRAIN_DEFAULTS, .lambda_dssim = 1.1f}},
        {"tolerance", {SG_TRAIN_DEFAULTS, .tolerance = 256}},
        {"position_lr_init", {SG_TRAIN_DEFAULTS, .position_lr_init = 0}},
        {"position_lr_final", {SG_TRAIN_DEFAULTS, .position_lr_final = 0}},
        {"percent_dense", {SG_TRAIN_DEFAULTS, .percent_dense = NAN}},
        {"densification_interval", {SG_TRAIN_DEFAULTS, .densification_interval = 0}},
        {"opacity_reset_interval", {SG_TRAIN_DEFAULTS, .opacity_reset_interval = 0}},
        {"init_points", {SG_TRAIN_DEFAULTS, .init_points = 3}},
        {"max_gaussians", {SG_TRAIN_DEFAULTS, .max_gaussians = 3}},
        {"max_instances: found 4000000001, expected 1 to 4000000000",
         {SG_TRAIN_DEFAULTS, .max_instances = 4000000001}},
        {NULL, {SG_TRAIN_DEFAULTS, .max_gaussians = 4, .init_points = 4, .lambda_dssim = 1}},
        {"defense.rho", {SG_TRAIN_DEFAULTS, .defense.rho = -0.91}},
        {"defense.rho", {SG_TRAIN_DEFAULTS, .defense.rho = 0.51}},
        {NULL, {SG_TRAIN_DEFAULTS, .defense.rho = -0.9}},
        {NULL, {SG_TRAIN_DEFAULTS, .defense.rho = 0.5}},
        {"defense.frequency", {SG_TRAIN_DEFAULTS, .defense.frequency = 0}},
        {"defense.exponent", {SG_TRAIN_DEFAULTS, .defense.exponent = -1}},
        {"defense.interval", {SG_TRAIN_DEFAULTS, .defense.interval = 0}},
        {"defense.from", {SG_TRAIN_DEFAULTS, .defense.from = -2}},
        {"defense.anisotropy_scale", {SG_TRAIN_DEFAULTS, .defense.anisotropy_scale = NAN}},
        {"defense.tv_scale", {SG_TRAIN_DEFAULTS, .defense.tv_scale = -1}},
        {"defense.spectrum.band.high", {SG_TRAIN_DEFAULTS, .defense.spectrum.band.high = 1.01}},
        {NULL,
         {SG_TRAIN_DEFAULTS, .defense.spectrum.band.high = 1, .defense.spectrum.band.low = 1}},
    };
    sg_ctx *ctx = make_context(1);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const char *name = cases[i].name;
        const int code = sg_train_check(ctx, &cases[i].p);
        if (code != (name ? SG_ERR_USAGE : SG_OK) || (name && !strstr(sg_last_error(ctx), name)))
            fail_msg("case %zu, %s: %d, %s", i, name ? name : "good", code, sg_last_error(ctx));
    }
    sg_ctx_destroy(&ctx);
}

/* Adam's step counters: none moves when a densification replaces the parameters, opacity stands
 * still at a reset. */
static void test_adam_steps(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    p.white_background = true; /* resets at densify_from_iter too, which does not densify */
    struct fixture f = make_fixture(1);
    sg_trainer *t;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 40; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    /* 40 - densifications at 10, 15, ..., 30 - the last iteration */
    assert_int_equal(t->adam_steps[SG_G_XYZ], 40 - 5 - 1);
    assert_int_equal(t->adam_steps[SG_G_OPACITY], 40 - 5 - 1 - 1);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Black, white, or at each iteration a colour of its own; what is rendered of the model is never on
 * a random one. */
static void test_background(void **state)
{
    (void) state;
    enum { PIXELS = SIDE * SIDE };
    static float planes[3 * PIXELS], rgb[3 * PIXELS];
    struct fixture f = make_fixture(1);
    for (size_t i = 0; i < f.start->count; i++) /* out of sight */
        *sg_model_at(f.start, i, SG_P_XYZ + 2) = -50;
    for (int kind = 0; kind < 3; kind++) {
        struct sg_train_params p = short_params();
        p.white_background = kind == 1, p.random_background = kind == 2;
        sg_renderer *r;
        sg_trainer *t = begin_training(&f, &p);
        float before = -1;
        for (int it = 1; it <= 3; it++) {
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
            assert_int_equal(sg_engine_read_image(t->engine, planes, NULL, NULL), SG_OK);
            const float red = planes[0], green = planes[PIXELS], blue = planes[2 * PIXELS];
            if (kind == 2)
                assert_true(red != green && green != blue && red != before && red > 0 && red < 1);
            else
                assert_true(red == (float) kind && green == red && blue == red);
            before = red;
        }
        assert_int_equal(sg_trainer_renderer(t, &r), SG_OK);
        assert_int_equal(sg_render(r, &f.views[0].camera, rgb, NULL, NULL, NULL), SG_OK);
        for (int i = 0; i < 3 * PIXELS; i++)
            assert_true(rgb[i] == (kind == 1));
        sg_renderer_destroy(&r);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* Two trainings on photos that differ where a mask leaves them out. */
static void check_masked(const struct sg_train_params *p)
{
    struct fixture f = make_fixture(1);
    struct sg_model *trained[2];
    uint8_t mask[SIDE * SIDE];
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < SIDE * SIDE; i++) {
            mask[i] = i % SIDE < SIDE / 2 ? 255 : 0;
            for (int v = 0; v < VIEWS && !mask[i]; v++)
                memset(f.views[v].rgb + 3 * i, k ? 255 : 0, 3);
        }
        for (int v = 0; v < VIEWS; v++)
            f.views[v].mask = mask;
        trained[k] = train(&f, p, 12, NULL, NULL, NULL);
    }
    assert_same(trained[0], trained[1]);
    for (int k = 0; k < 2; k++)
        sg_model_destroy(&trained[k]);
    clear_fixture(&f);
}

/* What a mask leaves out of a photo has no influence, whatever is trained; photos of which nothing
 * is left are none. */
static void test_masks(void **state)
{
    (void) state;
    for (int variant = 0; variant < 5; variant++) {
        struct sg_train_params p = short_params();
        p.model = variant == 1 ? SG_MODEL_MIP : SG_MODEL_3DGS;
        p.strategy = variant == 2 ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
        p.absgrad = variant == 3, p.exposure = variant == 4;
        check_masked(&p);
    }
    struct fixture f = make_fixture(1);
    const struct sg_train_params p = short_params();
    uint8_t mask[SIDE * SIDE] = {0};
    sg_trainer *t;
    f.scene.train = f.views;
    for (int v = 0; v < VIEWS; v++)
        f.views[v].mask = mask;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f.ctx), "masks leave nothing"));
    clear_fixture(&f);
}

/* Larger than a tenth of the extent is too large, once opacities have been reset. */
static void test_too_large(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    struct sg_train_step s;
    p.densify_grad_threshold = 1e9f, p.opacity_reset_interval = 10, p.opacity_lr = 0,
    p.scaling_lr = 0;
    for (size_t i = 0; i < f.start->count; i++) { /* every other one, where the extent is 2 */
        for (int k = 0; k < 3; k++)
            *sg_model_at(f.start, i, SG_P_SCALE + k) = logf(i % 2 ? 0.15f : 0.4f);
        *sg_model_at(f.start, i, SG_P_OPACITY) = 3;
    }
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= 15; it++) { /* densifies at 10 too */
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.pruned, it == 15 ? f.start->count / 2 : 0);
    }
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Cameras at one place have no extent that rates could scale with: positions move all the same. */
static void test_no_extent(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    const struct sg_train_params p = short_params();
    float most = 0;
    f.scene.extent = 0;
    struct sg_model *m = train(&f, &p, 1, NULL, NULL, NULL);
    for (size_t i = 0; i < m->count; i++)
        most =
            fmaxf(most, fabsf(*sg_model_at(m, i, SG_P_XYZ) - *sg_model_at(f.start, i, SG_P_XYZ)));
    assert_true(most > 1e-6f && most < 1);
    sg_model_destroy(&m);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_schedule),       cmocka_unit_test(test_ranges),
        cmocka_unit_test(test_adam_steps),     cmocka_unit_test(test_threads),
        cmocka_unit_test(test_beyond_the_end), cmocka_unit_test(test_numbers_of_photos),
        cmocka_unit_test(test_resume),         cmocka_unit_test(test_loss_falls),
        cmocka_unit_test(test_golden_losses),  cmocka_unit_test(test_background),
        cmocka_unit_test(test_masks),          cmocka_unit_test(test_too_large),
        cmocka_unit_test(test_no_extent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
