/* SPDX-License-Identifier: Apache-2.0 */
/* The strategy mcmc: its formulas against published values, its order of operations, its
 * limits. */
#include "core/rng.h"
#include "math/real_f64.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

#include "math/explore.h"

static const struct sg_mcmc_params released = {SG_MCMC_DEFAULTS};

/* Values of the double sum of the paper. */
static void test_share(void **state)
{
    (void) state;
    static const struct {
        double opacity;
        unsigned count;
        double own, scale;
    } cases[] = {{0.5, 1, 0.5, 1},
                 {0.5, 2, 0.292893219, 0.952151954},
                 {0.9, 2, 0.683772234, 0.867937851},
                 {0.9, 5, 0.369042656, 0.797124447},
                 {0.99, 10, 0.369042656, 0.667350279},
                 {0.2, 3, 0.0716822333, 0.978668533},
                 {0.999, 50, 0.12903641, 0.584918253},
                 {0.999, 70, 0.12903641, 0.584918253}}; /* more count as 50 */
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        double scale;
        const double own = sg_mcmc_share(&released, cases[i].opacity, cases[i].count, &scale);
        if (fabs(own - cases[i].own) > 1e-8 || fabs(scale - cases[i].scale) > 1e-8)
            fail_msg("%g, %u: found %.9g and %.9g", cases[i].opacity, cases[i].count, own, scale);
    }
    double scale, least;
    const struct sg_mcmc_params other = {.dead = 0.25f, .copies = 2};
    assert_true(fabs(sg_mcmc_share(&other, 0.9, 7, &scale) - cases[2].own) < 1e-8);
    assert_true(fabs(scale - cases[2].scale) < 1e-8);
    assert_true(sg_mcmc_share(&other, 0.3, 2, &least) == 0.25);
    const struct sg_mcmc_params many = {.copies = 1000};
    for (unsigned n = 1; n <= 1000; n++)
        for (int k = 0; k < 3; k++) {
            const double own = sg_mcmc_share(&many, (const double[]){0, 0.7, 1}[k], n, &scale);
            assert_true(own >= 0 && own < 1 && scale >= 0 && scale < 1.0001);
        }
    assert_true(sg_mcmc_share(&released, 0.006, 50, &scale) == (double) 0.005f); /* never dead */
    assert_true(sg_mcmc_share(&released, 1, 1, &scale) < 1 && scale > 0.9);
}

/* N coincident copies look in their centre as the one did, and so does the integral along a line
 * through it. */
static void test_share_conserves(void **state)
{
    (void) state;
    static const double opacity[] = {0.5, 0.9, 0.9, 0.99};
    static const unsigned count[] = {2, 2, 5, 10};
    for (int i = 0; i < 4; i++) {
        double scale, before = 0, after = 0;
        const double own = sg_mcmc_share(&released, opacity[i], count[i], &scale);
        for (int x = -4000; x <= 4000; x++) {
            const double d = x * 0.002;
            before += opacity[i] * exp(-d * d / 2);
            after += 1 - pow(1 - own * exp(-d * d / (2 * scale * scale)), count[i]);
        }
        assert_true(fabs(1 - pow(1 - own, count[i]) - opacity[i]) < 1e-12);
        assert_true(fabs(after / before - 1) < 1e-6);
    }
}

#define OPACITY_WEIGHT 0.3f
#define SCALE_WEIGHT 0.2f

/* The part of the loss that the weights add. */
static double regulariser(const struct sg_model *m)
{
    double sum = 0;
    for (size_t i = 0; i < m->count; i++) {
        sum += (double) OPACITY_WEIGHT / (1 + exp(-(double) *sg_model_at(m, i, SG_P_OPACITY)));
        for (int k = 0; k < 3; k++)
            sum += (double) SCALE_WEIGHT / 3 * exp((double) *sg_model_at(m, i, SG_P_SCALE + k));
    }
    return sum / (double) m->count;
}

