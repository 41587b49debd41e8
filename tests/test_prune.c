/* SPDX-License-Identifier: Apache-2.0 */
/* The scores of published pruning methods against brute force, and the training after them. */
#include "math/real_f64.h"

#include "engine/ref/render.h"
#include "model/columns.h"
#include "prune/finetune.h"
#include "prune/score.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

#define MOST 80
#define GRID(n) (((n) + SG_TILE - 1) / SG_TILE)

static double rgb[3 * SIDE * SIDE], transmittance[SIDE * SIDE], depth[SIDE * SIDE];
static int last[SIDE * SIDE];
static struct ref_image image = {.rgb = rgb, .t = transmittance, .depth = depth, .last = last};
static struct ref_splat splats[MOST];
static struct ref_entry list[MOST];
static double planes[MOST][SG_PARAMS_MAX];

static void project_all(const struct sg_model *m, const struct pinhole *view, int width, int height)
{
    image.width = width, image.height = height;
    for (size_t i = 0; i < m->count; i++) {
        for (int p = 0; p < SG_PARAMS_MAX; p++)
            planes[i][p] = p < sg_param_count(m->sh_degree) ? (double) *sg_model_at(m, i, p) : 0;
        ref_project(view, planes[i], m->active_sh_degree, GRID(width), GRID(height), &splats[i]);
    }
}

/* The gradient of one value of the image at a time. */
static void brute_fisher(const struct sg_model *m, const struct sg_camera *camera, bool released,
                         double *fisher)
{
    static double unit[3 * SIDE * SIDE];
    static const float background[3];
    const struct pinhole view = view_make(camera);
    const int width = camera->width, height = camera->height;
    project_all(m, &view, width, height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            const size_t n = ref_tile_list(splats, m->count, x / SG_TILE, y / SG_TILE, list);
            ref_pixel_forward(splats, list, n, x, y, background, &image);
            for (int ch = 0; ch < 3; ch++) {
                double *one = &unit[(ch * height + y) * width + x];
                for (size_t i = 0; i < m->count; i++) {
                    memset(&splats[i].g, 0, sizeof(splats[i].g));
                    memset(splats[i].g_rgb, 0, sizeof(splats[i].g_rgb));
                }
                *one = 1;
                ref_pixel_backward(splats, list, x, y, background, &image, unit);
                *one = 0;
                for (size_t k = 0; k < n; k++) {
                    struct ref_splat *s = &splats[list[k].id];
                    double g[SG_PARAMS_MAX], p[6];
                    for (int c = 0; c < ch && released; c++)
                        s->g_rgb[c] = s->g_rgb[ch];
                    ref_parameter_gradient(&view, s, planes[list[k].id], m->active_sh_degree, g);
                    for (int i = 0; i < 3; i++)
                        p[i] = g[SG_P_XYZ + i], p[3 + i] = g[SG_P_SCALE + i];
                    for (int i = 0; i < 36; i++)
                        fisher[36 * list[k].id + (size_t) i] += p[i / 6] * p[i % 6];
                }
            }
        }
}

static struct sg_prune_params params_of(enum sg_pruner method)
{
    return (struct sg_prune_params){SG_PRUNE_DEFAULTS, .method = method};
}

