/* SPDX-License-Identifier: Apache-2.0 */
/* Trainings of anchors: what is the same, what a checkpoint keeps, and what limits do. */
#include <unistd.h>

#include "train/schedule.h"
#include "races.h"
#include "training_anchors.h"

static sg_trainer *begin(struct fixture *f, const struct sg_train_params *p)
{
    sg_trainer *t;
    f->scene.train = f->views;
    if (sg_trainer_create(f->ctx, &f->scene, NULL, p, &t))
        fail_msg("%s", sg_last_error(f->ctx));
    return t;
}

struct course {
    double loss[40];
    size_t gaussians[40];
};

static struct sg_model *run(struct fixture *f, sg_trainer *t, int until, struct course *course)
{
    struct sg_model *m;
    struct sg_train_step s;
    while (sg_trainer_iteration(t) < until) {
        if (sg_trainer_step(t, &s))
            fail_msg("%s", sg_last_error(f->ctx));
        course->loss[s.iteration - 1] = s.loss;
        course->gaussians[s.iteration - 1] = s.gaussians;
        assert_true(isfinite(s.loss));
    }
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    return m;
}

/* It learns and grows, and the same bytes come from any number of threads. */
static void test_threads(void **state)
{
    (void) state;
    struct course first_course = {0};
    char path[] = "/tmp/sg_scaffold_XXXXXX";
    close(mkstemp(path));
    for (int threads = 1; threads <= 3; threads++) {
        struct fixture f = make_points(threads);
        struct course course;
        const struct sg_train_params p = scaffold_params();
        sg_trainer *t = begin(&f, &p);
        const size_t before = sg_trainer_gaussians(t);
        struct sg_model *m = run(&f, t, 40, &course);
        assert_int_equal(before % SG_ANCHOR_GAUSSIANS, 0);
        assert_int_equal(sg_trainer_gaussians(t), m->count * SG_ANCHOR_GAUSSIANS);
        assert_true(course.gaussians[39] > before);
        assert_true(course.gaussians[10] == before && course.gaussians[11] > before);
        assert_true(course.loss[38] + course.loss[37] < 0.7 * (course.loss[0] + course.loss[1]));
        if (threads > 1)
            assert_memory_equal(&course, &first_course, sizeof(course));
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        static char kept[1 << 22], now[1 << 22];
        FILE *file = fopen(path, "rb");
        assert_non_null(file);
        const size_t size = fread(now, 1, sizeof(now), file);
        fclose(file);
        assert_in_range(size, 1000, sizeof(now) - 1);
        if (threads > 1)
            assert_memory_equal(kept, now, size);
        memcpy(kept, now, size);
        first_course = course;
        sg_trainer_destroy(&t);
        sg_model_destroy(&m);
        clear_points(&f);
    }
    unlink(path);
}

/* On every engine: the same bytes from any number of threads, and the losses of the oracle, also
 * where anchors grow and masks leave pixels out. */
static void test_engines(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    struct course expected;
    static uint8_t mask[SIDE * SIDE];
    const int n = engine_cases(cases);
    for (int i = 0; i < SIDE * SIDE; i++)
        mask[i] = i % SIDE < SIDE / 2 ? 255 : 0;
    for (int k = n - 1; k >= 0; k--) { /* the oracle first */
        struct sg_model *m[2];
        struct fixture fixtures[2]; /* their contexts outlive the models */
        for (int threads = 1; threads <= 2; threads++) {
            struct fixture *f = &fixtures[threads - 1];
            struct sg_train_params p = scaffold_params();
            struct course course;
            p.engine = cases[k].engine, p.cpu = cases[k].variant;
            *f = make_points(3 * threads - 2);
            f->views[1].mask = mask;
            sg_trainer *t = begin(f, &p);
            m[threads - 1] = run(f, t, 16, &course);
            assert_true(course.gaussians[15] > course.gaussians[0]);
            if (k == n - 1)
                expected = course;
            for (int i = 0; i < 16; i++)
                if (!(fabs(course.loss[i] - expected.loss[i]) < 1e-3 * expected.loss[i]))
                    fail_msg("%s: iteration %d: loss %g, expected %g", case_name(cases[k]), i + 1,
                             course.loss[i], expected.loss[i]);
            sg_trainer_destroy(&t);
        }
        assert_same_anchors(m[0], m[1]);
        for (int i = 0; i < 2; i++) {
            sg_model_destroy(&m[i]);
            clear_points(&fixtures[i]);
        }
    }
}

