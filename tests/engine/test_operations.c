/* SPDX-License-Identifier: Apache-2.0 */
/* What every engine must do, by the calls of engine.h alone: each case runs on every engine and
 * variant of this machine and is compared with the oracle, or with differences of the engine's own
 * values. */
#include "operations.h"

static struct sg_step losses_of(struct sg_engine *e, const struct sg_model *m, const uint8_t *mask,
                                size_t n)
{
    return losses_against(e, m, mask, 0, 255.9f, n);
}

static bool counts_absolute(int k)
{
    sg_ctx *ctx = make_context(1);
    struct sg_engine *e;
    assert_int_equal(sg_engine_create(ctx, cases[k].engine, cases[k].variant, &e), SG_OK);
    const int code = sg_engine_set_statistic(e, SG_GRADIENT_ABSOLUTE);
    assert_true(
        code == SG_OK ||
        (code == SG_ERR_USAGE && strstr(sg_last_error(ctx), "which engine vulkan does not count")));
    sg_engine_destroy(&e);
    sg_ctx_destroy(&ctx);
    return code == SG_OK;
}

/* Every loss on its own and all of them, with a mask and without: values and gradients as the
 * oracle's. */
static void test_losses(void **state)
{
    (void) state;
    static const char *const names[] = {[SG_LOSS_PHOTOMETRIC] = "loss: photometric",
                                        [SG_LOSS_ANISOTROPY] = "loss: anisotropy",
                                        [SG_LOSS_TOTAL_VARIATION] = "loss: total variation"};
    static uint8_t mask[PIXELS];
    for (size_t i = 0; i < PIXELS; i++)
        mask[i] = i % 5 && i % 7 ? 255 : 0;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_sure_model(ctx, 31);
    for (size_t n = 1; n <= SG_LOSSES; n++)
        for (int masked = 0; masked < 2; masked++) {
            struct sg_engine *ref = begin(ctx, case_count - 1, m, NULL);
            const struct sg_step expected = losses_of(ref, m, masked ? mask : NULL, n);
            struct sg_model *right = gradients_of(ctx, ref, m);
            for (int k = 0; k < case_count - 1; k++) {
                struct sg_engine *e = begin(ctx, k, m, NULL);
                const struct sg_step found = losses_of(e, m, masked ? mask : NULL, n);
                for (size_t kind = 0; kind < SG_LOSSES; kind++) {
                    assert_int_equal(isnan(found.loss[kind]) != 0, kind >= n);
                    if (kind < n)
                        assert_within(case_name(cases[k]), names[kind],
                                      fabs(found.loss[kind] / expected.loss[kind] - 1), 1e-5);
                }
                struct sg_model *g = gradients_of(ctx, e, m);
                assert_gradients(case_name(cases[k]), "gradient of all losses", g, right, 1e-4);
                sg_model_destroy(&g);
                sg_engine_destroy(&e);
            }
            sg_model_destroy(&right);
            sg_engine_destroy(&ref);
        }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* The penalties of the total variation that losses_against does not have. */
static void test_penalties(void **state)
{
    (void) state;
    static const enum sg_tv_penalty penalties[] = {SG_TV_PENALTY_L1, SG_TV_PENALTY_L2};
    static float planes[3 * PIXELS];
    const struct sg_camera camera = make_camera(W, H, 3);
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_sure_model(ctx, 31);
    for (int p = 0; p < 2; p++) {
        const struct sg_loss losses[] = {
            {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}},
            {SG_LOSS_TOTAL_VARIATION, 3, {.total_variation = penalties[p]}},
        };
        struct sg_model *right = NULL;
        double expected = 0;
        for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
            struct sg_engine *e = begin(ctx, k, m, NULL);
            const struct sg_target target = {.planes = planes};
            const double found =
                step_against(e, m, &camera, &target, losses, 2).loss[SG_LOSS_TOTAL_VARIATION];
            struct sg_model *g = gradients_of(ctx, e, m);
            sg_engine_destroy(&e);
            if (!right) {
                expected = found, right = g;
                continue;
            }
            assert_within(case_name(cases[k]), "loss: total variation", fabs(found / expected - 1),
                          1e-5);
            assert_gradients(case_name(cases[k]), "gradient of all losses", g, right, 1e-4);
            sg_model_destroy(&g);
        }
        sg_model_destroy(&right);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static const struct sg_update *some_update(void)
{
    static struct sg_update u = {.adam = true, .statistics = true};
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = 0.01f * (float) (g + 1), u.root[g] = 30;
    return &u;
}

/* Stored gradients and a step from them move the model as the two stages in one do, and count the
 * same statistics. */
static void test_two_stages(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 32), *after[2];
    float gradient[2][GAUSSIANS];
    for (int k = 0; k < case_count; k++) {
        for (int stages = 0; stages < 2; stages++) {
            struct sg_engine *e = begin(ctx, k, m, NULL);
            losses_of(e, m, NULL, 1);
            assert_int_equal(sg_engine_raster_backward(e), SG_OK);
            if (stages)
                assert_int_equal(sg_engine_project_backward(e, true), SG_OK);
            assert_int_equal(sg_engine_optimise(e, some_update()), SG_OK);
            assert_int_equal(sg_model_create(ctx, m->count, m->sh_degree, &after[stages]), SG_OK);
            assert_int_equal(sg_engine_download(e, after[stages], NULL), SG_OK);
            assert_int_equal(
                sg_engine_read_statistics(e, &(struct sg_statistics){.gradient = gradient[stages]}),
                SG_OK);
            sg_engine_destroy(&e);
        }
        assert_memory_equal(after[1]->params, after[0]->params, values_of(m) * sizeof(float));
        assert_memory_equal(gradient[0], gradient[1], sizeof(gradient[0]));
        assert_memory_not_equal(after[0]->params, m->params, values_of(m) * sizeof(float));
        sg_model_destroy(&after[0]);
        sg_model_destroy(&after[1]);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* ---- a shape ---- */

/* Scales that have a floor, softly: scale' = log(exp(scale) + floor), and colours that are
 * halved. */
static void floor_forward(const void *arg, const float *params, const float *column, int planes,
                          float *shaped)
{
    (void) column;
    const float least = *(const float *) arg;
    memcpy(shaped, params, (size_t) planes * SG_LANES * sizeof(float));
    for (int i = SG_P_SCALE * SG_LANES; i < SG_P_ROT * SG_LANES; i++)
        shaped[i] = logf(expf(params[i]) + least);
    for (int i = SG_P_SH * SG_LANES; i < (SG_P_SH + 3) * SG_LANES; i++)
        shaped[i] = 0.5f * params[i];
}

static void floor_backward(const void *arg, const float *params, const float *column, int planes,
                           float *gradients)
{
    (void) column;
    const float least = *(const float *) arg;
    (void) planes;
    for (int i = SG_P_SCALE * SG_LANES; i < SG_P_ROT * SG_LANES; i++)
        gradients[i] *= expf(params[i]) / (expf(params[i]) + least);
    for (int i = SG_P_SH * SG_LANES; i < (SG_P_SH + 3) * SG_LANES; i++)
        gradients[i] *= 0.5f;
}

/* The image with a shape is that of the shaped parameters; its gradients are those of the
 * parameters, by differences. */
static void test_shape(void **state)
{
    (void) state;
    enum { N = 12 };
    static float weight[3 * PIXELS], rgb[2][3 * PIXELS];
    static const float least = 0.05f;
    const struct sg_shape shape = {"floor", &least, SG_COLUMNS, floor_forward, floor_backward};
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    for (size_t i = 0; i < 3 * PIXELS; i++)
        weight[i] =
            draw(15, i, 0.5f, 1); /* of one sign: the ring at the cut-off of alpha weighs little */
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, N, 1, 33), *shaped, *g;
    for (size_t i = 0; i < N; i++) { /* all in sight and hardly hidden */
        *sg_model_at(m, i, SG_P_OPACITY) = 1;
        for (int axis = 0; axis < 3; axis++)
            *sg_model_at(m, i, SG_P_XYZ + axis) *= 0.6f;
    }
    assert_int_equal(sg_model_create(ctx, N, 1, &shaped), SG_OK);
    floor_forward(&least, m->params, NULL, sg_param_count(1), shaped->params);
    assert_int_equal(sg_model_create(ctx, N, 1, &g), SG_OK);
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, shaped, NULL);
        assert_int_equal(sg_engine_draw(e, &camera, 1, &params, false), SG_OK);
        assert_int_equal(sg_engine_read_image(e, rgb[0], NULL, NULL), SG_OK);
        assert_int_equal(sg_engine_upload(e, m, NULL), SG_OK);
        assert_int_equal(sg_engine_set_shape(e, &shape), SG_OK);
        assert_int_equal(sg_engine_draw(e, &camera, 1, &params, false), SG_OK);
        assert_int_equal(sg_engine_read_image(e, rgb[1], NULL, NULL), SG_OK);
        assert_memory_equal(rgb[0], rgb[1], sizeof(rgb[0]));
        assert_int_equal(sg_engine_write_image_gradient(e, weight), SG_OK);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        assert_int_equal(sg_engine_read_gradients(e, g), SG_OK);
        const int tried[] = {SG_P_SCALE, SG_P_SCALE + 1, SG_P_SCALE + 2, SG_P_SH, SG_P_SH + 2};
        for (size_t t = 0; t < sizeof(tried) / sizeof(tried[0]); t++) {
            float largest = 0;
            for (size_t i = 0; i < N; i++)
                largest = fmaxf(largest, fabsf(*sg_model_at(g, i, tried[t])));
            assert_true(largest > 1e-3f);
            for (size_t i = 0; i < N; i++) {
                float *value = sg_model_at(m, i, tried[t]);
                const float kept = *value, step = 0.02f;
                double change = 0;
                for (int side = -1; side <= 1; side += 2) {
                    *value = kept + (float) side * step;
                    assert_int_equal(sg_engine_upload(e, m, NULL), SG_OK);
                    assert_int_equal(sg_engine_draw(e, &camera, 1, &params, false), SG_OK);
                    assert_int_equal(sg_engine_read_image(e, rgb[0], NULL, NULL), SG_OK);
                    for (size_t v = 0; v < 3 * PIXELS; v++)
                        change += side * (double) rgb[0][v] * (double) weight[v];
                }
                *value = kept;
                change /= 2 * (double) step;
                const float found = *sg_model_at(g, i, tried[t]);
                if (!(fabs(change - (double) found) < 0.08 * (double) largest))
                    fail_msg("%s: Gaussian %zu, plane %d: gradient %g, expected %g",
                             case_name(cases[k]), i, tried[t], (double) found, change);
            }
        }
        /* A step moves the parameters, not what is drawn, and by Adam's rule in the direction of
         * the gradient. */
        struct sg_model *after;
        struct sg_update u = *some_update();
        assert_int_equal(sg_engine_upload(e, m, NULL), SG_OK);
        assert_int_equal(sg_engine_draw(e, &camera, 1, &params, false), SG_OK);
        assert_int_equal(sg_engine_write_image_gradient(e, weight), SG_OK);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        assert_int_equal(sg_engine_optimise(e, &u), SG_OK);
        assert_int_equal(sg_model_create(ctx, N, 1, &after), SG_OK);
        assert_int_equal(sg_engine_download(e, after, NULL), SG_OK);
        for (size_t i = 0; i < N; i++) {
            const float moved = *sg_model_at(after, i, SG_P_SCALE) - *sg_model_at(m, i, SG_P_SCALE);
            assert_true(fabsf(moved) < 0.2f && moved * *sg_model_at(g, i, SG_P_SCALE) <= 0);
        }
        sg_model_destroy(&after);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_model_destroy(&g);
    sg_model_destroy(&shaped);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* ---- the model's life ---- */

static struct sg_columns make_optimiser(sg_ctx *ctx, size_t n, int degree)
{
    struct sg_columns o;
    assert_int_equal(sg_columns_create(ctx, n, degree, SG_COLUMN_SAVED, &o), SG_OK);
    for (size_t i = 0; i < n; i++) {
        for (int p = 0; p < sg_param_count(degree); p++) {
            const size_t at = sg_param_index(sg_param_count(degree), i, p);
            o.at[SG_C_MOMENT1][at] = draw(16, at, -1, 1),
            o.at[SG_C_MOMENT2][at] = draw(17, at, 0, 1);
        }
        o.at[SG_C_GRAD_SUM][i] = draw(18, i, 0, 1), o.at[SG_C_GRAD_COUNT][i] = (float) (i % 4);
    }
    return o;
}

static void assert_held(int k, const char *what, const struct held *a, const struct held *b)
{
    const size_t bytes = values_of(b->m) * sizeof(float), each = b->m->count * sizeof(float);
    if (a->m->count != b->m->count || memcmp(a->m->params, b->m->params, bytes) ||
        memcmp(a->o.at[SG_C_MOMENT1], b->o.at[SG_C_MOMENT1], bytes) ||
        memcmp(a->o.at[SG_C_MOMENT2], b->o.at[SG_C_MOMENT2], bytes) ||
        memcmp(a->o.at[SG_C_GRAD_SUM], b->o.at[SG_C_GRAD_SUM], each) ||
        memcmp(a->o.at[SG_C_GRAD_COUNT], b->o.at[SG_C_GRAD_COUNT], each))
        fail_msg("%s: %s: the model or its state differs", case_name(cases[k]), what);
}

/* upload and adopt leave the same; adopt takes what it is given. */
static void test_adopt(void **state)
{
    (void) state;
    for (int k = 0; k < case_count; k++) {
        sg_ctx *ctx = make_context(1);
        struct sg_model *m = make_model(ctx, GAUSSIANS, 1, 34);
        struct sg_columns o = make_optimiser(ctx, GAUSSIANS, 1);
        struct sg_engine *a = begin(ctx, k, m, &o), *b = begin(ctx, k, m, NULL);
        assert_int_equal(sg_engine_adopt(b, m, &o), SG_OK);
        assert_null(m->params);
        assert_null(o.at[SG_C_MOMENT1]);
        struct held x = held_by(ctx, a, 1), y = held_by(ctx, b, 1);
        assert_held(k, "adopt", &y, &x);
        assert_true(x.m->params[3] != 0 && x.o.at[SG_C_MOMENT2][3] != 0);
        forget(&x);
        forget(&y);
        sg_model_destroy(&m);
        sg_engine_destroy(&a);
        sg_engine_destroy(&b);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
}

/* Removal, copies, children and inserted rows together, with statistics kept and without, below and
 * above the count from which the model is put in order: the oracle's bytes. Then opacity and scales
 * are limited, and again. */
static void test_edits(void **state)
{
    (void) state;
    static const size_t counts[] = {GAUSSIANS, 6000};
    for (int s = 0; s < 4; s++) {
        const size_t n = counts[s % 2];
        struct held expected = {0};
        sg_ctx *ctx = make_context(2);
        struct sg_model *m = make_model(ctx, n, 1, 35), *rows = make_model(ctx, n / 5, 1, 37);
        struct sg_columns o = make_optimiser(ctx, n, 1);
        uint8_t *keep = calloc(n, 1), *kind = calloc(n, 1);
        uint32_t *source = calloc(n, sizeof(*source));
        assert_true(keep && kind && source);
        struct sg_edit edit = {
            .keep = keep, .source = source, .kind = kind, .rows = rows, .seed = 5, .stream = 9};
        edit.statistics = s >= 2;
        for (size_t i = 0; i < n; i++) {
            keep[i] = i % 3 != 1;
            edit.kept += keep[i];
            if (i % 4 == 1) {
                source[edit.appended] = (uint32_t) i;
                kind[edit.appended++] = i % 8 == 1 ? SG_EDIT_CHILD : SG_EDIT_COPY;
            }
            if (i % 5 == 0) {
                source[edit.appended] = (uint32_t) (n / 5 - 1 - i / 5);
                kind[edit.appended++] = SG_EDIT_INSERT;
            }
        }
        for (int k = case_count - 1; k >= 0; k--) {
            struct sg_engine *e = begin(ctx, k, m, &o);
            assert_int_equal(sg_engine_edit(e, &edit), SG_OK);
            assert_int_equal(sg_engine_count(e), edit.kept + edit.appended);
            assert_int_equal(sg_engine_reset_opacity(e, 0.1f), SG_OK);
            assert_int_equal(sg_engine_floor_scale(e, 0.02f), SG_OK);
            struct held found = held_by(ctx, e, 1);
            for (size_t i = 0; i < found.m->count; i++) {
                assert_true(*sg_model_at(found.m, i, SG_P_OPACITY) <= logf(0.1f / 0.9f));
                assert_true(*sg_model_at(found.m, i, SG_P_SCALE + 1) >= logf(0.02f));
            }
            if (k == case_count - 1)
                expected = found;
            else {
                assert_held(k, "edit", &found, &expected);
                forget(&found);
            }
            sg_engine_destroy(&e);
        }
        /* Of the survivors, by their moments, which the edit only moves. */
        size_t same = 0;
        if (n == counts[0]) { /* the order is the survivors', then the appended */
            for (size_t i = 0, to = 0; i < n; i++)
                if (keep[i]) {
                    same += expected.o.at[SG_C_MOMENT1][sg_param_index(23, to, 0)] ==
                            o.at[SG_C_MOMENT1][sg_param_index(23, i, 0)];
                    assert_true(expected.o.at[SG_C_GRAD_SUM][to] ==
                                (edit.statistics ? o.at[SG_C_GRAD_SUM][i] : 0));
                    to++;
                }
            assert_int_equal(same, edit.kept);
            for (size_t i = 0; i < edit.appended; i++)
                for (int p = 0; p < 23 && kind[i] == SG_EDIT_INSERT; p++) {
                    const size_t at = sg_param_index(23, edit.kept + i, p);
                    const float given = *sg_model_at(rows, source[i], p);
                    const float limit = logf(0.1f / 0.9f), least = logf(0.02f);
                    assert_true(expected.m->params[at] == (p == SG_P_OPACITY ? fminf(given, limit)
                                                           : p >= SG_P_SCALE && p < SG_P_ROT
                                                               ? fmaxf(given, least)
                                                               : given));
                    assert_true(expected.o.at[SG_C_MOMENT1][at] == 0 &&
                                expected.o.at[SG_C_MOMENT2][at] == 0);
                }
        }
        forget(&expected);
        sg_model_destroy(&rows);
        free(keep), free(kind), free(source);
        sg_model_destroy(&m);
        sg_columns_clear(&o);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
}

/* An appended entry that names no Gaussian and no row is refused, and the model stays. */
static void test_edit_arguments(void **state)
{
    (void) state;
    enum { N = 20, ROWS = 3 };
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, N, 1, 38), *rows = make_model(ctx, ROWS, 1, 39),
                    *other = make_model(ctx, ROWS, 0, 39);
    uint8_t keep[N];
    memset(keep, 1, sizeof(keep));
    const struct {
        const struct sg_model *rows;
        uint32_t source;
        uint8_t kind;
        int code;
    } tried[] = {
        {rows, ROWS - 1, SG_EDIT_INSERT, SG_OK},  {rows, ROWS, SG_EDIT_INSERT, SG_ERR_USAGE},
        {NULL, 0, SG_EDIT_INSERT, SG_ERR_USAGE},  {rows, N, SG_EDIT_COPY, SG_ERR_USAGE},
        {rows, N, SG_EDIT_CHILD, SG_ERR_USAGE},   {rows, 0, SG_EDIT_KEEP, SG_ERR_USAGE},
        {other, 0, SG_EDIT_INSERT, SG_ERR_USAGE},
    };
    for (int k = 0; k < case_count; k++)
        for (size_t t = 0; t < sizeof(tried) / sizeof(tried[0]); t++) {
            struct sg_engine *e = begin(ctx, k, m, NULL);
            const struct sg_edit edit = {.keep = keep,
                                         .kept = N,
                                         .appended = 1,
                                         .source = &tried[t].source,
                                         .kind = &tried[t].kind,
                                         .rows = tried[t].rows};
            assert_int_equal(sg_engine_edit(e, &edit), tried[t].code);
            assert_int_equal(sg_engine_count(e), N + (tried[t].code == SG_OK));
            sg_clear_error(ctx);
            sg_engine_destroy(&e);
        }
    sg_model_destroy(&m);
    sg_model_destroy(&rows);
    sg_model_destroy(&other);
    sg_ctx_destroy(&ctx);
}

/* A model in order of bytes, not of ours, and statistics by their definition. */
static void test_statistics(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, 0, 36);
    struct sg_columns o = make_optimiser(ctx, GAUSSIANS, 0);
    float gradient[GAUSSIANS], opacity[GAUSSIANS], largest[GAUSSIANS], smallest[GAUSSIANS];
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, m, &o);
        assert_int_equal(
            sg_engine_read_statistics(e, &(struct sg_statistics){.gradient = gradient,
                                                                 .opacity = opacity,
                                                                 .largest = largest,
                                                                 .log_smallest = smallest}),
            SG_OK);
        for (size_t i = 0; i < GAUSSIANS; i++) {
            const float *s[3] = {sg_model_at(m, i, SG_P_SCALE), sg_model_at(m, i, SG_P_SCALE + 1),
                                 sg_model_at(m, i, SG_P_SCALE + 2)};
            const double logit = (double) *sg_model_at(m, i, SG_P_OPACITY);
            const double most = (double) fmaxf(*s[0], fmaxf(*s[1], *s[2]));
            assert_true(gradient[i] == (o.at[SG_C_GRAD_COUNT][i] > 0
                                            ? o.at[SG_C_GRAD_SUM][i] / o.at[SG_C_GRAD_COUNT][i]
                                            : 0));
            assert_float_equal((double) opacity[i], 1 / (1 + exp(-logit)), 1e-6);
            assert_float_equal((double) largest[i], exp(most), 1e-5 * exp(most));
            assert_true(smallest[i] == fminf(*s[0], fminf(*s[1], *s[2])));
        }
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_columns_clear(&o);
    sg_ctx_destroy(&ctx);
}