/* 45 x 39 pixels and a view half as large, in which positions and sizes weigh differently. */
static void pup_agrees_with_brute_force(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    const struct sg_camera cameras[] = {make_camera(45, 39, 3), make_camera(31, 20, 2.2)};
    const struct sg_camera *const views[] = {&cameras[0], &cameras[1]};
    double *own = calloc(36 * MOST, sizeof(double)), *pinned = calloc(36 * MOST, sizeof(double));
    for (int degree = 0; degree <= 3; degree += 3) {
        struct sg_model *m = make_model(ctx, MOST, degree, 5);
        struct sg_prune_params p = params_of(SG_PRUNER_PUP);
        m->active_sh_degree = degree;
        *sg_model_at(m, 7, SG_P_XYZ) = 1000; /* nobody sees it */
        p.reduce = 1;
        for (int released = 0; released < 2; released++) {
            double *got = released ? pinned : own;
            double *expected = calloc(36 * MOST, sizeof(double));
            p.released_gradient = released;
            assert_int_equal(sg_pup_fisher(ctx, views, 2, m, &p, got), SG_OK);
            brute_fisher(m, &cameras[0], released, expected);
            brute_fisher(m, &cameras[1], released, expected);
            size_t seen = 0;
            for (size_t i = 0; i < m->count; i++)
                for (size_t k = 0; k < 36; k++) {
                    const double *e = expected + 36 * i,
                                 size = sqrt(e[7 * (k / 6)] * e[7 * (k % 6)]);
                    if (!(fabs(got[36 * i + k] - e[k]) <= 1e-10 * size))
                        fail_msg("Gaussian %zu, %zu: found %.17g, expected %.17g", i, k,
                                 got[36 * i + k], e[k]);
                    seen += k == 0 && size > 0;
                }
            assert_true(seen > MOST / 2);
            free(expected);
        }
        double moved = 0; /* only positions see the view direction */
        for (size_t i = 0; i < 36 * m->count; i++) {
            if (degree == 0 || (i / 6 % 6 > 2 && i % 6 > 2))
                assert_memory_equal(&own[i], &pinned[i], sizeof(double));
            moved += fabs(own[i] - pinned[i]);
        }
        assert_true((moved > 0) == (degree > 0));
        sg_model_destroy(&m);
    }
    free(own);
    free(pinned);
    sg_ctx_destroy(&ctx);
}

/* A view is reduced as a whole: to sides that are rounded up, with the same fields of view. */
static void pup_reduces_views(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    const struct sg_camera camera = make_camera(45, 38, 3), *const view = &camera;
    struct sg_camera small = camera;
    const struct sg_camera *const reduced = &small;
    struct sg_model *m = make_model(ctx, MOST, 1, 5);
    double *own = calloc(36 * MOST, sizeof(double)), *expected = calloc(36 * MOST, sizeof(double));
    struct sg_prune_params p = params_of(SG_PRUNER_PUP);
    small.width = 12, small.height = 10;
    small.fx *= 12 / 45.0, small.cx *= 12 / 45.0, small.fy *= 10 / 38.0, small.cy *= 10 / 38.0;
    assert_int_equal(p.reduce, 4);
    assert_int_equal(sg_pup_fisher(ctx, &view, 1, m, &p, own), SG_OK);
    p.reduce = 1;
    assert_int_equal(sg_pup_fisher(ctx, &reduced, 1, m, &p, expected), SG_OK);
    size_t seen = 0;
    for (size_t i = 0; i < 36 * m->count; i++) {
        assert_true(fabs(own[i] - expected[i]) <= 1e-9 * fabs(expected[i]));
        seen += expected[i] != 0;
    }
    assert_true(seen > 36 * MOST / 2);
    free(own);
    free(expected);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void log_det_is_exact(void **state)
{
    (void) state;
    double m[36] = {0};
    for (int i = 0; i < 6; i++)
        m[7 * i] = pow(10, 4 * i - 14); /* 20 digits apart */
    assert_true(fabs(sg_log_det6(m) - (60 - 84) * log(10)) < 1e-9);
    m[1] = m[6] = 0.5 * sqrt(m[0] * m[7]);
    assert_true(fabs(sg_log_det6(m) - (60 - 84) * log(10) - log(0.75)) < 1e-9);
    m[1] = m[6] = sqrt(m[0] * m[7]);
    assert_true(sg_log_det6(m) == -INFINITY);
    m[35] = 0;
    assert_true(sg_log_det6(m) == -INFINITY);
    m[35] = NAN;
    assert_true(isnan(sg_log_det6(m)));
}

/* Every Gaussian in every pixel, sorted by depth. */
static void naive_sums(const struct sg_model *m, const struct sg_camera *camera, bool weighed,
                       double *sum)
{
    const struct pinhole view = view_make(camera);
    project_all(m, &view, camera->width, camera->height);
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            const size_t n = ref_tile_list(splats, m->count, x / SG_TILE, y / SG_TILE, list);
            double t = 1, dx, dy, gauss, alpha;
            for (size_t k = 0; k < n; k++) {
                const struct ref_splat *s = &splats[list[k].id];
                if (!ref_pair(s, x, y, &dx, &dy, &gauss, &alpha))
                    continue;
                if (t * (1 - alpha) < (double) SG_T_MIN)
                    break;
                sum[list[k].id] += s->o * (weighed ? t : 1);
                t *= 1 - alpha;
            }
        }
}

