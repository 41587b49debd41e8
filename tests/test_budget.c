/* SPDX-License-Identifier: Apache-2.0 */
/* Hard budgets: on Gaussians, on memory, on time. */
#include <unistd.h>

#include "core/context.h"
#include "math/constants.h"
#include "train/densify.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

/* For any scores and any Gaussians that are to grow or to be removed: the model is never above the
 * limit, it is full if enough are to grow, and none is replaced that scores above one that stays.
 */
struct random_scores {
    sg_ctx *ctx;
    uint64_t seed;
    size_t n;
};

static int random_score(void *arg, struct sg_scores *out)
{
    const struct random_scores *r = arg;
    *out =
        (struct sg_scores){.count = r->n,
                           .score = sg_alloc_raw(r->ctx, SG_MEM_MISC, r->n, sizeof(double)),
                           .log_smallest = sg_alloc_raw(r->ctx, SG_MEM_MISC, r->n, sizeof(float)),
                           .keys = sg_alloc_raw(r->ctx, SG_MEM_MISC, r->n, sizeof(uint64_t))};
    for (size_t i = 0; i < r->n; i++)
        out->score[i] = (double) draw(r->seed, i, -20, 5), out->log_smallest[i] = 0;
    return SG_OK;
}

static void test_growth(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    const float large = 0.3f; /* of every fourth */
    size_t some_died = 0;
    for (uint64_t seed = 0; seed < 60; seed++) {
        const size_t n = 20 + (size_t) draw(seed, 1, 0, 300);
        const size_t limit = 10 + (size_t) draw(seed, 2, 0, 400);
        struct sg_model *m = make_model(ctx, n, 0, seed);
        struct sg_engine *b;
        struct sg_columns o;
        struct random_scores r = {ctx, seed, n};
        assert_int_equal(sg_columns_create(ctx, n, 0, SG_COLUMN_SAVED, &o), SG_OK);
        size_t wish = 0, dying = 0;
        for (size_t i = 0; i < n; i++) {
            o.at[SG_C_GRAD_COUNT][i] = 1;
            o.at[SG_C_GRAD_SUM][i] = (float) (int) draw(seed + 100, i, 0, 10); /* many equals */
            wish += o.at[SG_C_GRAD_SUM][i] >= 4;
            *sg_model_at(m, i, SG_P_XYZ) = (float) i; /* a name */
        }
        for (size_t i = 0; i < n; i++) {
            if (seed % 3 == 0 && i % 7 == 0)
                *sg_model_at(m, i, SG_P_OPACITY) = -8;
            bool dies = *sg_model_at(m, i, SG_P_OPACITY) == -8;
            for (int axis = 0; axis < 3; axis++)
                dies |= seed % 4 == 1 && expf(*sg_model_at(m, i, SG_P_SCALE + axis)) > large;
            dying += dies;
        }
        b = make_engine(ctx, "cpu", NULL, m, &o);
        struct sg_densify_params p = {.gradient = 4,
                                      .split_scale = draw(seed, 3, 0.01f, 0.2f),
                                      .prune_scale = seed % 4 == 1 ? large : 0,
                                      .max_gaussians = limit,
                                      .score = seed % 5 ? random_score : NULL,
                                      .arg = &r,
                                      .replace = draw(seed, 4, 0, 0.2f),
                                      .seed = seed};
        struct sg_densify_result result;
        assert_int_equal(sg_densify(b, &p, &result), SG_OK);
        const size_t count = sg_engine_count(b);
        assert_true(count <= limit && count > 0);
        assert_int_equal(count + result.pruned, n + result.cloned + result.split);
        assert_true(result.pruned >= result.replaced);
        assert_true(result.pruned >= dying ||
                    seed % 4 == 1); /* large ones may have split into smaller */
        some_died += dying > 0 && result.replaced > 0;
        if (dying == 0 &&
            n + wish >=
                limit + result.replaced) /* removed ones may have been among those to grow */
            assert_true(count + result.replaced >= limit);
        if (n + wish <= limit)
            assert_true(result.replaced == 0 && !result.limited);
        if (seed % 5 && result.replaced) { /* the highest score that was removed is below the lowest
                                              that stayed */
            struct sg_model *after;
            double lowest = 1e9, highest = -1e9;
            assert_int_equal(sg_model_create(ctx, count, 0, &after), SG_OK);
            assert_int_equal(sg_engine_download(b, after, NULL), SG_OK);
            uint8_t *stayed = calloc(n, 1);
            for (size_t i = 0; i < count; i++) {
                const float name = *sg_model_at(after, i, SG_P_XYZ);
                if (name == floorf(name) && name < (float) n)
                    stayed[(size_t) name] = 1;
            }
            for (size_t i = 0; i < n; i++) {
                const bool whole =
                    o.at[SG_C_GRAD_SUM][i] < 4; /* neither split nor a candidate for it */
                const double score = (double) draw(seed, i, -20, 5);
                if (!whole)
                    continue;
                if (stayed[i])
                    lowest = fmin(lowest, score);
                else
                    highest = fmax(highest, score);
            }
            if (dying == 0)
                assert_true(highest < lowest);
            free(stayed);
            sg_model_destroy(&after);
        }
        sg_columns_clear(&o);
        sg_engine_destroy(&b);
        sg_model_destroy(&m);
    }
    assert_true(some_died > 5);
    sg_ctx_destroy(&ctx);
}

