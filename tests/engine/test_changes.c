/* SPDX-License-Identifier: Apache-2.0 */
/* What changes Gaussians in place or what is drawn of them, on every engine and variant of this
 * machine. */
#include "model/mip.h"
#include "operations.h"

#include "math/real_f32.h"

#include "math/random.h"

/* ---- the 3D filter of Mip-Splatting ---- */

static const struct sg_shape mip = {
    .name = "mip", .column = SG_C_FILTER, .forward = sg_mip_forward, .backward = sg_mip_backward};

static struct sg_columns filter_of(sg_ctx *ctx, struct sg_engine *e)
{
    struct sg_columns o;
    assert_int_equal(
        sg_columns_create(ctx, sg_engine_count(e), 0, SG_COLUMN_SAVED | SG_COLUMN_MIP, &o), SG_OK);
    assert_int_equal(sg_engine_download(e, NULL, &o), SG_OK);
    return o;
}

/* Of many widths, and none in every fifth place. */
static struct sg_columns some_filters(sg_ctx *ctx, size_t n, int degree)
{
    struct sg_columns o;
    assert_int_equal(sg_columns_create(ctx, n, degree, SG_COLUMN_SAVED | SG_COLUMN_MIP, &o), SG_OK);
    for (size_t i = 0; i < n; i++)
        o.at[SG_C_FILTER][i] = 0.1f * (float) (i % 5) * draw(83, i, 0, 1);
    return o;
}

/* What is drawn through the filter, its gradients and a step by these are the oracle's; and what is
 * drawn is not what is drawn without. */