static void lightgaussian_agrees_with_a_naive_rasteriser(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_model *m = make_model(f.ctx, MOST, 1, 9);
    f.scene.train = f.views;
    for (int weight = 0; weight < 2; weight++) {
        struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
        double score[MOST], volume[MOST], sum[MOST] = {0}, factor[MOST];
        p.weight = (enum sg_global_weight) weight;
        assert_int_equal(sg_prune_scores(f.ctx, &f.scene, m, &p, score), SG_OK);
        for (int v = 0; v < VIEWS; v++)
            naive_sums(m, &f.views[v].camera, weight, sum);
        for (size_t i = 0; i < MOST; i++)
            volume[i] =
                exp(planes[i][SG_P_SCALE] + planes[i][SG_P_SCALE + 1] + planes[i][SG_P_SCALE + 2]);
        assert_int_equal(sg_volume_factors(f.ctx, &p, volume, MOST, factor), SG_OK);
        size_t off = 0, seen = 0;
        for (size_t i = 0; i < MOST; i++) {
            off += fabs(score[i] - sum[i] * factor[i]) > 1e-4 * score[i];
            assert_true(fabs(score[i] - sum[i] * factor[i]) <= 0.01 * score[i] + 2 * factor[i]);
            seen += score[i] > 0;
        }
        assert_true(off <= MOST / 10 && seen > MOST / 2); /* pairs at a cut-off */
    }
    sg_model_destroy(&m);
    clear_fixture(&f);
}

/* One Gaussian alone in P pixels has o P; behind another one in the same place, less. */
static void lightgaussian_has_known_values(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_model *m;
    double score[2], count[2];
    f.scene.train = f.views, f.scene.n_train = 1;
    for (size_t n = 1; n <= 2; n++) {
        assert_int_equal(sg_model_create(f.ctx, n, 0, &m), SG_OK);
        for (size_t i = 0; i < n; i++) {
            for (int k = 0; k < 3; k++)
                *sg_model_at(m, i, SG_P_SCALE + k) = -1.5f;
            *sg_model_at(m, i, SG_P_ROT) = 1;
        }
        struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
        p.score = SG_GLOBAL_COUNT;
        assert_int_equal(sg_prune_scores(f.ctx, &f.scene, m, &p, count), SG_OK);
        assert_true(count[0] > 50);
        p.score = SG_GLOBAL_V_IMPORTANT; /* of equal volumes: the factor is 1 */
        assert_int_equal(sg_prune_scores(f.ctx, &f.scene, m, &p, score), SG_OK);
        for (size_t i = 0; i < n; i++)
            assert_true(fabs(score[i] - 0.5 * count[0]) < 1e-6);
        p.weight = SG_GLOBAL_WEIGHT_TRANSMITTANCE;
        assert_int_equal(sg_prune_scores(f.ctx, &f.scene, m, &p, score), SG_OK);
        assert_true(fabs(score[0] - 0.5 * count[0]) < 1e-3 * count[0]);
        if (n == 2)
            assert_true(score[1] < 0.49 * count[0] && score[1] > 0.25 * count[0]);
        sg_model_destroy(&m);
    }
    f.scene.n_train = VIEWS;
    clear_fixture(&f);
}

/* Volumes 1 to 10: 90 % are larger than 1. Of ten, those up to rank trunc(0.66 x 9) go, and
 * equals with them; one is always left. */