/* dL/dimage of two pixels beside the middle of a round splat: `sign` times as much on the right. */
static void push(struct sg_engine *e, float sign)
{
    static float gradient[3 * PIXELS];
    const size_t middle = (size_t) (H / 2) * W + W / 2;
    memset(gradient, 0, sizeof(gradient));
    gradient[middle - 2] = 1;
    gradient[middle + 2] = sign;
    assert_int_equal(sg_engine_write_image_gradient(e, gradient), SG_OK);
    assert_int_equal(sg_engine_raster_backward(e), SG_OK);
    assert_int_equal(sg_engine_project_backward(e, true), SG_OK);
}

/* Contributions of two pixels that are opposite cancel in the norm, and add up in the absolute
 * statistic; there equal ones and opposite ones are the same. */
static void test_absolute_cancels_nothing(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m;
    struct sg_camera camera = {
        .width = W, .height = H, .fx = 60, .fy = 60, .cx = W / 2 + 0.5, .cy = H / 2 + 0.5};
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    camera.R[0] = camera.R[4] = camera.R[8] = 1;
    assert_int_equal(sg_model_create(ctx, 1, 0, &m), SG_OK);
    *sg_model_at(m, 0, SG_P_XYZ + 2) = 2;
    *sg_model_at(m, 0, SG_P_ROT) = 1;
    for (int axis = 0; axis < 3; axis++)
        *sg_model_at(m, 0, SG_P_SCALE + axis) = logf(0.1f);
    *sg_model_at(m, 0, SG_P_SH) = 1;
    for (int k = 0; k < case_count; k++) {
        float found[2][2];
        if (!counts_absolute(k))
            continue;
        for (int absolute = 0; absolute < 2; absolute++)
            for (int same = 0; same < 2; same++) {
                struct sg_engine *e = begin(ctx, k, m, NULL);
                assert_int_equal(
                    sg_engine_set_statistic(e, absolute ? SG_GRADIENT_ABSOLUTE : SG_GRADIENT_NORM),
                    SG_OK);
                assert_int_equal(sg_engine_draw(e, &camera, 0, &params, false), SG_OK);
                push(e, same ? 1 : -1);
                assert_int_equal(
                    sg_engine_read_statistics(
                        e, &(struct sg_statistics){.gradient = &found[absolute][same]}),
                    SG_OK);
                sg_engine_destroy(&e);
            }
        /* a gradient of the same sign on both sides would move it both ways */
        assert_true(found[0][0] > 0.1f);
        assert_true(found[0][1] < 1e-5f * found[0][0]);
        assert_float_equal((double) found[1][0], (double) found[0][0], 1e-4 * (double) found[0][0]);
        assert_float_equal((double) found[1][1], (double) found[0][0], 1e-4 * (double) found[0][0]);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Both statistics over two views as the oracle's, with few and with many instances at once. Views
 * count for Gaussians that are too faint to be drawn, which are visible, too. */
static void test_gradient_statistics(void **state)
{
    (void) state;
    static float weight[3 * PIXELS];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 37);
    for (size_t i = 1; i < GAUSSIANS; i += 10)
        *sg_model_at(m, i, SG_P_OPACITY) = -7;
    for (size_t i = 0; i < 3 * PIXELS; i++)
        weight[i] = draw(19, i, -1, 1);
    for (int kind = SG_GRADIENT_NORM; kind <= SG_GRADIENT_MIP; kind++)
        for (int banded = 0; banded < 2; banded++) {
            const bool mip = kind == SG_GRADIENT_MIP;
            float expected[2 * GAUSSIANS], found[2 * GAUSSIANS], views[GAUSSIANS];
            size_t visible[2];
            for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
                const struct sg_render_params params = {.max_instances = banded ? 60 : 1 << 20,
                                                        .mip_kernel = mip ? 0.1f : 0};
                if (kind != SG_GRADIENT_NORM && !counts_absolute(k))
                    continue;
                struct sg_engine *e = begin(ctx, k, m, NULL);
                assert_int_equal(sg_engine_set_statistic(e, (enum sg_gradient_statistic) kind),
                                 SG_OK);
                for (int view = 2; view < 4; view++) {
                    const struct sg_camera camera = make_camera(W, H, view);
                    struct sg_step step;
                    assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, false), SG_OK);
                    assert_int_equal(sg_engine_write_image_gradient(e, weight), SG_OK);
                    assert_int_equal(sg_engine_raster_backward(e), SG_OK);
                    assert_int_equal(sg_engine_optimise(e, &(struct sg_update){.statistics = true}),
                                     SG_OK);
                    assert_int_equal(sg_engine_read_step(e, &step), SG_OK);
                    assert_int_equal(step.stats.bands > 1, banded && k < case_count - 1);
                    if (k == case_count - 1)
                        visible[view - 2] = step.stats.visible;
                    assert_int_equal(step.stats.visible, visible[view - 2]);
                }
                float *to = k == case_count - 1 ? expected : found, largest = 0;
                assert_int_equal(
                    sg_engine_read_statistics(
                        e, &(struct sg_statistics){.gradient = to, .absolute = to + GAUSSIANS}),
                    SG_OK);
                struct held h = held_by(ctx, e, DEGREE);
                if (to == expected) {
                    memcpy(views, h.o.at[SG_C_GRAD_COUNT], sizeof(views));
                    assert_true(views[1] == 2 && views[11] == 2);
                }
                assert_memory_equal(h.o.at[SG_C_GRAD_COUNT], views, sizeof(views));
                forget(&h);
                sg_engine_destroy(&e);
                for (size_t i = 0; i < 2 * GAUSSIANS; i++)
                    largest = fmaxf(largest, expected[i]);
                size_t off = 0;
                for (size_t i = 0; i < 2 * GAUSSIANS && to == found; i++)
                    off += !(fabsf(found[i] - expected[i]) <= 2e-3f * largest);
                if (off > 3 || !(largest > 0) || !(expected[GAUSSIANS] > 0) != !mip)
                    fail_msg("%s: statistic %d: %zu are off", case_name(cases[k]), kind, off);
            }
        }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Photos that come and go, more of them than a device has room for before the first one is done,
 * are as those that stay: the exposure that has learned from each is the same. Then their handle is
 * that of a photo that stays. */