static void test_mip(void **state)
{
    (void) state;
    static float expected[3 * PIXELS], found[3 * PIXELS], plain[3 * PIXELS];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 84), *right = NULL, *moved = NULL;
    struct sg_columns o = some_filters(ctx, GAUSSIANS, DEGREE);
    struct sg_update u = {.adam = true};
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = 0.01f, u.root[g] = 30;
    for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
        struct sg_model *g, *after;
        struct sg_engine *e = begin(ctx, k, m, &o);
        assert_int_equal(sg_model_create(ctx, GAUSSIANS, DEGREE, &after), SG_OK);
        losses_against(e, m, NULL, 0, 255.9f, 1);
        assert_int_equal(sg_engine_read_image(e, plain, NULL, NULL), SG_OK);
        assert_int_equal(sg_engine_set_shape(e, &mip), SG_OK);
        losses_against(e, m, NULL, 0, 255.9f, 1);
        assert_int_equal(sg_engine_read_image(e, right ? found : expected, NULL, NULL), SG_OK);
        g = gradients_of(ctx, e, m);
        assert_int_equal(sg_engine_optimise(e, &u), SG_OK);
        assert_int_equal(sg_engine_download(e, after, NULL), SG_OK);
        sg_engine_destroy(&e);
        if (!right) {
            right = g, moved = after;
            continue;
        }
        size_t changed = 0;
        for (size_t i = 0; i < 3 * PIXELS; i++)
            changed += fabsf(found[i] - plain[i]) > 1e-2f;
        assert_true(changed >= PIXELS / 10);
        assert_within(case_name(cases[k]), "image through the 3D filter",
                      difference_of(found, expected, 3 * PIXELS, NULL, 1), 1e-5);
        assert_gradients(case_name(cases[k]), "gradient through the 3D filter", g, right, 1e-4);
        assert_gradients(case_name(cases[k]), "parameters after a step", after, moved, 1e-5);
        sg_model_destroy(&g);
        sg_model_destroy(&after);
    }
    sg_model_destroy(&right);
    sg_model_destroy(&moved);
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* It follows from the nearest camera that sees a Gaussian; what none sees gets the largest. */
static void test_filter(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m;
    struct sg_camera close_by = {.width = 800,
                                 .height = 600,
                                 .fx = 1000,
                                 .fy = 1000,
                                 .cx = 400,
                                 .cy = 300,
                                 .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                     far = close_by;
    const struct sg_camera *both[] = {&close_by, &far};
    far.t[2] = 3;
    assert_int_equal(sg_model_create(ctx, 5, 0, &m), SG_OK);
    const float at[5][3] = {{0, 0, 2}, {0, 0, 0.2f}, {0, 0, -9}, {0, 0, 4}, {0, 0.779f, 2}};
    for (size_t i = 0; i < 5; i++) {
        for (int k = 0; k < 3; k++)
            *sg_model_at(m, i, SG_P_XYZ + k) = at[i][k];
        *sg_model_at(m, i, SG_P_ROT) = 1;
    }
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, m, NULL);
        struct sg_columns o;
        const double unit = 0.4472136 / 1000;
        const struct sg_mip_filter released = {0.2, 0.15}, wider = {0.8, 0.14};
        assert_int_equal(sg_engine_filter(e, both, 2, &wider), SG_OK);
        o = filter_of(ctx, e);
        assert_true(fabs((double) o.at[SG_C_FILTER][0] / (2 * unit * 2) - 1) < 1e-5);
        assert_true(fabs((double) o.at[SG_C_FILTER][4] / (2 * unit * 5) - 1) < 1e-5);
        sg_columns_clear(&o);
        assert_int_equal(sg_engine_filter(e, both, 2, &released), SG_OK);
        o = filter_of(ctx, e);
        /* 0.2 is too near for the first, and 3.2 from the second; -9 is behind both. The last lies
         * 14.9 % below the edge. */
        const double depth[5] = {2, 3.2, 4, 4, 2};
        for (size_t i = 0; i < 5; i++) {
            const double expected = unit * depth[i];
            if (fabs((double) o.at[SG_C_FILTER][i] / expected - 1) > 1e-5)
                fail_msg("%s: Gaussian %zu: filter %g, expected %g", case_name(cases[k]), i,
                         (double) o.at[SG_C_FILTER][i], expected);
        }
        sg_columns_clear(&o);
        /* further away, the far camera changes nothing that the near one sees; larger focal lengths
         * make all smaller */
        far.t[2] = 60, far.fx = 2000;
        assert_int_equal(sg_engine_filter(e, both, 2, &released), SG_OK);
        o = filter_of(ctx, e);
        assert_true(fabs((double) o.at[SG_C_FILTER][0] / (2 * unit / 2) - 1) < 1e-5);
        assert_true(fabs((double) o.at[SG_C_FILTER][1] / (60.2 * unit / 2) - 1) < 1e-5);
        /* none is seen at all: the filter stays */
        const float kept = o.at[SG_C_FILTER][1];
        sg_columns_clear(&o);
        close_by.t[2] = far.t[2] = -100;
        assert_int_equal(sg_engine_filter(e, both, 2, &released), SG_OK);
        o = filter_of(ctx, e);
        assert_true(o.at[SG_C_FILTER][1] == kept);
        sg_columns_clear(&o);
        close_by.t[2] = 0, far.t[2] = 3, far.fx = 1000;
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* A reset limits what is drawn, not what is stored. */
static void test_reset(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 40, 0, 82), *after;
    struct sg_columns o = some_filters(ctx, 40, 0);
    const size_t stride = (size_t) sg_param_count(0) * SG_LANES;
    assert_int_equal(sg_model_create(ctx, 40, 0, &after), SG_OK);
    for (int k = 0; k < case_count; k++) {
        struct sg_engine *e = begin(ctx, k, m, &o);
        int limited = 0;
        assert_int_equal(sg_engine_set_shape(e, &mip), SG_OK);
        assert_int_equal(sg_engine_reset_opacity(e, 0.01f), SG_OK);
        assert_int_equal(sg_engine_download(e, after, NULL), SG_OK);
        for (size_t i = 0; i < 40; i++) {
            float shaped[SG_PARAMS_MAX * SG_LANES];
            double drawn[2];
            for (int which = 0; which < 2; which++) {
                sg_mip_forward(NULL, (which ? after : m)->params + i / SG_LANES * stride,
                               o.at[SG_C_FILTER] + i / SG_LANES * SG_LANES, sg_param_count(0),
                               shaped);
                drawn[which] =
                    1 / (1 + exp(-(double) shaped[SG_P_OPACITY * SG_LANES + i % SG_LANES]));
            }
            limited += drawn[0] > 0.01;
            if (!(fabs(drawn[1] - fmin(drawn[0], 0.01)) < 1e-5))
                fail_msg("%s: Gaussian %zu: %g after %g", case_name(cases[k]), i, drawn[1],
                         drawn[0]);
        }
        assert_in_range(limited, 10, 39); /* some are, some are not */
        sg_engine_destroy(&e);
    }
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    sg_model_destroy(&after);
    sg_ctx_destroy(&ctx);
}

