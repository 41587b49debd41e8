/* SPDX-License-Identifier: Apache-2.0 */
/* Variants of training repeat: the same bytes for any number of threads and after a checkpoint,
 * which a run without the variant refuses. */
#include <unistd.h>

#include "engine/host/exposure.h"
#include "train/exposure.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

/* others: runs that refuse the checkpoint. */
static void assert_repeats(const struct sg_train_params *p, const struct sg_train_params *others,
                           int n_others)
{
    char path[] = "/tmp/sg_variant_XXXXXX";
    const int runs = getenv("SG_TEST_ENGINE") ? 1 : 2; /* a device has its own threads */
    struct fixture fixtures[2];
    struct sg_train_params own = *p;
    struct sg_model *expected = NULL, *found;
    sg_trainer *t;
    own.engine = main_engine();
    close(mkstemp(path));
    for (int k = 0; k < runs; k++) {
        fixtures[k] = make_fixture(k ? 4 : 1);
        for (size_t i = 0; i < 9; i++) /* transparent: pruned or relocated */
            *sg_model_at(fixtures[k].start, 7 * i, SG_P_OPACITY) = -9;
        found = train(&fixtures[k], &own, 40, path, NULL, NULL);
        if (k) {
            assert_same(found, expected);
            sg_model_destroy(&found);
        } else
            expected = found;
        found = train(&fixtures[k], &own, 40, NULL, path, NULL);
        assert_same(found, expected);
        sg_model_destroy(&found);
    }
    for (int k = 0; k < n_others; k++) {
        assert_int_equal(
            sg_trainer_resume(fixtures[0].ctx, &fixtures[0].scene, path, &others[k], &t),
            SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(fixtures[0].ctx), path));
        sg_clear_error(fixtures[0].ctx);
    }
    unlink(path);
    sg_model_destroy(&expected);
    for (int k = 0; k < runs; k++)
        clear_fixture(&fixtures[k]);
}

/* A run that has ended and goes on is one that was longer from the beginning: ends with and without
 * what is due in the last iteration, the first iteration among them. */
static void assert_extends(const struct sg_train_params *p)
{
    static const int ends[] = {1, 10, 20, 23, 30, 39};
    char path[] = "/tmp/sg_variant_XXXXXX";
    struct fixture f = make_fixture(2);
    struct sg_train_params own = *p, shorter;
    own.engine = main_engine();
    close(mkstemp(path));
    for (size_t i = 0; i < 9; i++)
        *sg_model_at(f.start, 7 * i, SG_P_OPACITY) = -9;
    struct sg_model *expected = train(&f, &own, 40, NULL, NULL, NULL), *found;
    for (size_t k = 0; k < sizeof(ends) / sizeof(ends[0]); k++) {
        shorter = own;
        shorter.iterations = ends[k];
        sg_trainer *t = begin_training(&f, &shorter);
        while (sg_trainer_iteration(t) < ends[k])
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        sg_trainer_destroy(&t);
        t = resume_training(&f, &shorter, path); /* all is done */
        assert_int_equal(sg_trainer_iteration(t), ends[k]);
        sg_trainer_destroy(&t);
        found = train(&f, &own, 40, NULL, path, NULL);
        assert_same(found, expected);
        sg_model_destroy(&found);
    }
    unlink(path);
    sg_model_destroy(&expected);
    clear_fixture(&f);
}

static void test_longer(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    assert_extends(&p);
    p.defense.on = true;
    p.defense.interval = 10;
    assert_extends(&p);
    p = short_params();
    p.at_limit = SG_AT_LIMIT_UNIVERSAL;
    p.max_gaussians = 150;
    assert_extends(&p);
    p = short_params();
    p.model = SG_MODEL_MIP;
    assert_extends(&p);
    p = short_params();
    p.strategy = SG_STRATEGY_MCMC;
    p.mcmc.until = 35;
    p.mcmc.cap_max = 140;
    assert_extends(&p);
}