static void ranks_are_those_of_the_released_code(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
    double volume[10], factor[10], sorted[10], score[10] = {3, 1, 4, 10, 5, 9, 2, 6, 8, 7};
    uint8_t keep[10];
    for (int i = 0; i < 10; i++)
        volume[i] = 10 - i;
    p.volume_power = 1;
    assert_int_equal(sg_volume_factors(ctx, &p, volume, 10, factor), SG_OK);
    assert_true(factor[0] == 10 && factor[9] == 1);
    p.volume_clip = true;
    assert_int_equal(sg_volume_factors(ctx, &p, volume, 10, factor), SG_OK);
    assert_true(factor[0] == 1 && factor[9] == 1);
    volume[3] = INFINITY, volume[4] = NAN; /* the largest */
    assert_int_equal(sg_volume_factors(ctx, &p, volume, 10, factor), SG_OK);
    assert_true(factor[3] == 1 && factor[4] == 1 && factor[9] == 1);
    for (int i = 0; i < 10; i++)
        volume[i] = INFINITY;
    assert_int_equal(sg_volume_factors(ctx, &p, volume, 10, factor), SG_OK);
    assert_true(factor[3] == 1 && factor[9] == 1);
    assert_int_equal(sg_prune_choose(score, 10, 1, sorted, keep), 9);
    assert_true(keep[3]);
    assert_int_equal(sg_prune_choose(score, 10, 0.66, sorted, keep), 6);
    for (int i = 0; i < 10; i++)
        assert_int_equal(keep[i], score[i] > 6);
    score[9] = 6;
    assert_int_equal(sg_prune_choose(score, 10, 0.66, sorted, keep), 7);
    score[1] = -INFINITY, score[6] = NAN;
    assert_int_equal(sg_prune_choose(score, 10, 0, sorted, keep), 1);
    assert_true(!keep[1]);
    assert_int_equal(sg_prune_choose(score, 10, 1, sorted, keep), 9);
    assert_true(keep[6]);
    for (int i = 0; i < 10; i++)
        score[i] = 0;
    assert_int_equal(sg_prune_choose(score, 10, 0.1, sorted, keep), 9);
    sg_ctx_destroy(&ctx);
}

/* Positions continue from the iteration of the model; the others lose 5 % every 400. */
static void rates_follow_the_released_schedule(void **state)
{
    (void) state;
    const struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
    const struct sg_train_params t = sg_finetune_params(&p);
    assert_int_equal(t.iterations, 5000);
    for (int it = 1; it <= 5000; it += 7) {
        const double expected = 1.6e-4 * pow(0.01, (30000.0 + it) / 35000);
        assert_true(fabs(sg_position_lr(&t, it) - expected) < 1e-6 * expected);
    }
    for (int it = 399; it <= 401; it++) {
        double lr[SG_GROUPS] = {1, 1, 1, 1, 1, 1};
        sg_strategy_finetune.rates(NULL, it - 1, it, lr);
        assert_true(lr[SG_G_XYZ] == (it == 400 ? 0.95 : 1));
        assert_true(lr[SG_G_REST] == (it < 400 ? 1 : 0.95));
    }
    double lr[SG_GROUPS] = {1, 1, 1, 1, 1, 1};
    sg_strategy_finetune.rates(NULL, 4998, 4999, lr);
    assert_true(fabs(lr[SG_G_OPACITY] - pow(0.95, 12)) < 1e-12 && lr[SG_G_XYZ] == 1);
    /* LightGaussian during training: 3 % every 1000. */
    for (int it = 999; it <= 1001; it++) {
        double during[SG_GROUPS] = {1, 1, 1, 1, 1, 1};
        sg_strategy_lightgaussian.rates(NULL, it - 1, it, during);
        assert_true(during[SG_G_XYZ] == (it == 1000 ? 0.97 : 1));
        assert_true(during[SG_G_DC] == (it < 1000 ? 1 : 0.97));
    }
}

static double mean_psnr(struct fixture *f, const struct sg_model *m)
{
    struct sg_eval e;
    sg_renderer *r;
    assert_int_equal(sg_renderer_create(f->ctx, "cpu", NULL, m, NULL, &r), SG_OK);
    assert_int_equal(sg_evaluate(f->ctx, r, f->views, VIEWS, NULL, &e), SG_OK);
    const double psnr = e.psnr;
    sg_eval_clear(&e);
    sg_renderer_destroy(&r);
    return psnr;
}

static int count_steps(void *priv, const struct sg_train_step *step)
{
    (void) step;
    return ++*(int *) priv == 30;
}