/* ---- densification as Markov chain Monte Carlo ---- */

/* The noise is covariance x normal, gated by opacity: through the matrix, and nothing else moves.
 * The last Gaussian holds still. */
static void check_explored(const char *name, const struct sg_model *m, const struct sg_model *after,
                           const struct sg_exploration *x, const double gate[4])
{
    for (size_t i = 0; i < 5; i++) {
        double q[4], R[9], sigma[9] = {0}, len = 0;
        for (int c = 0; c < 4; c++)
            q[c] = (double) *sg_model_at(m, i, SG_P_ROT + c), len += q[c] * q[c];
        for (int c = 0; c < 4; c++)
            q[c] /= sqrt(len);
        R[0] = 1 - 2 * (q[2] * q[2] + q[3] * q[3]), R[1] = 2 * (q[1] * q[2] - q[0] * q[3]);
        R[2] = 2 * (q[1] * q[3] + q[0] * q[2]), R[3] = 2 * (q[1] * q[2] + q[0] * q[3]);
        R[4] = 1 - 2 * (q[1] * q[1] + q[3] * q[3]), R[5] = 2 * (q[2] * q[3] - q[0] * q[1]);
        R[6] = 2 * (q[1] * q[3] - q[0] * q[2]), R[7] = 2 * (q[2] * q[3] + q[0] * q[1]);
        R[8] = 1 - 2 * (q[1] * q[1] + q[2] * q[2]);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                for (int c = 0; c < 3; c++)
                    sigma[3 * a + b] += R[3 * a + c] * R[3 * b + c] *
                                        exp(2 * (double) *sg_model_at(m, i, SG_P_SCALE + c));
        for (int a = 0; a < 3; a++) {
            double expected = 0;
            for (int b = 0; b < 3 && i < 4; b++)
                expected +=
                    (double) x->amount * gate[i] * sigma[3 * a + b] *
                    (double) sg_rng_normal(x->seed, SG_RNG_EXPLORE, x->stream, 3 * i + (size_t) b);
            const double found = (double) *sg_model_at(after, i, SG_P_XYZ + a) -
                                 (double) *sg_model_at(m, i, SG_P_XYZ + a);
            if (fabs(found - expected) > 1e-4 * fabs(expected) + 1e-6)
                fail_msg("%s: Gaussian %zu, axis %d: moved by %g, expected %g", name, i, a, found,
                         expected);
        }
        for (int p = SG_P_OPACITY; p < sg_param_count(0); p++)
            assert_true(*sg_model_at(after, i, p) == *sg_model_at(m, i, p));
    }
}

/* On the gate's published values, and with another gate. */
static void test_explore(void **state)
{
    (void) state;
    static const float opacity[] = {0.001f, 0.005f, 0.01f, 0.05f};
    static const double gate[2][4] = {{0.598688, 0.5, 0.377541, 0.0109869},
                                      {0.638763, 0.610639, 0.574443, 0.289050}};
    static const struct sg_exploration how[] = {{40, 100, 0.005f, 7, 9}, {40, 30, 0.02f, 7, 10}};
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, 5, 0, 52), *after;
    struct sg_columns o;
    for (size_t i = 0; i < 4; i++)
        *sg_model_at(m, i, SG_P_OPACITY) = logf(opacity[i] / (1 - opacity[i]));
    *sg_model_at(m, 4, SG_P_OPACITY) = 1;
    for (int k = 0; k < 2 * case_count; k++) {
        struct sg_engine *e = begin(ctx, k / 2, m, NULL);
        assert_int_equal(sg_engine_explore(e, &how[k % 2]), SG_OK);
        download(ctx, e, 0, &after, &o);
        check_explored(case_name(cases[k / 2]), m, after, &how[k % 2], gate[k % 2]);
        sg_columns_clear(&o);
        sg_model_destroy(&after);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Gaussians that an edit has added move too, before any view of the edited model. */
static void test_explore_edited(void **state)
{
    (void) state;
    enum { N = 200, EDITED = 2 * N };
    static const struct sg_exploration how = {40, 100, 0.005f, 7, 9};
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    uint8_t keep[N], kind[N];
    uint32_t source[N];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, N, 0, 53), *expected = NULL;
    memset(keep, 1, sizeof(keep));
    for (uint32_t i = 0; i < N; i++) {
        *sg_model_at(m, i, SG_P_OPACITY) = -5;
        source[i] = i, kind[i] = SG_EDIT_COPY;
    }
    const struct sg_edit edit = {
        .keep = keep, .kept = N, .appended = N, .source = source, .kind = kind};
    for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
        struct sg_engine *e = begin(ctx, k, m, NULL);
        struct sg_model *after;
        struct sg_columns o;
        assert_int_equal(sg_engine_draw(e, &camera, 0, &params, false), SG_OK);
        assert_int_equal(sg_engine_edit(e, &edit), SG_OK);
        assert_int_equal(sg_engine_explore(e, &how), SG_OK);
        download(ctx, e, 0, &after, &o);
        for (size_t i = 0; i < EDITED; i++)
            for (int axis = 0; axis < 3; axis++) {
                const float before = *sg_model_at(m, i % N, SG_P_XYZ + axis),
                            found = *sg_model_at(after, i, SG_P_XYZ + axis),
                            right = *sg_model_at(expected ? expected : after, i, SG_P_XYZ + axis);
                if (!(fabsf(found - right) <= 1e-4f * fabsf(right - before) + 1e-6f) ||
                    found == before)
                    fail_msg("%s: Gaussian %zu, axis %d: moved from %g to %g, expected %g",
                             case_name(cases[k]), i, axis, (double) before, (double) found,
                             (double) right);
            }
        sg_columns_clear(&o);
        sg_engine_destroy(&e);
        if (expected)
            sg_model_destroy(&after);
        else
            expected = after;
    }
    sg_model_destroy(&expected);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* An entry copies parameters, sets the opacity, adds to the scales, and clears moments only where
 * it says so. */
