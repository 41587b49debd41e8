/* SPDX-License-Identifier: Apache-2.0 */
/* Looks at the tolerances: noise is measured during training, the tolerances and the threshold of
 * growth follow, and the result depends neither on threads nor on where a run was saved. */
#include "image/smooth.h"
#include "train/trainer.h"
#include "training.h"

#include <unistd.h>

#define PHOTO 80
#define EPSILON 10
#define LOOK 12

#define BLACK (-6.0f) /* also with the SH of higher degrees */

enum noisy { SOME, ALL };

/* Large Gaussians of one grey that cover the photos, and photos of them with noise of +-EPSILON;
 * with SOME the last photo is clean. */
static struct fixture make_grey(int threads, float grey, enum noisy noisy)
{
    struct fixture f = make_fixture(threads);
    for (int v = 0; v < VIEWS; v++)
        free(f.views[v].rgb);
    for (size_t i = 0; i < f.truth->count; i++)
        for (int m = 0; m < 2; m++) {
            struct sg_model *model = m ? f.start : f.truth;
            for (int k = 0; k < 3; k++) {
                *sg_model_at(model, i, SG_P_SCALE + k) = 0;
                *sg_model_at(model, i, SG_P_SH + k) = grey + 0.1f * (float) k;
            }
            *sg_model_at(model, i, SG_P_OPACITY) = -1;
        }
    make_photos(f.ctx, f.truth, PHOTO, f.views, VIEWS);
    for (size_t v = 0; v + (noisy == SOME) < VIEWS; v++)
        for (size_t i = 0; i < 3 * PHOTO * PHOTO; i++) {
            const int value =
                f.views[v].rgb[i] + (draw(9, v * 100000 + i, -1, 1) < 0 ? -1 : 1) * EPSILON;
            f.views[v].rgb[i] = (uint8_t) (value < 0 ? 0 : value > 255 ? 255 : value);
        }
    return f;
}

static struct fixture make_noisy(int threads)
{
    return make_grey(threads, 0, SOME);
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
        assert_int_equal(s.noise.compared, it < LOOK ? 0 : VIEWS - 1);
        assert_int_equal(s.noise.photos, s.noise.compared);
    }
    assert_true(s.noise.level > 1.1 * EPSILON && s.noise.level < 1.9 * EPSILON); /* raised */
    assert_true(s.noise.before == 20);
    assert_int_equal(s.noise.deciding, s.noise.photos);
    assert_true(s.noise.kurtosis < 2.5);
    assert_true(s.noise.beyond > 0 && s.noise.beyond < 1);
    for (size_t v = 0; v < VIEWS; v++)
        assert_true(sg_trainer_tolerance(t, v) == (v + 1 < VIEWS ? (float) s.noise.level : 0));
    assert_int_equal(sg_trainer_step(t, &s), SG_OK);
    assert_int_equal(s.noise.compared, 0);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* After 1, 3, 5, 7 and 9 times as many iterations, the last ones only while Gaussians are added. */