/* A run of `first` that is saved after `at` iterations goes on with `then` as the whole one. */
static void assert_goes_on(struct fixture *f, const struct sg_train_params *first, int at,
                           const struct sg_train_params *then, const char *path,
                           const struct sg_model *expected, const struct course *whole)
{
    struct course part;
    sg_trainer *t = begin(f, first);
    struct sg_model *unused = run(f, t, at, &part), *found;
    assert_int_equal(sg_trainer_save(t, path), SG_OK);
    sg_trainer_destroy(&t);
    t = resume_training(f, then, path);
    found = run(f, t, 40, &part);
    assert_memory_equal(whole, &part, sizeof(*whole));
    assert_same_anchors(expected, found);
    sg_trainer_destroy(&t);
    sg_model_destroy(&unused);
    sg_model_destroy(&found);
}

/* A resumed run has the bytes of one that was not interrupted. */
static void test_resume(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_scaffold_XXXXXX";
    close(mkstemp(path));
    for (int at = 5; at < 40; at += 8) { /* 5, 13, ..., between growths; one before any */
        struct fixture f = make_points(2);
        struct course whole;
        struct sg_train_params p = scaffold_params();
        p.scaffold.distance = at > 20, p.scaffold.bank = at > 10, p.scaffold.appearance = at > 25;
        sg_trainer *t = begin(&f, &p);
        struct sg_model *expected = run(&f, t, 40, &whole);
        sg_trainer_destroy(&t);
        assert_goes_on(&f, &p, at, &p, path, expected, &whole);
        sg_model_destroy(&expected);
        clear_points(&f);
    }
    /* Another model's run is refused, and a file that was altered. */
    struct fixture f = make_points(1);
    struct sg_train_params other = scaffold_params();
    f.scene.train = f.views;
    sg_trainer *t;
    other.scaffold.cells = 8;
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
    sg_clear_error(f.ctx);
    other = short_params();
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
    sg_clear_error(f.ctx);
    other = scaffold_params();
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    fseek(file, -5000, SEEK_END);
    fputc('x', file);
    fclose(file);
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
    sg_clear_error(f.ctx);
    assert_int_equal(truncate(path, 4000), 0);
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
    sg_clear_error(f.ctx);
    clear_points(&f);
    unlink(path);
}

/* A run that has ended and goes on is one that was longer from the beginning. */
static void test_longer(void **state)
{
    (void) state;
    skip_without_races();
    char path[] = "/tmp/sg_scaffold_XXXXXX";
    struct fixture f = make_points(2);
    struct sg_train_params p = scaffold_params(), shorter;
    struct course whole;
    p.densify_grad_threshold = 3e-4f; /* that some reach */
    shorter = p;
    sg_trainer *t = begin(&f, &p);
    struct sg_model *expected = run(&f, t, 40, &whole);
    sg_trainer_destroy(&t);
    close(mkstemp(path));
    for (int end = 1; end < 40; end += 9) { /* 28: of growth */
        shorter.iterations = end;
        assert_goes_on(&f, &shorter, end, &p, path, expected, &whole);
    }
    unlink(path);
    sg_model_destroy(&expected);
    clear_points(&f);
}

/* Optional parts learn, and help. A run without them refuses their checkpoints, and the other way
 * round. */
