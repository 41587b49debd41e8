/* SPDX-License-Identifier: Apache-2.0 */
/* Which anchors go: those without opacity, as in the released code of Scaffold-GS, and those with
 * the lowest scores of the filter. */
#include "math/real_f64.h"

#include "anchor_models.h"
#include "defense/filter.h"
#include "engine/ref/ref_neural.h"
#include "engine/ref/render.h"
#include "training_anchors.h"

/* ---- without opacity ---- */

#define APART 17 /* anchors with values of their own: each in another block */

/* What an anchor has that no view sees, before and after iteration 1600 of the released schedule.
 * It goes if it was seen in more than 80 views with less than 0.005 of opacity in each; either way
 * the two numbers begin anew after more than 80 views. */
static const struct {
    float seen, opacity;
    bool goes;
    float seen_after, opacity_after;
} unseen[] = {
    {81, 0.39f, true, 0, 0}, {81, 0.41f, false, 0, 0},    {80, 0, false, 80, 0},
    {200, 1, false, 0, 0},   {200, 0.99999f, true, 0, 0}, {0, 0, false, 0, 0},
    {79, 7, false, 79, 7},
};
#define UNSEEN (sizeof(unseen) / sizeof(unseen[0]))
#define GROWS 0   /* also what goes makes a new anchor before */
#define LARGE 1   /* with sizes above the limit */
#define OFFSETS 5 /* drawn in 41, 40 and 0 views */

static size_t place(size_t k)
{
    return APART * k + 3;
}

static float *statistic(const struct sg_columns *o, size_t i, int plane)
{
    return &o->at[SG_C_ANCHOR_STATISTICS][sg_param_index(SG_A_STATISTICS, i, plane)];
}

static float *value(const struct sg_columns *o, size_t i, int plane)
{
    return &o->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, plane)];
}

static void read_anchors(const sg_trainer *t, struct sg_model **m, struct sg_columns *o)
{
    const size_t n = sg_engine_count(t->engine);
    assert_int_equal(sg_model_create(t->ctx, n, 0, m), SG_OK);
    assert_int_equal(sg_columns_create(t->ctx, n, 0, SG_COLUMN_SAVED | SG_COLUMN_ANCHORS, o),
                     SG_OK);
    assert_int_equal(sg_engine_download(t->engine, *m, o), SG_OK);
}

/* Moves some anchors behind all cameras and gives them statistics. */
static void prepare(const sg_trainer *t)
{
    struct sg_model *m;
    struct sg_columns o;
    read_anchors(t, &m, &o);
    assert_true(m->count > place(UNSEEN - 1));
    assert_non_null(o.networks = sg_networks_create(t->ctx, 0));
    assert_int_equal(sg_engine_download(t->engine, NULL, &o), SG_OK);
    for (size_t i = 0; i < m->count; i++)
        for (int p = 0; p < SG_A_PLANES; p++) { /* Adam's moments, to know them by */
            const size_t at = sg_param_index(SG_A_PLANES, i, p);
            o.at[SG_C_ANCHOR_MOMENT1][at] = 1e-9f * (float) (i + 1);
            o.at[SG_C_ANCHOR_MOMENT2][at] = 1e-2f * (float) (p + 1);
        }
    for (size_t k = 0; k < UNSEEN; k++) {
        const size_t i = place(k);
        for (int axis = 0; axis < 3; axis++) {
            *sg_model_at(m, i, SG_P_XYZ + axis) = axis == 2 ? -50 : 10 * (float) k;
            *sg_model_at(m, i, SG_P_SCALE + axis) = logf(0.1f);
        }
        *statistic(&o, i, SG_A_SEEN) = unseen[k].seen;
        *statistic(&o, i, SG_A_OPACITY) = unseen[k].opacity;
    }
    for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++) { /* cell 4 of the grid with cells of 0.2 */
        for (int axis = 0; axis < 3; axis++)
            *value(&o, place(GROWS), SG_A_OFFSET + 3 * g + axis) = axis == 0 ? 7.1f : 0;
        *statistic(&o, place(GROWS), SG_A_DRAWN + g) = 50;
        *statistic(&o, place(GROWS), SG_A_GRADIENT + g) = 50 * 0.0003f;
    }
    *value(&o, place(LARGE), SG_A_SIZE + 1) = 0.2f;
    *value(&o, place(LARGE), SG_A_SIZE + 2) = 0.04f;
    *sg_model_at(m, place(LARGE), SG_P_SCALE + 1) = 0.2f; /* the offsets' unit has no limit */
    *statistic(&o, place(OFFSETS), SG_A_DRAWN) = 41;
    *statistic(&o, place(OFFSETS), SG_A_GRADIENT) = 41 * 0.0001f; /* too little to grow */
    *statistic(&o, place(OFFSETS), SG_A_DRAWN + 1) = 40;
    *statistic(&o, place(OFFSETS), SG_A_GRADIENT + 1) = 40 * 0.0003f; /* not drawn often enough */
    assert_int_equal(sg_engine_upload(t->engine, m, &o), SG_OK);
    sg_model_destroy(&m);
    sg_columns_clear(&o);
}

