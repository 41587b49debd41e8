/* SPDX-License-Identifier: Apache-2.0 */
/* The frequency filter: weights, ranks, and which Gaussians it removes. */
#include "defense/filter.h"
#include "training.h"

static void test_weight(void **state)
{
    (void) state;
    struct sg_defense_params p = {SG_DEFENSE_DEFAULTS};
    /* S = 1/2 at s = 0.0234 for t = 8 */
    const double half = log(sqrt(log(2) / (2 * M_PI * M_PI * 64)));
    assert_float_equal(exp(half), 0.0234, 1e-4);
    assert_float_equal(sg_filter_log_weight(&p, (float) half), 2 * log(0.5), 1e-5);
    /* Small scales: (2 pi^2 t^2 s^2)^alpha, where 1 - exp would be 0 in float, and far below. */
    const double small[] = {1e-6, 2e-6, 1e-12, 1e-30};
    for (int i = 0; i < 4; i++)
        assert_float_equal(sg_filter_log_weight(&p, (float) log(small[i])),
                           2 * log(2 * M_PI * M_PI * 64 * small[i] * small[i]), 1e-4);
    p.sigma = SG_SIGMA_EIGEN;
    assert_float_equal(sg_filter_log_weight(&p, (float) log(1e-6)),
                       2 * log(2 * M_PI * M_PI * 64 * 1e-24), 1e-4);
    p.sigma = SG_SIGMA_STD;
    assert_float_equal(sg_filter_log_weight(&p, 20), 0, 1e-12); /* no frequency at all */
    assert_true(sg_filter_log_weight(&p, -INFINITY) == -INFINITY);
    assert_true(sg_filter_log_weight(&p, -1e30f) == -INFINITY);
    assert_true(sg_filter_log_weight(&p, NAN) == -INFINITY);
    assert_float_equal(sg_filter_log_weight(&p, INFINITY), 0, 0);
}

struct ranked {
    double score;
    float thickness;
    size_t index;
};

static int by_rank(const void *a, const void *b)
{
    const struct ranked *x = a, *y = b;
    if (x->score != y->score)
        return x->score < y->score ? -1 : 1;
    if (x->thickness != y->thickness)
        return x->thickness < y->thickness ? -1 : 1;
    return x->index < y->index ? -1 : 1;
}

/* Against a sort, with many equals at every level. */
static void test_ranks(void **state)
{
    (void) state;
    enum { N = 3000 };
    double score[N];
    float thickness[N];
    uint64_t keys[N];
    uint8_t keep[N];
    struct ranked sorted[N];
    const struct sg_scores s = {
        .count = N, .score = score, .log_smallest = thickness, .keys = keys};
    for (int kind = 0; kind < 4; kind++) {
        size_t kept = 0, rank = 0;
        for (size_t i = 0; i < N; i++) {
            const float v = draw((uint64_t) kind, i, -30, 5);
            score[i] = kind == 0 ? (double) v : i % 3 == 0 ? -INFINITY : (double) roundf(v / 10);
            thickness[i] = kind == 2 ? 1 : roundf(draw(9, i, -5, 5));
            keep[i] = kind != 3 || i % 4 != 1;
            if (keep[i])
                sorted[kept++] = (struct ranked){score[i], thickness[i], i};
        }
        qsort(sorted, kept, sizeof(sorted[0]), by_rank);
        for (size_t k = 0; k < N && kind != 3; k += 97)
            assert_true(sg_scores_rank(&s, k) == sorted[k].score);
        for (size_t step = 1; rank + step < kept; rank += step, step = step * 3 + 1) {
            sg_scores_remove(&s, step, keep); /* a little more each time */
            for (size_t k = 0; k < kept; k++)
                assert_int_equal(keep[sorted[k].index], k >= rank + step);
        }
        sg_scores_remove(&s, kept - rank, keep);
        for (size_t k = 0; k < N; k++)
            assert_int_equal(keep[k], 0);
    }
}