static void pruning_removes_and_repairs(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    f.scene.train = f.views;
    f.truth->active_sh_degree = 1;
    const size_t n = f.truth->count;
    *sg_model_at(f.truth, 3, SG_P_XYZ) = 500; /* nobody sees it */
    for (int method = SG_PRUNER_LIGHTGAUSSIAN; method <= SG_PRUNER_SPECTRAL; method++) {
        struct sg_prune_params p = params_of((enum sg_pruner) method);
        struct sg_prune_result r;
        struct sg_model *bare, *one, *tuned;
        p.ratio = 0.5, p.finetune = 0, p.reduce = 1;
        assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &bare, &r), SG_OK);
        assert_true(r.rounds == 1 && r.before[0] == n && bare->count == n - r.removed[0]);
        assert_true(r.removed[0] >= (n - 1) / 2 + 1 && r.removed[0] < 0.8 * (double) n);
        assert_true(r.unseen[0] >= 1);
        for (size_t i = 0; i < bare->count; i++)
            assert_true(*sg_model_at(bare, i, SG_P_XYZ) < 100);
        /* The first iteration prunes and takes no step; it is the last here too. */
        p.finetune = 2;
        assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &one, NULL), SG_OK);
        assert_same(one, bare);
        p.finetune = 150, p.trained = 300;
        assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &tuned, NULL), SG_OK);
        assert_int_equal(tuned->count, bare->count);
        assert_true(mean_psnr(&f, tuned) > mean_psnr(&f, bare) + 0.5);
        sg_model_destroy(&bare);
        sg_model_destroy(&one);
        sg_model_destroy(&tuned);
    }
    /* To a number: in one round, with PUP in two; none where there are no more. */
    for (int method = SG_PRUNER_LIGHTGAUSSIAN; method <= SG_PRUNER_SPECTRAL; method++)
        for (uint64_t most = 7; most <= n; most += n - 7) {
            struct sg_prune_params p = params_of((enum sg_pruner) method);
            struct sg_prune_result r;
            struct sg_model *m;
            p.max_gaussians = most, p.finetune = 0, p.reduce = 1;
            assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &m, &r), SG_OK);
            assert_true(m->count <= most && (m->count == most || method != SG_PRUNER_PUP));
            assert_int_equal(r.rounds, most == n ? 0 : method == SG_PRUNER_PUP ? 2 : 1);
            assert_true(r.rounds < 2 || r.before[1] == 14);
            sg_model_destroy(&m);
        }
    /* Two rounds, and stopped in the second. */
    struct sg_prune_params p = params_of(SG_PRUNER_PUP);
    struct sg_prune_result r;
    struct sg_model *m;
    int steps = 0;
    p.reduce = 1, p.finetune = 20;
    assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &m, &r), SG_OK);
    assert_true(r.rounds == 2 && r.before[1] == n - r.removed[0] &&
                r.removed[1] >= (r.before[1] - 1) / 2 + 1);
    sg_model_destroy(&m);
    p.step = count_steps, p.step_priv = &steps;
    assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &m, &r), SG_ERR_INTERRUPTED);
    assert_true(!m && steps == 30);
    assert_int_equal(sg_mem_current(f.ctx, SG_MEM_OPTIMISER), 0);
    clear_fixture(&f);
}

/* One view cannot tell all of a position and a size. So Gaussians that it shows have PUP's score of
 * those that it does not show, but do not count as such. */
