/* SPDX-License-Identifier: Apache-2.0 */
/* What the defense's filter makes of anchors: scores by every reading, and what it spares. */
#include <unistd.h>

#include "anchor_models.h"
#include "defense/filter.h"
#include "math/constants.h"
#include "training_anchors.h"

#define ANCHORS 5
#define MADE 3 /* Gaussians of each anchor, in each view */
#define SEES 2 /* views */
#define SAME(a, b) (fabs((a) - (b)) <= 1e-3 * fabs(b))

/* Networks that do not depend on what they read: each anchor is drawn as the same Gaussians. The
 * last of them is outside all views, the second is thinner, and the last anchor is never seen. */
static struct sg_model *make_known_anchors(sg_ctx *ctx, struct sg_model **gaussians)
{
    const int numbers[MADE] = {1, 4, 8};
    struct sg_model *m;
    assert_int_equal(sg_model_create(ctx, ANCHORS, 0, &m), SG_OK);
    assert_int_equal(sg_anchors_add(ctx, m, 0), SG_OK);
    assert_int_equal(sg_model_create(ctx, ANCHORS * MADE, 0, gaussians), SG_OK);
    struct sg_weights *w = &m->columns->networks->value;
    m->columns->networks->voxel = 0.01f;
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
        float *covariance = &w->bias[SG_O_COVARIANCE + 7 * k];
        w->bias[SG_O_OPACITY + k] = -1;
        covariance[2] = k == numbers[1] ? -3 : 0; /* a sigmoid's argument */
        covariance[3] = 1;
    }
    for (size_t i = 0; i < ANCHORS; i++) {
        const float position[3] = {-0.8f + 0.5f * (float) i, 0.1f * (float) i,
                                   i == ANCHORS - 1 ? -50 : 0};
        sg_anchor_set(m, i, position, 0, logf(0.1f + 0.02f * (float) i));
        float *anchor = m->columns->at[SG_C_ANCHOR];
        for (int j = 0; j < MADE; j++) {
            const size_t to = i * MADE + (size_t) j;
            const float log_size = logf(0.1f + 0.02f * (float) i);
            w->bias[SG_O_OPACITY + numbers[j]] = 0.5f; /* tanh of it is the opacity */
            for (int axis = 0; axis < 3; axis++) {
                const float offset = j == 2 ? 90 * (axis == 0) : 0.1f * (float) (j * (axis == 1));
                const float thinner = axis == 2 && j == 1 ? -3 : 0;
                anchor[sg_param_index(SG_A_PLANES, i, SG_A_OFFSET + 3 * numbers[j] + axis)] =
                    offset;
                *sg_model_at(*gaussians, to, SG_P_XYZ + axis) = position[axis] + offset;
                *sg_model_at(*gaussians, to, SG_P_SCALE + axis) =
                    log_size - logf(1 + expf(-thinner));
            }
            *sg_model_at(*gaussians, to, SG_P_ROT) = 1;
            *sg_model_at(*gaussians, to, SG_P_OPACITY) = logf((expf(1) - 1) / 2);
        }
    }
    return m;
}

/* By the definition, of the hits of every Gaussian in every view. */
static double score_of(const struct sg_defense_params *p, double hits[SEES][ANCHORS * MADE],
                       const struct sg_model *gaussians, const struct sg_model *anchors, size_t i)
{
    double sum = 0, most = 0, value = 0, weight[MADE];
    for (int j = 0; j < MADE; j++) {
        float size = anchors->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, SG_A_SIZE)];
        if (p->anchor_sigma == SG_ANCHOR_SIGMA_NEURAL)
            size =
                *sg_model_at((struct sg_model *) gaussians, i * MADE + (size_t) j, SG_P_SCALE + 2);
        weight[j] = pow(1 - exp(-2 * M_PI * M_PI * 64 * exp(2 * (double) size)), 2);
    }
    for (int v = 0; v < SEES; v++) {
        double all = 0;
        for (int j = 0; j < MADE; j++)
            all += hits[v][i * MADE + (size_t) j];
        if (p->hit == SG_HIT_VIEWS)
            all = all > 0;
        for (int j = 0; j < MADE; j++) {
            const double own = hits[v][i * MADE + (size_t) j];
            value = weight[j] * (p->anchor_hits == SG_ANCHOR_HITS_ANCHOR ? all : own);
            sum += value;
            most = fmax(most, value);
        }
    }
    return p->anchor_score == SG_COMBINE_SUM   ? sum
           : p->anchor_score == SG_COMBINE_MAX ? most
                                               : sum / (SEES * MADE);
}

