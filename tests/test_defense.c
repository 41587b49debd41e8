/* SPDX-License-Identifier: Apache-2.0 */
/* The defense in training: when the filter runs, what `auto` makes of it, losses, reports. */
#include <unistd.h>

#include "defense/filter.h"
#include "image/total_variation.h"
#include "races.h"
#include "splatguard/audit.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

static struct sg_train_params defended(void)
{
    struct sg_train_params p = short_params();
    p.defense.on = true, p.defense.rho = 0.07, p.defense.interval = 5, p.defense.views = 3;
    return p;
}

/* Counts at every event, the window, and statistics that outlive an event of their own. */
static void test_events(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = defended();
    for (int interval = 5; interval <= 7; interval++) {
        sg_trainer *t;
        int events = 0, edits = 0;
        p.defense.interval = interval, p.defense.from = interval == 6 ? 12 : -1,
        p.defense.until = interval == 6 ? 30 : -1;
        t = begin_training(&f, &p);
        for (int it = 1; it <= 40; it++) {
            struct sg_train_step s;
            const size_t before = sg_trainer_gaussians(t);
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_true(s.defense.anisotropy > 0 && s.defense.total_variation > 0);
            const bool due = it % interval == 0 && it > (interval == 6 ? 12 : 5) &&
                             it < (interval == 6 ? 30 : 35);
            assert_int_equal(s.defense.filtered, due);
            assert_int_equal(s.defense.scored, due ? before + s.cloned + s.split - s.pruned : 0);
            assert_int_equal(s.defense.removed, (size_t) (0.07 * (double) s.defense.scored));
            assert_int_equal(s.gaussians,
                             before + s.cloned + s.split - s.pruned - s.defense.removed);
            events += due;
            edits += due || (it % 5 == 0 && it > 5 && it < 35);
        }
        assert_true(events >= 2);
        assert_int_equal(t->adam_steps[SG_G_XYZ],
                         40 - edits - 1); /* Adam takes no step where the model is edited */
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* Hits are counted while Gaussians still have their opacity: a reset in the same iteration comes
 * after. */
static void test_before_reset(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_step steps[2];
    float highest[2];
    for (int resets = 0; resets < 2; resets++) {
        struct sg_train_params p = defended();
        struct sg_model *m;
        p.opacity_reset_interval = resets ? 20 : 1000;
        sg_trainer *t = begin_training(&f, &p);
        while (sg_trainer_iteration(t) < 20)
            assert_int_equal(sg_trainer_step(t, &steps[resets]), SG_OK);
        assert_int_equal(sg_trainer_model(t, &m), SG_OK);
        highest[resets] = -INFINITY;
        for (size_t i = 0; i < m->count; i++)
            highest[resets] = fmaxf(highest[resets], *sg_model_at(m, i, SG_P_OPACITY));
        sg_model_destroy(&m);
        sg_trainer_destroy(&t);
    }
    assert_true(highest[0] > 0 && highest[1] < -4); /* logits: 0.01 */
    assert_true(steps[0].defense.filtered && steps[0].defense.removed > 0);
    assert_int_equal(steps[0].defense.unseen, steps[1].defense.unseen);
    for (int k = 0; k < 3; k++)
        assert_true(steps[0].defense.score[k] == steps[1].defense.score[k]);
    clear_fixture(&f);
}

/* The total variation of the first step's render. */
static double first_variation(struct fixture *f, const struct sg_train_params *p)
{
    static float planes[3 * SIDE * SIDE];
    double rows[6 * SIDE];
    sg_trainer *t = begin_training(f, p);
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    const struct sg_camera *camera = &f->scene.train[sg_trainer_pick_view(t, 1)].camera;
    assert_int_equal(sg_engine_draw(t->engine, camera, sg_active_degree(p, 0, 1), &render, false),
                     SG_OK);
    assert_int_equal(sg_engine_read_image(t->engine, planes, NULL, NULL), SG_OK);
    sg_trainer_destroy(&t);
    return sg_tv_loss(f->ctx, planes, SIDE, SIDE, p->defense.tv, 0, NULL, rows);
}

/* Each loss has its own weight and norm, and falls more with a higher weight. */
static void test_losses(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    for (int which = 0; which < 2; which++) {
        double sum[2] = {0};
        for (int strong = 0; strong < 2; strong++) {
            struct sg_train_params p = defended();
            p.defense.rho = 0;
            p.densify_until_iter = 0;
            p.defense.lambda = strong ? 20 : 1e-9;
            p.defense.anisotropy_scale = which ? 0 : 0.1;
            p.defense.tv_scale = which ? 1 : 0;
            sg_trainer *t = begin_training(&f, &p);
            for (int it = 1; it <= 39; it++) {
                struct sg_train_step s;
                assert_int_equal(sg_trainer_step(t, &s), SG_OK);
                assert_true(isnan(which ? s.defense.anisotropy : s.defense.total_variation));
                if (it > 33)
                    sum[strong] += which ? s.defense.total_variation : s.defense.anisotropy;
            }
            sg_trainer_destroy(&t);
        }
        assert_true(sum[1] < 0.9 * sum[0]);
    }
    for (int norm = SG_TV_PENALTY_L2; norm <= SG_TV_PENALTY_HUBER; norm++) {
        struct sg_train_params p = defended();
        struct sg_train_step s;
        p.defense.tv = (enum sg_tv_penalty) norm;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        sg_trainer_destroy(&t);
        const double expected = first_variation(&f, &p);
        assert_float_equal(s.defense.total_variation, expected, 1e-9 * expected);
    }
    clear_fixture(&f);
}

/* Three tenths of what grows between two removals, of late, from where the filter's window begins,
 * and of what grows in the same iteration, were it the first; nothing once nothing grows. Also
 * where time is short and steps go over several iterations, and so over several densifications of
 * which one takes place. */
static void test_share_of_growth(void **state)
{
    (void) state;
    static const struct {
        int interval, from, events; /* growth comes every 5 iterations; events: 0 = some */
    } cases[] = {{2, -1, 0}, {6, -1, 0}, {20, -1, 0}, {10, -1, 4}, {23, -1, 1}, {5, 17, 5}};
    struct fixture f = make_fixture(2);
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++)
        for (int hurry = 0; hurry < 2; hurry++) {
            const bool counted = cases[k].events && !hurry;
            struct sg_train_params p = defended();
            double growth = 0, now = 0;
            int events = 0, removals = 0, growths = 0, before = 0;
            p.defense.rho = -0.3, p.defense.interval = cases[k].interval,
            p.defense.from = cases[k].from;
            p.defense.until = 50, p.iterations = 49, p.densify_until_iter = 45;
            p.max_seconds = hurry ? 7 : 0; /* seven iterations a second */
            p.clock = fake_clock, p.clock_arg = &now;
            sg_trainer *t = begin_training(&f, &p);
            while (sg_trainer_iteration(t) < p.iterations) {
                struct sg_train_step s;
                const size_t gaussians = sg_trainer_gaussians(t);
                assert_int_equal(sg_trainer_step(t, &s), SG_OK);
                now += 1;
                if (sg_densifies(&p, before, s.iteration)) {
                    const double share = (double) (s.cloned + s.split) / (double) gaussians;
                    growth = growth > 0 ? growth + (share - growth) / 4 : share;
                    growths += s.iteration > sg_filters_from(&p);
                }
                if (counted)
                    assert_int_equal(s.defense.filtered,
                                     s.iteration < 45 && sg_filters(&p, before, s.iteration));
                before = s.iteration;
                if (!s.defense.filtered)
                    continue;
                assert_true(before < 45); /* afterwards the price is too high */
                assert_float_equal(s.defense.rho, fmin(0.3 * growth * growths, 0.5), 1e-12);
                growths = 0;
                events++, removals += s.defense.removed > 0;
            }
            assert_true(removals >= 1 && growth > 0);
            if (counted)
                assert_int_equal(events, cases[k].events);
            sg_trainer_destroy(&t);
        }
    clear_fixture(&f);
}

/* Almost nothing grows: the least share is removed when the filter begins. It shrinks until
 * densification ends, and stops at half of the first model. */
static void test_least(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = defended();
    int whole = 0, part = 0, none = 0;
    p.defense.rho = -0.001, p.defense.interval = 3; /* densifies every 5 iterations */
    p.densify_grad_threshold = 1e9f;
    p.iterations = 49, p.densify_until_iter = 45;
    for (double least = 0.2; least < 0.5; least *= 2) {
        double first = 0;
        bool due = false;
        p.defense.rho_least = least;
        sg_trainer *t = begin_training(&f, &p);
        while (sg_trainer_iteration(t) < p.iterations) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            due |= sg_densifies(&p, s.iteration - 1, s.iteration);
            if (!s.defense.filtered)
                continue;
            assert_true(due);
            due = false;
            const double n = (double) s.defense.scored;
            first = first > 0 ? first : n;
            const double fading = least * (45 - s.iteration) / (45. - p.densify_from_iter);
            const double rho = fmax(fmin(fading, 1 - first / 2 / n), 0);
            assert_float_equal(s.defense.rho, rho, 1e-12);
            assert_int_equal(s.defense.removed, (size_t) (s.defense.rho * n));
            whole += rho == fading, part += rho > 0 && rho < fading, none += rho == 0;
        }
        sg_trainer_destroy(&t);
    }
    assert_true(whole >= 2 && part >= 1 && none >= 1);
    clear_fixture(&f);
}