static void unseen_is_what_no_view_shows(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_model *m = make_model(f.ctx, MOST, 0, 5);
    size_t expected = 0, lowest = 0;
    f.scene.train = f.views, f.scene.n_train = 1;
    *sg_model_at(m, 20, SG_P_XYZ) = 500; /* nobody sees it */
    for (int method = SG_PRUNER_LIGHTGAUSSIAN; method <= SG_PRUNER_SPECTRAL; method++) {
        struct sg_prune_params p = params_of((enum sg_pruner) method);
        struct sg_prune_result r;
        struct sg_model *left;
        double score[MOST];
        p.ratio = 0.01, p.finetune = 0, p.reduce = 1;
        assert_int_equal(sg_prune_scores(f.ctx, &f.scene, m, &p, score), SG_OK);
        assert_true(score[20] == (method == SG_PRUNER_LIGHTGAUSSIAN ? 0 : -INFINITY));
        assert_int_equal(sg_prune(f.ctx, &f.scene, m, &p, &left, &r), SG_OK);
        for (size_t i = 0; i < MOST; i++) {
            expected += method == SG_PRUNER_LIGHTGAUSSIAN && score[i] == 0;
            lowest += method == SG_PRUNER_PUP && score[i] == -INFINITY;
        }
        assert_int_equal(r.unseen[0], expected);
        sg_model_destroy(&left);
    }
    assert_true(lowest > expected);
    for (int kind = 0; kind <= SG_GLOBAL_OPACITY; kind++) { /* also where hits do not count */
        struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
        struct sg_prune_result r;
        struct sg_model *left;
        p.score = (enum sg_global_score) kind, p.ratio = 0.01, p.finetune = 0;
        assert_int_equal(sg_prune(f.ctx, &f.scene, m, &p, &left, &r), SG_OK);
        assert_int_equal(r.unseen[0], expected);
        sg_model_destroy(&left);
    }
    const struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
    double score[MOST];
    for (int axis = 0; axis < 3; axis++) /* a volume that overflows */
        *sg_model_at(m, 20, SG_P_SCALE + axis) = 300;
    assert_int_equal(sg_prune_scores(f.ctx, &f.scene, m, &p, score), SG_OK);
    assert_true(score[20] == 0);
    f.scene.n_train = VIEWS;
    sg_model_destroy(&m);
    clear_fixture(&f);
}

/* At 8/15 and 12/15 of the iterations; a resumed run has the same bytes. */
static void training_removes_twice(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    p.strategy = SG_STRATEGY_LIGHTGAUSSIAN, p.densify_until_iter = 20;
    f.scene.train = f.views;
    sg_trainer *t = begin_training(&f, &p);
    size_t before = f.start->count;
    struct sg_model *held = NULL, *rested = NULL;
    while (sg_trainer_iteration(t) < 40) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        if (s.iteration == 21)
            assert_in_range(s.gaussians, before * 2 / 5, before - (before - 1) / 2 - 1);
        if (s.iteration == 32)
            assert_in_range(s.gaussians, before / 2, before - (size_t) (0.4 * (double) before));
        if (s.iteration == 31)
            assert_int_equal(sg_trainer_model(t, &held), SG_OK);
        if (s.iteration == 32)
            assert_int_equal(sg_trainer_model(t, &rested), SG_OK);
        before = s.gaussians;
    }
    /* The one that removes takes no step: what stays is as it was, in its order. */
    for (size_t i = 0, k = 0; i < rested->count; i++, k++) {
        while (k < held->count &&
               *sg_model_at(held, k, SG_P_XYZ) != *sg_model_at(rested, i, SG_P_XYZ))
            k++;
        assert_true(k < held->count);
    }
    sg_model_destroy(&held);
    sg_model_destroy(&rested);
    sg_trainer_destroy(&t);
    struct sg_model *whole = train(&f, &p, 40, "prune_at_20.bin", NULL, NULL),
                    *resumed = train(&f, &p, 40, NULL, "prune_at_20.bin", NULL);
    assert_same(whole, resumed);
    p.strategy = SG_STRATEGY_DEFAULT;
    assert_int_equal(sg_trainer_resume(f.ctx, &f.scene, "prune_at_20.bin", &p, &t), SG_ERR_INPUT);
    remove("prune_at_20.bin");
    sg_model_destroy(&whole);
    sg_model_destroy(&resumed);
    clear_fixture(&f);
}

/* The first step of a run without time is all of it. What was due before the model settles is due
 * in it. */
