/* SPDX-License-Identifier: Apache-2.0 */
/* The 3D filter of Mip-Splatting: its values and gradients, what it follows from, and how a
 * training uses it. */
#include <limits.h>
#include <unistd.h>

#include "model/mip.h"
#include "train/densify.h"
#include "train/schedule.h"
#include "train/trainer.h"
#include "training.h"

static float block[SG_PARAMS_MAX * SG_LANES], shaped[SG_PARAMS_MAX * SG_LANES], filter[SG_LANES];

#define AT(array, plane, lane) (array)[(plane) *SG_LANES + (lane)]

static double opacity(float logit)
{
    return 1 / (1 + exp(-(double) logit));
}

/* Values of the released code, at usual sizes and where squares would underflow. */
static void test_values(void **state)
{
    (void) state;
    memset(block, 0, sizeof(block));
    memset(filter, 0, sizeof(filter));
    filter[0] = filter[1] = filter[2] = 0.01f;
    for (int k = 0; k < 3; k++) {
        AT(block, SG_P_SCALE + k, 0) = logf(0.01f * (float) (k + 1));
        AT(block, SG_P_SCALE + k, 1) = -25;
        AT(block, SG_P_SCALE + k, 2) = 3;
        AT(block, SG_P_SCALE + k, 3) = -4;
    }
    for (int lane = 0; lane < SG_LANES; lane++)
        AT(block, SG_P_OPACITY, lane) = logf(0.8f / 0.2f), AT(block, SG_P_SH, lane) = 0.3f;
    sg_mip_forward(NULL, block, filter, sg_param_count(1), shaped);
    const double wide[3] = {0.0141421356, 0.0223606798, 0.0316227766};
    for (int k = 0; k < 3; k++) {
        assert_true(fabs(exp((double) AT(shaped, SG_P_SCALE + k, 0)) / wide[k] - 1) < 1e-6);
        assert_true(fabsf(AT(shaped, SG_P_SCALE + k, 1) - logf(0.01f)) < 1e-6f);
        assert_true(fabsf(AT(shaped, SG_P_SCALE + k, 2) - 3) < 1e-5f);
    }
    assert_true(fabs(opacity(AT(shaped, SG_P_OPACITY, 0)) - 0.8 * 0.6) < 1e-6);
    const double log_least = log(0.8) + 3 * (-25 - log(0.01));
    assert_true(fabs((double) AT(shaped, SG_P_OPACITY, 1) - log_least) < 1e-3);
    assert_true(fabs(opacity(AT(shaped, SG_P_OPACITY, 2)) - 0.8) < 1e-5);
    for (int p = 0; p < sg_param_count(1); p++) /* no filter, and what it does not touch */
        for (int lane = 0; lane < SG_LANES; lane++)
            if (lane >= 3 || (p != SG_P_OPACITY && (p < SG_P_SCALE || p >= SG_P_SCALE + 3)))
                assert_true(AT(shaped, p, lane) == AT(block, p, lane));
}

/* Of a weighted sum of what is drawn. */
static double weighted(void)
{
    double sum = 0;
    sg_mip_forward(NULL, block, filter, sg_param_count(0), shaped);
    for (int lane = 0; lane < SG_LANES; lane++)
        for (int p = SG_P_OPACITY; p < SG_P_SCALE + 3; p++)
            sum +=
                (double) (0.3f * (float) (p - SG_P_OPACITY) - 0.4f) * (double) AT(shaped, p, lane);
    return sum;
}

static void test_gradient(void **state)
{
    (void) state;
    float gradients[SG_PARAMS_MAX * SG_LANES];
    for (int lane = 0; lane < SG_LANES; lane++) {
        filter[lane] = lane == 7 ? 0 : 0.002f * (float) (lane + 1);
        AT(block, SG_P_OPACITY, lane) = draw(80, (uint64_t) lane, -4, 4);
        for (int k = 0; k < 3; k++)
            AT(block, SG_P_SCALE + k, lane) = draw(81, (uint64_t) (3 * lane + k), -6, -2);
    }
    for (int p = 0; p < sg_param_count(0); p++)
        for (int lane = 0; lane < SG_LANES; lane++)
            AT(gradients, p, lane) = 0.3f * (float) (p - SG_P_OPACITY) - 0.4f;
    sg_mip_backward(NULL, block, filter, sg_param_count(0), gradients);
    for (int p = SG_P_OPACITY; p < SG_P_SCALE + 3; p++)
        for (int lane = 0; lane < SG_LANES; lane++) {
            float *value = &AT(block, p, lane);
            const float kept = *value;
            double change = 0;
            for (int side = -1; side <= 1; side += 2) {
                *value = kept + 0.02f * (float) side;
                change += side * weighted() / 0.04;
            }
            *value = kept;
            const double found = (double) AT(gradients, p, lane);
            if (!(fabs(found - change) < 2e-3 * fabs(change) + 1e-3))
                fail_msg("plane %d, lane %d: gradient %g, expected %g", p, lane, found, change);
        }
}

