/* SPDX-License-Identifier: Apache-2.0 */
/* The second look at the tolerances: noise is measured during training, the tolerances follow, and
 * the result depends neither on threads nor on where a run was saved. */
#include "training.h"

#include <unistd.h>

#define PHOTO 80
#define EPSILON 10
#define LOOK 12

/* Large grey Gaussians that cover the photos, and photos of them with noise of +-EPSILON; the last
 * photo is clean. */
static struct fixture make_noisy(int threads)
{
    struct fixture f = make_fixture(threads);
    for (int v = 0; v < VIEWS; v++)
        free(f.views[v].rgb);
    for (size_t i = 0; i < f.truth->count; i++)
        for (int m = 0; m < 2; m++) {
            struct sg_model *model = m ? f.start : f.truth;
            for (int k = 0; k < 3; k++) {
                *sg_model_at(model, i, SG_P_SCALE + k) = 0;
                *sg_model_at(model, i, SG_P_SH + k) = 0.1f * (float) k;
            }
            *sg_model_at(model, i, SG_P_OPACITY) = -1;
        }
    make_photos(f.ctx, f.truth, PHOTO, f.views, VIEWS);
    for (size_t v = 0; v + 1 < VIEWS; v++)
        for (size_t i = 0; i < 3 * PHOTO * PHOTO; i++) {
            const int noisy =
                f.views[v].rgb[i] + (draw(9, v * 100000 + i, -1, 1) < 0 ? -1 : 1) * EPSILON;
            f.views[v].rgb[i] = (uint8_t) (noisy < 0 ? 0 : noisy > 255 ? 255 : noisy);
        }
    return f;
}

static const float estimated[VIEWS] = {20, 25, 20, 20, 20, 0};

static struct sg_train_params look_params(void)
{
    struct sg_train_params p = short_params();
    p.tolerances = estimated;
    p.tolerance_look = LOOK;
    p.tolerance_tv = 0.05f;
    return p;
}

static void tolerances_follow_the_noise(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    const struct sg_train_params p = look_params();
    sg_trainer *t = begin_training(&f, &p);
    struct sg_train_step s;
    for (int it = 1; it <= LOOK; it++) {
        for (size_t v = 0; v < VIEWS; v++)
            assert_true(sg_trainer_tolerance(t, v) == estimated[v]);
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.noise.photos, it < LOOK ? 0 : VIEWS - 1);
    }
    assert_true(s.noise.level > 0.75 * EPSILON && s.noise.level < 1.3 * EPSILON);
    assert_true(s.noise.kurtosis < 2.5);
    for (size_t v = 0; v < VIEWS; v++)
        assert_true(sg_trainer_tolerance(t, v) == (v + 1 < VIEWS ? (float) s.noise.level : 0));
    assert_int_equal(sg_trainer_step(t, &s), SG_OK);
    assert_int_equal(s.noise.photos, 0);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

static void no_look_is_asked_for(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    for (int i = 0; i < 3; i++) {
        struct sg_train_params p = look_params();
        if (i == 0)
            p.tolerance_look = 0;
        else if (i == 1)
            p.tolerances = NULL, p.tolerance = 20;
        else
            p.tolerance_look = -1, p.densify_until_iter = 500; /* from 50 on */
        sg_trainer *t = begin_training(&f, &p);
        for (int it = 1; it <= LOOK + 2; it++) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_int_equal(s.noise.photos, 0);
        }
        assert_true(sg_trainer_tolerance(t, 0) == 20);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

static void same_bytes_for_threads_and_resume(void **state)
{
    (void) state;
    const struct sg_train_params p = look_params();
    char path[] = "/tmp/sg_noise_XXXXXX";
    close(mkstemp(path));
    struct fixture one = make_noisy(1), three = make_noisy(3);
    struct sg_model *a = train(&one, &p, 40, path, NULL, NULL); /* saved after the look */
    struct sg_model *b = train(&three, &p, 40, NULL, NULL, NULL);
    struct sg_model *c = train(&three, &p, 40, NULL, path, NULL);
    assert_same(a, b);
    assert_same(a, c);
    struct sg_train_params never =
        p; /* the look makes a difference, so that this shows something */
    never.tolerance_look = 0;
    struct sg_model *d = train(&one, &never, 40, NULL, NULL, NULL);
    assert_true(d->count != a->count || memcmp(d->params, a->params, 16 * sizeof(float)));
    sg_model_destroy(&a);
    sg_model_destroy(&b);
    sg_model_destroy(&c);
    sg_model_destroy(&d);
    remove(path);
    clear_fixture(&one);
    clear_fixture(&three);
}

/* A tolerance brings a total variation with it, unless its weight is 0. */
static void total_variation_of_tolerated_photos(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    struct sg_train_params p = short_params();
    p.tolerance_tv = 0;
    struct sg_model *plain = train(&f, &p, 10, NULL, NULL, NULL);
    p.tolerance_tv = 1;
    struct sg_model *still = train(&f, &p, 10, NULL, NULL, NULL); /* no photo has a tolerance */
    assert_same(plain, still);
    p.tolerance = 4;
    struct sg_model *smooth = train(&f, &p, 10, NULL, NULL, NULL);
    p.tolerance_tv = 0;
    struct sg_model *free_within = train(&f, &p, 10, NULL, NULL, NULL);
    assert_memory_not_equal(smooth->params, free_within->params, 16 * sizeof(float));
    sg_model_destroy(&plain);
    sg_model_destroy(&still);
    sg_model_destroy(&smooth);
    sg_model_destroy(&free_within);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tolerances_follow_the_noise),
        cmocka_unit_test(no_look_is_asked_for),
        cmocka_unit_test(same_bytes_for_threads_and_resume),
        cmocka_unit_test(total_variation_of_tolerated_photos),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