static void a_long_step_removes(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    p.strategy = SG_STRATEGY_LIGHTGAUSSIAN, p.densify_until_iter = 20;
    p.tolerance = 8, p.tolerance_low_pass = 1;
    p.max_seconds = 1e-9;
    f.scene.train = f.views;
    sg_trainer *t = begin_training(&f, &p);
    struct sg_train_step s;
    assert_int_equal(sg_trainer_step(t, &s), SG_OK);
    assert_int_equal(s.iteration, p.iterations);
    assert_in_range(s.gaussians, 1, f.start->count * 3 / 5);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Each way to meet a limit keeps it, but for the one that may exceed it. */
static void limits_are_met(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_model *models[4];
    for (int way = SG_AT_LIMIT_SCORE; way <= SG_AT_LIMIT_UNIVERSAL; way++) {
        struct sg_train_params p = short_params();
        p.max_gaussians = 150, p.at_limit = (enum sg_at_limit) way,
        p.densify_grad_threshold = 1e-6f;
        f.scene.train = f.views;
        sg_trainer *t = begin_training(&f, &p);
        size_t most = 0, before = f.start->count;
        struct sg_train_limits limits;
        while (sg_trainer_iteration(t) < 40) {
            struct sg_train_step s;
            assert_int_equal(sg_trainer_step(t, &s), SG_OK);
            assert_true(s.render.visible <= before); /* hits that are counted are not the step's */
            before = s.gaussians;
            most = s.gaussians > most ? s.gaussians : most;
        }
        sg_trainer_limits(t, &limits);
        assert_true(limits.gaussians_bound);
        assert_true(way == SG_AT_LIMIT_UNIVERSAL ? most > 150 && most <= 300 : most <= 150);
        assert_int_equal(sg_trainer_model(t, &models[way]), SG_OK);
        sg_trainer_destroy(&t);
        struct sg_model *again = train(&f, &p, 40, "limit_at_20.bin", NULL, NULL),
                        *resumed = train(&f, &p, 40, NULL, "limit_at_20.bin", NULL);
        assert_same(models[way], again);
        assert_same(models[way], resumed); /* also of more than the limit */
        remove("limit_at_20.bin");
        sg_model_destroy(&again);
        sg_model_destroy(&resumed);
    }
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++)
            assert_true(
                models[a]->count != models[b]->count ||
                memcmp(models[a]->params, models[b]->params, SG_LANES * 3 * sizeof(float)) != 0);
    for (int way = 0; way < 4; way++)
        sg_model_destroy(&models[way]);
    clear_fixture(&f);
}