/* A run at its limit, defended or not. */
static void test_limit(void **state)
{
    (void) state;
    for (int on = 0; on < 2; on++) {
        struct fixture f = make_fixture(2);
        struct sg_train_params p = short_params();
        struct sg_train_limits limits;
        sg_trainer *t;
        p.max_gaussians = 130, p.densify_grad_threshold = 1e-6f;
        p.defense.on = on, p.defense.interval = 5, p.defense.rho = 0.02;
        t = begin_training(&f, &p);
        size_t most = 0, replaced = 0;
        while (sg_trainer_iteration(t) < p.iterations) {
            struct sg_train_step s;
            const size_t room = 130 - sg_trainer_gaussians(t);
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_true(s.gaussians <= 130);
            most = s.gaussians > most ? s.gaussians : most;
            assert_true(s.cloned + s.split <= room + 3); /* 3% at a time give way */
            replaced += s.cloned + s.split > room;
        }
        assert_true(replaced > 0);
        assert_true(most >= 127);
        sg_trainer_limits(t, &limits);
        assert_true(limits.gaussians_bound && !limits.by_memory && !limits.time_bound);
        sg_trainer_destroy(&t);
        /* A limit below the first number of Gaussians: they are thinned out evenly. */
        p.max_gaussians = 50;
        t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_gaussians(t), 50);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        sg_trainer_destroy(&t);
        clear_fixture(&f);
    }
}

/* Of so few Gaussians that 3 % of them is none, none is replaced. The limit still stops growth, and
 * the run says so. */
static void test_few_at_limit(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    struct sg_train_limits limits;
    struct sg_model *start = f.start;
    f.start = make_model(f.ctx, 30, 1, 5);
    p.max_gaussians = 30, p.densify_grad_threshold = 1e-6f;
    sg_trainer *t = begin_training(&f, &p);
    sg_trainer_limits(t, &limits);
    assert_false(limits.gaussians_bound);
    while (sg_trainer_iteration(t) < 10)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    sg_trainer_limits(t, &limits);
    assert_true(limits.gaussians_bound);
    sg_trainer_destroy(&t);
    sg_model_destroy(&f.start);
    f.start = start;
    clear_fixture(&f);
}

/* What a training can be beside the default, each with arrays of its own. */
enum variant { PLAIN, MIP, MCMC, EXPOSURE, VARIANTS };

static void vary(struct sg_train_params *p, enum variant variant)
{
    p->model = variant == MIP ? SG_MODEL_MIP : SG_MODEL_3DGS;
    p->strategy = variant == MCMC ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
    p->exposure = variant == EXPOSURE;
    if (variant == MCMC) /* the filter removes, which it does not do */
        p->defense.rho = 0;
}

static void count_fallbacks(void *priv, enum sg_log_level level, const char *message)
{
    *(int *) priv += level == SG_LOG_WARN && strstr(message, "as with --at-limit stop");
}

/* The universal threshold lets the model exceed its limit where memory has room for twice as many,
 * and otherwise keeps it, and warns; either way the limit is the one that was asked for. */