/* With an image that has no gradient the first moments are a tenth of the regularisers' gradient,
 * of Gaussians in and out of sight alike. */
static void test_regularisers(void **state)
{
    (void) state;
    enum { SIZE = 32 };
    static const float zero[3 * SIZE * SIZE];
    static const char *const engines[] = {"cpu", "ref"};
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, 37, 1, 51), *after;
    const struct sg_camera camera = make_camera(SIZE, SIZE, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    *sg_model_at(m, 5, SG_P_XYZ + 2) = -50; /* behind the camera */
    for (int k = 0; k < 4; k++) {
        struct sg_engine *e = make_engine(ctx, engines[k / 2], NULL, m, NULL);
        struct sg_update u = {
            .adam = true, .mean_opacity = OPACITY_WEIGHT, .mean_scale = SCALE_WEIGHT};
        struct sg_columns o;
        for (int g = 0; g < SG_GROUPS; g++)
            u.rate[g] = 0.001f, u.root[g] = 30;
        assert_int_equal(sg_engine_draw(e, &camera, 1, &params, false), SG_OK);
        assert_int_equal(sg_engine_write_image_gradient(e, zero), SG_OK);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        if (k % 2) /* stored gradients, too */
            assert_int_equal(sg_engine_project_backward(e, false), SG_OK);
        assert_int_equal(sg_engine_optimise(e, &u), SG_OK);
        download(ctx, e, 1, &after, &o);
        for (size_t i = 0; i < m->count; i++)
            for (int p = 0; p < sg_param_count(1); p++) {
                float *value = sg_model_at(m, i, p);
                const float kept = *value, step = 0.01f;
                *value = kept + step;
                const double above = regulariser(m), high = (double) *value;
                *value = kept - step;
                const double expected = (above - regulariser(m)) / (high - (double) *value);
                *value = kept;
                const double found =
                    10 * (double) o.at[SG_C_MOMENT1][sg_param_index(sg_param_count(1), i, p)];
                if (fabs(found - expected) > 1e-4 * fabs(expected) + 1e-9)
                    fail_msg("%s: Gaussian %zu, plane %d: gradient %g, expected %g", engines[k / 2],
                             i, p, found, expected);
                if (p == SG_P_OPACITY || p == SG_P_SCALE)
                    assert_true(expected > 1e-5);
            }
        sg_columns_clear(&o);
        sg_model_destroy(&after);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Edits at 10, 15, 20 and 25. */
static struct sg_train_params mcmc_params(void)
{
    struct sg_train_params p = short_params();
    p.strategy = SG_STRATEGY_MCMC;
    p.mcmc.until = 30;
    p.mcmc.cap_max = 140;
    return p;
}

/* Grows by the factor, rounded down, to the cap; the dead are moved, all others make room by none;
 * the edit of an iteration takes the place of its step, which only an edit of nothing leaves. */
static void test_order(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = mcmc_params();
    static const size_t expected[] = {126, 132, 138, 140};
    for (size_t i = 0; i < 7; i++)
        *sg_model_at(f.start, 10 * i, SG_P_OPACITY) = -9; /* dead */
    p.opacity_lr = 0;                                     /* and they stay dead */
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= 32; it++) {
        struct sg_train_step s;
        const int steps = t->adam_steps[SG_G_XYZ];
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        const bool edit = it % 5 == 0 && it >= 10 && it < 30;
        assert_int_equal(s.gaussians, it < 10 ? 120 : it >= 25 ? 140 : expected[it / 5 - 2]);
        assert_int_equal(s.relocated, it == 10 ? 7 : 0);
        assert_int_equal(t->adam_steps[SG_G_XYZ] - steps, !edit);
        assert_int_equal(s.split + s.pruned, 0);
    }
    struct sg_train_limits limits;
    sg_trainer_limits(t, &limits);
    assert_false(limits.gaussians_bound); /* the cap is no budget */
    sg_trainer_destroy(&t);

    /* The last iteration edits nothing. */
    p.iterations = 20;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 20; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_gaussians(t), expected[1]);
    sg_trainer_destroy(&t);
    p.iterations = 40;

    /* At the cap with no dead one the step is taken. */
    p.mcmc.cap_max = 100;
    for (size_t i = 0; i < 7; i++)
        *sg_model_at(f.start, 10 * i, SG_P_OPACITY) = 0;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 12; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(t->adam_steps[SG_G_XYZ], 12);
    assert_int_equal(sg_trainer_gaussians(t), 120);
    sg_trainer_destroy(&t);

    /* A budget below the cap binds. */
    p.mcmc.cap_max = 140, p.max_gaussians = 125;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 30; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    sg_trainer_limits(t, &limits);
    assert_int_equal(sg_trainer_gaussians(t), 125);
    assert_true(limits.gaussians_bound);
    sg_trainer_destroy(&t);

    /* Also one that the model fills from the start, so that no edit comes about. */
    p.max_gaussians = f.start->count;
    t = begin_training(&f, &p);
    for (int it = 1; it <= 10; it++) {
        sg_trainer_limits(t, &limits);
        assert_false(limits.gaussians_bound);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    }
    assert_int_equal(t->adam_steps[SG_G_XYZ], 10);
    sg_trainer_limits(t, &limits);
    assert_true(limits.gaussians_bound);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Every iteration moves positions by noise in that iteration's rate and the scene's extent, also
 * one that edits the model; the last moves none. Of a Gaussian that no view shows noise is all. */
static void test_noise(void **state)
{
    (void) state;
    enum { AWAY = 5 };
    struct fixture f = make_fixture(1);
    struct sg_train_params p = mcmc_params();
    p.mcmc.cap_max = f.start->count, p.mcmc.noise_lr = 5e4f;
    p.mcmc.opacity_reg = p.mcmc.scale_reg = 0;
    p.position_lr_final = 1.6e-5f, p.position_lr_max_steps = 30;
    *sg_model_at(f.start, AWAY, SG_P_XYZ + 2) = -50;
    *sg_model_at(f.start, AWAY, SG_P_OPACITY) = logf(0.006f / 0.994f);
    for (int k = 0; k < 3; k++)
        *sg_model_at(f.start, AWAY, SG_P_SCALE + k) = -2 - 0.5f * (float) k;
    *sg_model_at(f.start, 0, SG_P_OPACITY) = -9; /* dead: relocated at 10 */
    sg_trainer *t = begin_training(&f, &p);
    double at[2][SG_P_SH] = {{0}};
    for (int k = 0; k < SG_P_SH; k++)
        at[0][k] = (double) *sg_model_at(f.start, AWAY, k);
    for (int it = 1; it <= 40; it++) {
        struct sg_model *m;
        struct sg_train_step s;
        assert_int_equal(sg_trainer_step(t, &s), SG_OK);
        assert_true((s.relocated > 0) == (it == 10) || it > 10);
        assert_int_equal(sg_trainer_model(t, &m), SG_OK);
        double n[3], move[3] = {0};
        for (int k = 0; k < SG_P_SH; k++)
            at[1][k] = (double) *sg_model_at(m, AWAY, k);
        for (uint64_t k = 0; k < 3; k++)
            n[k] = 5e4 * sg_position_lr(&p, it) * f.scene.extent *
                   explore_gate(at[0][SG_P_OPACITY], 100, (double) p.mcmc.dead) *
                   (double) sg_rng_normal(p.seed, SG_RNG_EXPLORE, (uint64_t) it, 3 * AWAY + k);
        if (it < 40)
            explore_move(at[0] + SG_P_ROT, at[0] + SG_P_SCALE, n, move);
        for (int k = 0; k < SG_P_SH; k++) {
            const double found = at[1][k] - at[0][k], expected = k < 3 ? move[k] : 0;
            if (fabs(found - expected) > 1e-4 * fabs(expected) + 4e-6)
                fail_msg("iteration %d, plane %d: moved by %g, expected %g", it, k, found,
                         expected);
        }
        memcpy(at[0], at[1], sizeof(at[0]));
        sg_model_destroy(&m);
    }
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Of those that share their opacity the moments begin anew, of a place that one has died in they
 * stay, as in the released code. */
static void test_moments(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = mcmc_params();
    struct sg_model *m[2];
    struct sg_columns o[2];
    size_t sources = 0;
    p.mcmc.cap_max = f.start->count;
    p.opacity_lr = 0;
    for (size_t i = 0; i < 7; i++)
        *sg_model_at(f.start, 10 * i, SG_P_OPACITY) = -9;
    sg_trainer *t = begin_training(&f, &p);
    for (int k = 0; k < 2; k++) {
        while (sg_trainer_iteration(t) < 9 + k)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        download(f.ctx, t->engine, 1, &m[k], &o[k]);
    }
    for (size_t i = 0; i < f.start->count; i++) {
        const bool dead = i < 70 && i % 10 == 0,
                   source = !dead && *sg_model_at(m[0], i, SG_P_OPACITY) !=
                                         *sg_model_at(m[1], i, SG_P_OPACITY);
        sources += source;
        for (int c = SG_C_MOMENT1; c <= SG_C_MOMENT2; c++)
            for (int plane = 0; plane < sg_param_count(1); plane++) {
                const size_t at = sg_param_index(sg_param_count(1), i, plane);
                assert_true(o[1].at[c][at] == (source ? 0 : o[0].at[c][at]));
                assert_true(plane != SG_P_SCALE || o[0].at[c][at] != 0);
            }
    }
    assert_in_range(sources, 1, 7);
    for (int k = 0; k < 2; k++) {
        sg_model_destroy(&m[k]);
        sg_columns_clear(&o[k]);
    }
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Draws of an edit, each with the probability of its opacity. */
static void draw_sources(const double *opacity, const bool *counts, size_t n, uint64_t seed,
                         enum sg_rng_use use, int it, size_t draws, size_t *source, unsigned *times)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++) {
        sum += counts[i] ? opacity[i] : 0;
        times[i] = 0;
    }
    for (size_t k = 0; k < draws; k++) {
        const double u = (double) (sg_rng_u64(seed, use, (uint64_t) it, k) >> 11) * 0x1p-53;
        double below = 0;
        size_t i = 0;
        while (below += counts[i] ? opacity[i] : 0, below <= u * sum)
            i++;
        source[k] = i;
        times[i]++;
    }
}

/* Gives a Gaussian its share: its logit, and what its scales gain. */
static void take_share(const struct sg_mcmc_params *p, double *opacity, unsigned times,
                       double *scale)
{
    double gain;
    *opacity = sg_mcmc_share(p, *opacity, times + 1, &gain);
    *scale += log(gain);
}

/* A whole edit: the dead become copies of those that are alive, which share their opacity with
 * them; then copies are added of all, by the opacities that there are then. */
static void test_edit(void **state)
{
    (void) state;
    enum { BEFORE = 120, AFTER = 168, DEAD = 40 };
    struct fixture f = make_fixture(1);
    struct sg_train_params p = mcmc_params();
    struct sg_model *m[2];
    size_t source[AFTER], of[AFTER], drawn_dead = 0;
    unsigned times[BEFORE];
    double opacity[BEFORE], scale[BEFORE] = {0};
    bool alive[BEFORE], all[BEFORE];
    p.mcmc.cap_max = 1000, p.mcmc.growth = 1.4, p.mcmc.dead = 0.2f, p.mcmc.noise_lr = 0;
    p.opacity_lr = 0;
    for (size_t i = 0; i < BEFORE; i++) /* 0.19, 0.3 and 0.9 */
        *sg_model_at(f.start, i, SG_P_OPACITY) = i < DEAD ? -1.45f : i % 2 ? -0.85f : 2.2f;
    sg_trainer *t = begin_training(&f, &p);
    for (int k = 0; k < 2; k++) {
        while (sg_trainer_iteration(t) < 9 + k)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        assert_int_equal(sg_trainer_model(t, &m[k]), SG_OK);
    }
    for (size_t i = 0; i < BEFORE; i++) {
        opacity[i] = 1 / (1 + exp(-(double) *sg_model_at(m[0], i, SG_P_OPACITY)));
        of[i] = i, alive[i] = i >= DEAD, all[i] = true;
    }
    draw_sources(opacity, alive, BEFORE, p.seed, SG_RNG_RELOCATE, 10, DEAD, source, times);
    for (size_t i = DEAD; i < BEFORE; i++)
        if (times[i])
            take_share(&p.mcmc, &opacity[i], times[i], &scale[i]);
    for (size_t i = 0; i < DEAD; i++)
        of[i] = source[i], opacity[i] = opacity[source[i]], scale[i] = scale[source[i]];
    draw_sources(opacity, all, BEFORE, p.seed, SG_RNG_GROW, 10, AFTER - BEFORE, source, times);
    for (size_t i = 0; i < BEFORE; i++)
        if (times[i])
            take_share(&p.mcmc, &opacity[i], times[i], &scale[i]);
    assert_int_equal(m[1]->count, AFTER);
    for (size_t i = 0; i < AFTER; i++) {
        const size_t at = i < BEFORE ? i : source[i - BEFORE];
        drawn_dead += i >= BEFORE && at < DEAD;
        for (int plane = 0; plane < sg_param_count(1); plane++) {
            double expected = (double) *sg_model_at(m[0], of[at], plane);
            if (plane == SG_P_OPACITY)
                expected = log(opacity[at] / (1 - opacity[at]));
            else if (plane >= SG_P_SCALE && plane < SG_P_ROT)
                expected += scale[at];
            const double found = (double) *sg_model_at(m[1], i, plane);
            if (fabs(found - expected) > 1e-5 + 1e-5 * fabs(expected))
                fail_msg("Gaussian %zu, plane %d: found %g, expected %g", i, plane, found,
                         expected);
        }
    }
    assert_true(drawn_dead > 0);
    for (int k = 0; k < 2; k++)
        sg_model_destroy(&m[k]);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* Five edits without a death from 100000 on: never above the cap or the budget, and never fewer. */
static void test_growth(void **state)
{
    (void) state;
    static const size_t expected[] = {100000, 105000, 110250, 115762, 121550, 127627};
    sg_trainer t = {.params = sg_train_params_default()};
    bool bound;
    for (int k = 1; k <= 5; k++) {
        assert_int_equal(sg_mcmc_target(&t, expected[k - 1], &bound), expected[k]);
        assert_false(bound);
    }
    t.params.mcmc.cap_max = 104000;
    assert_int_equal(sg_mcmc_target(&t, 100000, &bound), 104000);
    assert_int_equal(sg_mcmc_target(&t, 104001, &bound), 104001);
    assert_false(bound);
    t.budget.gaussians = 103000;
    assert_int_equal(sg_mcmc_target(&t, 100000, &bound), 103000);
    assert_true(bound);
}

/* Points begin at half the opacity and a tenth of the size, or as the parameters say. */
static void test_begin(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = mcmc_params();
    struct sg_model *m[3];
    p.init_points = 50;
    f.scene.format = SG_FORMAT_BLENDER; /* the same cube for both */
    for (int mcmc = 0; mcmc < 3; mcmc++) {
        sg_trainer *t;
        p.strategy = mcmc ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
        if (mcmc == 2)
            p.mcmc.init_opacity = 0.2f, p.mcmc.init_scale = 3;
        f.scene.train = f.views;
        assert_int_equal(sg_trainer_create(f.ctx, &f.scene, NULL, &p, &t), SG_OK);
        assert_int_equal(sg_trainer_model(t, &m[mcmc]), SG_OK);
        sg_trainer_destroy(&t);
    }
    for (size_t i = 0; i < 50; i++) {
        assert_true(*sg_model_at(m[1], i, SG_P_OPACITY) == 0);
        assert_true(fabsf(*sg_model_at(m[0], i, SG_P_SCALE) + logf(0.1f) -
                          *sg_model_at(m[1], i, SG_P_SCALE)) < 1e-6f);
        assert_true(*sg_model_at(m[1], i, SG_P_XYZ) == *sg_model_at(m[0], i, SG_P_XYZ));
        assert_true(fabsf(*sg_model_at(m[2], i, SG_P_OPACITY) + logf(4)) < 1e-6f);
        assert_true(fabsf(*sg_model_at(m[0], i, SG_P_SCALE) + logf(3) -
                          *sg_model_at(m[2], i, SG_P_SCALE)) < 1e-6f);
    }
    for (int k = 0; k < 3; k++)
        sg_model_destroy(&m[k]);
    clear_fixture(&f);
}

/* Where positions begin: the farthest coordinate of a run of these parameters. */
static float farthest(struct fixture *f, const struct sg_train_params *p)
{
    struct sg_model *m;
    sg_trainer *t;
    float most = 0;
    assert_int_equal(sg_trainer_create(f->ctx, &f->scene, NULL, p, &t), SG_OK);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    for (size_t i = 0; i < m->count; i++)
        for (int k = 0; k < 3; k++)
            most = fmaxf(most, fabsf(*sg_model_at(m, i, SG_P_XYZ + k)));
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);
    return most;
}

/* Random points fill the cube of NeRF-Synthetic, elsewhere 3 extents to each side or as many as
 * the parameters say, also in place of the scene's points. */
static void test_random_points(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    struct sg_train_params p = mcmc_params();
    float points[3 * 5] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0.5f, 0.5f, 0.5f};
    uint8_t colours[3 * 5] = {0};
    p.init_points = 2000;
    f.scene.train = f.views;
    f.scene.extent = 0.2;
    f.scene.format = SG_FORMAT_BLENDER;
    assert_in_range(1000 * farthest(&f, &p), 1295, 1300);
    f.scene.format = SG_FORMAT_COLMAP;
    assert_in_range(1000 * farthest(&f, &p), 597, 600);
    f.scene.points = points, f.scene.point_colors = colours, f.scene.n_points = 5;
    assert_true(farthest(&f, &p) == 1);
    p.random_points = true;
    assert_in_range(1000 * farthest(&f, &p), 597, 600);
    sg_trainer *t;
    assert_int_equal(sg_trainer_create(f.ctx, &f.scene, f.start, &p, &t), SG_ERR_USAGE);
    p.random_extent = 7;
    assert_in_range(1000 * farthest(&f, &p), 1394, 1400);
    p.strategy = SG_STRATEGY_DEFAULT, p.random_extent = 0;
    assert_in_range(1000 * farthest(&f, &p), 1295, 1300);
    f.scene.points = NULL, f.scene.point_colors = NULL, f.scene.n_points = 0;
    clear_fixture(&f);
}

/* The filter removes Gaussians, which this strategy does not do. */
static void test_defense(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_train_params p = mcmc_params();
    p.defense.on = true;
    assert_int_equal(sg_train_check(ctx, &p), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "defense.rho"));
    p.defense.rho = 0;
    assert_int_equal(sg_train_check(ctx, &p), SG_OK);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_share),         cmocka_unit_test(test_share_conserves),
        cmocka_unit_test(test_regularisers),  cmocka_unit_test(test_order),
        cmocka_unit_test(test_noise),         cmocka_unit_test(test_moments),
        cmocka_unit_test(test_edit),          cmocka_unit_test(test_growth),
        cmocka_unit_test(test_begin),         cmocka_unit_test(test_defense),
        cmocka_unit_test(test_random_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