/* The universal threshold gates growth alone: what is there at first stays. */
static void universal_keeps_the_first_model(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = short_params();
    const size_t first = f.start->count;
    f.scene.train = f.views;
    for (int stops = 0; stops < 2; stops++) {
        struct sg_train_step s;
        p.max_gaussians = first * 2 / 3;
        p.at_limit = stops ? SG_AT_LIMIT_STOP : SG_AT_LIMIT_UNIVERSAL;
        sg_trainer *t = begin_training(&f, &p);
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.gaussians, stops ? p.max_gaussians : first);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* Nothing could learn from such photos. */
static void masks_that_leave_nothing_are_refused(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_prune_params p = params_of(SG_PRUNER_LIGHTGAUSSIAN);
    uint8_t unused[SIDE * SIDE] = {0};
    struct sg_model *left;
    f.scene.train = f.views;
    for (int v = 0; v < VIEWS; v++)
        f.views[v].mask = unused;
    for (p.finetune = 5; p.finetune >= 0; p.finetune -= 5) {
        const int code = sg_prune(f.ctx, &f.scene, f.start, &p, &left, NULL);
        assert_int_equal(code, p.finetune ? SG_ERR_INPUT : SG_OK);
        if (code)
            assert_non_null(strstr(sg_last_error(f.ctx), "masks leave nothing"));
        sg_model_destroy(&left);
    }
    clear_fixture(&f);
}

/* Of the first three, which are as large as the view. */
static size_t large_of(sg_trainer *t)
{
    struct sg_model *m;
    size_t n = 0;
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    for (size_t i = 0; i < m->count; i++)
        n += *sg_model_at(m, i, SG_P_SCALE) > -0.8f;
    sg_model_destroy(&m);
    return n;
}

/* Where the limit is met from the start nothing grows; what is larger than 20 pixels goes at the
 * first densification after the first reset, and not at that of the reset. A resumed run has the
 * same bytes. A limit that is never met changes nothing. */
static void universal_threshold_is_the_released_one(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    p.max_gaussians = f.start->count, p.at_limit = SG_AT_LIMIT_UNIVERSAL;
    p.densify_grad_threshold = 1e-6f;
    for (size_t i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            *sg_model_at(f.start, i, SG_P_SCALE + k) = -0.4f; /* as large as the view */
    for (int k = 0; k < 3; k++)
        *sg_model_at(f.start, 0, k) = 0;
    f.scene.train = f.views, f.scene.extent = 20;
    sg_trainer *t = begin_training(&f, &p);
    size_t at_20 = 0;
    while (sg_trainer_iteration(t) < 25) {
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_int_equal(s.cloned + s.split, 0);
        if (s.iteration == 20) {
            at_20 = s.gaussians;
            assert_int_equal(large_of(t), 3);
        }
        if (s.iteration == 25)
            assert_true(s.pruned >= 1 && s.gaussians == at_20 - s.pruned);
    }
    assert_true(at_20 > 0 && large_of(t) == 0);
    sg_trainer_destroy(&t);
    struct sg_model *whole = train(&f, &p, 40, "universal_at_20.bin", NULL, NULL),
                    *resumed = train(&f, &p, 40, NULL, "universal_at_20.bin", NULL);
    assert_same(whole, resumed);
    remove("universal_at_20.bin");
    sg_model_destroy(&whole);
    sg_model_destroy(&resumed);
    p.max_gaussians = 1000000;
    whole = train(&f, &p, 40, NULL, NULL, NULL);
    p.max_gaussians = 0, p.at_limit = SG_AT_LIMIT_SCORE;
    resumed = train(&f, &p, 40, NULL, NULL, NULL);
    assert_true(whole->count > f.start->count);
    assert_same(whole, resumed);
    sg_model_destroy(&whole);
    sg_model_destroy(&resumed);
    clear_fixture(&f);
}

static void scores_do_not_depend_on_threads(void **state)
{
    (void) state;
    double score[2][3][120];
    for (int k = 0; k < 2; k++) {
        struct fixture f = make_fixture(1 + 4 * k);
        f.scene.train = f.views;
        for (int method = 0; method < 3; method++) {
            const struct sg_prune_params p = params_of((enum sg_pruner) method);
            assert_int_equal(sg_prune_scores(f.ctx, &f.scene, f.truth, &p, score[k][method]),
                             SG_OK);
        }
        clear_fixture(&f);
    }
    assert_memory_equal(score[0], score[1], sizeof(score[0]));
}

static void bad_parameters_are_refused(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_prune_params p = params_of(SG_PRUNER_PUP);
    double score[120];
    p.ratio = 1.5;
    assert_int_equal(sg_prune_scores(f.ctx, &f.scene, f.truth, &p, score), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(f.ctx), "ratio: found 1.5, expected"));
    p = params_of(SG_PRUNER_PUP), p.reduce = 0;
    assert_int_equal(sg_prune_scores(f.ctx, &f.scene, f.truth, &p, score), SG_ERR_USAGE);
    p = params_of(SG_PRUNER_PUP);
    struct sg_model *m;
    f.scene.n_train = 0;
    assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &m, NULL), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f.ctx), "no training view"));
    f.scene.n_train = VIEWS, f.scene.train = f.views;
    *sg_model_at(f.truth, 2, SG_P_SCALE) = NAN;
    assert_int_equal(sg_prune(f.ctx, &f.scene, f.truth, &p, &m, NULL), SG_ERR_INPUT);
    assert_null(m);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pup_agrees_with_brute_force),
        cmocka_unit_test(pup_reduces_views),
        cmocka_unit_test(log_det_is_exact),
        cmocka_unit_test(lightgaussian_agrees_with_a_naive_rasteriser),
        cmocka_unit_test(lightgaussian_has_known_values),
        cmocka_unit_test(ranks_are_those_of_the_released_code),
        cmocka_unit_test(rates_follow_the_released_schedule),
        cmocka_unit_test(pruning_removes_and_repairs),
        cmocka_unit_test(unseen_is_what_no_view_shows),
        cmocka_unit_test(training_removes_twice),
        cmocka_unit_test(a_long_step_removes),
        cmocka_unit_test(limits_are_met),
        cmocka_unit_test(universal_keeps_the_first_model),
        cmocka_unit_test(masks_that_leave_nothing_are_refused),
        cmocka_unit_test(universal_threshold_is_the_released_one),
        cmocka_unit_test(scores_do_not_depend_on_threads),
        cmocka_unit_test(bad_parameters_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