/* The defense is weak on clean photos and mild on weak poisons, and a scene's units do not matter.
 */
static void test_automatic(void **state)
{
    (void) state;
    struct sg_audit_image images[2] = {
        {.score = 0.02, .features = {.content = 1e5, .osc_down = 3, .osc_across = 3}},
        {.score = 0.25, .features = {.content = 1e5, .osc_down = 9, .osc_across = 9}}};
    const struct sg_audit audit = {.count = 2, .images = images};
    struct sg_defense_params p = {SG_DEFENSE_DEFAULTS};
    float shares[2], tolerances[60];
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, shares, tolerances, &p);
    assert_true(shares[0] == 0 && shares[1] == 0 && p.view_weights == shares && p.lambda == 6);
    assert_true(p.rho == -0.1 && p.rho_least == 0);
    assert_float_equal(p.frequency, 8, 1e-12);
    images[0].score = images[1].score = 0.95;
    images[0].features =
        (struct sg_audit_features){.content = 1e5, .osc_down = 1.5, .osc_across = 0.8};
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, shares, tolerances, &p);
    assert_float_equal(p.lambda * (double) shares[0], 6, 1e-6); /* weak */
    assert_float_equal(p.lambda * (double) shares[1], 6, 1e-6); /* what oscillates is texture */
    images[1].features.osc_quiet = 3.6;
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, shares, tolerances, &p);
    assert_float_equal(p.lambda * (double) shares[1], 12, 1e-5);
    assert_float_equal(p.rho, -(0.1 + 0.35 * (0.25 + 1) / 2), 1e-12);
    assert_float_equal(p.rho_least, 0.05 * 0.625 * 0.625, 1e-12);
    images[0].features.half_osc = 10.5, images[1].features.quarter_osc = 42;
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, shares, tolerances, &p);
    assert_float_equal(p.lambda * (double) shares[0], 9, 1e-5);  /* coarse noise */
    assert_float_equal(p.lambda * (double) shares[1], 24, 1e-5); /* no photo gets more */
    const double weight = sg_filter_log_weight(&p, -4);
    for (double units = 1e-3; units <= 1e3; units *= 1e3) {
        sg_defense_automatic(&audit, 5.2 * units, (double) SG_TOLERANCE_AUTO, shares, tolerances,
                             &p);
        assert_float_equal(sg_filter_log_weight(&p, (float) (-4 + log(units))), weight, 1e-5);
    }
    /* Certain photos form a set of their own; blank ones are not judged. */
    struct sg_audit_image many[60] = {{.score = 0}};
    for (int i = 0; i < 60; i++)
        many[i] = (struct sg_audit_image){.score = 0.1, .features = {.content = 1e4}};
    float more[60];
    for (int i = 0; i < 3; i++)
        many[i] =
            (struct sg_audit_image){.score = 0.995, .features = {.content = 1e4, .osc_down = 5}};
    sg_defense_automatic(&(struct sg_audit){.count = 60, .images = many}, 1,
                         (double) SG_TOLERANCE_AUTO, more, tolerances, &p);
    assert_float_equal(p.rho, -0.45, 1e-9);
    many[3] = many[4] = (struct sg_audit_image){
        .score = 1, .features = {.content = 1e4}}; /* which take nothing away */
    sg_defense_automatic(&(struct sg_audit){.count = 60, .images = many}, 1,
                         (double) SG_TOLERANCE_AUTO, more, tolerances, &p);
    assert_float_equal(p.rho, -0.45, 1e-9);
    many[3] = many[4] = many[5];
    many[0].score = many[1].score = 0.98;
    sg_defense_automatic(&(struct sg_audit){.count = 60, .images = many}, 1,
                         (double) SG_TOLERANCE_AUTO, more, tolerances, &p);
    assert_float_equal(p.rho, -(0.1 + 0.35 / 3), 1e-9);
    many[2].score = 0.98;
    for (int i = 3; i < 57; i++)
        many[i].features.content = 0;
    sg_defense_automatic(&(struct sg_audit){.count = 60, .images = many}, 1,
                         (double) SG_TOLERANCE_AUTO, more, tolerances, &p);
    assert_float_equal(p.rho, -(0.1 + 0.35 / 2), 1e-9);
    assert_float_equal(sg_defense_frequency(0), sg_defense_frequency(1),
                       0); /* one place of cameras */
    assert_true(sg_defense_frequency(1e-30) <= 1e9 && sg_defense_frequency(1e30) >= 1e-9);
    /* A score half way gets half of it, and a tenth of a vote counts a tenth. */
    images[0] = (struct sg_audit_image){
        .score = 0.6, .features = {.content = 1e4, .osc_down = 9, .osc_across = 9}};
    images[1] = (struct sg_audit_image){
        .score = 0.9, .features = {.content = 1e3, .osc_down = 9, .osc_across = 9}};
    sg_defense_automatic(&audit, 1, (double) SG_TOLERANCE_AUTO, shares, tolerances, &p);
    assert_float_equal((double) shares[0], 0.5, 1e-6);
    assert_float_equal(p.rho, -(0.1 + 0.35 * (0.5 + 0.1) / 1.1), 1e-9);
    images[0].score = 0.3, images[1].score = 0.995; /* also without doubt */
    sg_defense_automatic(&audit, 1, (double) SG_TOLERANCE_AUTO, shares, tolerances, &p);
    assert_float_equal(p.rho, -(0.1 + 0.35 * 0.1), 1e-6);
    sg_defense_automatic(&(struct sg_audit){0}, 1, (double) SG_TOLERANCE_AUTO, shares, tolerances,
                         &p);
    assert_float_equal(p.rho, -0.1, 1e-12);
}