static void test_parts(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_scaffold_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_points(2);
    struct sg_train_params p = scaffold_params(), other = p;
    struct course plain, course;
    sg_trainer *t = begin(&f, &p);
    sg_model_destroy(&(struct sg_model *){run(&f, t, 40, &plain)});
    sg_trainer_destroy(&t);
    p.scaffold.distance = p.scaffold.bank = p.scaffold.appearance = true;
    t = begin(&f, &p);
    struct sg_model *before, *after;
    assert_int_equal(sg_trainer_model(t, &before), SG_OK);
    after = run(&f, t, 40, &course);
    const struct sg_weights *w[2] = {&before->columns->networks->value,
                                     &after->columns->networks->value};
    assert_true(memcmp(w[0]->distance, w[1]->distance, sizeof(w[0]->distance)) != 0);
    for (int j = 0; j < SG_BANK_OUTPUTS; j++)
        assert_true(w[0]->bank_bias[j] != w[1]->bank_bias[j]);
    assert_int_equal(after->columns->networks->photos, VIEWS);
    for (size_t i = 0; i < VIEWS; i++) { /* as far apart as normal numbers are at the start */
        float *start = before->columns->networks->appearance[i].value, sum = 0;
        for (int k = 0; k < SG_APPEARANCE; k++) {
            assert_true(start[k] != after->columns->networks->appearance[i].value[k]);
            sum += start[k] * start[k] / SG_APPEARANCE;
        }
        assert_true(sum > 0.4f && sum < 2);
    }
    assert_true(course.loss[39] < 1.1 * plain.loss[39]);
    assert_int_equal(sg_trainer_save(t, path), SG_OK);
    sg_trainer_destroy(&t);
    f.scene.train = f.views;
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
    sg_clear_error(f.ctx);
    other = p;
    other.scaffold.bank = false;
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, path, &other, &t), SG_ERR_INPUT);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    clear_points(&f);
    unlink(path);
}

/* Adam does not move anchors in iterations in which they grow, but always moves the networks, and
 * anchors that the view did not see, by their momentum. */
static void test_steps(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_points(1);
    struct sg_train_params p = scaffold_params();
    p.densify_grad_threshold = 1e9f; /* none grows */
    struct course course;
    sg_trainer *t = begin(&f, &p);
    struct sg_model *before = run(&f, t, 11, &course), *after = run(&f, t, 12, &course);
    assert_same(before, after);
    assert_memory_equal(before->columns->at[SG_C_ANCHOR], after->columns->at[SG_C_ANCHOR],
                        before->capacity * SG_A_PLANES * sizeof(float));
    assert_true(memcmp(before->columns->networks, after->columns->networks,
                       sizeof(struct sg_networks)) != 0);
    assert_int_equal(t->adam_steps[SG_G_FEATURE], 11);
    sg_model_destroy(&before);
    before = run(&f, t, 13, &course);
    size_t same = 0;
    for (size_t i = 0; i < before->count; i++)
        same += before->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, SG_A_FEATURE)] ==
                after->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, SG_A_FEATURE)];
    assert_true(same < before->count / 4);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    before = run(&f, t, p.iterations - 1, &course);
    after = run(&f, t, p.iterations, &course); /* the last iteration takes no step */
    assert_same_anchors(before, after);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    sg_trainer_destroy(&t);

    p = scaffold_params();
    p.iterations = 24; /* nor does it let anchors grow */
    t = begin(&f, &p);
    sg_model_destroy(&(struct sg_model *){run(&f, t, 19, &course)});
    const size_t earlier = sg_trainer_gaussians(t);
    before = run(&f, t, p.iterations - 1, &course);
    assert_true(sg_trainer_gaussians(t) > earlier);
    after = run(&f, t, p.iterations, &course);
    assert_same_anchors(before, after);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

/* To how far two numbers are apart. */
static void widen(double *most, float a, float b)
{
    *most = fmax(*most, fabs((double) a - (double) b));
}

/* Rates at half of the published schedule. The first step of Adam is as long as the rate, in each
 * group of anchors' numbers and each network. Features are 0 before it, so that of the feature bank
 * is 0, and the second one shorter. */
