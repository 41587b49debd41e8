/* SPDX-License-Identifier: Apache-2.0 */
/* Schedule, densification, determinism and checkpoints. */
#include <unistd.h>

#include "backend/backend.h"
#include "backend/cpu/dispatch.h"
#include "math/constants.h"
#include "models.h"
#include "train/densify.h"
#include "train/schedule.h"
#include "train/trainer.h"

#define SIDE 48
#define VIEWS 6

/* Photos of a known model, rendered by the oracle; the trainer starts from its shaken copy. */
struct fixture {
    sg_ctx *ctx;
    struct sg_scene scene;
    struct sg_view views[VIEWS];
    struct sg_model *truth, *start;
};

static struct fixture make_fixture(int threads)
{
    struct fixture f = {.ctx = make_context(threads)};
    f.truth = make_model(f.ctx, 120, 1, 21);
    sg_renderer *r;
    assert_int_equal(sg_renderer_create(f.ctx, "ref", NULL, f.truth, NULL, &r), SG_OK);
    float *rgb = malloc(3 * SIDE * SIDE * sizeof(float));
    for (int i = 0; i < VIEWS; i++) {
        struct sg_view *v = &f.views[i];
        v->name = (char *) "view";
        v->camera = make_camera(SIDE, SIDE, 2.6 + 0.2 * i);
        v->camera.t[0] += 0.15 * (i - 2);
        v->rgb = malloc(3 * SIDE * SIDE);
        assert_int_equal(sg_render(r, &v->camera, rgb, NULL, NULL, NULL), SG_OK);
        sg_quantise(rgb, SIDE, SIDE, v->rgb);
    }
    free(rgb);
    sg_renderer_destroy(&r);
    f.scene = (struct sg_scene){.path = (char *) "fixture", .train = NULL, .n_train = VIEWS, .extent = 2};
    assert_int_equal(sg_model_create(f.ctx, f.truth->count, 1, &f.start), SG_OK);
    f.start->active_sh_degree = 0;
    memcpy(f.start->params, f.truth->params, f.truth->capacity * (size_t) sg_param_count(1) * sizeof(float));
    for (size_t i = 0; i < f.start->count; i++)
        for (int p = 0; p < SG_P_SH + 3; p++)
            *sg_model_at(f.start, i, p) += draw(4, i * 64 + (size_t) p, -0.15f, 0.15f);
    return f;
}

static void clear_fixture(struct fixture *f)
{
    for (int i = 0; i < VIEWS; i++)
        free(f->views[i].rgb);
    sg_model_destroy(f->ctx, &f->truth);
    sg_model_destroy(f->ctx, &f->start);
    sg_ctx_destroy(&f->ctx);
}

/* Densifies from iteration 10 on, resets at 20, ends at 40. */
static struct sg_train_params short_params(void)
{
    return (struct sg_train_params){SG_TRAIN_DEFAULTS,
                                    .iterations = 40,
                                    .sh_interval = 8,
                                    .densify_from_iter = 5,
                                    .densification_interval = 5,
                                    .densify_until_iter = 35,
                                    .opacity_reset_interval = 20,
                                    .densify_grad_threshold = 0.0001f};
}

static struct sg_model *train(struct fixture *f, const struct sg_train_params *p, int iterations,
                              const char *save_at_20, const char *load, double *losses)
{
    sg_trainer *t;
    struct sg_model *m;
    f->scene.train = f->views;
    assert_int_equal(sg_trainer_create(f->ctx, &f->scene, f->start, p, &t), SG_OK);
    if (load)
        assert_int_equal(sg_trainer_load(t, load), SG_OK);
    while (sg_trainer_iteration(t) < iterations) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.gaussians, sg_trainer_gaussians(t));
        if (losses)
            losses[s.iteration - 1] = s.loss;
        if (save_at_20 && s.iteration == 20)
            assert_int_equal(sg_trainer_save(t, save_at_20), SG_OK);
    }
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    sg_trainer_destroy(&t);
    return m;
}

static void assert_same(const struct sg_model *a, const struct sg_model *b)
{
    assert_int_equal(a->count, b->count);
    for (size_t i = 0; i < a->count; i++)
        for (int p = 0; p < sg_param_count(a->sh_degree); p++)
            assert_memory_equal(sg_model_at(a, i, p), sg_model_at(b, i, p), sizeof(float));
}

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
        sg_model_destroy(f.ctx, &m);
        clear_fixture(&f);
    }
    sg_model_destroy(first.ctx, &expected);
    clear_fixture(&first);
}