/* Noise within a tolerance needs no filter, more noise does, and clean photos get neither. */
static void test_automatic_tolerance(void **state)
{
    (void) state;
    const struct sg_audit_features strong = {
        .content = 1e5, .osc_down = 9, .osc_across = 9, .osc_quiet = 7.2};
    struct sg_audit_image images[3];
    for (int i = 0; i < 3; i++)
        images[i] = (struct sg_audit_image){
            .score = 0.95, .features = strong, .verdict = SG_AUDIT_POISONED};
    images[0].tau = 12, images[1].tau = 18;
    images[2].score = 0.1, images[2].verdict = SG_AUDIT_CLEAN;
    struct sg_audit audit = {.count = 3, .images = images, .tau = 15, .tau_error = 2};
    struct sg_defense_params p = {SG_DEFENSE_DEFAULTS};
    float weights[3], tolerances[3];
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, weights, tolerances, &p);
    assert_true(tolerances[0] == 17 && tolerances[1] == 18 && tolerances[2] == 0);
    assert_true(weights[0] == 0 && weights[1] == 0 && weights[2] == 0);
    assert_float_equal(p.rho, -0.1 / 3, 1e-12); /* for the photo without a tolerance */
    assert_true(p.rho_least == 0 && p.view_weights == weights);
    sg_defense_automatic(&audit, 5.2, 0, weights, tolerances, &p); /* without tolerances */
    assert_float_equal(p.lambda * (double) weights[0], 24, 1e-5);
    assert_float_equal(p.rho, -(0.1 + 0.35 * 2 / 3), 1e-12);
    images[1].tau = 0, images[1].verdict = SG_AUDIT_UNSEEN; /* masks leave nothing of it */
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, weights, tolerances, &p);
    assert_true(tolerances[0] == 17 && tolerances[1] == 0);
    images[1].verdict = SG_AUDIT_POISONED;
    /* A fixed tolerance covers clean photos and weaker noise, but not stronger one. */
    images[0].tau = 12, images[1].tau = 18;
    sg_defense_automatic(&audit, 5.2, 20, weights, tolerances, &p);
    assert_true(tolerances[0] == 20 && tolerances[1] == 20 && tolerances[2] == 20 && p.rho == 0);
    assert_true(weights[0] == 0 && weights[1] == 0 && weights[2] == 0);
    sg_defense_automatic(&audit, 5.2, 14, weights, tolerances, &p);
    assert_true(tolerances[0] == 14 && tolerances[1] == 0 && tolerances[2] == 14);
    assert_true(p.lambda * (double) weights[1] > 20 && p.rho < -0.1);
    /* None is larger than the largest. */
    audit.tau = 30, audit.tau_error = 9;
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, weights, tolerances, &p);
    assert_true((double) tolerances[0] == SG_TOLERANCE_MAX);
    /* Photos that are changed by more than that oscillate more than a bounded poison makes them. */
    for (int k = 0; k < 4; k++) {
        const bool fixed = k & 1;
        images[0].features.half_osc = images[1].features.half_osc = k < 2 ? 20 : 17;
        images[0].features.quarter_osc = images[1].features.quarter_osc = k < 2 ? 9 : 11;
        sg_defense_automatic(&audit, 5.2, fixed ? 20 : (double) SG_TOLERANCE_AUTO, weights,
                             tolerances, &p);
        assert_true(tolerances[0] == 0 && tolerances[1] == 0);
        assert_true(tolerances[2] == (fixed ? 20 : 0));
        float alone[3]; /* without a filter a tolerance is better than none */
        sg_defense_tolerances(&audit, alone);
        assert_true((double) alone[0] == SG_TOLERANCE_MAX && alone[2] == 0);
        assert_float_equal(p.lambda * (double) weights[0], 24, 1e-5);
        assert_float_equal(p.rho, fixed ? -(0.2 / 3 + 0.35 * 2 / 3) : -(0.1 + 0.35 * 2 / 3), 1e-12);
    }
    images[0].features.quarter_osc = images[1].features.quarter_osc = 9;
    sg_defense_automatic(&audit, 5.2, (double) SG_TOLERANCE_AUTO, weights, tolerances, &p);
    assert_true((double) tolerances[0] == SG_TOLERANCE_MAX && tolerances[1] > 0);
}