static void test_rates(void **state)
{
    (void) state;
    skip_without_races();
    sg_trainer published = {.params = sg_train_params_default(), .extent = 3};
    const struct sg_scaffold_params *s = &published.params.scaffold;
    const float pairs[SG_NETWORK_RATES][2] = {{s->opacity_lr_init, s->opacity_lr_final},
                                              {s->covariance_lr_init, s->covariance_lr_final},
                                              {s->colour_lr_init, s->colour_lr_final},
                                              {s->bank_lr_init, s->bank_lr_final},
                                              {s->appearance_lr_init, s->appearance_lr_final}};
    static const double half[SG_NETWORK_RATES] = {2e-4, 0.004, 6.3246e-4, 3.1623e-4, 0.005};
    double lr[SG_GROUPS];
    for (int n = 0; n < SG_NETWORK_RATES; n++)
        assert_float_equal(sg_falling_lr(&published.params, 15000, pairs[n][0], pairs[n][1]),
                           half[n], 1e-4 * half[n]);
    sg_strategy_scaffold.rates(&published, 14999, 15000, lr);
    assert_float_equal(lr[SG_G_OFFSET], 0.003, 1e-8);
    assert_float_equal(lr[SG_G_FEATURE], 0.0075, 1e-8);
    assert_float_equal(lr[SG_G_SCALE], 0.007, 1e-8);
    assert_true(lr[SG_G_OPACITY] == 0 && lr[SG_G_ROT] == 0);

    struct fixture f = make_points(1);
    struct sg_train_params p = scaffold_params();
    p.scaffold.distance = p.scaffold.bank = p.scaffold.appearance = true;
    struct course course;
    sg_trainer *t = begin(&f, &p);
    struct sg_model *m[3];
    double most[2][SG_NETWORK_RATES] = {{0}}, anchors[3] = {0};
    assert_int_equal(sg_trainer_model(t, &m[0]), SG_OK);
    for (int it = 1; it <= 2; it++) {
        const size_t view = sg_trainer_pick_view(t, (uint64_t) it);
        m[it] = run(&f, t, it, &course);
        const struct sg_networks *now = m[it]->columns->networks,
                                 *before = m[it - 1]->columns->networks;
        for (size_t i = 0; i < SG_WEIGHTS; i++)
            widen(&most[it - 1][sg_weight_network(i)], ((const float *) &now->value)[i],
                  ((const float *) &before->value)[i]);
        for (int k = 0; k < SG_APPEARANCE; k++)
            widen(&most[it - 1][SG_N_APPEARANCE], now->appearance[view].value[k],
                  before->appearance[view].value[k]);
    }
    for (int k = 0; k < SG_NETWORK_RATES; k++) {
        const int it = k == SG_N_BANK ? 2 : 1; /* of Adam's second step: 0.1 / 0.19 and the root */
        const double rate = sg_falling_lr(&p, it, pairs[k][0], pairs[k][1]) *
                            (it == 1 ? 1 : 0.1 / 0.19 * sqrt(0.001999 / 0.001)),
                     found = most[it - 1][k];
        if (fabs(found - rate) > 1e-3 * rate || (it == 2 && most[0][k] != 0))
            fail_msg("network %d: a step of %g, expected %g", k, found, rate);
    }
    for (size_t i = 0; i < m[0]->count; i++)
        for (int plane = 0; plane < SG_A_PLANES; plane++) {
            const size_t at = sg_param_index(SG_A_PLANES, i, plane);
            widen(&anchors[plane < SG_A_FEATURE ? 0
                           : plane < SG_A_SIZE  ? 1
                                                : 2],
                  m[1]->columns->at[SG_C_ANCHOR][at], m[0]->columns->at[SG_C_ANCHOR][at]);
        }
    sg_strategy_scaffold.rates(t, 0, 1, lr);
    assert_float_equal(anchors[0], lr[SG_G_OFFSET], 1e-3 * lr[SG_G_OFFSET]);
    assert_float_equal(anchors[1], lr[SG_G_FEATURE], 1e-3 * lr[SG_G_FEATURE]);
    assert_float_equal(anchors[2], lr[SG_G_SCALE], 1e-3 * lr[SG_G_SCALE]);
    for (int k = 0; k < 3; k++)
        sg_model_destroy(&m[k]);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

/* The numbers of all photos move in each iteration, those of other views by their momentum. */
static void test_momentum(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_points(1);
    struct sg_train_params p = scaffold_params();
    struct course course;
    p.scaffold.appearance = true;
    sg_trainer *t = begin(&f, &p);
    struct sg_model *before = run(&f, t, VIEWS, &course), *after = run(&f, t, VIEWS + 1, &course);
    for (size_t i = 0; i < VIEWS; i++)
        for (int k = 0; k < SG_APPEARANCE; k++)
            assert_true(before->columns->networks->appearance[i].value[k] !=
                        after->columns->networks->appearance[i].value[k]);
    sg_model_destroy(&before);
    sg_model_destroy(&after);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

/* Makes the networks say the same of all Gaussians: that they are drawn, or not. */
static void draw_all(sg_trainer *t, bool drawn)
{
    struct sg_model *m;
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    for (int o = 0; o < SG_ANCHOR_GAUSSIANS; o++) { /* tanh(1) */
        m->columns->networks->value.bias[SG_O_OPACITY + o] = drawn ? 1 : -1;
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            m->columns->networks->value.output[SG_O_OPACITY + o][h] = 0;
    }
    assert_int_equal(sg_engine_upload(t->engine, m, m->columns), SG_OK);
    sg_model_destroy(&m);
}

/* A view counts an anchor that it sees, also one that draws nothing there, which adds no opacity:
 * else the emptiest would never go. */
static void test_seen(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    for (int k = 0, n = engine_cases(cases); k < n; k++) {
        struct fixture f = make_points(2);
        struct sg_train_params p = scaffold_params();
        struct sg_columns o[2];
        size_t count = 0;
        double seen = 0;
        p.engine = cases[k].engine, p.cpu = cases[k].variant;
        p.scaffold.from = 1000; /* statistics begin after iteration 2 */
        p.scaffold.scaling_lr = 0;
        for (int drawn = 0; drawn < 2; drawn++) {
            sg_trainer *t = begin(&f, &p);
            draw_all(t, drawn);
            while (sg_trainer_iteration(t) < 10)
                assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
            count = sg_engine_count(t->engine);
            assert_int_equal(
                sg_columns_create(f.ctx, count, 0, SG_COLUMN_SAVED | SG_COLUMN_ANCHORS, &o[drawn]),
                SG_OK);
            assert_int_equal(sg_engine_download(t->engine, NULL, &o[drawn]), SG_OK);
            sg_trainer_destroy(&t);
        }
        for (size_t i = 0; i < count; i++) {
            const float *a[2];
            for (int drawn = 0; drawn < 2; drawn++)
                a[drawn] =
                    o[drawn].at[SG_C_ANCHOR_STATISTICS] + sg_param_index(SG_A_STATISTICS, i, 0);
            assert_true(a[0][SG_A_SEEN * SG_LANES] == a[1][SG_A_SEEN * SG_LANES]);
            assert_true(a[0][SG_A_OPACITY * SG_LANES] == 0);
            assert_true((a[1][SG_A_OPACITY * SG_LANES] > 0) == (a[1][SG_A_SEEN * SG_LANES] > 0));
            seen += (double) a[0][SG_A_SEEN * SG_LANES];
        }
        assert_true(seen > 4 * (double) count && seen <= 8 * (double) count);
        for (int drawn = 0; drawn < 2; drawn++)
            sg_columns_clear(&o[drawn]);
        clear_points(&f);
    }
}

/* A view that draws nothing has a loss, and leaves no NaN. */
static void test_nothing_drawn(void **state)
{
    (void) state;
    struct fixture f = make_points(1);
    struct sg_train_params p = scaffold_params();
    struct course course;
    p.scaffold.from = 1000;
    sg_trainer *t = begin(&f, &p);
    draw_all(t, false);
    struct sg_model *m = run(&f, t, 10, &course);
    const float *w = (const float *) m->columns->networks;
    for (size_t i = 0; i < sizeof(*m->columns->networks) / sizeof(float); i++)
        assert_true(isfinite(w[i]));
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

/* Limits count the Gaussians that anchors can be drawn as. */
static void test_limits(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_points(1);
    struct sg_train_params p = scaffold_params();
    struct course course;
    struct sg_train_limits limits;
    sg_trainer *t = begin(&f, &p);
    const size_t first = sg_trainer_gaussians(t);
    sg_trainer_destroy(&t);
    p.max_gaussians = first + 95;
    t = begin(&f, &p);
    struct sg_model *m = run(&f, t, 40, &course);
    for (int i = 0; i < 40; i++)
        assert_true(course.gaussians[i] <= p.max_gaussians);
    assert_int_equal(course.gaussians[39], first + 90);
    sg_trainer_limits(t, &limits);
    assert_true(limits.gaussians_bound);
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    p.max_gaussians = 100;
    t = begin(&f, &p);
    assert_int_equal(sg_trainer_gaussians(t), 100);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

/* The memory that the plan allows is enough, also for checkpoints and measurements. */
static void test_memory(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture f = make_points(2);
    struct sg_train_params p = scaffold_params();
    struct sg_train_limits limits;
    struct sg_train_step s;
    f.scene.train = f.views;
    char path[] = "/tmp/sg_scaffold_XXXXXX";
    close(mkstemp(path));
    const uint64_t limit = 13 << 20;
    sg_ctx *ctx;
    sg_trainer *t;
    sg_renderer *renderer;
    struct sg_eval eval;
    p.iterations = 120, p.densify_until_iter = 110;
    p.scaffold.voxel = 0.004f;
    p.densify_grad_threshold = 0;
    assert_int_equal(
        sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 2, .max_memory = limit}), SG_OK);
    if (sg_trainer_create(ctx, &f.scene, NULL, &p, &t))
        fail_msg("%s", sg_last_error(ctx));
    sg_trainer_limits(t, &limits);
    assert_true(limits.by_memory);
    assert_in_range(limits.max_gaussians, 2000, 12000);
    while (sg_trainer_iteration(t) < p.iterations) {
        if (sg_trainer_step(t, &s))
            fail_msg("%s", sg_last_error(ctx));
        assert_true(s.gaussians <= limits.max_gaussians);
        if (s.iteration % 50 == 0)
            assert_int_equal(sg_trainer_save(t, path), SG_OK);
    }
    assert_int_equal(sg_trainer_renderer(t, &renderer), SG_OK);
    assert_int_equal(sg_evaluate(ctx, renderer, f.views, 1, NULL, &eval), SG_OK);
    sg_eval_clear(&eval);
    sg_renderer_destroy(&renderer);
    sg_trainer_limits(t, &limits);
    assert_true(limits.gaussians_bound);
    assert_true(sg_trainer_gaussians(t) > limits.max_gaussians * 9 / 10);
    assert_true(sg_mem_peak(ctx, SG_MEM_TAGS) <= limit);
    sg_trainer_destroy(&t);
    sg_ctx_destroy(&ctx);
    unlink(path);
    clear_points(&f);
}

/* The filter removes the share of the anchors, with either size, after they grew. */
static void test_filter(void **state)
{
    (void) state;
    for (int sigma = 0; sigma < 2; sigma++) {
        struct fixture f = make_points(2);
        struct sg_train_params p = scaffold_params();
        p.defense.on = true;
        p.defense.rho = 0.2;
        p.defense.interval = 4;
        p.defense.views = 3;
        p.defense.anchor_sigma = (enum sg_anchor_sigma) sigma;
        sg_trainer *t = begin(&f, &p);
        struct sg_train_step s;
        size_t filtered = 0;
        while (sg_trainer_iteration(t) < 40) {
            if (sg_trainer_step(t, &s))
                fail_msg("%s", sg_last_error(f.ctx));
            filtered += s.defense.filtered;
            assert_true(s.defense.filtered ==
                        (s.iteration >= 12 && s.iteration < 35 && s.iteration % 4 == 0));
            if (s.defense.filtered)
                assert_int_equal(s.defense.removed,
                                 s.defense.scored / SG_ANCHOR_GAUSSIANS / 5 * SG_ANCHOR_GAUSSIANS);
        }
        assert_int_equal(filtered, 6);
        sg_trainer_destroy(&t);
        clear_points(&f);
    }
}

/* What the constants of the released code change, where they are given other values. */
static void test_constants(void **state)
{
    (void) state;
    struct fixture f = make_points(2);
    struct course course;
    enum { PLAIN, EVERY, GRIDS, FINER, SEEN, OPACITY, VOLUME, CASES };
    size_t first[CASES], count[CASES];
    double size[CASES];
    f.scene.train = f.views;
    for (int i = 0; i < CASES; i++) {
        struct sg_train_params p = scaffold_params();
        struct sg_train_step s = {0};
        size_t removed = 0;
        p.engine = main_engine();
        p.scaffold.every = i == EVERY ? 3 : 1;
        p.scaffold.grids = i == GRIDS ? 1 : 3;
        p.scaffold.finer = i == FINER ? 2 : 4;
        p.scaffold.seen = i == SEEN ? 1 : 0.8f;
        p.scaffold.min_opacity = i == OPACITY ? 10 : 0.005f;
        p.scaffold.volume = i == VOLUME ? 1000 : 0.01f;
        sg_trainer *t = begin(&f, &p);
        first[i] = sg_trainer_gaussians(t) / SG_ANCHOR_GAUSSIANS;
        while (sg_trainer_iteration(t) < 12) {
            if (sg_trainer_step(t, &s))
                fail_msg("%s", sg_last_error(f.ctx));
            removed += s.pruned;
        }
        assert_true(removed == 0 || i == OPACITY);
        assert_true(removed > 0 || i != OPACITY);
        struct sg_model *m = run(&f, t, 13, &course);
        count[i] = m->count, size[i] = 0;
        for (size_t k = 0; k < m->count; k++)
            size[i] +=
                (double) m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, k, SG_A_SIZE)];
        sg_model_destroy(&m);
        sg_trainer_destroy(&t);
    }
    assert_int_equal(first[EVERY], (f.scene.n_points + 2) / 3);
    assert_true(count[PLAIN] > first[PLAIN]);
    assert_true(count[GRIDS] < count[PLAIN] && count[FINER] > count[PLAIN]);
    assert_true(count[SEEN] < count[PLAIN]);
    assert_int_equal(count[VOLUME], count[PLAIN]);
    assert_true(size[VOLUME] < size[PLAIN]); /* it makes Gaussians small */
    clear_points(&f);
}