static void test_resume(void **state)
{
    (void) state;
    const struct sg_train_params p = short_params();
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_fixture(2);
    struct sg_model *whole = train(&f, &p, 40, path, NULL, NULL);
    struct sg_model *resumed = train(&f, &p, 40, NULL, path, NULL);
    assert_same(resumed, whole);
    sg_model_destroy(f.ctx, &whole);
    sg_model_destroy(f.ctx, &resumed);

    /* Altered or cut checkpoints are refused and leave the trainer usable. */
    FILE *file = fopen(path, "rb");
    char *data = malloc(1 << 22);
    const size_t size = fread(data, 1, 1 << 22, file);
    fclose(file);
    sg_trainer *t;
    f.scene.train = f.views;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_OK);
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
        assert_int_equal(sg_trainer_load(t, path), SG_ERR_INPUT);
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
    static const double golden[20] = {0.149084311, 0.171352502, 0.125135843, 0.213942214, 0.190587816,
                                      0.217004532, 0.160757864, 0.210872132, 0.114614588, 0.197553805,
                                      0.220949767, 0.164029543, 0.244421249, 0.140668635, 0.159918372,
                                      0.248571060, 0.202053479, 0.229328267, 0.171610140, 0.225170305};
    struct sg_train_params p = short_params();
    struct fixture f = make_fixture(2);
    const struct cpu_kernels *variants[4];
    for (int v = 0, n = sg_cpu_variants(variants); v <= n; v++) {
        double losses[20];
        if (v < n)
            p.cpu = variants[v]->name;
        else
            p.backend = "ref";
        struct sg_model *m = train(&f, &p, 20, NULL, NULL, losses);
        sg_model_destroy(f.ctx, &m);
        for (int i = 0; i < 20; i++)
            if (fabs(losses[i] - golden[i]) > 5e-4 * golden[i])
                fail_msg("%s: loss %d: found %.9f, expected %.9f", v < n ? p.cpu : "ref", i + 1, losses[i], golden[i]);
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
    sg_model_destroy(f.ctx, &m);
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
        densifications += sg_densifies(&p, it);
        steps += it <= 600 && !sg_densifies(&p, it);
    }
    assert_int_equal(densifications, 144); /* 600, 700, ..., 14900 */
    assert_int_equal(steps, 599);
    assert_false(sg_densifies(&p, 500));
    assert_true(sg_densifies(&p, 600));
    assert_false(sg_densifies(&p, 15000));
    assert_false(sg_resets_opacity(&p, 500));
    assert_true(sg_resets_opacity(&white, 500));
    assert_true(sg_resets_opacity(&p, 3000) && sg_resets_opacity(&p, 12000));
    assert_false(sg_resets_opacity(&p, 15000));
    assert_float_equal(sg_position_lr(&p, 0), 1.6e-4, 1e-10);
    assert_float_equal(sg_position_lr(&p, 30000), 1.6e-6, 1e-12);
    assert_float_equal(sg_position_lr(&p, 15000), 1.6e-5, 1e-11);
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