static void test_relocate(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 20, 1, 53), *after;
    struct sg_columns o, found;
    const int planes = sg_param_count(1);
    assert_int_equal(sg_columns_create(ctx, 20, 1, SG_COLUMN_SAVED, &o), SG_OK);
    for (size_t i = 0; i < o.capacity * (size_t) planes; i++)
        o.at[SG_C_MOMENT1][i] = o.at[SG_C_MOMENT2][i] = 3;
    const struct sg_relocation r = {.count = 2,
                                    .to = (const uint32_t[]){4, 17},
                                    .from = (const uint32_t[]){17, 17},
                                    .opacity = (const float[]){-1, -2},
                                    .scale = (const float[]){-0.5f, -0.25f},
                                    .fresh = (const uint8_t[]){0, 1}};
    const struct sg_relocation wrong[] = {
        {.count = 1, .to = (const uint32_t[]){20}, .from = r.from},
        {.count = 1, .to = r.to, .from = (const uint32_t[]){20}}};
    for (int v = 0; v < case_count; v++) {
        struct sg_engine *e = begin(ctx, v, m, &o);
        assert_int_equal(sg_engine_relocate(e, &r), SG_OK);
        download(ctx, e, 1, &after, &found);
        for (size_t i = 0; i < 20; i++)
            for (int p = 0; p < planes; p++) {
                const size_t from = i == 4 ? 17 : i;
                const bool moved = i == 4 || i == 17, scale = p >= SG_P_SCALE && p < SG_P_SCALE + 3;
                float expected = *sg_model_at(m, from, p);
                if (moved && p == SG_P_OPACITY)
                    expected = i == 4 ? -1 : -2;
                if (moved && scale)
                    expected += i == 4 ? -0.5f : -0.25f;
                assert_true(*sg_model_at(after, i, p) == expected);
                const size_t at = sg_param_index(planes, i, p);
                assert_true(found.at[SG_C_MOMENT1][at] == (i == 17 ? 0 : 3));
                assert_true(found.at[SG_C_MOMENT2][at] == (i == 17 ? 0 : 3));
            }
        for (int k = 0; k < 2; k++)
            assert_int_equal(sg_engine_relocate(e, &wrong[k]), SG_ERR_USAGE);
        sg_clear_error(ctx);
        sg_engine_destroy(&e);
        sg_columns_clear(&found);
        sg_model_destroy(&after);
    }
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Entries that read what earlier ones wrote, and write what they read: the oracle's bytes. */
static void test_relocate_in_order(void **state)
{
    (void) state;
    enum { N = 40, ENTRIES = 300 };
    uint32_t to[ENTRIES], from[ENTRIES];
    float opacity[ENTRIES], scale[ENTRIES];
    uint8_t fresh[ENTRIES];
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, N, 1, 85), *expected = NULL;
    struct sg_columns o, state_expected = {0};
    const size_t bytes = values_of(m) * sizeof(float);
    assert_int_equal(sg_columns_create(ctx, N, 1, SG_COLUMN_SAVED, &o), SG_OK);
    for (size_t i = 0; i < values_of(m); i++)
        o.at[SG_C_MOMENT1][i] = o.at[SG_C_MOMENT2][i] = 3;
    for (uint64_t k = 0; k < ENTRIES; k++) {
        to[k] = (uint32_t) draw(86, k, 0, N);
        from[k] = k % 3 ? (uint32_t) draw(87, k, 0, N) : to[k];
        opacity[k] = draw(88, k, -2, 2), scale[k] = draw(89, k, -1, 1);
        fresh[k] = k % 7 == 0;
    }
    for (int v = case_count - 1; v >= 0; v--) { /* the oracle is the last */
        struct sg_engine *e = begin(ctx, v, m, &o);
        struct sg_model *after;
        struct sg_columns found;
        for (size_t n = 0; n < ENTRIES; n = n ? n * 2 : 75) {
            const struct sg_relocation r = {n ? n : 75,  to + n,    from + n,
                                            opacity + n, scale + n, fresh + n};
            assert_int_equal(sg_engine_relocate(e, &r), SG_OK);
        }
        assert_int_equal(sg_engine_relocate(e, &(struct sg_relocation){0}), SG_OK);
        download(ctx, e, 1, &after, &found);
        sg_engine_destroy(&e);
        if (!expected) {
            expected = after, state_expected = found;
            continue;
        }
        assert_memory_equal(after->params, expected->params, bytes);
        for (int c = SG_C_MOMENT1; c <= SG_C_MOMENT2; c++)
            assert_memory_equal(found.at[c], state_expected.at[c], bytes);
        sg_columns_clear(&found);
        sg_model_destroy(&after);
    }
    assert_memory_not_equal(expected->params, m->params, bytes);
    sg_columns_clear(&state_expected);
    sg_columns_clear(&o);
    sg_model_destroy(&expected);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* The kernels' random numbers, in C: the bits of the host's, and normals that are the same but for
 * rounding. */