/* With smaller sizes, what is not in use neither acts nor learns. */
static void test_sizes(void **state)
{
    (void) state;
    enum { OFFSETS = 3, FEATURES = 5, HIDDEN = 7, NUMBERS = 4 };
    struct fixture f = make_points(2);
    struct sg_train_params p = scaffold_params();
    struct course course;
    f.scene.train = f.views;
    p.engine = main_engine();
    p.scaffold.offsets = OFFSETS, p.scaffold.features = FEATURES;
    p.scaffold.hidden = HIDDEN, p.scaffold.numbers = NUMBERS;
    p.scaffold.distance = p.scaffold.appearance = true;
    sg_trainer *t = begin(&f, &p);
    const size_t before = sg_trainer_gaussians(t);
    struct sg_model *m = run(&f, t, 40, &course);
    assert_true(m->count > before / SG_ANCHOR_GAUSSIANS);
    for (size_t i = 0; i < m->count; i++)
        for (int k = 0; k < SG_A_SIZE; k++) {
            const bool used = k < SG_A_FEATURE ? k < 3 * OFFSETS : k < SG_A_FEATURE + FEATURES;
            assert_true(used ||
                        m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, k)] == 0);
        }
    const struct sg_networks *n = m->columns->networks;
    const struct sg_weights *w = &n->value;
    for (int h = 0; h < SG_HIDDEN; h++) {
        const bool used = h % SG_NETWORK_HIDDEN < HIDDEN;
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
            assert_true((w->input[i][h] != 0) ==
                        (used && (i < FEATURES || i >= SG_ANCHOR_FEATURES)));
        assert_true((w->distance[h] != 0) == used);
    }
    for (int o = 0; o < SG_OUTPUTS; o++) {
        const int gaussian = o < SG_O_COVARIANCE ? o
                             : o < SG_O_COLOUR   ? (o - SG_O_COVARIANCE) / 7
                                                 : (o - SG_O_COLOUR) / 3;
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            assert_true((w->output[o][h] != 0) == (h < HIDDEN && gaussian < OFFSETS));
    }
    for (int o = OFFSETS; o < SG_ANCHOR_GAUSSIANS; o++)
        assert_true(w->bias[o] == -1);
    for (int k = 0; k < SG_APPEARANCE; k++)
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            assert_true((w->appearance[k][h] != 0) == (k < NUMBERS && h < HIDDEN));
    for (size_t i = 0; i < n->photos; i++)
        for (int k = 0; k < SG_APPEARANCE; k++)
            assert_true((n->appearance[i].value[k] != 0) == (k < NUMBERS));
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    clear_points(&f);
}