static void read_filter(sg_ctx *ctx, struct sg_engine *e, int degree, struct sg_columns *out)
{
    assert_int_equal(
        sg_columns_create(ctx, sg_engine_count(e), degree, SG_COLUMN_SAVED | SG_COLUMN_MIP, out),
        SG_OK);
    assert_int_equal(sg_engine_download(e, NULL, out), SG_OK);
}

/* As many grow by the absolute statistic as by the norm, and at least one. */
static void test_growth(void **state)
{
    (void) state;
    enum { N = 101 };
    for (int some = 0; some < 2; some++) {
        sg_ctx *ctx = make_context(1);
        struct sg_model *m = make_model(ctx, N, 0, 83);
        struct sg_columns o;
        struct sg_densify_result r;
        assert_int_equal(sg_columns_create(ctx, N, 0, SG_COLUMN_SAVED | SG_COLUMN_MIP, &o), SG_OK);
        for (size_t i = 0; i < N; i++) {
            *sg_model_at(m, i, SG_P_OPACITY) = 0;
            o.at[SG_C_GRAD_COUNT][i] = 2;
            o.at[SG_C_GRAD_SUM][i] = some && i < 10 ? 0.5f : 0.01f;
            o.at[SG_C_GRAD_ABSOLUTE][i] = 0.1f * (float) i;
        }
        struct sg_engine *e = make_engine(ctx, "cpu", NULL, m, &o);
        assert_int_equal(sg_densify(e,
                                    &(struct sg_densify_params){
                                        .gradient = 0.2f, .absolute = true, .split_scale = 1e9f},
                                    &r),
                         SG_OK);
        /* the quantile lies at 10 / 101 x 100 = 9.9 from the top: those of 91 to 100 reach it */
        assert_int_equal(r.cloned, some ? 20 : 1);
        sg_engine_destroy(&e);
        sg_columns_clear(&o);
        sg_model_destroy(&m);
        sg_ctx_destroy(&ctx);
    }
}

/* After growth has ended, every 100 iterations but not in the last 100. */
static void test_schedule(void **state)
{
    (void) state;
    struct sg_train_params p = sg_train_params_default();
    int count = 0;
    p.model = SG_MODEL_MIP;
    for (int it = 1; it <= p.iterations; it++)
        if (sg_renews_filter(&p, INT_MAX, it - 1, it)) {
            assert_true(it % 100 == 0 && it >= 15100 && it <= 29800);
            count++;
        }
    assert_int_equal(count, 148);
    p.mip.interval = 5000;
    assert_true(sg_renews_filter(&p, INT_MAX, 19999, 20000) &&
                !sg_renews_filter(&p, INT_MAX, 24999, 25000));
    p.mip.interval = 100; /* also where nothing densifies since a tolerance settles */
    assert_true(sg_renews_filter(&p, 14000, 14099, 14100));
    assert_false(sg_renews_filter(&p, 14000, 13999, 14000));
    p.model = SG_MODEL_3DGS;
    assert_false(sg_renews_filter(&p, INT_MAX, 15099, 15100));
}

/* The model that a training hands out looks like the one that it holds, and its filter follows the
 * cameras. */
static void test_model(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    static float rgb[2][3 * SIDE * SIDE];
    sg_renderer *r;
    struct sg_model *m;
    p.model = SG_MODEL_MIP;
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= 25; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    struct sg_columns o;
    read_filter(f.ctx, t->engine, t->sh_degree, &o);
    for (size_t i = 0; i < sg_trainer_gaussians(t); i++)
        assert_true(o.at[SG_C_FILTER][i] > 0.005f && o.at[SG_C_FILTER][i] < 0.1f);
    sg_columns_clear(&o);
    assert_int_equal(sg_trainer_renderer(t, &r), SG_OK);
    assert_int_equal(sg_render(r, &f.views[0].camera, rgb[0], NULL, NULL, NULL), SG_OK);
    sg_renderer_destroy(&r);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS, .mip_kernel = 0.1f};
    assert_int_equal(sg_renderer_create(f.ctx, NULL, NULL, m, &params, &r), SG_OK);
    assert_int_equal(sg_render(r, &f.views[0].camera, rgb[1], NULL, NULL, NULL), SG_OK);
    for (size_t i = 0; i < 3 * SIDE * SIDE; i++)
        assert_true(fabsf(rgb[0][i] - rgb[1][i]) < 1e-3f);
    sg_renderer_destroy(&r);
    sg_model_destroy(&m);
    sg_trainer_destroy(&t);

    p.strategy = SG_STRATEGY_MCMC;
    assert_int_equal(sg_train_check(f.ctx, &p), SG_ERR_USAGE);
    p.strategy = SG_STRATEGY_DEFAULT, p.absgrad = true;
    assert_int_equal(sg_train_check(f.ctx, &p), SG_ERR_USAGE);
    clear_fixture(&f);
}

