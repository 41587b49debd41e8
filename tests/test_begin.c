/* SPDX-License-Identifier: Apache-2.0 */
/* The first model of a run: from points, a model or a checkpoint, thinned out to its limit. */
#include <unistd.h>

#include "math/constants.h"
#include "train/begin.h"
#include "training.h"

/* Points are taken evenly from all over the scene, each with its own colour. */
static void test_points(void **state)
{
    (void) state;
    enum { N = 100, LEFT = 40 };
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    struct sg_model *m;
    sg_trainer *t;
    float points[3 * N];
    uint8_t colors[3 * N];
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 3; k++)
            points[3 * i + k] = k ? (float) (i * i % 17) : (float) i,
                           colors[3 * i + k] = (uint8_t) (2 * i);
    f.scene.points = points, f.scene.point_colors = colors, f.scene.n_points = N,
    f.scene.train = f.views;
    p.max_gaussians = LEFT;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_OK);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    assert_int_equal(m->count, LEFT);
    for (size_t k = 0; k < LEFT; k++) {
        const size_t i = k * N / LEFT;
        assert_true(*sg_model_at(m, k, SG_P_XYZ) == (float) i);
        assert_float_equal(*sg_model_at(m, k, SG_P_SH),
                           ((float) colors[3 * i] / 255 - 0.5f) / SG_SH_C0, 1e-4);
    }
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* The same for a model, with all its parameters and its SH degree. A model with a value that is not
 * finite is refused. */
static void test_model(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    struct sg_model *m;
    sg_trainer *t;
    f.start->active_sh_degree = 1;
    p.max_gaussians = 50;
    t = begin_training(&f, &p);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    assert_int_equal(m->count, 50);
    assert_int_equal(m->active_sh_degree, 1);
    for (size_t k = 0; k < m->count; k++)
        for (int i = 0; i < sg_param_count(1); i++)
            assert_true(*sg_model_at(m, k, i) == *sg_model_at(f.start, k * f.start->count / 50, i));
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    *sg_model_at(f.start, 7, SG_P_OPACITY) = NAN;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f.ctx), "Gaussian 7"));
    clear_fixture(&f);
}

/* What a lower degree does not learn is not in the model: renderers would draw it. */
static void test_degree(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    f.start->active_sh_degree = 1;
    p.sh_degree = 0;
    for (size_t limit = 0; limit <= 50; limit += 50) {
        struct sg_model *m;
        p.max_gaussians = limit;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_model(t, &m), SG_OK);
        const size_t n = f.start->count, left = limit ? limit : n;
        assert_int_equal(m->count, left);
        assert_int_equal(m->sh_degree, 0);
        assert_int_equal(m->active_sh_degree, 0);
        for (size_t k = 0; k < left; k++)
            for (int i = 0; i < sg_param_count(0); i++)
                assert_true(*sg_model_at(m, k, i) == *sg_model_at(f.start, k * n / left, i));
        sg_model_destroy(&m);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* The number that memory allows varies from run to run. A checkpoint slightly above it continues
 * whole; one above the user's own limit is thinned out. */
static void test_checkpoint_above_limit(void **state)
{
    (void) state;
    static const struct {
        size_t limit, left;
    } cases[] = {{119, 120}, {117, 120}, {110, 110}};
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    sg_trainer *t = begin_training(&f, &p);
    assert_int_equal(sg_trainer_gaussians(t), 120);
    assert_int_equal(sg_trainer_save(t, path), SG_OK);
    sg_trainer_destroy(&t);
    p.max_gaussians = 119;
    t = resume_training(&f, &p, path);
    assert_int_equal(sg_trainer_gaussians(t), 119);
    for (int k = 0; k < 3; k++) {
        t->budget = (struct sg_budget){.gaussians = cases[k].limit, .by_memory = true};
        assert_int_equal(sg_trainer_fit_count(t, 120), cases[k].left);
        assert_int_equal(t->budget.gaussians, cases[k].left);
    }
    sg_trainer_destroy(&t);
    unlink(path);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_points), cmocka_unit_test(test_model),
                                       cmocka_unit_test(test_degree),
                                       cmocka_unit_test(test_checkpoint_above_limit)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