static void check_scores(struct engine_case c)
{
    sg_ctx *ctx = make_context(2);
    struct sg_model *gaussians, *m = make_known_anchors(ctx, &gaussians);
    struct sg_engine *e, *plain = make_engine(ctx, c.engine, c.variant, gaussians, NULL);
    struct sg_view views[SEES] = {{.camera = make_camera(64, 48, 3)},
                                  {.camera = make_camera(90, 60, 4)}};
    const struct sg_scene scene = {.train = views, .n_train = SEES};
    const struct sg_render_params render = sg_render_params_default();
    double found[2][3][ANCHORS];
    e = make_scaffold(ctx, c, m);
    for (int kind = 0; kind < 3; kind++) {
        double hits[SEES][ANCHORS * MADE];
        for (int v = 0; v < SEES; v++) {
            const struct sg_camera *camera = &views[v].camera;
            assert_int_equal(
                sg_engine_count_hits(plain, &camera, 1, &render, (enum sg_hit) kind, hits[v]),
                SG_OK);
            for (size_t i = 0; i < ANCHORS * MADE; i++)
                assert_true((hits[v][i] > 0) == (i < (ANCHORS - 1) * MADE && i % MADE < 2));
        }
        for (int reading = 0; reading < 12; reading++) {
            const struct sg_defense_params p = {
                SG_DEFENSE_DEFAULTS, .hit = (enum sg_hit) kind,
                .anchor_sigma = reading & 1 ? SG_ANCHOR_SIGMA_ANCHOR : SG_ANCHOR_SIGMA_NEURAL,
                .anchor_hits = reading & 2 ? SG_ANCHOR_HITS_ANCHOR : SG_ANCHOR_HITS_NEURAL,
                .anchor_score = (enum sg_combine)(reading / 4)};
            struct sg_scores s;
            assert_int_equal(sg_score(e, &scene, &p, &render, 42, 600, &s), SG_OK);
            assert_int_equal(s.unseen, 1);
            for (size_t i = 0; i < ANCHORS - 1; i++) {
                double expected = score_of(&p, hits, gaussians, m, i);
                if (kind == SG_HIT_VIEWS && reading == 1) /* a view counts once */
                    expected /= 2;
                if (!SAME(exp(s.score[i]), expected))
                    fail_msg("%s: hits %d, reading %d, anchor %zu: score %g, expected %g",
                             case_name(c), kind, reading, i, exp(s.score[i]), expected);
                if (!kind && !(reading & 1))
                    found[reading >> 1 & 1][reading / 4][i] = exp(s.score[i]);
            }
            assert_true(s.score[ANCHORS - 1] == -INFINITY);
            sg_scores_clear(&s);
        }
    }
    for (int a = 0; a < 6; a++) /* no two readings are the same */
        for (int b = 0; b < a; b++)
            assert_false(SAME(found[a / 3][a % 3][1], found[b / 3][b % 3][1]));
    sg_engine_destroy(&e);
    sg_engine_destroy(&plain);
    sg_model_destroy(&m);
    sg_model_destroy(&gaussians);
    sg_ctx_destroy(&ctx);
}

static void test_scores(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    for (int k = 0; k < n; k++)
        check_scores(cases[k]);
}

/* The lowest of those that are not spared go: the unseen first, unless they stay; none that is
 * younger than the grace. */
