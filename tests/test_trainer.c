/* SPDX-License-Identifier: Apache-2.0 */
/* Schedule, determinism and checkpoints. */
#include <unistd.h>

#include "backend/backend.h"
#include "backend/cpu/dispatch.h"
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
    assert_true(sg_resets_opacity(&p, 2999, 3000) && sg_resets_opacity(&p, 11999, 12000));
    assert_false(sg_resets_opacity(&p, 14999, 15000));
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
    t = begin_training(&f, &p);
    for (int it = 1; it <= 40; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    /* 40 - densifications at 10, 15, ..., 30 - the last iteration */
    assert_int_equal(t->adam_steps[SG_G_XYZ], 40 - 5 - 1);
    assert_int_equal(t->adam_steps[SG_G_OPACITY], 40 - 5 - 1 - 1);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_schedule), cmocka_unit_test(test_adam_steps), cmocka_unit_test(test_threads),
        cmocka_unit_test(test_resume),   cmocka_unit_test(test_loss_falls), cmocka_unit_test(test_golden_losses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
