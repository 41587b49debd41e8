/* SPDX-License-Identifier: Apache-2.0 */
/* What a training tells of its next filter pass: scores, hits, when and how many. */
#include <math.h>
#include <stdlib.h>

#include "defense/filter.h"
#include "training.h"

static struct sg_train_params defended(void)
{
    struct sg_train_params p = short_params();
    p.defense.on = true, p.defense.rho = 0.07, p.defense.interval = 7, p.defense.views = 3;
    return p;
}

struct rank {
    double score;
    float thickness;
    size_t at;
};

static int by_score(const void *a, const void *b)
{
    const struct rank *x = a, *y = b;
    return x->score != y->score ? (x->score > y->score) - (x->score < y->score)
           : x->thickness != y->thickness
               ? (x->thickness > y->thickness) - (x->thickness < y->thickness)
               : (x->at > y->at) - (x->at < y->at);
}

/* The scores of a trainer, the lowest first. Also: hits and score belong together. */
static struct rank *ranks(sg_trainer *t, const struct sg_defense_params *p, size_t n,
                          uint8_t *stays, struct sg_filter_pass *next)
{
    struct rank *r = malloc(n * sizeof(*r));
    double *score = malloc(n * sizeof(*score)), *hits = malloc(n * sizeof(*hits));
    uint8_t *own = malloc(n);
    struct sg_model *m;
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    assert_int_equal(m->count, n);
    assert_int_equal(sg_trainer_scores(t, score, hits, stays ? stays : own, next), SG_OK);
    for (size_t i = 0; i < n; i++) {
        const float *scale = sg_model_at(m, i, SG_P_SCALE);
        r[i] =
            (struct rank){.score = score[i],
                          .thickness = fminf(fminf(scale[0], scale[SG_LANES]), scale[2 * SG_LANES]),
                          .at = i};
        if (score[i] > -INFINITY) {
            assert_true(hits[i] > 0);
            assert_float_equal(hits[i], round(hits[i]), 1e-6 * hits[i]); /* pixels */
            assert_float_equal(score[i], sg_filter_log_weight(p, r[i].thickness) + log(hits[i]),
                               1e-5);
        } else
            assert_true(hits[i] == 0);
    }
    qsort(r, n, sizeof(*r), by_score);
    sg_model_destroy(&m);
    free(score);
    free(hits);
    free(own);
    return r;
}

/* Trains to iteration 40 and looks before each step. No parameter moves in the iteration of a pass,
 * so what the iteration before says is what goes. Returns the model. */
static struct sg_model *look_on(struct fixture *f, const struct sg_train_params *p)
{
    struct sg_model *before, *after;
    sg_trainer *t = begin_training(f, p);
    int passes = 0;
    for (int it = 1; it <= 40; it++) {
        const size_t n = sg_trainer_gaussians(t);
        struct sg_filter_pass next;
        struct sg_train_step s;
        uint8_t *stays = malloc(n);
        struct rank *r = ranks(t, &p->defense, n, stays, &next);
        const int due = (it + 6) / 7 * 7; /* densification is from 5 to 35 */
        assert_float_equal(next.share, due < 35 ? 0.07 : 0, 0);
        assert_int_equal(next.iteration, due < 35 ? due : it - 1);
        assert_int_equal(sg_trainer_model(t, &before), SG_OK);
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.defense.filtered, due < 35 && it == due);
        size_t goes = 0, k = 0;
        for (size_t i = 0; i < n; i++)
            goes += !stays[i];
        if (due >= 35)
            assert_int_equal(goes, 0);
        if (s.defense.filtered) {
            assert_true(goes > 0);
            assert_int_equal(s.defense.removed, goes);
            if (p->defense.rule == SG_PRUNE_EXACT && p->defense.unseen == SG_UNSEEN_FIRST)
                for (size_t i = 0; i < n; i++) /* the lowest */
                    assert_int_equal(stays[r[i].at], i >= (size_t) (next.share * (double) n));
            assert_int_equal(sg_trainer_model(t, &after), SG_OK);
            for (size_t i = 0; i < n; i++)
                if (stays[i]) {
                    for (int axis = 0; axis < 3; axis++)
                        assert_true(*sg_model_at(before, i, SG_P_XYZ + axis) ==
                                    *sg_model_at(after, k, SG_P_XYZ + axis));
                    k++;
                }
            sg_model_destroy(&after);
            passes++;
        }
        sg_model_destroy(&before);
        free(r);
        free(stays);
    }
    assert_int_equal(passes, 4);
    assert_int_equal(sg_trainer_model(t, &after), SG_OK);
    sg_trainer_destroy(&t);
    return after;
}

static void test_next(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    const struct sg_train_params p = defended();
    struct sg_train_params keeps = p, threshold = p;
    keeps.defense.unseen = SG_UNSEEN_KEEP, keeps.defense.views = 1;
    threshold.defense.rule = SG_PRUNE_THRESHOLD;
    struct sg_model *looked = look_on(&f, &p), *plain = train(&f, &p, 40, NULL, NULL, NULL), *other;
    assert_same(plain, looked); /* looking on changes nothing */
    sg_model_destroy(&plain);
    sg_model_destroy(&looked);
    other = look_on(&f, &keeps);
    sg_model_destroy(&other);
    other = look_on(&f, &threshold);
    sg_model_destroy(&other);
    /* Nothing is removed in the last tenth of a training with a tolerance. */
    struct sg_train_params tolerant = p;
    tolerant.tolerance = 4, tolerant.iterations = 30;
    sg_trainer *settled = begin_training(&f, &tolerant);
    for (int it = 1; it <= 27; it++) {
        struct sg_filter_pass next;
        free(ranks(settled, &p.defense, sg_trainer_gaussians(settled), NULL, &next));
        assert_true(next.share > 0 ? it <= 21 && next.iteration <= 27 : it > 21);
        assert_int_equal(sg_trainer_step(settled, NULL), SG_OK);
    }
    sg_trainer_destroy(&settled);
    clear_fixture(&f);
}

/* A share of the growth is known after it; without the defense, and with a strategy that has no
 * filter, there are scores and no pass. */
static void test_shares(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = defended();
    struct sg_filter_pass next;
    struct sg_train_step s;
    p.defense.rho = -0.4;
    sg_trainer *t = begin_training(&f, &p);
    int passes = 0;
    for (int it = 1; it <= 34; it++) {
        free(ranks(t, &p.defense, sg_trainer_gaussians(t), NULL, &next));
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        if (s.defense.filtered)
            assert_float_equal(next.share, s.defense.rho, 0);
        passes += s.defense.filtered;
    }
    assert_true(passes > 1);
    sg_trainer_destroy(&t);
    for (int k = 0; k < 2; k++) {
        p.defense.on = k == 1;
        p.strategy = k == 1 ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
        p.max_gaussians = 200;
        p.defense.rho = 0;
        t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        free(ranks(t, &p.defense, sg_trainer_gaussians(t), NULL, &next));
        assert_true(next.share == 0 && next.iteration == 1);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_next), cmocka_unit_test(test_shares)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