static void test_universal(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    struct sg_train_limits limits;
    size_t room = 0;
    p.densify_grad_threshold = 1e-9f, p.iterations = 160, p.densify_until_iter = 150,
    p.densification_interval = 3, p.opacity_reset_interval = 1000;
    p.engine = "cpu"; /* all of whose memory is limited */
    f.scene.train = f.views;
    for (int k = 0; k < 3; k++) {
        sg_ctx *ctx;
        sg_trainer *t;
        size_t most = 0;
        int fallbacks = 0;
        p.at_limit = k ? SG_AT_LIMIT_UNIVERSAL : SG_AT_LIMIT_STOP;
        p.max_gaussians = k == 1 ? room / 4 * 3 : k == 2 ? room / 4 : 0;
        assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1,
                                                                     .max_memory = 15 << 20,
                                                                     .log = count_fallbacks,
                                                                     .log_priv = &fallbacks}),
                         SG_OK);
        assert_int_equal(sg_trainer_create(ctx, &f.scene, f.start, &p, &t), SG_OK);
        assert_int_equal(fallbacks, k == 1);
        for (int it = 0; it < p.iterations; it++) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            most = s.gaussians > most ? s.gaussians : most;
        }
        sg_trainer_limits(t, &limits);
        room = k ? room : limits.max_gaussians;
        assert_true(limits.gaussians_bound && limits.by_memory == !k);
        assert_int_equal(limits.max_gaussians, k ? p.max_gaussians : room);
        assert_true(k == 2 ? most > limits.max_gaussians && most <= 2 * limits.max_gaussians
                           : most <= limits.max_gaussians);
        sg_trainer_destroy(&t);
        sg_ctx_destroy(&ctx);
    }
    clear_fixture(&f);
}

/* Growth that would take all memory stops at the context's limit, without an error. */
static void test_memory(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    sg_ctx *whole = f.ctx, *ctx;
    struct sg_train_params p = short_params();
    const uint64_t limit = 16 << 20;
    p.densify_grad_threshold = 1e-9f, p.iterations = 160, p.densify_until_iter = 150,
    p.densification_interval = 3, p.mcmc.until = 150, p.mcmc.growth = 1.2;
    f.scene.train = f.views;
    for (int k = 0; k < VARIANTS + 1; k++) {
        const bool bands = k == VARIANTS;
        struct sg_train_limits limits;
        sg_trainer *t;
        char path[] = "/tmp/sg_checkpoint_XXXXXX";
        close(mkstemp(path));
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 2, .max_memory = limit}), SG_OK);
        p.max_instances = bands ? 700 : 1 << 24;
        p.defense.on = bands, p.defense.rho = 0.01, p.defense.interval = 3;
        vary(&p, bands ? PLAIN : (enum variant) k);
        assert_int_equal(sg_trainer_create(ctx, &f.scene, f.start, &p, &t), SG_OK);
        sg_trainer_limits(t, &limits);
        assert_true(limits.by_memory && limits.max_gaussians > 1000 &&
                    limits.max_gaussians < 12000);
        while (sg_trainer_iteration(t) < p.iterations) {
            struct sg_train_step s;
            const int code = sg_trainer_step(t, &s);
            if (code)
                fail_msg("%s", sg_last_error(ctx));
            if (s.iteration % 50 == 0)
                assert_int_equal(sg_trainer_save(t, path), SG_OK);
        }
        sg_renderer *renderer;
        struct sg_eval eval;
        assert_int_equal(sg_trainer_renderer(t, &renderer), SG_OK);
        assert_int_equal(sg_evaluate(ctx, renderer, f.views, 1, NULL, &eval), SG_OK);
        sg_eval_clear(&eval);
        sg_renderer_destroy(&renderer);
        sg_trainer_limits(t, &limits);
        assert_true(limits.gaussians_bound);
        if (sg_mem_peak(ctx, SG_MEM_TAGS) > limit)
            fail_msg("variant %d: peak %llu bytes, the limit is %llu", k,
                     (unsigned long long) sg_mem_peak(ctx, SG_MEM_TAGS),
                     (unsigned long long) limit);
        if (!bands)
            assert_true(sg_trainer_gaussians(t) > limits.max_gaussians * 9 / 10);
        sg_trainer_destroy(&t);
        unlink(path);
        sg_ctx_destroy(&ctx);
    }
    /* A run that cannot fit is refused before it starts. */
    sg_trainer *t;
    assert_int_equal(
        sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 4 << 20}), SG_OK);
    assert_int_equal(sg_trainer_create(ctx, &f.scene, f.start, &p, &t), SG_ERR_BUDGET);
    assert_non_null(strstr(sg_last_error(ctx), "expected at least"));
    sg_ctx_destroy(&ctx);
    assert_ptr_equal(f.ctx, whole);
    clear_fixture(&f);
}

/* The least memory that an error asks for is enough to train a defended model and to measure it,
 * of each variant, whether photos to train on or to test with are the large ones; a byte less is
 * refused. */