/* Adam's step counters: none moves when a densification replaces the parameters, opacity stands still at a reset. */
static void test_adam_steps(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    p.white_background = true; /* resets at densify_from_iter too, which does not densify */
    struct fixture f = make_fixture(1);
    sg_trainer *t;
    f.scene.train = f.views;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_OK);
    for (int it = 1; it <= 40; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    /* 40 - densifications at 10, 15, ..., 30 - the last iteration */
    assert_int_equal(t->adam_steps[SG_G_XYZ], 40 - 5 - 1);
    assert_int_equal(t->adam_steps[SG_G_OPACITY], 40 - 5 - 1 - 1);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Six Gaussians, each a case of the rules. */
static void test_densify(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m, *after;
    struct sg_optimiser o;
    struct sg_backend *b;
    const float tau = 0.0002f, limit = 0.0625f; /* a scale whose logarithm is exact enough to come back */
    assert_int_equal(sg_model_create(ctx, 6, 0, &m), SG_OK);
    assert_int_equal(sg_optimiser_create(ctx, 6, 0, &o), SG_OK);
    assert_int_equal(sg_backend_create(ctx, "cpu", NULL, &b), SG_OK);
    /* 0 clones (gradient exactly tau), 1 stays (just below), 2 splits, 3 is too transparent, 4 too large, 5 clones but
     * dies */
    const float gradient[] = {tau, 0.00019999f, 0.001f, 0, 0, 0.01f};
    const float scale[] = {0.01f, 0.01f, 0.5f, 0.01f, 3.0f, 0.01f};
    const float opacity[] = {0.5f, 0.5f, 0.9f, 0.001f, 0.5f, 0.004f};
    for (size_t i = 0; i < 6; i++) {
        o.grad_sum[i] = 2 * gradient[i], o.grad_count[i] = 2;
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_SCALE + k) = logf(scale[i]);
        *sg_model_at(m, i, SG_P_XYZ) = (float) i;
        *sg_model_at(m, i, SG_P_ROT) = 1;
        *sg_model_at(m, i, SG_P_OPACITY) = logf(opacity[i] / (1 - opacity[i]));
        o.m[sg_param_index(sg_param_count(0), i, 0)] = 7;
    }
    assert_int_equal(b->ops->upload(b, m, &o), SG_OK);
    struct sg_densify_result r;
    struct sg_densify_params p = {.gradient = tau, .split_scale = limit, .prune_scale = 1, .seed = 1, .stream = 600};
    assert_int_equal(sg_densify(b, &p, &r), SG_OK);
    assert_int_equal(r.cloned, 2);
    assert_int_equal(r.split, 1);
    assert_int_equal(r.pruned, 4); /* 3, 4, 5 and 5's clone */
    assert_int_equal(b->ops->count(b), 5);
    struct sg_optimiser moments;
    assert_int_equal(sg_model_create(ctx, 5, 0, &after), SG_OK);
    assert_int_equal(sg_optimiser_create(ctx, 5, 0, &moments), SG_OK);
    assert_int_equal(b->ops->download(b, after, &moments), SG_OK);
    /* survivors 0, 1; the clone of 0; two children of 2 */
    assert_float_equal(*sg_model_at(after, 0, 0), 0, 0);
    assert_float_equal(*sg_model_at(after, 1, 0), 1, 0);
    assert_float_equal(*sg_model_at(after, 2, 0), 0, 0);
    for (size_t i = 3; i < 5; i++) {
        assert_float_equal(*sg_model_at(after, i, SG_P_SCALE), logf(0.5f / SG_SPLIT_SHRINK), 1e-5);
        assert_true(fabsf(*sg_model_at(after, i, 0) - 2) < 2.5f && *sg_model_at(after, i, 0) != 2);
    }
    assert_true(*sg_model_at(after, 3, 0) != *sg_model_at(after, 4, 0));
    for (size_t i = 0; i < 5; i++) {
        assert_float_equal(moments.m[sg_param_index(sg_param_count(0), i, 0)], i < 2 ? 7 : 0, 0);
        assert_float_equal(moments.grad_count[i], 0, 0);
    }
    sg_backend_destroy(&b);
    sg_optimiser_clear(ctx, &o);
    sg_optimiser_clear(ctx, &moments);
    sg_model_destroy(ctx, &m);
    sg_model_destroy(ctx, &after);
    sg_ctx_destroy(&ctx);
}

/* Exactly at percent_dense x extent a Gaussian is cloned; at the limit of Gaussians nothing grows. */
static void test_densify_limits(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m;
    struct sg_optimiser o;
    struct sg_backend *b;
    assert_int_equal(sg_model_create(ctx, 3, 0, &m), SG_OK);
    assert_int_equal(sg_optimiser_create(ctx, 3, 0, &o), SG_OK);
    assert_int_equal(sg_backend_create(ctx, "ref", NULL, &b), SG_OK);
    for (size_t i = 0; i < 3; i++) {
        o.grad_sum[i] = 1, o.grad_count[i] = 1; /* scale log 0: exactly 1 */
        *sg_model_at(m, i, SG_P_ROT) = 1;
    }
    assert_int_equal(b->ops->upload(b, m, &o), SG_OK);
    struct sg_densify_result r;
    struct sg_densify_params p = {.gradient = 0.5f, .split_scale = 1, .max_gaussians = 4, .seed = 1};
    assert_int_equal(sg_densify(b, &p, &r), SG_OK);
    assert_int_equal(r.cloned, 1);
    assert_int_equal(r.split, 0);
    assert_int_equal(b->ops->count(b), 4);
    sg_backend_destroy(&b);
    sg_optimiser_clear(ctx, &o);
    sg_model_destroy(ctx, &m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_schedule),       cmocka_unit_test(test_adam_steps),    cmocka_unit_test(test_densify),
        cmocka_unit_test(test_densify_limits), cmocka_unit_test(test_threads),       cmocka_unit_test(test_resume),
        cmocka_unit_test(test_loss_falls),     cmocka_unit_test(test_golden_losses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