/* Another way to compute the expected model. */
static void train_same(struct fixture *f, const struct sg_train_params *p, const char *load,
                       const struct sg_model *expected)
{
    struct sg_model *m = train(f, p, 40, NULL, load, NULL);
    assert_same(expected, m);
    sg_model_destroy(&m);
}

static void test_same_bytes(void **state)
{
    (void) state;
    struct sg_train_params p = defended();
    p.defense.rho = -0.4, p.defense.rho_least = 0.3; /* have state of their own */
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture one = make_fixture(1), three = make_fixture(3);
    for (int late = 0; late < 2;
         late++) { /* saved right after a removal, and between a growth and its removal */
        p.defense.interval = late ? 15 : 5, p.defense.from = late ? 12 : -1;
        struct sg_model *a = train(&one, &p, 40, path, NULL, NULL);
        train_same(&three, &p, NULL, a);
        train_same(&three, &p, path, a);
        sg_model_destroy(&a);
    }
    unlink(path);
    clear_fixture(&one);
    clear_fixture(&three);
}

/* Any SH degree, with and without a limit: in bands and resumed, the same bytes. */
static void test_combinations(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_fixture(2);
    struct sg_model *start = f.start;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    for (int degree = 0; degree <= 3; degree++) {
        assert_int_equal(sg_model_create(f.ctx, start->count, degree, &f.start), SG_OK);
        f.start->active_sh_degree = 0;
        for (size_t i = 0; i < start->count; i++)
            for (int p = 0; p < SG_P_SH + 3; p++)
                *sg_model_at(f.start, i, p) = *sg_model_at(start, i, p);
        for (int limited = 0; limited < 2; limited++) {
            struct sg_train_params p = defended();
            p.sh_degree = degree, p.defense.rho = degree % 2 ? 0.07 : -0.4;
            p.max_gaussians = limited ? 140 : 0;
            p.densify_grad_threshold = 1e-6f;
            struct sg_model *whole = train(&f, &p, 40, path, NULL, NULL);
            assert_true(whole->sh_degree == degree &&
                        (limited ? whole->count <= 140 : whole->count > 140));
            train_same(&f, &p, path, whole);
            p.max_instances = 60;
            train_same(&f, &p, NULL, whole);
            sg_model_destroy(&whole);
        }
        sg_model_destroy(&f.start);
    }
    f.start = start;
    unlink(path);
    clear_fixture(&f);
}