static void test_spared(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *gaussians, *m = make_known_anchors(ctx, &gaussians);
    struct sg_view views[SEES] = {{.camera = make_camera(64, 48, 3)},
                                  {.camera = make_camera(64, 48, 3)}};
    const struct sg_scene scene = {.train = views, .n_train = SEES};
    const struct sg_render_params render = sg_render_params_default();
    float born[SG_LANES] = {0, 500, 401, 400}; /* iterations; it is the 600th */
    /* Scores rise with the number of the anchor, but the last one is not seen. */
    const struct {
        double rho;
        enum sg_prune_rule rule;
        enum sg_filter_unseen unseen;
        int views, grace;
        unsigned left; /* a bit for each */
    } cases[] = {
        {0.4, SG_PRUNE_EXACT, SG_UNSEEN_FIRST, 1, 0, 0xe},
        {0.4, SG_PRUNE_EXACT, SG_UNSEEN_KEEP, 1, 0, 0x1c},
        {0.4, SG_PRUNE_EXACT, SG_UNSEEN_KEEP, 2, 0, 0xe}, /* all views are counted */
        {0.4, SG_PRUNE_EXACT, SG_UNSEEN_KEEP, 1, 200, 0x16},
        {0.4, SG_PRUNE_EXACT, SG_UNSEEN_KEEP, 1, 100, 0x1c},
        {0.4, SG_PRUNE_EXACT, SG_UNSEEN_KEEP, 1, 101, 0x1a},
        {0.5, SG_PRUNE_EXACT, SG_UNSEEN_FIRST, 1, 200, 0xe},
        {0.9, SG_PRUNE_EXACT, SG_UNSEEN_KEEP, 1, 200, 0x16}, /* no more than are left to remove */
        {0.5, SG_PRUNE_THRESHOLD, SG_UNSEEN_KEEP, 1, 0, 0x1c},
        {0.5, SG_PRUNE_THRESHOLD, SG_UNSEEN_KEEP, 1, 101, 0x1a},
        {0.1, SG_PRUNE_THRESHOLD, SG_UNSEEN_FIRST, 1, 0, 0xf},
    };
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const struct sg_defense_params p = {SG_DEFENSE_DEFAULTS,       .rule = cases[k].rule,
                                            .unseen = cases[k].unseen, .views = cases[k].views,
                                            .grace = cases[k].grace,   .exponent = 4};
        struct sg_defense_step step = {0};
        struct sg_engine *e;
        struct sg_model *after;
        unsigned left = 0;
        m->columns->at[SG_C_BORN] = born;
        e = make_scaffold(ctx, (struct engine_case){main_engine(), NULL}, m);
        m->columns->at[SG_C_BORN] = NULL;
        assert_int_equal(sg_filter(e, &scene, &p, &render, cases[k].rho, 42, 600, &step), SG_OK);
        assert_int_equal(step.unseen, 1);
        assert_int_equal(sg_model_create(ctx, sg_engine_count(e), 0, &after), SG_OK);
        assert_int_equal(step.removed, ANCHORS - after->count);
        assert_int_equal(sg_engine_download(e, after, NULL), SG_OK);
        for (size_t i = 0; i < ANCHORS; i++)
            for (size_t j = 0; j < after->count; j++)
                if (*sg_model_at(after, j, SG_P_XYZ) == *sg_model_at(m, i, SG_P_XYZ))
                    left |= 1u << i;
        if (left != cases[k].left)
            fail_msg("case %zu: left %#x, expected %#x", k, left, cases[k].left);
        sg_model_destroy(&after);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_model_destroy(&gaussians);
    sg_ctx_destroy(&ctx);
}

/* With a unit of single Gaussians the lowest of these are hidden: views do not make them any more,
 * they have no gradient, and do not count in the next pass. An anchor without any goes. */