static void test_random(void **state)
{
    (void) state;
    double sum = 0, squares = 0;
    enum { N = 200000 };
    for (uint64_t i = 0; i < N; i++) {
        const uint64_t key = sg_rng_key(i % 5, SG_RNG_EXPLORE, i / 7),
                       at = i % 3 ? i : i * 0x123456789abcdefu;
        const uint64_t bits = sg_rng_u64(i % 5, SG_RNG_EXPLORE, i / 7, at);
        const struct words w =
            random_mix(words_add(words_of((uint32_t) key, (uint32_t) (key >> 32)),
                                 words_of((uint32_t) at, (uint32_t) (at >> 32))));
        assert_true(w.low == (uint32_t) bits && w.high == (uint32_t) (bits >> 32));
        const double expected = (double) sg_rng_normal(i % 5, SG_RNG_EXPLORE, i / 7, at),
                     found = (double) random_normal(w);
        if (!(fabs(found - expected) <= 1e-6 * fabs(expected) + 1e-9))
            fail_msg("%llu: found %.9g, expected %.9g", (unsigned long long) i, found, expected);
        sum += found, squares += found * found;
    }
    assert_float_equal(sum / N, 0, 0.01);
    assert_float_equal(squares / N, 1, 0.02);
    /* the ends of both ranges */
    assert_true(random_minus_log(0xffffffffu) == 0);
    assert_float_equal(random_minus_log(0), 32 * 0.69314718056, 1e-5);
    assert_float_equal(random_minus_log(0x7fffffffu), 0.69314718056, 1e-6);
    assert_true(random_cosine(0) == 1 && random_cosine(0x80000000u) == -1);
    assert_true(random_cosine(0x40000000u) == 0 && random_cosine(0xc0000000u) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mip),
        cmocka_unit_test(test_filter),
        cmocka_unit_test(test_reset),
        cmocka_unit_test(test_explore),
        cmocka_unit_test(test_explore_edited),
        cmocka_unit_test(test_relocate),
        cmocka_unit_test(test_relocate_in_order),
        cmocka_unit_test(test_random),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