static void compare_number(const char *name, const char *what, size_t k, float found,
                           float expected)
{
    if (found != expected)
        fail_msg("%s: anchor %zu: found %s %g, expected %g", name, k, what, (double) found,
                 (double) expected);
}

/* One that stays has what it had, apart from too large sizes. */
static void compare_kept(const char *name, const struct sg_model *m, const struct sg_columns *o,
                         size_t i, const struct sg_model *before, const struct sg_columns *b,
                         size_t k)
{
    static const int columns[] = {SG_C_ANCHOR, SG_C_ANCHOR_MOMENT1, SG_C_ANCHOR_MOMENT2};
    for (int p = 0; p < sg_param_count(0); p++)
        compare_number(name, "a parameter", k, *sg_model_at(m, i, p), *sg_model_at(before, k, p));
    for (int c = 0; c < 3; c++)
        for (int p = 0; p < SG_A_PLANES; p++) {
            const float had = b->at[columns[c]][sg_param_index(SG_A_PLANES, k, p)];
            compare_number(name, sg_columns[columns[c]].name, k,
                           o->at[columns[c]][sg_param_index(SG_A_PLANES, i, p)],
                           columns[c] == SG_C_ANCHOR && p >= SG_A_SIZE ? fminf(had, 0.05f) : had);
        }
}

static void compare_statistics(const char *name, const struct sg_columns *o, size_t i, size_t k)
{
    compare_number(name, "views", k, *statistic(o, i, SG_A_SEEN), unseen[k].seen_after);
    compare_number(name, "opacity", k, *statistic(o, i, SG_A_OPACITY), unseen[k].opacity_after);
    for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++) {
        const bool waits = k == OFFSETS && g == 1;
        compare_number(name, "drawn", k, *statistic(o, i, SG_A_DRAWN + g), waits ? 40 : 0);
        compare_number(name, "gradient", k, *statistic(o, i, SG_A_GRADIENT + g),
                       waits ? 40 * 0.0003f : 0);
    }
}

/* The new one is where the anchor that goes had its Gaussians, and has nothing of its own yet. */
static void compare_new(const char *name, const struct sg_model *m, const struct sg_columns *o,
                        size_t i, const struct sg_columns *b)
{
    static const float position[] = {0.8f, 0, -50};
    for (int axis = 0; axis < 3; axis++) {
        assert_true(fabsf(*sg_model_at(m, i, SG_P_XYZ + axis) - position[axis]) < 1e-5f);
        assert_true(fabsf(*value(o, i, SG_A_SIZE + axis) - logf(0.2f)) < 1e-5f);
    }
    for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
        compare_number(name, "a feature", i, *value(o, i, SG_A_FEATURE + f),
                       *value(b, place(GROWS), SG_A_FEATURE + f));
    for (int p = 0; p < SG_A_STATISTICS; p++)
        compare_number(name, "a statistic", i, *statistic(o, i, p), 0);
    for (int p = 0; p < SG_A_PLANES; p++)
        compare_number(name, "a moment", i,
                       o->at[SG_C_ANCHOR_MOMENT2][sg_param_index(SG_A_PLANES, i, p)], 0);
}