static void check_single(struct engine_case c)
{
    sg_ctx *ctx = make_context(2);
    struct sg_model *gaussians, *m = make_known_anchors(ctx, &gaussians), *after;
    struct sg_view views[SEES] = {{.camera = make_camera(64, 48, 3)},
                                  {.camera = make_camera(64, 48, 3)}};
    const struct sg_scene scene = {.train = views, .n_train = SEES};
    const struct sg_camera *seen[SEES] = {&views[0].camera, &views[1].camera};
    const struct sg_render_params render = sg_render_params_default();
    const struct sg_defense_params p = {SG_DEFENSE_DEFAULTS, .unit = SG_UNIT_GAUSSIAN};
    const struct sg_weighing single = {.kind = SG_HIT_PIXELS, .single = true};
    double before[ANCHORS * SG_ANCHOR_GAUSSIANS], hits[ANCHORS * SG_ANCHOR_GAUSSIANS];
    struct sg_defense_step step = {0};
    struct sg_engine *e = make_scaffold(ctx, c, m);
    assert_int_equal(sg_engine_weigh_hits(e, seen, SEES, &render, &single, before), SG_OK);
    /* Of 50 only numbers 1 and 4 of the first four anchors are seen; number 4 is the thinner one.
     * 43 go: the 42 unseen, with them the last anchor, and number 4 of the first. */
    assert_int_equal(sg_filter(e, &scene, &p, &render, 43. / 50, 42, 600, &step), SG_OK);
    assert_int_equal(step.scored, 50);
    assert_int_equal(step.unseen, 42);
    assert_int_equal(step.removed, 43);
    assert_int_equal(sg_engine_count(e), ANCHORS - 1);
    assert_int_equal(sg_engine_weigh_hits(e, seen, SEES, &render, &single, hits), SG_OK);
    for (size_t i = 0; i < (ANCHORS - 1) * SG_ANCHOR_GAUSSIANS; i++) {
        const size_t number = i % SG_ANCHOR_GAUSSIANS;
        if ((hits[i] > 0) != (number == 1 || (number == 4 && i != 4)))
            fail_msg("%s: Gaussian %zu of anchor %zu has %g hits, before %g", case_name(c), number,
                     i / SG_ANCHOR_GAUSSIANS, hits[i], before[i]);
    }
    /* The next pass: none is unseen, and number 4 of the second anchor is the lowest. */
    assert_int_equal(sg_filter(e, &scene, &p, &render, 1.5 / 7, 42, 700, &step), SG_OK);
    assert_int_equal(step.scored, 7);
    assert_int_equal(step.unseen, 0);
    assert_int_equal(step.removed, 1);
    assert_int_equal(sg_engine_weigh_hits(e, seen, SEES, &render, &single, hits), SG_OK);
    assert_true(hits[14] == 0 && hits[11] > 0);
    /* A file of it is a model like any other. */
    assert_int_equal(sg_model_create(ctx, ANCHORS - 1, 0, &after), SG_OK);
    assert_int_equal(sg_anchors_add(ctx, after, 0), SG_OK);
    assert_int_equal(sg_engine_download(e, after, after->columns), SG_OK);
    const float *anchor = after->columns->at[SG_C_ANCHOR];
    for (size_t i = 0; i < ANCHORS - 1; i++)
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
            const float offset = anchor[sg_param_index(SG_A_PLANES, i, SG_A_OFFSET + 3 * k)];
            assert_true((offset == SG_OFFSET_HIDDEN) != (k == 1 || (k == 4 && i > 1)));
        }
    assert_int_equal(sg_model_check(ctx, after, "after"), SG_OK);
    sg_engine_destroy(&e);
    sg_model_destroy(&after);
    sg_model_destroy(&m);
    sg_model_destroy(&gaussians);
    sg_ctx_destroy(&ctx);
}

static void test_single(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    for (int k = 0; k < n; k++)
        check_single(cases[k]);
}

/* Of all anchors, by their positions: their Gaussians that are hidden, as bits. */
struct hidden {
    float at[256][3];
    unsigned bits[256];
    size_t count;
};

static struct hidden hidden_of(sg_trainer *t)
{
    struct hidden h = {.count = sg_engine_count(t->engine)};
    sg_ctx *ctx = sg_engine_ctx(t->engine);
    struct sg_model *m;
    assert_in_range(h.count, 1, 256);
    assert_int_equal(sg_model_create(ctx, h.count, 0, &m), SG_OK);
    assert_int_equal(sg_anchors_add(ctx, m, 0), SG_OK);
    assert_int_equal(sg_engine_download(t->engine, m, m->columns), SG_OK);
    for (size_t i = 0; i < h.count; i++) {
        for (int k = 0; k < 3; k++)
            h.at[i][k] = *sg_model_at(m, i, SG_P_XYZ + k);
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            h.bits[i] |= (unsigned) (m->columns->at[SG_C_ANCHOR][sg_param_index(
                                         SG_A_PLANES, i, SG_A_OFFSET + 3 * k)] == SG_OFFSET_HIDDEN)
                         << k;
    }
    sg_model_destroy(&m);
    return h;
}