static void test_least(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_view large = {.name = (char *) "large", .camera = make_camera(1000, 750, 3)};
    large.rgb = calloc(3 * 1000, 750);
    for (int i = 0; i < 2 * VARIANTS; i++) {
        const int k = i % 2;
        const struct sg_scene scene = {.path = (char *) "fixture",
                                       .train = k ? f.views : &large,
                                       .n_train = 1,
                                       .test = k ? &large : f.views,
                                       .n_test = 1,
                                       .extent = 2};
        struct sg_train_params p = short_params();
        struct sg_ctx_params memory = {.threads = 1, .max_memory = 1 << 20};
        struct sg_eval eval;
        sg_renderer *r;
        sg_trainer *t;
        sg_ctx *ctx;
        p.init_points = 1000, p.defense.on = true;
        vary(&p, (enum variant)(i / 2));
        for (int least = 0; least < 3; least++) {
            assert_int_equal(sg_ctx_create(&ctx, &memory), SG_OK);
            const int code = sg_trainer_create(ctx, &scene, NULL, &p, &t);
            assert_int_equal(code, least < 2 ? SG_ERR_BUDGET : SG_OK);
            if (least < 2) {
                const char *number = strstr(sg_last_error(ctx), "at least ");
                assert_non_null(number);
                memory.max_memory = strtoull(number + 9, NULL, 10) - (least == 0);
                sg_ctx_destroy(&ctx);
            }
        }
        for (int it = 0; it < 2; it++)
            if (sg_trainer_step(t, NULL))
                fail_msg("%s", sg_last_error(ctx));
        assert_int_equal(sg_trainer_renderer(t, &r), SG_OK);
        if (sg_evaluate(ctx, r, scene.test, 1, NULL, &eval))
            fail_msg("%s", sg_last_error(ctx));
        sg_eval_clear(&eval);
        sg_renderer_destroy(&r);
        sg_trainer_destroy(&t);
        sg_ctx_destroy(&ctx);
    }
    free(large.rgb);
    clear_fixture(&f);
}

static uint64_t planned(const struct sg_scene *scene, int threads, uint64_t limit, bool sums)
{
    const struct sg_train_params p = short_params();
    struct sg_budget plan;
    sg_ctx *ctx;
    assert_int_equal(
        sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads, .max_memory = limit}),
        SG_OK);
    assert_int_equal(sg_budget_plan(ctx, scene, &p, 3, 0, sums, &plan), SG_OK);
    sg_ctx_destroy(&ctx);
    return plan.gaussians;
}

/* Sums of gradients, and rows of every thread, leave less room for Gaussians. */
static void test_room(void **state)
{
    (void) state;
    struct sg_view view = {.name = (char *) "view", .camera = make_camera(320, 240, 3)};
    struct sg_view wide = {.name = (char *) "wide", .camera = make_camera(20000, 4, 3)};
    const struct sg_scene scene = {.path = (char *) "fixture", .train = &view, .n_train = 1};
    const struct sg_scene rows = {.path = (char *) "fixture", .train = &wide, .n_train = 1};
    assert_true(planned(&scene, 1, 24 << 20, true) < planned(&scene, 1, 24 << 20, false));
    assert_true(4 * planned(&rows, 16, 500 << 20, false) < 3 * planned(&rows, 1, 500 << 20, false));
}

/* What a variant needs more than the default: as planned, a Gaussian and beside, and as used by
 * models of the same size. */
struct need {
    double each, fixed;
    uint64_t peak;
};

#define FULL 6000 /* Gaussians */

static struct need measure_need(struct fixture *f, enum variant variant)
{
    enum { LOW = 24 << 20, HIGH = 96 << 20 };
    struct sg_train_params p = short_params();
    struct need need;
    struct sg_budget plan[2];
    struct sg_train_limits limits;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    sg_trainer *t;
    sg_ctx *ctx;
    vary(&p, variant);
    for (int k = 0; k < 2; k++) {
        const struct sg_ctx_params memory = {.threads = 1, .max_memory = k ? HIGH : LOW};
        assert_int_equal(sg_ctx_create(&ctx, &memory), SG_OK);
        assert_int_equal(sg_budget_plan(ctx, &f->scene, &p, 1, 0, false, &plan[k]), SG_OK);
        sg_ctx_destroy(&ctx);
    }
    need.each = (double) (HIGH - LOW) / (double) (plan[1].gaussians - plan[0].gaussians);
    need.fixed = (double) LOW - need.each * (double) plan[0].gaussians;

