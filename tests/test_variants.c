/* SPDX-License-Identifier: Apache-2.0 */
/* Variants of training repeat: the same bytes for any number of threads and after a checkpoint,
 * which a run without the variant refuses. */
#include <unistd.h>

#include "training.h"

static void assert_repeats(const struct sg_train_params *p, const struct sg_train_params *other)
{
    char path[] = "/tmp/sg_variant_XXXXXX";
    struct fixture fixtures[2];
    struct sg_model *expected = NULL, *found;
    sg_trainer *t;
    close(mkstemp(path));
    for (int k = 0; k < 2; k++) {
        fixtures[k] = make_fixture(k ? 4 : 1);
        for (size_t i = 0; i < 9; i++) /* transparent: pruned or relocated */
            *sg_model_at(fixtures[k].start, 7 * i, SG_P_OPACITY) = -9;
        found = train(&fixtures[k], p, 40, path, NULL, NULL);
        if (k) {
            assert_same(found, expected);
            sg_model_destroy(&found);
        } else
            expected = found;
        found = train(&fixtures[k], p, 40, NULL, path, NULL);
        assert_same(found, expected);
        sg_model_destroy(&found);
    }
    assert_int_equal(sg_trainer_resume(fixtures[0].ctx, &fixtures[0].scene, path, other, &t),
                     SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(fixtures[0].ctx), path));
    unlink(path);
    sg_model_destroy(&expected);
    clear_fixture(&fixtures[0]);
    clear_fixture(&fixtures[1]);
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
    assert_repeats(&p, &other);
}

static void test_mcmc(void **state)
{
    (void) state;
    struct sg_train_params p = short_params(), other = p;
    p.strategy = SG_STRATEGY_MCMC;
    p.mcmc.until = 30;
    p.mcmc.cap_max = 140;
    assert_repeats(&p, &other);
    other = p;
    other.mcmc.opacity_reg = 0.02f;
    assert_repeats(&p, &other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_absgrad),
        cmocka_unit_test(test_mcmc),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