/* Weights of views: 0 for all equals lambda 0, 1 for all equals no weights, a half equals half of
 * lambda, and each view has its own. */
static void test_shares(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = defended();
    struct sg_model *models[2][3];
    for (int shared = 0; shared < 2; shared++)
        for (int k = 0; k < 3; k++) {
            float shares[VIEWS];
            for (size_t i = 0; i < VIEWS; i++)
                shares[i] = 0.5f * (float) k;
            p.defense.view_weights = shared ? shares : NULL;
            p.defense.lambda = shared ? 3 : 1.5 * k;
            models[shared][k] = train(&f, &p, 30, NULL, NULL, NULL);
        }
    for (int k = 0; k < 3; k++)
        assert_same(models[0][k], models[1][k]);
    for (int shared = 0; shared < 2; shared++)
        for (int k = 0; k < 3; k++)
            sg_model_destroy(&models[shared][k]);
    float own[VIEWS];
    uint8_t none[SIDE * SIDE] = {0};
    for (int v = 0; v < VIEWS; v++)
        own[v] = (float) (v % 2);
    p.defense.view_weights = own;
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= VIEWS; it++) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(isnan(s.defense.anisotropy) != 0, own[s.view] == 0);
        assert_int_equal(isnan(s.defense.total_variation) != 0, own[s.view] == 0);
    }
    sg_trainer_destroy(&t);
    p.tolerance = 8; /* brings a total variation of its own */
    t = begin_training(&f, &p);
    for (int it = 1; it <= VIEWS; it++) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(isnan(s.defense.anisotropy) != 0, own[s.view] == 0);
        assert_true(s.defense.total_variation > 0);
    }
    sg_trainer_destroy(&t);
    p.tolerance = 0;
    for (int k = 0; k < 2; k++) {
        own[1] = k ? NAN : 1001;
        assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_ERR_USAGE);
        assert_non_null(strstr(sg_last_error(f.ctx), "defense.view_weights["));
    }
    p.defense.view_weights = NULL; /* without used pixels there is no gradient */
    t = begin_training(&f, &p);
    f.views[sg_trainer_pick_view(t, 1)].mask =
        none; /* of the view that the run below begins with */
    sg_trainer_destroy(&t);
    t = begin_training(&f, &p);
    struct sg_model *m;
    assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    assert_same(m, f.start);
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* The 10th, 50th and 90th percentile of an event are those of Gaussians that are seen. Gaussians
 * that stay keep the statistics for densification. Of a model that no view sees one Gaussian is
 * left. */