    p.densify_from_iter = 1, p.densification_interval = 2, p.densify_grad_threshold = 1e-9f;
    p.max_gaussians = FULL;
    close(mkstemp(path));
    ctx = make_context(1);
    struct sg_model *start = make_model(f->ctx, FULL, 1, 3);
    assert_int_equal(sg_trainer_create(ctx, &f->scene, start, &p, &t), SG_OK);
    sg_model_destroy(&start);
    for (int i = 0; i < 5; i++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_save(t, path), SG_OK);
    sg_trainer_limits(t, &limits);
    assert_true(limits.gaussians_bound); /* it did edit */
    assert_in_range(sg_trainer_gaussians(t), FULL * 9 / 10, FULL);
    need.peak = sg_mem_peak(ctx, SG_MEM_TAGS);
    sg_trainer_destroy(&t);
    sg_ctx_destroy(&ctx);
    unlink(path);
    return need;
}

static void test_variants(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    f.scene.train = f.views;
    const struct need plain = measure_need(&f, PLAIN);
    for (int k = PLAIN + 1; k < VARIANTS; k++) {
        const struct need own = measure_need(&f, (enum variant) k);
        const double more = FULL * (own.each - plain.each) + own.fixed - plain.fixed,
                     used = (double) own.peak - (double) plain.peak;
        if (used > more + 4096)
            fail_msg("variant %d: found %g bytes more than the default's, expected %g", k, used,
                     more);
        assert_true(k != MIP || used > 100 * FULL);
    }
    clear_fixture(&f);
}

/* Gaussians so large that not all of their tile lists fit are rendered in bands. */
static void test_large_gaussians(void **state)
{
    (void) state;
    struct sg_view view = {.name = (char *) "view", .camera = make_camera(320, 240, 3)};
    const struct sg_scene scene = {
        .path = (char *) "fixture", .train = &view, .n_train = 1, .extent = 2};
    const struct sg_train_params p = short_params();
    sg_trainer *t;
    sg_ctx *ctx;
    assert_int_equal(
        sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 24 << 20}), SG_OK);
    struct sg_model *m = make_model(ctx, 3000, 0, 3);
    for (size_t i = 0; i < m->count; i++)
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_SCALE + k) = 0.5f;
    view.rgb = calloc(3 * 320, 240);
    assert_int_equal(sg_trainer_create(ctx, &scene, m, &p, &t), SG_OK);
    sg_model_destroy(&m);
    if (sg_trainer_step(t, NULL))
        fail_msg("%s", sg_last_error(ctx));
    sg_trainer_destroy(&t);
    sg_ctx_destroy(&ctx);
    free(view.rgb);
}

/* The number that fits depends neither on the initial model, which is freed, nor on the SH degree
 * that is asked for when a run is resumed. A tighter limit holds from the first step on. */
static void test_same_limit(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    struct sg_train_limits limits, resumed;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    f.scene.train = f.views;
    for (int degree = 0; degree < 4; degree += 3) {
        sg_ctx *ctx;
        sg_trainer *t;
        struct sg_model *initial;
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 24 << 20}),
            SG_OK);
        p.sh_degree = degree, p.max_gaussians = 0;
        assert_int_equal(sg_trainer_create(ctx, &f.scene, NULL, &p, &t), SG_OK);
        sg_trainer_limits(t, &limits);
        sg_trainer_destroy(&t);
        initial = make_model(ctx, 2 * (size_t) limits.max_gaussians, degree, 3);
        p.sh_degree = 3;
        assert_int_equal(sg_trainer_create(ctx, &f.scene, initial, &p, &t), SG_OK);
        sg_model_destroy(&initial);
        sg_trainer_limits(t, &resumed);
        const uint64_t begun =
            resumed.max_gaussians; /* apart from a few bytes of the model's structure */
        assert_in_range(begun, limits.max_gaussians - 1, limits.max_gaussians);
        assert_int_equal(sg_trainer_gaussians(t), begun);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        sg_trainer_destroy(&t);
        p.sh_degree = 3 - degree;
        assert_int_equal(sg_trainer_resume(ctx, &f.scene, path, &p, &t), SG_OK);
        sg_trainer_limits(t, &resumed);
        assert_in_range(resumed.max_gaussians, begun, limits.max_gaussians);
        assert_int_equal(sg_trainer_gaussians(t), begun);
        sg_trainer_destroy(&t);
        p.max_gaussians = 500;
        assert_int_equal(sg_trainer_resume(ctx, &f.scene, path, &p, &t), SG_OK);
        assert_int_equal(sg_trainer_gaussians(t), 500);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        sg_trainer_limits(t, &resumed);
        assert_true(resumed.gaussians_bound);
        sg_trainer_destroy(&t);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
        /* With much less memory than the checkpoint's model needs, a part of the model continues.
         */
        p.max_gaussians = 0;
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 12 << 20}),
            SG_OK);
        assert_int_equal(sg_trainer_resume(ctx, &f.scene, path, &p, &t), SG_OK);
        sg_trainer_limits(t, &resumed);
        assert_true(resumed.max_gaussians < limits.max_gaussians / 3);
        assert_int_equal(sg_trainer_gaussians(t), resumed.max_gaussians);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        sg_trainer_destroy(&t);
        sg_ctx_destroy(&ctx);
    }
    unlink(path);
    clear_fixture(&f);
}