static void looks_are_repeated(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    for (int until = 11; until <= 35; until += 24) {
        struct sg_train_params p = look_params();
        p.tolerance_look = 2, p.densify_until_iter = until;
        if (until > 11) /* growth that goes on for longer than a short run */
            p.tolerance_look = -1, p.iterations = 20, p.densify_until_iter = 15000;
        sg_trainer *t = begin_training(&f, &p);
        double least = 0; /* what was given is far above */
        for (int it = 1; it <= p.iterations; it++) {
            struct sg_train_step s;
            const bool look = it % 4 == 2 && it <= 18 && it <= until;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_int_equal(s.noise.compared, look ? VIEWS - 1 : 0);
            if (!look)
                continue;
            assert_true(sg_trainer_tolerance(t, 0) == (float) s.noise.level);
            assert_true(s.noise.before == (least > 0 ? least : 20));
            assert_true(s.noise.level >= least);
            least = s.noise.level;
        }
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* The level is half as much again as what was measured, but at most what was given, unless more was
 * measured. Of photos that are known to be without lossy compression it is what was measured. */
static void level_is_raised(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    double levels[3];
    for (int i = 0; i < 3; i++) {
        const float g = (const float[]){1, 12.5f, 40}[i], given[VIEWS] = {g, g, g, g, g, 0};
        struct sg_train_params p = look_params();
        struct sg_noise n;
        p.tolerances = given;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        levels[i] = n.level;
        sg_trainer_destroy(&t);
    }
    assert_true(levels[0] > 0.75 * EPSILON && levels[0] < 1.25 * EPSILON);
    assert_true(levels[1] == 12.5 && levels[2] == 1.5 * levels[0]);
    for (size_t lossless = 0; lossless <= VIEWS; lossless++) {
        static const float given[VIEWS] = {40, 40, 40,
                                           40, 40, 0}; /* the last one is not looked at */
        struct sg_train_params p = look_params();
        struct sg_noise n;
        p.tolerances = given;
        for (size_t v = 0; v < VIEWS; v++)
            f.views[v].lossless = v < lossless;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        const double lossy = lossless < VIEWS ? 1 - (double) lossless / (VIEWS - 1) : 0;
        assert_float_equal(n.level, (1 + 0.5 * lossy) * levels[0], 1e-9);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* The first level that was measured stays. */
static void first_level_stays(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    const struct sg_train_params p = look_params();
    for (int before = 0; before <= 30; before += 5) {
        struct sg_noise n;
        sg_trainer *t = begin_training(&f, &p);
        t->noise = before;
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        if (before)
            assert_true(n.level == before);
        else
            assert_true(n.level > 1.1 * EPSILON && n.level < 1.9 * EPSILON);
        assert_true(t->noise == n.level && n.bounded == 0 && n.added == 0);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* Noise is measured in photos with quiet parts; where none has any, nothing changes. */
static void photos_without_quiet_parts(void **state)
{
    (void) state;
    for (int masked = 3; masked <= VIEWS; masked++) {
        struct fixture f = make_noisy(1);
        uint8_t *mask = calloc(PHOTO * PHOTO, 1);
        const struct sg_train_params p = look_params();
        struct sg_noise n;
        mask[0] = 255; /* a pixel to train with */
        for (int v = 0; v < masked; v++)
            f.views[v].mask = mask;
        for (int before = 0; before <= 30; before += 30) {
            sg_trainer *t = begin_training(&f, &p);
            t->noise = before;
            assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
            assert_int_equal(n.compared, VIEWS - 1);
            assert_int_equal(n.photos, masked < VIEWS ? VIEWS - 1 - masked : 0);
            assert_true(before     ? n.level == before
                        : n.photos ? n.level > 1.1 * EPSILON && n.level < 1.9 * EPSILON
                                   : n.level == 0);
            assert_true(sg_trainer_tolerance(t, 1) ==
                        (n.level > 0 ? (float) n.level : estimated[1]));
            sg_trainer_destroy(&t);
        }
        for (int v = 0; v < masked; v++)
            f.views[v].mask = NULL;
        free(mask);
        clear_fixture(&f);
    }
}

/* Photos whose render is black show the bound. It replaces what other looks have found, down to
 * half of what was given. A photo that the audit calls clean gets a tolerance if it shows it too.
 */
static void bound_on_black(void **state)
{
    (void) state;
    for (int noisy = SOME; noisy <= ALL; noisy++) {
        struct fixture f = make_grey(1, BLACK, (enum noisy) noisy);
        for (float g = 6; g <= 40; g += 34) {
            const float given[VIEWS] = {g, g, g, g, g, 0};
            struct sg_train_params p = look_params();
            struct sg_noise n;
            p.tolerances = given;
            sg_trainer *t = begin_training(&f, &p);
            t->noise = 14;
            assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
            assert_true(n.level == fmax(EPSILON, (double) g / 2) && n.photos == 0);
            assert_int_equal(n.compared, VIEWS - 1);
            assert_int_equal(n.bounded, VIEWS - 1);
            assert_int_equal(n.added, noisy == ALL);
            for (size_t v = 0; v < VIEWS; v++)
                assert_true(sg_trainer_tolerance(t, v) ==
                            (v + 1 < VIEWS || noisy == ALL ? (float) n.level : 0));
            assert_float_equal(n.beyond, 1 - (noisy == ALL ? 1 : 5.0 / 6) * (g < EPSILON ? 0.6 : 1),
                               1e-6);
            assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
            assert_int_equal(n.added, 0);
            sg_trainer_destroy(&t);
        }
        clear_fixture(&f);
    }
}

/* What the audit gave the photos that it doubts limits a bound from below, also when others have
 * been added that are more. */
static void added_photos_do_not_vote(void **state)
{
    (void) state;
    struct fixture f = make_grey(1, BLACK, ALL);
    static const float given[VIEWS] = {40, 0, 0, 0, 0, 0};
    struct sg_train_params p = look_params();
    struct sg_noise n;
    p.tolerances = given;
    sg_trainer *t = begin_training(&f, &p);
    for (int look = 0; look < 2; look++) {
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        assert_true(n.level == 20 && n.compared == (look ? VIEWS : 1));
        assert_int_equal(n.added, look ? 0 : VIEWS - 1);
    }
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Nor does a photo get a tolerance whose black is a little grey, or that has much weaker noise. */
static void other_blacks_are_clean(void **state)
{
    (void) state;
    struct fixture f = make_grey(1, BLACK, SOME);
    static const float given[VIEWS] = {20, 20, 20, 20, 20, 0};
    for (int noise = 0; noise < 2; noise++) {
        struct sg_train_params p = look_params();
        struct sg_noise n;
        for (size_t i = 0; i < 3 * PHOTO * PHOTO; i++)
            f.views[VIEWS - 1].rgb[i] = noise && draw(9, i, -1, 1) < 0 ? 0 : 4;
        p.tolerances = given;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        assert_true(n.level >= EPSILON && n.added == 0);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* One photo in five that shows a bound is too few. */
static void bound_in_few_photos(void **state)
{
    (void) state;
    struct fixture f = make_grey(1, BLACK, ALL);
    for (int shown = 1; shown <= 2; shown++) {
        uint8_t *mask = calloc(PHOTO * PHOTO, 1);
        const struct sg_train_params p = look_params();
        struct sg_noise n;
        memset(mask, 255, 10);
        for (int v = shown; v < VIEWS - 1; v++)
            f.views[v].mask = mask;
        sg_trainer *t = begin_training(&f, &p);
        t->noise = 14;
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        assert_int_equal(n.bounded, shown);
        assert_true(n.level == (shown == 1 ? 14 : EPSILON));
        sg_trainer_destroy(&t);
        for (int v = shown; v < VIEWS - 1; v++)
            f.views[v].mask = NULL;
        free(mask);
    }
    clear_fixture(&f);
}

/* A tolerance that was given is compared too, and stays. */
static void given_tolerance_stays(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    struct sg_train_params p = look_params();
    struct sg_train_step s = {0};
    p.tolerances = NULL, p.tolerance = 20;
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= LOOK; it++)
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
    assert_int_equal(s.noise.compared, VIEWS);
    assert_true(s.noise.level > 0.75 * EPSILON && s.noise.level < 1.3 * EPSILON);
    assert_true(sg_trainer_tolerance(t, 0) == 20);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* The threshold falls with the share of the differences that exceeds the tolerance, to 0.6. */
static void growth_follows_what_is_hidden(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    p.tolerance = 2, p.tolerance_look = 1, p.densify_until_iter = 16;
    const float threshold = 0.001f;
    struct sg_model *m[6];
    for (int i = 0; i < 4; i++) {
        p.tolerance_growth = (const float[]){0, 1000, 1e-3f, 0}[i];
        p.densify_grad_threshold = i == 3 ? (float) (0.6 * (double) threshold) : threshold;
        m[i] = train(&f, &p, 16, NULL, NULL, NULL);
    }
    assert_same(m[0], m[1]);
    assert_same(m[2], m[3]);
    assert_true(m[2]->count > m[0]->count);
    p.tolerance = 0, p.densify_grad_threshold = threshold; /* nothing is hidden, and nothing seen */
    for (int i = 4; i < 6; i++) {
        p.tolerance_growth = i == 4 ? 0 : 0.5f;
        m[i] = train(&f, &p, 16, NULL, NULL, NULL);
    }
    assert_same(m[4], m[5]);
    for (int i = 0; i < 6; i++)
        sg_model_destroy(&m[i]);
    clear_fixture(&f);
}

/* A look in an iteration that resets opacity would see little, so it comes one before, also where
 * time is short and a step would do both. */
static void looks_come_before_resets(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1);
    struct sg_train_params p = look_params();
    p.opacity_reset_interval = LOOK, p.iterations = p.densify_until_iter = 40;
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= LOOK; it++) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.noise.compared, it == LOOK - 1 ? VIEWS - 1 : 0);
    }
    sg_trainer_destroy(&t);

    double now = 0;
    p.max_seconds = p.iterations / 4.0, p.clock = fake_clock, p.clock_arg = &now;
    t = begin_training(&f, &p);
    int most = 0;
    while (sg_trainer_iteration(t) < LOOK - 1) {
        struct sg_train_step s;
        const int before = sg_trainer_iteration(t);
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        most = s.iteration - before > most ? s.iteration - before : most;
        assert_int_equal(s.noise.compared, s.iteration == LOOK - 1 ? VIEWS - 1 : 0);
        now += 1;
    }
    assert_in_range(most, 3, 8);
    assert_int_equal(sg_trainer_iteration(t), LOOK - 1);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

static struct sg_train_params smoothing_params(void)
{
    struct sg_train_params p = look_params();
    p.tolerance_smooth = 0; /* anything beyond the tolerances */
    return p;
}

/* Where the tolerances hide too little, the photos that have one are smoothed, and trained on as if
 * they had been read so. */
static void photos_that_disagree_are_smoothed(void **state)
{
    (void) state;
    struct fixture f = make_noisy(1), smoothed = make_noisy(1);
    struct sg_train_params p = smoothing_params();
    struct sg_train_step s, next, same;
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= LOOK; it++)
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
    assert_true(s.noise.smooths);
    assert_true(s.noise.level > 0.75 * EPSILON && s.noise.level < 1.25 * EPSILON); /* not raised */
    const double x = s.noise.level / 16, sigma = 75 * x * sqrt(fmin(x, 1));
    for (size_t v = 0; v + 1 < VIEWS; v++) /* as strongly as the noise asks for */
        assert_int_equal(sg_smooth_bilateral(f.ctx, sigma, f.views[v].rgb, NULL, PHOTO, PHOTO,
                                             smoothed.views[v].rgb),
                         SG_OK);
    for (size_t v = 0; v < VIEWS; v++) {
        assert_true(sg_trainer_tolerance(t, v) == 0);
        assert_int_equal(sg_trainer_smooths(t, v), v + 1 < VIEWS);
    }
    assert_true(sg_trainer_growth_threshold(t) == p.densify_grad_threshold);
    struct sg_model *m = NULL;
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    for (int it = LOOK + 1; it <= p.iterations; it++) { /* no second look */
        assert_int_equal(sg_trainer_step(t, it == LOOK + 1 ? &next : &s), SG_OK);
        assert_int_equal(s.noise.compared, it == LOOK + 1 ? VIEWS - 1 : 0);
    }
    sg_trainer_destroy(&t);

    struct sg_train_params plain = p;
    plain.tolerances = NULL;
    sg_model_destroy(&smoothed.start);
    smoothed.start = m;
    t = begin_training(&smoothed, &plain);
    t->steps = LOOK; /* the same view */
    assert_int_equal(sg_trainer_step(t, &same), SG_OK);
    assert_int_equal(same.view, next.view);
    assert_true(same.loss == next.loss && same.l1 == next.l1 && same.ssim == next.ssim);
    sg_trainer_destroy(&t);
    clear_fixture(&smoothed); /* its model is of the other context */
    clear_fixture(&f);
}

/* Not where a tolerance helps: little is beyond, or the bound shows; nor tolerances that were
 * given. That the noise is weak (3) is no reason. */
static void others_are_not_smoothed(void **state)
{
    (void) state;
    for (int i = 0; i < 5; i++) {
        struct fixture f = make_grey(1, i == 2 ? BLACK : 0, SOME);
        struct sg_train_params p = smoothing_params();
        struct sg_noise n;
        if (i == 1)
            p.tolerance_smooth = 1;
        if (i == 3)
            for (size_t v = 0; v < VIEWS; v++) /* half of the noise */
                for (size_t k = 0; k < 3 * PHOTO * PHOTO; k++)
                    f.views[v].rgb[k] = (uint8_t) ((f.views[v].rgb[k] + f.views[v].rgb[0]) / 2);
        if (i == 4)
            p.tolerances = NULL, p.tolerance = 20;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_measure_noise(t, 1, &n), SG_OK);
        assert_int_equal(n.smooths, i == 0 || i == 3);
        if (i == 3)
            assert_true(n.level > 0 && n.level < 10);
        sg_trainer_destroy(&t);
        clear_fixture(&f);
    }
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
            p.tolerances = NULL, p.tolerance_look = 2;
        else
            p.tolerance_look = -1, p.densify_until_iter = p.iterations = 500; /* from 50 on */
        sg_trainer *t = begin_training(&f, &p);
        for (int it = 1; it <= LOOK + 2; it++) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_int_equal(s.noise.compared, 0);
        }
        assert_true(sg_trainer_tolerance(t, 0) == (i == 1 ? 0 : 20));
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

static void same_bytes(struct sg_train_params p)
{
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

static void same_bytes_for_threads_and_resume(void **state)
{
    (void) state;
    same_bytes(look_params());
    same_bytes(smoothing_params());
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
        cmocka_unit_test(looks_are_repeated),
        cmocka_unit_test(level_is_raised),
        cmocka_unit_test(first_level_stays),
        cmocka_unit_test(photos_without_quiet_parts),
        cmocka_unit_test(bound_on_black),
        cmocka_unit_test(added_photos_do_not_vote),
        cmocka_unit_test(other_blacks_are_clean),
        cmocka_unit_test(bound_in_few_photos),
        cmocka_unit_test(given_tolerance_stays),
        cmocka_unit_test(growth_follows_what_is_hidden),
        cmocka_unit_test(looks_come_before_resets),
        cmocka_unit_test(photos_that_disagree_are_smoothed),
        cmocka_unit_test(others_are_not_smoothed),
        cmocka_unit_test(no_look_is_asked_for),
        cmocka_unit_test(same_bytes_for_threads_and_resume),
        cmocka_unit_test(total_variation_of_tolerated_photos),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