static void check_opacity(struct engine_case c)
{
    const char *name = case_name(c);
    struct fixture f = make_points(2);
    struct sg_train_params p = sg_train_params_default();
    struct sg_train_step step;
    struct sg_model *before, *after;
    struct sg_columns b, o;
    sg_trainer *t;
    p.engine = c.engine, p.cpu = c.variant;
    p.model = SG_MODEL_SCAFFOLD;
    p.scaffold.voxel = 0.05f, p.scaffold.cells = 4;
    f.scene.train = f.views;
    if (sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t))
        fail_msg("%s", sg_last_error(f.ctx));
    prepare(t);
    t->iteration = 1598;
    assert_int_equal(sg_trainer_step(t, &step), SG_OK); /* the engine's own memory has them now */
    assert_int_equal(step.pruned, 0);
    read_anchors(t, &before, &b);
    for (size_t k = 0; k < UNSEEN; k++) {
        compare_number(name, "views", k, *statistic(&b, place(k), SG_A_SEEN), unseen[k].seen);
        compare_number(name, "opacity", k, *statistic(&b, place(k), SG_A_OPACITY),
                       unseen[k].opacity);
    }
    assert_int_equal(sg_trainer_step(t, &step), SG_OK);
    assert_int_equal(step.iteration, 1600);
    read_anchors(t, &after, &o);
    assert_int_equal(step.pruned, 2 * SG_ANCHOR_GAUSSIANS);
    assert_int_equal(step.cloned, SG_ANCHOR_GAUSSIANS);
    assert_int_equal(after->count, before->count - 1);
    size_t i = 0, next = 0;
    for (size_t k = 0; k < before->count; k++) {
        const bool own = next < UNSEEN && k == place(next);
        const size_t number = next;
        next += own;
        if (own && unseen[number].goes)
            continue;
        compare_kept(name, after, &o, i, before, &b, k);
        if (own)
            compare_statistics(name, &o, i, number);
        else /* too few views to begin anew */
            assert_true(*statistic(&o, i, SG_A_SEEN) > 0);
        i++;
    }
    assert_int_equal(i + 1, after->count);
    compare_new(name, after, &o, i, &b);
    assert_int_equal(sg_trainer_step(t, &step), SG_OK); /* it goes on with those that are left */
    assert_true(isfinite(step.loss) && step.pruned == 0);
    sg_columns_clear(&b);
    sg_columns_clear(&o);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

static void test_opacity(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    for (int k = 0, n = engine_cases(cases); k < n; k++)
        check_opacity(cases[k]);
}

/* ---- by the filter's score ---- */

#define W 37
#define H 29
#define GRID(n) (((n) + SG_TILE - 1) / SG_TILE)
#define SCORED 24
#define BEHIND 4 /* every so many one is behind the cameras */
#define SHARE 0.375
#define LOWEST ((size_t) (SHARE * SCORED))

/* The Gaussians that a view draws, in the order of their anchors. */
struct drawn {
    struct ref_splat splats[SCORED * SG_ANCHOR_GAUSSIANS];
    double log_smallest[SCORED * SG_ANCHOR_GAUSSIANS], hits[SCORED * SG_ANCHOR_GAUSSIANS];
    size_t anchor[SCORED * SG_ANCHOR_GAUSSIANS], count;
};

static void generate(const struct sg_model *m, const struct sg_camera *camera, struct drawn *d)
{
    static struct ref_weights w;
    const struct pinhole view = view_make(camera);
    const float *weights = (const float *) &m->columns->networks->value;
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        ((double *) &w)[i] = (double) weights[i];
    d->count = 0;
    for (size_t i = 0; i < m->count; i++) {
        double drawn[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
        bool exists[SG_ANCHOR_GAUSSIANS];
        const struct ref_view from = {{view.centre[0], view.centre[1], view.centre[2]}, 0, {0}};
        struct ref_anchor a;
        if (i % BEHIND == BEHIND - 1)
            continue;
        for (int k = 0; k < 3; k++) {
            a.position[k] = (double) *sg_model_at(m, i, SG_P_XYZ + k);
            a.reach[k] = (double) *sg_model_at(m, i, SG_P_SCALE + k);
        }
        for (int p = 0; p < SG_A_PLANES; p++)
            a.anchor[p] = (double) *value(m->columns, i, p);
        ref_neural_forward(&w, &a, &from, drawn, exists);
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
            double params[SG_PARAMS_MAX] = {0};
            if (!exists[k])
                continue;
            memcpy(params, drawn[k], sizeof(drawn[k]));
            ref_project(&view, params, 0, GRID(W), GRID(H), &d->splats[d->count]);
            d->log_smallest[d->count] = fmin(fmin(drawn[k][SG_P_SCALE], drawn[k][SG_P_SCALE + 1]),
                                             drawn[k][SG_P_SCALE + 2]);
            d->hits[d->count] = 0;
            d->anchor[d->count++] = i;
        }
    }
}