/* More grows by absolute gradients than by those that cancel. */
static void test_absgrad(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    const struct sg_train_params other = p;
    size_t grown[2] = {0};
    p.densify_grad_threshold = 0.0005f;
    for (int k = 0; k < 2; k++) {
        struct fixture f = make_fixture(2);
        p.absgrad = k;
        sg_trainer *t = begin_training(&f, &p);
        for (int it = 1; it <= 10; it++) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            grown[k] += s.cloned + s.split;
        }
        sg_trainer_destroy(&t);
        clear_fixture(&f);
    }
    assert_true(grown[1] > grown[0]);
    p = other;
    p.absgrad = true;
    assert_repeats(&p, &other, 1);
}

static void test_mcmc(void **state)
{
    (void) state;
    struct sg_train_params p = short_params(), others[2] = {p};
    p.strategy = SG_STRATEGY_MCMC;
    p.mcmc.until = 30;
    p.mcmc.cap_max = 140;
    others[1] = p;
    others[1].mcmc.opacity_reg = 0.02f;
    assert_repeats(&p, others, 2);
}

static void test_mip(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    const struct sg_train_params other = p;
    p.model = SG_MODEL_MIP;
    assert_repeats(&p, &other, 1);
}

/* A photo that is darker than the others is explained by its exposure, not by the model. */
static void test_exposure(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    const struct sg_train_params other = p;
    sg_trainer *t;
    p.exposure = true;
    p.iterations = 120, p.densify_until_iter = 0;
    for (size_t i = 0; i < 3 * SIDE * SIDE; i++)
        f.views[2].rgb[i] = (uint8_t) (0.7 * f.views[2].rgb[i]);
    f.scene.train = f.views;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.truth, &p, &t), SG_OK);
    const float *e;
    assert_int_equal(sg_trainer_exposures(t, &e), SG_OK);
    for (int k = 0; k < SG_EXPOSURE; k++)
        assert_true(e[2 * SG_EXPOSURE + k] == (k % 5 == 0 ? 1 : 0));
    while (sg_trainer_iteration(t) < 120)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_exposures(t, &e), SG_OK);
    for (size_t view = 0; view < VIEWS; view++)
        for (int c = 0; c < 3; c++) {
            const float scale = e[view * SG_EXPOSURE + (size_t) (5 * c)];
            assert_true(view == 2 ? scale < 0.92f : scale > 0.95f);
        }
    sg_trainer_destroy(&t);
    clear_fixture(&f);

    p = other;
    p.exposure = true;
    assert_repeats(&p, &other, 1);
}

/* A checkpoint's exposures must be numbers. */
static void test_exposure_checkpoint(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_variant_XXXXXX";
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    p.exposure = true;
    p.engine = "cpu"; /* whose exposures are the host's */
    close(mkstemp(path));
    sg_trainer *t = begin_training(&f, &p);
    t->exposures[SG_EXPOSURE + 3] = NAN;
    assert_int_equal(sg_trainer_save(t, path), SG_OK);
    sg_trainer_destroy(&t);
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &p, &t), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f.ctx), "section \"exposure\": found value 15 of nan"));
    unlink(path);
    clear_fixture(&f);
}