static void test_report(void **state)
{
    (void) state;
    enum { N = 5000 }; /* more than a thread scores at once */
    static float gradient[N];
    sg_ctx *ctx = make_context(1);
    struct sg_view view = {.camera = make_camera(96, 96, 4)};
    const struct sg_scene scene = {.train = &view, .n_train = 1};
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    for (int none = 0; none < 2; none++) {
        const struct sg_defense_params p = {SG_DEFENSE_DEFAULTS,
                                            .rule = none ? SG_PRUNE_THRESHOLD : SG_PRUNE_EXACT};
        struct sg_model *m = make_model(ctx, N, 0, 5);
        struct sg_defense_step step = {0};
        struct sg_columns o;
        struct sg_engine *b;
        struct sg_scores s;
        assert_int_equal(sg_columns_create(ctx, N, 0, SG_COLUMN_SAVED, &o), SG_OK);
        for (size_t i = 0; i < N; i++) {
            if (none || i % 3 == 0)
                *sg_model_at(m, i, SG_P_XYZ + 2) = -50;
            o.at[SG_C_GRAD_COUNT][i] = 1, o.at[SG_C_GRAD_SUM][i] = (float) (i + 1); /* a name */
        }
        b = make_engine(ctx, "cpu", NULL, m, &o);
        assert_int_equal(sg_score(b, &scene, &p, &render, 42, 600, &s), SG_OK);
        for (size_t i = 0; i < N; i++)
            assert_true(s.score[i] == -INFINITY || (!none && i % 3));
        assert_int_equal(sg_filter(b, &scene, &p, &render, 0.2, 42, 600, &step), SG_OK);
        assert_int_equal(step.unseen, s.unseen);
        assert_int_equal(step.removed, none ? N - 1 : N / 5);
        for (size_t k = 0; k < 3; k++) {
            const size_t below = (N - s.unseen - 1) * (1 + 4 * k) / 10;
            assert_true(step.score[k] == (none ? 0 : sg_scores_rank(&s, s.unseen + below)));
        }
        assert_int_equal(sg_engine_count(b), N - step.removed);
        assert_int_equal(
            sg_engine_read_statistics(b, &(struct sg_statistics){.gradient = gradient}), SG_OK);
        for (size_t i = 0; i < N - step.removed; i++) /* in the order that they were in */
            assert_true(gradient[i] > (i ? gradient[i - 1] : 0));
        sg_scores_clear(&s);
        sg_engine_destroy(&b);
        sg_columns_clear(&o);
        sg_model_destroy(&m);
    }
    sg_ctx_destroy(&ctx);
}