/* Steps of a second each: the run ends in time, with its whole schedule, resumed or not. */
static void test_time(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    double now = 1000;
    p.iterations = 400, p.densification_interval = 20, p.densify_from_iter = 40,
    p.densify_until_iter = 300;
    p.opacity_reset_interval = 150;
    p.clock = fake_clock, p.clock_arg = &now;
    for (int cut = 0; cut < 2; cut++) {
        static const double limits[] = {100, 7.5, 0.001};
        for (int k = 0; k < 3; k++) {
            struct sg_train_limits l;
            struct sg_train_step s;
            int steps = 0, densified = 0, before = 0;
            sg_trainer *t;
            p.max_seconds = limits[k];
            t = begin_training(&f, &p);
            const double begin = now;
            double away = 0;
            while (sg_trainer_iteration(t) < p.iterations) {
                assert_int_equal(sg_trainer_step(t, &s), SG_OK);
                densified += sg_densifies(&p, before, s.iteration);
                assert_true(s.iteration > before);
                before = s.iteration;
                now += 1; /* the step's own time is seen by the next one */
                steps++;
                if (cut && steps == 3 && before < p.iterations) { /* time away does not count */
                    assert_int_equal(sg_trainer_save(t, path), SG_OK);
                    sg_trainer_destroy(&t);
                    now += 5000, away += 5000;
                    t = resume_training(&f, &p, path);
                }
            }
            assert_int_equal(s.iteration, 400);
            assert_true(now - begin - away <=
                        fmax(limits[k] + 1, 2)); /* the first step shows how long one takes */
            assert_int_equal(t->steps, steps);
            if (k == 0) /* a hundred steps: every densification took place, one perhaps just as they
                           begin */
                assert_in_range(densified, 12, 13);
            sg_trainer_limits(t, &l);
            assert_true(l.time_bound && !l.gaussians_bound);
            sg_trainer_destroy(&t);
        }
    }
    /* Time before the first step counts. A pause is not expected to happen again. */
    for (int pause = 0; pause < 2; pause++) {
        p.max_seconds = 100, p.seconds_before = pause ? 0 : 90;
        sg_trainer *t = begin_training(&f, &p);
        const double begin = now;
        for (int steps = 1; sg_trainer_iteration(t) < p.iterations; steps++) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_true(!pause || s.iteration <= 4 * (now - begin + 1) + 1); /* four a second */
            now += pause && steps == 30 ? 20 : 1;
        }
        assert_true(now - begin <= p.max_seconds - p.seconds_before + 1);
        sg_trainer_destroy(&t);
    }
    /* With enough time every iteration is done, also if most of the time passes before the first.
     */
    sg_trainer *t;
    struct sg_train_limits l;
    p.max_seconds = 1000, p.seconds_before = 900, p.iterations = 60;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 60; it++, now += 1) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.iteration, it);
    }
    sg_trainer_limits(t, &l);
    assert_false(l.time_bound);
    sg_trainer_destroy(&t);
    unlink(path);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_growth),
                                       cmocka_unit_test(test_limit),
                                       cmocka_unit_test(test_few_at_limit),
                                       cmocka_unit_test(test_universal),
                                       cmocka_unit_test(test_memory),
                                       cmocka_unit_test(test_least),
                                       cmocka_unit_test(test_room),
                                       cmocka_unit_test(test_variants),
                                       cmocka_unit_test(test_large_gaussians),
                                       cmocka_unit_test(test_same_limit),
                                       cmocka_unit_test(test_time)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