/* Steps of Adam with rates from 0.01 to 0.001, of all photos: those of others by momentum. */
static void test_exposure_steps(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_train_params p = short_params();
    float *e;
    double gradient[SG_EXPOSURE] = {0};
    assert_true(fabs(sg_exposure_lr(&p, 0) - 0.01) < 1e-9);
    assert_true(fabs(sg_exposure_lr(&p, 20) - 0.01 / sqrt(10)) < 1e-8);
    assert_true(fabs(sg_exposure_lr(&p, 40) - 0.001) < 1e-9);
    assert_int_equal(sg_exposures_create(ctx, 2, &e), SG_OK);
    gradient[0] = 2, gradient[7] = -3;
    struct sg_exposure_update update = sg_exposures_update(&p, 0, 1);
    sg_host_learn_exposures(e, 2, 1, gradient, &update);
    for (int k = 0; k < 2 * SG_EXPOSURE; k++) {
        const double start = k % SG_EXPOSURE % 5 == 0, moved = k == SG_EXPOSURE       ? -0.01
                                                               : k == SG_EXPOSURE + 7 ? 0.01
                                                                                      : 0;
        assert_true(fabs((double) e[k] - start - moved) < 1e-7);
    }
    memset(gradient, 0, sizeof(gradient));
    update = sg_exposures_update(&p, 0, 2);
    sg_host_learn_exposures(e, 2, 0, gradient, &update); /* the other photo: m 0.18, v 0.003996 */
    const double m = 0.9 * 0.2 / (1 - 0.81), v = 0.999 * 0.004 / (1 - 0.999 * 0.999);
    assert_true(fabs((double) e[SG_EXPOSURE] - (0.99 - 0.01 * m / sqrt(v))) < 1e-6);
    assert_true(e[0] == 1);
    sg_free(e);
    sg_ctx_destroy(&ctx);
}

/* Trains with masks on photos whose left-out half has this grey. exposures: those learned. */
static struct sg_model *train_masked(struct fixture *f, const struct sg_train_params *p, int grey,
                                     double losses[12], float exposures[VIEWS * SG_EXPOSURE])
{
    static uint8_t mask[SIDE * SIDE];
    struct sg_train_step step;
    struct sg_model *m;
    const float *e;
    for (int i = 0; i < SIDE * SIDE; i++) {
        mask[i] = i % SIDE < SIDE / 2 ? 255 : 0;
        for (int v = 0; v < VIEWS && !mask[i]; v++)
            memset(f->views[v].rgb + 3 * i, grey, 3);
    }
    for (int v = 0; v < VIEWS; v++)
        f->views[v].mask = mask;
    sg_trainer *t = begin_training(f, p);
    for (int it = 1; it <= 12; it++) {
        if (sg_trainer_step(t, &step))
            fail_msg("%s", sg_last_error(f->ctx));
        losses[it - 1] = step.loss;
    }
    assert_int_equal(sg_trainer_exposures(t, &e), SG_OK);
    if (p->exposure)
        memcpy(exposures, e, VIEWS * SG_EXPOSURE * sizeof(*e));
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    sg_trainer_destroy(&t);
    return m;
}

/* What a mask leaves out of a photo has no influence, on any engine. */
static void test_masks(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    for (int variant = 0; variant < 4; variant++)
        for (int c = 0; c < n; c++) {
            struct fixture f = make_fixture(2);
            struct sg_train_params p = short_params();
            struct sg_model *m[2];
            double losses[2][12];
            float exposures[2][VIEWS * SG_EXPOSURE] = {0};
            p.engine = cases[c].engine, p.cpu = cases[c].variant;
            p.model = variant == 1 ? SG_MODEL_MIP : SG_MODEL_3DGS;
            p.strategy = variant == 2 ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
            p.exposure = variant == 3;
            for (int k = 0; k < 2; k++)
                m[k] = train_masked(&f, &p, k ? 255 : 0, losses[k], exposures[k]);
            assert_same(m[0], m[1]);
            assert_true(m[0]->count > f.start->count); /* it did grow */
            assert_memory_equal(losses[0], losses[1], sizeof(losses[0]));
            assert_memory_equal(exposures[0], exposures[1], sizeof(exposures[0]));
            assert_true(!p.exposure || (exposures[0][1] != 0 && exposures[0][0] != 1));
            sg_model_destroy(&m[0]);
            sg_model_destroy(&m[1]);
            clear_fixture(&f);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_longer),         cmocka_unit_test(test_absgrad),
        cmocka_unit_test(test_mcmc),           cmocka_unit_test(test_mip),
        cmocka_unit_test(test_exposure),       cmocka_unit_test(test_exposure_checkpoint),
        cmocka_unit_test(test_exposure_steps), cmocka_unit_test(test_masks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