static void test_refusals(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_fixture(1);
    const struct sg_train_params good = defended();
    static const struct {
        const char *name;
        double value;
    } cases[] = {{"rho", 1},          {"rho", -1},  {"rho_least", 0.6},
                 {"rho_least", -0.1}, {"views", 0}, {"band.high", 0.1},
                 {"bins", 255},       {"bins", 7},  {"lambda", -1}};
    f.scene.train = f.views;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        struct sg_train_params p = good;
        sg_trainer *t;
        const char *name = cases[i].name;
        if (!strcmp(name, "rho"))
            p.defense.rho = cases[i].value;
        else if (!strcmp(name, "rho_least"))
            p.defense.rho_least = cases[i].value;
        else if (!strcmp(name, "views"))
            p.defense.views = (int) cases[i].value;
        else if (!strcmp(name, "band.high"))
            p.defense.spectrum.band.high = cases[i].value;
        else if (!strcmp(name, "bins"))
            p.defense.spectrum.band.bins = (int) cases[i].value;
        else
            p.defense.lambda = cases[i].value;
        assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_ERR_USAGE);
        assert_non_null(strstr(sg_last_error(f.ctx), name));
        assert_non_null(strstr(sg_last_error(f.ctx), "expected"));
    }
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_events),
                                       cmocka_unit_test(test_before_reset),
                                       cmocka_unit_test(test_losses),
                                       cmocka_unit_test(test_share_of_growth),
                                       cmocka_unit_test(test_least),
                                       cmocka_unit_test(test_automatic),
                                       cmocka_unit_test(test_automatic_tolerance),
                                       cmocka_unit_test(test_same_bytes),
                                       cmocka_unit_test(test_combinations),
                                       cmocka_unit_test(test_shares),
                                       cmocka_unit_test(test_report),
                                       cmocka_unit_test(test_refusals)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