/* In a training: what is hidden stays so, also after a checkpoint, and fewer are drawn. */
static void test_single_training(void **state)
{
    char path[] = "/tmp/sg_single_XXXXXX";
    close(mkstemp(path));
    (void) state;
    struct fixture f = make_points(2);
    struct sg_train_params p = scaffold_params();
    struct sg_train_step s;
    uint64_t first = 0, last = 0;
    sg_trainer *t;
    p.engine = main_engine();
    p.defense.on = true;
    p.defense.rho = 0.3, p.defense.interval = 4, p.defense.views = 3;
    p.defense.unit = SG_UNIT_GAUSSIAN;
    p.densify_grad_threshold = 1e9f; /* none grows */
    f.scene.train = f.views;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_OK);
    const size_t anchors = sg_engine_count(t->engine);
    struct hidden before = hidden_of(t);
    for (int it = 1; it <= 36; it++) {
        if (sg_trainer_step(t, &s))
            fail_msg("%s", sg_last_error(f.ctx));
        assert_true(isfinite(s.loss));
        first = it == 6 ? s.render.visible : first;
        last = s.render.visible;
        const struct hidden now = hidden_of(t);
        for (size_t i = 0; i < now.count; i++)
            for (size_t k = 0; k < before.count; k++)
                assert_true(memcmp(now.at[i], before.at[k], sizeof(now.at[i])) != 0 ||
                            !(before.bits[k] & ~now.bits[i]));
        before = now;
        if (it == 20) {
            assert_int_equal(sg_trainer_save(t, path), SG_OK);
            sg_trainer_destroy(&t);
            t = resume_training(&f, &p, path);
        }
    }
    unsigned hidden = 0;
    for (size_t i = 0; i < before.count; i++)
        hidden += before.bits[i] > 0;
    assert_true(hidden > 10);
    assert_true(last < first);
    assert_in_range(sg_engine_count(t->engine), 1, anchors);
    sg_trainer_destroy(&t);
    p.defense.rho = -0.5;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    unlink(path);
    clear_points(&f);
}

/* Anchors that have grown, by the iteration in which they did. */
static size_t count_born(sg_trainer *t, int since)
{
    float born[4096] = {0};
    const size_t n = sg_engine_count(t->engine);
    size_t count = 0;
    assert_in_range(n, 1, 4096);
    assert_int_equal(
        sg_engine_download(t->engine, NULL, &(struct sg_columns){.at[SG_C_BORN] = born}), SG_OK);
    for (size_t i = 0; i < n; i++)
        count += born[i] > (float) since;
    return count;
}

/* In a training. A checkpoint keeps when anchors grew. */
static void test_grace(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_grace_XXXXXX";
    close(mkstemp(path));
    struct sg_model *model[2];
    struct fixture f = make_points(2);
    for (int resumed = 0; resumed < 2; resumed++) {
        struct sg_train_params p = scaffold_params();
        struct sg_train_step s;
        size_t born = 0, lost = 0;
        sg_trainer *t;
        p.engine = main_engine();
        p.defense.on = true;
        p.defense.rho = 0.3, p.defense.interval = 4, p.defense.views = 3;
        p.defense.grace = 9;
        f.scene.train = f.views;
        assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_OK);
        while (sg_trainer_iteration(t) < 36) {
            if (sg_trainer_step(t, &s))
                fail_msg("%s", sg_last_error(f.ctx));
            born += s.cloned / SG_ANCHOR_GAUSSIANS;
            if (s.cloned) /* all of the last 9 iterations are there */
                assert_true(count_born(t, s.iteration - 4) == s.cloned / SG_ANCHOR_GAUSSIANS);
            lost = born - count_born(t, 0);
            if (s.iteration <= 20)
                assert_true(lost == 0 && (s.iteration < 12 || born > 0));
            if (resumed && s.iteration == 22) {
                assert_int_equal(sg_trainer_save(t, path), SG_OK);
                sg_trainer_destroy(&t);
                t = resume_training(&f, &p, path);
                assert_int_equal(count_born(t, 0), born - lost);
            }
        }
        assert_true(lost > 0); /* of those that are older */
        assert_int_equal(sg_trainer_model(t, &model[resumed]), SG_OK);
        sg_trainer_destroy(&t);
    }
    assert_same_anchors(model[0], model[1]);
    for (int k = 0; k < 2; k++)
        sg_model_destroy(&model[k]);
    clear_points(&f);
    unlink(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scores), cmocka_unit_test(test_spared), cmocka_unit_test(test_single),
        cmocka_unit_test(test_single_training), cmocka_unit_test(test_grace)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