/* Whether the filter is that of the positions as they are. */
static bool follows(const struct fixture *f, sg_trainer *t)
{
    struct sg_columns before, now;
    read_filter(f->ctx, t->engine, t->sh_degree, &before);
    assert_int_equal(sg_trainer_renew_filter(t), SG_OK);
    read_filter(f->ctx, t->engine, t->sh_degree, &now);
    const bool same = !memcmp(before.at[SG_C_FILTER], now.at[SG_C_FILTER],
                              sg_trainer_gaussians(t) * sizeof(float));
    sg_columns_clear(&before);
    sg_columns_clear(&now);
    return same;
}

/* A training renews it after growth has ended too, also while a tolerance settles. */
static void test_renewal(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    for (int tolerance = 0; tolerance < 2; tolerance++) {
        struct sg_train_params p = short_params();
        p.model = SG_MODEL_MIP;
        p.densify_until_iter = 20, p.mip.interval = 6, p.tolerance = 8 * (float) tolerance;
        for (int last = 30; last <= 39; last += 3) {
            sg_trainer *t = begin_training(&f, &p);
            for (int it = 1; it <= last; it++)
                assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
            assert_int_equal(follows(&f, t), last == 30);
            sg_trainer_destroy(&t);
        }
    }
    struct sg_train_params p = short_params(); /* that grows until it settles at 36 */
    p.model = SG_MODEL_MIP;
    p.densify_until_iter = 1000, p.mip.interval = 1, p.tolerance = 8;
    sg_trainer *t = begin_training(&f, &p);
    for (int it = 1; it <= 38; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_true(follows(&f, t));
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* While the model grows each densification makes the filter anew, and nothing else does. */
static void test_growing(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    p.model = SG_MODEL_MIP;
    for (int last = 9; last <= 15; last += 3) { /* densifies at 10, 15, ... */
        sg_trainer *t = begin_training(&f, &p);
        for (int it = 1; it <= last; it++)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        assert_int_equal(follows(&f, t), last == 15);
        sg_trainer_destroy(&t);
    }
    clear_fixture(&f);
}

/* A file with the filter beside the parameters has it as its last property, and is read as the
 * folded model; a filter that is no number is refused. */
static void test_files(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_mip_XXXXXX", line[80] = "", before[80] = "";
    struct fixture f = make_fixture(2);
    struct sg_train_params p = short_params();
    struct sg_model *m[2], *back;
    p.model = SG_MODEL_MIP;
    close(mkstemp(path));
    for (int keep = 0; keep < 2; keep++) {
        p.keep_filter = keep;
        m[keep] = train(&f, &p, 12, NULL, NULL, NULL);
    }
    assert_null(m[0]->columns ? m[0]->columns->at[SG_C_FILTER] : NULL);
    assert_true(m[1]->columns->at[SG_C_FILTER][0] > 0);
    assert_true(*sg_model_at(m[1], 0, SG_P_SCALE) < *sg_model_at(m[0], 0, SG_P_SCALE));
    assert_int_equal(sg_model_write_ply(f.ctx, m[1], path), SG_OK);
    FILE *file = fopen(path, "r");
    while (strcmp(line, "end_header\n") && (memcpy(before, line, sizeof(line)), 1))
        assert_non_null(fgets(line, sizeof(line), file));
    fclose(file);
    assert_string_equal(before, "property float filter_3D\n");
    assert_int_equal(sg_model_read_ply(f.ctx, path, 1000000, &back), SG_OK);
    assert_same(back, m[0]);
    assert_null(back->columns->at[SG_C_FILTER]);
    sg_model_destroy(&back);
    static const float wrong[] = {-0.1f, NAN, INFINITY};
    for (int k = 0; k < 3; k++) {
        m[1]->columns->at[SG_C_FILTER][5] = wrong[k];
        assert_int_equal(sg_model_write_ply(f.ctx, m[1], path), SG_OK);
        assert_int_equal(sg_model_read_ply(f.ctx, path, 1000000, &back), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(f.ctx), "Gaussian 5: filter_3D: found"));
    }
    unlink(path);
    sg_model_destroy(&m[0]);
    sg_model_destroy(&m[1]);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_values),  cmocka_unit_test(test_gradient),
        cmocka_unit_test(test_growth),  cmocka_unit_test(test_schedule),
        cmocka_unit_test(test_model),   cmocka_unit_test(test_renewal),
        cmocka_unit_test(test_growing), cmocka_unit_test(test_files),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