/* Pixels that each is blended in, or its weight there. */
static void count_pixels(struct drawn *d, bool weighs)
{
    static struct ref_entry list[SCORED * SG_ANCHOR_GAUSSIANS];
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
            const size_t n = ref_tile_list(d->splats, d->count, x / SG_TILE, y / SG_TILE, list);
            double clear = 1, dx, dy, gauss, alpha;
            for (size_t k = 0; k < n; k++) {
                if (!ref_pair(&d->splats[list[k].id], x, y, &dx, &dy, &gauss, &alpha))
                    continue;
                if (clear * (1 - alpha) < (double) SG_T_MIN)
                    break;
                d->hits[list[k].id] += weighs ? alpha * clear : 1;
                clear *= 1 - alpha;
            }
        }
}

/* By the definition: over views and the Gaussians drawn in them the sum of hits, each with the
 * weight of that Gaussian's size in this view, or of the anchor's. most: the weight of a pixel. */
static void score_plainly(const struct sg_model *m, const struct sg_view *views,
                          const struct sg_defense_params *p, double *score, double *most)
{
    static struct drawn d;
    const double factor = -2 * M_PI * M_PI * p->frequency * p->frequency;
    memset(score, 0, SCORED * sizeof(double));
    memset(most, 0, SCORED * sizeof(double));
    for (int v = 0; v < VIEWS; v++) {
        double seen[SCORED] = {0}, weight[SCORED * SG_ANCHOR_GAUSSIANS];
        generate(m, &views[v].camera, &d);
        count_pixels(&d, p->hit == SG_HIT_WEIGHT);
        for (size_t k = 0; k < d.count; k++) {
            const size_t i = d.anchor[k];
            double size = d.log_smallest[k];
            if (p->anchor_sigma == SG_ANCHOR_SIGMA_ANCHOR)
                size = fmin(fmin((double) *value(m->columns, i, SG_A_SIZE),
                                 (double) *value(m->columns, i, SG_A_SIZE + 1)),
                            (double) *value(m->columns, i, SG_A_SIZE + 2));
            weight[k] = pow(1 - exp(factor * exp(2 * size)), p->exponent);
            most[i] = fmax(most[i], weight[k]);
            if (p->hit != SG_HIT_VIEWS)
                score[i] += weight[k] * d.hits[k];
            else if (d.hits[k] > 0 && p->anchor_sigma == SG_ANCHOR_SIGMA_NEURAL)
                score[i] += weight[k];
            else if (d.hits[k] > 0) /* the view counts once */
                seen[i] = weight[k];
        }
        for (size_t i = 0; i < SCORED; i++)
            score[i] += seen[i];
    }
}

static struct sg_model *make_scored(sg_ctx *ctx)
{
    struct sg_model *m = make_anchors(ctx, SCORED, 70);
    m->columns->networks->parts = 0;
    for (size_t i = 0; i < SCORED; i++) {
        if (i % BEHIND == BEHIND - 1)
            *sg_model_at(m, i, SG_P_XYZ + 2) = -20;
        for (int k = 0; k < 3; k++) /* of assorted sizes */
            *value(m->columns, i, SG_A_SIZE + k) += draw(75, 3 * i + (size_t) k, -2, 0.5f);
    }
    return m;
}

/* Those that stay are those that do not have the lowest scores, in their order. */
static void compare_filtered(const char *name, const struct sg_engine *engine,
                             const struct sg_model *m, const struct sg_defense_step *step,
                             const double *score)
{
    struct sg_model *after;
    double lowest = INFINITY, highest = 0;
    size_t k = 0;
    assert_true(step->filtered);
    assert_int_equal(step->scored, SCORED);
    assert_int_equal(step->unseen, SCORED / BEHIND);
    assert_int_equal(step->removed, LOWEST);
    assert_int_equal(sg_model_create(sg_engine_ctx(engine), SCORED - LOWEST, 0, &after), SG_OK);
    assert_int_equal(sg_engine_count(engine), after->count);
    assert_int_equal(sg_engine_download((struct sg_engine *) engine, after, NULL), SG_OK);
    for (size_t i = 0; i < SCORED; i++) {
        const bool stays =
            k < after->count && *sg_model_at(after, k, SG_P_XYZ) == *sg_model_at(m, i, SG_P_XYZ);
        k += stays;
        if (stays)
            lowest = fmin(lowest, score[i]);
        else
            highest = fmax(highest, score[i]);
    }
    assert_int_equal(k, after->count);
    if (!(highest > 0 && highest < 1.02 * lowest))
        fail_msg("%s: found one of score %g removed, expected less than %g", name, highest, lowest);
    sg_model_destroy(&after);
}