/* Six Gaussians in a row in front of a camera: which are removed, and why. */
static void test_filter(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m, *after;
    struct sg_engine *b;
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    struct sg_view view = {.camera = make_camera(96, 96, 4)};
    const struct sg_scene scene = {.train = &view, .n_train = 1};
    struct sg_defense_params p = {SG_DEFENSE_DEFAULTS, .on = true};
    assert_int_equal(sg_model_create(ctx, 6, 0, &m), SG_OK);
    for (size_t i = 0; i < 6; i++) { /* the same disc, ever thicker; 3 is behind the camera */
        *sg_model_at(m, i, SG_P_XYZ) = (float) i * 0.5f - 1.25f;
        *sg_model_at(m, i, SG_P_XYZ + 2) = i == 3 ? -50 : 0;
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_SCALE + k) =
                k == 2 ? logf(1e-6f * (float) (i + 1)) : logf(0.06f);
        *sg_model_at(m, i, SG_P_ROT) = 1;
        *sg_model_at(m, i, SG_P_OPACITY) = 2;
    }
    const struct {
        double rho;
        enum sg_prune_rule rule;
        size_t removed;
        float first; /* x of the thinnest left */
    } cases[] = {
        {0.1, SG_PRUNE_EXACT, 0, -1.25f},
        {0.17, SG_PRUNE_EXACT, 1, -1.25f},
        {0.34, SG_PRUNE_EXACT, 2, -0.75f},
        {0.17, SG_PRUNE_THRESHOLD, 1, -1.25f},
        {0.41, SG_PRUNE_THRESHOLD, 3, -0.25f},
        {0.01, SG_PRUNE_THRESHOLD, 1, -1.25f}, /* unseen Gaussians are removed for every share */
        {0, SG_PRUNE_THRESHOLD, 0, -1.25f},    /* unless there is none */
    };
    for (size_t c = 0; c < sizeof(cases) / sizeof(cases[0]); c++) {
        struct sg_defense_step step = {.anisotropy = 3};
        p.rule = cases[c].rule;
        b = make_engine(ctx, "cpu", NULL, m, NULL);
        assert_int_equal(sg_filter(b, &scene, &p, &render, cases[c].rho, 42, 600, &step), SG_OK);
        assert_true(step.filtered && step.scored == 6 && step.unseen == 1 && step.anisotropy == 3);
        assert_int_equal(step.removed, cases[c].removed);
        assert_int_equal(sg_engine_count(b), 6 - cases[c].removed);
        assert_true(step.score[0] < step.score[1] && step.score[1] < step.score[2]);
        assert_int_equal(sg_model_create(ctx, 6 - cases[c].removed, 0, &after), SG_OK);
        assert_int_equal(sg_engine_download(b, after, NULL), SG_OK);
        assert_float_equal(*sg_model_at(after, 0, 0), cases[c].first, 0);
        for (size_t i = 0; i < after->count && cases[c].removed;
             i++) /* unseen Gaussians were removed first */
            assert_true(*sg_model_at(after, i, SG_P_XYZ + 2) > -1);
        sg_model_destroy(&after);
        sg_engine_destroy(&b);
    }
    struct sg_defense_step step; /* equals go together */
    *sg_model_at(m, 4, SG_P_XYZ + 2) = -50;
    p.rule = SG_PRUNE_THRESHOLD;
    b = make_engine(ctx, "cpu", NULL, m, NULL);
    assert_int_equal(sg_filter(b, &scene, &p, &render, 0.01, 42, 600, &step), SG_OK);
    assert_int_equal(step.removed, 2);
    sg_engine_destroy(&b);
    /* The unseen stay where another view might see them, and then the thinnest go. */
    const struct sg_view two[2] = {view, view};
    const struct sg_scene more = {.train = (struct sg_view *) two, .n_train = 2};
    p.rule = SG_PRUNE_EXACT, p.unseen = SG_UNSEEN_KEEP;
    for (p.views = 1; p.views <= 2; p.views++) {
        b = make_engine(ctx, "cpu", NULL, m, NULL);
        assert_int_equal(sg_filter(b, &more, &p, &render, 0.34, 42, 600, &step), SG_OK);
        assert_int_equal(step.removed, 2);
        assert_int_equal(step.unseen, 2);
        assert_int_equal(sg_model_create(ctx, 4, 0, &after), SG_OK);
        assert_int_equal(sg_engine_download(b, after, NULL), SG_OK);
        assert_float_equal(*sg_model_at(after, 0, 0), p.views == 1 ? -0.25f : -1.25f, 0);
        sg_model_destroy(&after);
        sg_engine_destroy(&b);
    }
    sg_model_destroy(&m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Which views are counted: all, or a number of them. Each is counted at most once, and the choice
 * differs between events and seeds. */
static void test_views(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_view views[7];
    struct sg_model *m = make_model(ctx, 200, 0, 3);
    const struct sg_scene scene = {.train = views, .n_train = 7};
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    struct sg_engine *b;
    double *own[7];
    b = make_engine(ctx, "cpu", NULL, m, NULL);
    for (int v = 0; v < 7; v++) { /* sizes apart, so that hits identify the view */
        views[v] = (struct sg_view){.camera = make_camera(20 + 9 * v, 30, 3)};
        const struct sg_camera *camera = &views[v].camera;
        own[v] = malloc(200 * sizeof(double));
        assert_int_equal(sg_engine_count_hits(b, &camera, 1, &render, SG_HIT_PIXELS, own[v]),
                         SG_OK);
    }
    struct sg_defense_params p = {SG_DEFENSE_DEFAULTS, .exponent = 0}; /* the score is ln hits */
    unsigned before = 0, others = 0, ever = 0;
    struct sg_scores s;
    for (int it = 100; it <= 1000; it += 100)
        for (uint64_t seed = 42; seed <= 44; seed++) {
            const bool all = seed == 44;
            p.sample = all ? SG_VIEWS_ALL : SG_VIEWS_RANDOM, p.views = 3;
            assert_int_equal(sg_score(b, &scene, &p, &render, seed, it, &s), SG_OK);
            unsigned fits = 0, sets = 0;
            for (unsigned set = 0; set < 128; set++) { /* which views explain the hits? */
                bool right = true;
                for (size_t i = 0; i < 200 && right; i++) {
                    double sum = 0;
                    for (int v = 0; v < 7; v++)
                        sum += set >> v & 1 ? own[v][i] : 0;
                    right = sum > 0 ? fabs(exp(s.score[i]) - sum) < 1e-6 * sum
                                    : s.score[i] == -INFINITY;
                }
                fits += right, sets = right ? set : sets;
            }
            assert_int_equal(fits, 1);
            assert_int_equal(__builtin_popcount(sets), all ? 7 : 3);
            others += !all && sets != before;
            before = all ? before : sets, ever |= all ? 0 : sets;
            sg_scores_clear(&s);
        }
    assert_true(others >= 16 && ever == 127);
    p.hit = SG_HIT_VIEWS; /* counted once in each that has it */
    assert_int_equal(sg_score(b, &scene, &p, &render, 42, 100, &s), SG_OK);
    for (size_t i = 0; i < 200; i++) {
        int hits = 0;
        for (int v = 0; v < 7; v++)
            hits += own[v][i] > 0;
        assert_float_equal(exp(s.score[i]), hits, 1e-9);
    }
    sg_scores_clear(&s);
    for (int v = 0; v < 7; v++)
        free(own[v]);
    sg_engine_destroy(&b);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_weight), cmocka_unit_test(test_ranks),
                                       cmocka_unit_test(test_filter), cmocka_unit_test(test_views)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