static void test_passing(void **state)
{
    (void) state;
    enum { PHOTOS = 5 };
    static uint8_t photos[PHOTOS][3 * PIXELS];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    const struct sg_loss loss = {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
    const struct sg_exposure_update update = {.rate = 0.01, .root = 1};
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 44);
    for (size_t p = 0; p < PHOTOS; p++)
        for (size_t i = 0; i < 3 * PIXELS; i++)
            photos[p][i] = (uint8_t) draw(45 + p, i, 0, 255.9f);
    for (int k = 0; k < case_count; k++) {
        float exposures[2][SG_EXPOSURE_FLOATS] = {{0}};
        struct sg_step step[2];
        for (int passes = 0; passes < 2; passes++) {
            struct sg_engine *e = begin(ctx, k, m, NULL);
            struct sg_target target = {0};
            exposures[passes][0] = exposures[passes][5] = exposures[passes][10] = 1;
            assert_int_equal(sg_engine_set_exposures(e, exposures[passes], 1), SG_OK);
            for (int p = 0; p < 2 * PHOTOS; p++) { /* of two views: a device makes room in one */
                if (p % PHOTOS == 0)
                    assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, false), SG_OK);
                target.exposure = 1;
                assert_int_equal((passes ? sg_engine_photo_pass : sg_engine_photo_add)(
                                     e, W, H, photos[p % PHOTOS], NULL, &target.photo),
                                 SG_OK);
                assert_int_equal(sg_engine_losses(e, &target, &loss, 1), SG_OK);
                assert_int_equal(sg_engine_learn_exposures(e, &update), SG_OK);
                assert_int_equal(sg_engine_photo_drop(e, target.photo), SG_OK);
            }
            assert_int_equal(sg_engine_read_exposures(e), SG_OK);
            const sg_photo passed = target.photo;
            target.exposure = 0;
            assert_int_equal(sg_engine_photo_add(e, W, H, photos[0], NULL, &target.photo), SG_OK);
            assert_int_equal(target.photo, passed);
            assert_int_equal(sg_engine_losses(e, &target, &loss, 1), SG_OK);
            assert_int_equal(sg_engine_read_step(e, &step[passes]), SG_OK);
            sg_engine_destroy(&e);
        }
        assert_memory_equal(exposures[1], exposures[0], sizeof(exposures[0]));
        assert_true(step[1].photometric.total == step[0].photometric.total);
        assert_true(exposures[0][0] != 1);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_losses),
        cmocka_unit_test(test_penalties),
        cmocka_unit_test(test_two_stages),
        cmocka_unit_test(test_shape),
        cmocka_unit_test(test_adopt),
        cmocka_unit_test(test_edits),
        cmocka_unit_test(test_statistics),
        cmocka_unit_test(test_edit_arguments),
        cmocka_unit_test(test_absolute_cancels_nothing),
        cmocka_unit_test(test_gradient_statistics),
        cmocka_unit_test(test_passing),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