static void check_scores(struct engine_case c, const struct sg_defense_params *p)
{
    char name[64];
    sg_ctx *ctx = make_context(2);
    struct sg_view views[VIEWS];
    struct sg_scene scene = {.path = (char *) "views", .train = views, .n_train = VIEWS};
    struct sg_render_params render = sg_render_params_default();
    struct sg_model *m = make_scored(ctx);
    struct sg_engine *e = make_scaffold(ctx, c, m);
    struct sg_defense_step step = {0};
    struct sg_scores s;
    double score[SCORED], most[SCORED];
    for (int v = 0; v < VIEWS; v++)
        views[v] = (struct sg_view){.name = (char *) "view",
                                    .camera = make_camera(W, H, 2.2 + 0.3 * (double) v)};
    snprintf(name, sizeof(name), "%s: size %d, hit %d", case_name(c), (int) p->anchor_sigma,
             (int) p->hit);
    score_plainly(m, views, p, score, most);
    assert_int_equal(sg_score(e, &scene, p, &render, 1, 100, &s), SG_OK);
    assert_int_equal(s.count, SCORED);
    for (size_t i = 0; i < SCORED; i++) {
        const double found = exp(s.score[i]); /* a few pixels may be on either side of a cut-off */
        const double off = p->hit == SG_HIT_PIXELS ? 2 * most[i] : 0;
        if (!(fabs(found - score[i]) <= 1e-3 * score[i] + off) || (score[i] > 0) != (found > 0))
            fail_msg("%s: anchor %zu: score %g, expected %g", name, i, found, score[i]);
        assert_true((score[i] > 0) == (i % BEHIND != BEHIND - 1));
    }
    sg_scores_clear(&s);
    assert_int_equal(sg_filter(e, &scene, p, &render, SHARE, 1, 100, &step), SG_OK);
    compare_filtered(name, e, m, &step, score);
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* On every engine, of either size, with each kind of hit. */
static void test_scores(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    struct sg_defense_params p = sg_defense_params_default();
    p.frequency = 1; /* sizes matter */
    p.sample = SG_VIEWS_ALL;
    for (int k = 0, n = engine_cases(cases); k < n; k++)
        for (int i = 0; i < 6; i++) {
            p.anchor_sigma = i % 2 ? SG_ANCHOR_SIGMA_ANCHOR : SG_ANCHOR_SIGMA_NEURAL;
            p.hit = (enum sg_hit)(i / 2);
            check_scores(cases[k], &p);
        }
}

/* A checkpoint can say so of every offset: nothing is left to score, and nothing goes. */
static void test_all_hidden(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    struct sg_defense_params p = sg_defense_params_default();
    p.unit = SG_UNIT_GAUSSIAN;
    p.sample = SG_VIEWS_ALL;
    for (int k = 0, n = engine_cases(cases); k < n; k++)
        for (int rule = SG_PRUNE_EXACT; rule <= SG_PRUNE_THRESHOLD; rule++) {
            sg_ctx *ctx = make_context(2);
            struct sg_view view = {.name = (char *) "view", .camera = make_camera(W, H, 2.2)};
            struct sg_scene scene = {.path = (char *) "views", .train = &view, .n_train = 1};
            const struct sg_render_params render = sg_render_params_default();
            struct sg_model *m = make_scored(ctx);
            struct sg_engine *e = make_scaffold(ctx, cases[k], m);
            struct sg_defense_step step = {0};
            uint32_t hidden[SCORED];
            memset(hidden, 0xff, sizeof(hidden));
            p.rule = (enum sg_prune_rule) rule;
            assert_int_equal(sg_engine_hide(e, hidden), SG_OK);
            assert_int_equal(sg_filter(e, &scene, &p, &render, SHARE, 1, 100, &step), SG_OK);
            assert_true(step.filtered && !step.scored && !step.removed && !step.unseen);
            assert_int_equal(sg_engine_count(e), SCORED);
            sg_engine_destroy(&e);
            sg_model_destroy(&m);
            sg_ctx_destroy(&ctx);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_opacity),
                                       cmocka_unit_test(test_scores),
                                       cmocka_unit_test(test_all_hidden)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