/* Where a tolerance hides gradients, anchors grow at a lower threshold. */
static void test_hidden(void **state)
{
    (void) state;
    struct fixture f = make_points(2);
    struct sg_train_params p = scaffold_params();
    struct course course;
    p.tolerance = 2, p.tolerance_look = 9;
    const float threshold = 0.004f;
    struct sg_model *m[4];
    for (int i = 0; i < 4; i++) {
        p.tolerance_growth = (const float[]){0, 1000, 1e-3f, 0}[i];
        p.densify_grad_threshold = i == 3 ? (float) (0.6 * (double) threshold) : threshold;
        sg_trainer *t = begin(&f, &p);
        m[i] = run(&f, t, 26, &course);
        sg_trainer_destroy(&t);
    }
    assert_same_anchors(m[0], m[1]);
    assert_same_anchors(m[2], m[3]);
    assert_true(m[2]->count > m[0]->count);
    for (int i = 0; i < 4; i++)
        sg_model_destroy(&m[i]);
    clear_points(&f);
}

static void test_refused(void **state)
{
    (void) state;
    struct fixture f = make_points(1);
    struct sg_train_params p = scaffold_params();
    sg_trainer *t;
    f.scene.train = f.views;
    p.max_gaussians = 39;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    p = scaffold_params();
    p.strategy = SG_STRATEGY_MCMC;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    p = scaffold_params();
    p.scaffold.bank = true, p.scaffold.features = 31;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    p = scaffold_params();
    p.defense.on = true, p.defense.unit = SG_UNIT_GAUSSIAN, p.scaffold.offsets = 9;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    p = scaffold_params();
    p.absgrad = true;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    p = scaffold_params();
    p.at_limit = SG_AT_LIMIT_UNIVERSAL;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_ERR_USAGE);
    p = scaffold_params();
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(f.ctx), "init"));
    clear_points(&f);
}

/* What a mask leaves out of a photo has no influence on anchors and networks. */
static void test_masks(void **state)
{
    (void) state;
    skip_without_races();
    struct fixture fixtures[2]; /* their contexts outlive the models */
    struct sg_model *m[2];
    static uint8_t mask[SIDE * SIDE];
    for (int i = 0; i < SIDE * SIDE; i++)
        mask[i] = i % SIDE < SIDE / 2 ? 255 : 0;
    for (int k = 0; k < 2; k++) {
        struct sg_train_params p = scaffold_params();
        struct course course;
        fixtures[k] = make_points(1);
        for (int v = 0; v < VIEWS; v++) {
            fixtures[k].views[v].mask = mask;
            for (int i = 0; i < SIDE * SIDE; i++)
                if (!mask[i])
                    memset(fixtures[k].views[v].rgb + 3 * i, k ? 255 : 0, 3);
        }
        p.scaffold.bank = p.scaffold.appearance = true;
        sg_trainer *t = begin(&fixtures[k], &p);
        m[k] = run(&fixtures[k], t, 16, &course);
        assert_true(course.gaussians[15] > course.gaussians[0]);
        sg_trainer_destroy(&t);
    }
    assert_same_anchors(m[0], m[1]);
    for (int k = 0; k < 2; k++) {
        sg_model_destroy(&m[k]);
        clear_points(&fixtures[k]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_threads),       cmocka_unit_test(test_engines),
        cmocka_unit_test(test_resume),        cmocka_unit_test(test_longer),
        cmocka_unit_test(test_parts),         cmocka_unit_test(test_steps),
        cmocka_unit_test(test_nothing_drawn), cmocka_unit_test(test_rates),
        cmocka_unit_test(test_momentum),      cmocka_unit_test(test_seen),
        cmocka_unit_test(test_limits),        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_filter),        cmocka_unit_test(test_hidden),
        cmocka_unit_test(test_constants),     cmocka_unit_test(test_sizes),
        cmocka_unit_test(test_masks),         cmocka_unit_test(test_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
