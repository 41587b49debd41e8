/* SPDX-License-Identifier: Apache-2.0 */
/* The bytes of an engine's operations are the same for any number of threads. Hashes are printed:
 * tests/vulkan.cmake compares those of vector widths and of threads of the driver. */
#include "attack/ascent.h"
#include "model/mip.h"
#include "operations.h"

#define MOST 160 /* results of a test */

/* Of one run of the operations of a test. */
struct results {
    int n;
    char names[MOST][64];
    uint64_t hashes[MOST];
};
static struct results now;

/* FNV-1a, continued. */
static uint64_t hash(uint64_t from, const void *data, size_t bytes)
{
    const uint8_t *at = data;
    for (size_t i = 0; i < bytes; i++)
        from = (from ^ at[i]) * 0x100000001b3u;
    return from;
}
#define HASH_OF_NOTHING 0xcbf29ce484222325u

/* A result of this name. What it is the result of is different each time: so is the result. */
static void note_hash(const char *name, int a, int b, uint64_t value)
{
    assert_true(now.n < MOST);
    snprintf(now.names[now.n], sizeof(now.names[0]), "%s %d %d", name, a, b);
    for (int i = 0; i < now.n; i++)
        if (now.hashes[i] == value)
            fail_msg("%s is the same as %s", now.names[now.n], now.names[i]);
    now.hashes[now.n++] = value;
}

static void note(const char *name, int a, int b, const void *data, size_t bytes)
{
    note_hash(name, a, b, hash(HASH_OF_NOTHING, data, bytes));
}

static void note_model(const char *name, int a, int b, const struct sg_model *m,
                       const struct sg_columns *o)
{
    const int planes = sg_param_count(m->sh_degree);
    uint64_t h = HASH_OF_NOTHING;
    for (size_t i = 0; i < m->count; i++)
        for (int p = 0; p < planes; p++)
            h = hash(h, sg_model_at(m, i, p), sizeof(float));
    for (int c = SG_C_MOMENT1; c <= SG_C_MOMENT2 && o; c++)
        for (size_t i = 0; i < m->count; i++)
            for (int p = 0; p < planes; p++)
                h = hash(h, &o->at[c][sg_param_index(planes, i, p)], sizeof(float));
    note_hash(name, a, b, h);
}

static void note_held(const char *name, int a, int b, struct sg_engine *e, int degree)
{
    sg_ctx *ctx = sg_engine_ctx(e);
    struct sg_model *m;
    struct sg_columns o;
    download(ctx, e, degree, &m, &o);
    note_model(name, a, b, m, &o);
    sg_model_destroy(&m);
    sg_columns_clear(&o);
}

static void note_gradients(const char *name, int a, int b, struct sg_engine *e,
                           const struct sg_model *m)
{
    struct sg_model *g = gradients_of(sg_engine_ctx(e), e, m);
    note_model(name, a, b, g, NULL);
    sg_model_destroy(&g);
}

/* By one thread of the host and by three; or once on a device, which other processes repeat. */
static void check(void (*operations)(sg_ctx *ctx))
{
    struct results first = {0};
    for (int run = 0; run < (getenv("SG_TEST_ENGINE") ? 1 : 2); run++) {
        sg_ctx *ctx = make_context(run ? 3 : 1);
        now.n = 0;
        operations(ctx);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
        for (int i = 0; i < now.n; i++) {
            if (run == 0)
                printf("hash %s %016llx\n", now.names[i], (unsigned long long) now.hashes[i]);
            else if (now.hashes[i] != first.hashes[i])
                fail_msg("%s: other bytes the second time", now.names[i]);
        }
        first = now;
    }
}

static struct sg_engine *opened(sg_ctx *ctx, const struct sg_model *m)
{
    return make_engine(ctx, main_engine(), NULL, m, NULL);
}

/* ---- drawing ---- */

/* Images and their gradients, in bands and not: bands change nothing. */
static void draw_views(sg_ctx *ctx)
{
    static float rgb[2][3 * PIXELS], alpha[2][PIXELS], depth[2][PIXELS], weight[3 * PIXELS];
    struct sg_model *m = make_model(ctx, 400, DEGREE, 51);
    struct sg_engine *e = opened(ctx, m);
    for (size_t i = 0; i < 3 * PIXELS; i++)
        weight[i] = draw(52, i, -1, 1);
    for (int mip = 0; mip < 2; mip++)
        for (int view = 0; view < 2; view++)
            for (int banded = 0; banded < 2; banded++) {
                const struct sg_camera camera = make_camera(W - 3 * view, H, 3 - view);
                const struct sg_render_params params = {.background = {0.1f, 0.4f, 0.8f},
                                                        .mip_kernel = mip > 0 ? 0.1f : 0,
                                                        .max_instances = banded ? 90 : 1 << 20};
                assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, true), SG_OK);
                assert_int_equal(sg_engine_read_image(e, rgb[banded], alpha[banded], depth[banded]),
                                 SG_OK);
                const struct sg_render_stats s = stats_of(e);
                assert_int_equal(s.bands > 1, banded);
                if (banded) {
                    assert_memory_equal(rgb[1], rgb[0], sizeof(rgb[0]));
                    assert_memory_equal(alpha[1], alpha[0], sizeof(alpha[0]));
                    assert_memory_equal(depth[1], depth[0], sizeof(depth[0]));
                    continue;
                }
                const uint64_t counts[] = {s.visible, s.instances, s.pairs, s.max_tile};
                note("counts", mip, view, counts, sizeof(counts));
                note("image", mip, view, rgb[0], sizeof(rgb[0]));
                note("alpha", mip, view, alpha[0], sizeof(alpha[0]));
                note("depth", mip, view, depth[0], sizeof(depth[0]));
                assert_int_equal(sg_engine_write_image_gradient(e, weight), SG_OK);
                note_gradients("gradient", mip, view, e, m);
            }
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
}

static void test_views(void **state)
{
    (void) state;
    check(draw_views);
}

/* Each reading, with both filters. */
static void count_hits(sg_ctx *ctx)
{
    enum { N = 700 };
    static double hits[2][N];
    const struct sg_camera cameras[] = {make_camera(90, 70, 3), make_camera(49, 33, 2)};
    const struct sg_camera *const views[] = {&cameras[0], &cameras[1]};
    struct sg_model *m = make_model(ctx, N, 1, 12);
    struct sg_engine *e = opened(ctx, m);
    for (int kind = SG_HIT_PIXELS; kind <= SG_HIT_TRANSMITTANCE; kind++)
        for (int mip = 0; mip < 2; mip++) {
            for (int banded = 0; banded < 2; banded++) {
                const struct sg_render_params params = {.mip_kernel = mip > 0 ? 0.1f : 0,
                                                        .max_instances = banded ? 150 : 1 << 20};
                assert_int_equal(
                    sg_engine_count_hits(e, views, 2, &params, (enum sg_hit) kind, hits[banded]),
                    SG_OK);
            }
            assert_memory_equal(hits[1], hits[0], sizeof(hits[0]));
            note("hits", kind, mip, hits[0], sizeof(hits[0]));
        }
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
}

static void test_hits(void **state)
{
    (void) state;
    check(count_hits);
}

/* ---- losses ---- */

/* An engine is given the same anisotropy in all calls. */
static const struct loss_terms {
    bool masked, planes, exposed;
    float tolerance, low_pass;
    size_t n; /* of the three losses */
    enum sg_tv_penalty penalty;
    struct sg_anisotropy_params anisotropy;
} terms[] = {
    {.n = 1},
    {.n = 1, .masked = true},
    {.n = 1, .planes = true},
    {.n = 1, .exposed = true},
    {.n = 1, .tolerance = 0.1f},
    {.n = 1, .low_pass = 40},
    {.n = 1, .masked = true, .exposed = true, .tolerance = 0.1f, .low_pass = 40},
    {.n = 2, .anisotropy = {SG_ANISOTROPY_DEFAULTS}},
    {.n = 2, .masked = true, .anisotropy = {SG_ANISOTROPY_DEFAULTS, .energy = SG_ENERGY_AMPLITUDE}},
    {.n = 2, .anisotropy = {SG_ANISOTROPY_DEFAULTS, .channels = SG_CHANNELS_LUMA}},
    {.n = 3, .penalty = SG_TV_PENALTY_L2, .anisotropy = {SG_ANISOTROPY_DEFAULTS}},
    {.n = 3, .penalty = SG_TV_PENALTY_L1, .anisotropy = {SG_ANISOTROPY_DEFAULTS}},
    {.n = 3,
     .masked = true,
     .penalty = SG_TV_PENALTY_HUBER,
     .anisotropy = {SG_ANISOTROPY_DEFAULTS}},
};
#define TERMS ((int) (sizeof(terms) / sizeof(terms[0])))

/* Of a photo of which many values are near black or white. */
static struct sg_step lose_terms(struct sg_engine *e, const struct sg_model *m,
                                 const struct loss_terms *c)
{
    static const float exposure[SG_EXPOSURE] = {0.9f, 0.1f, 0.2f,  0,      0.08f, 1.1f,
                                                0.2f, 0,    -0.1f, -0.03f, 0.75f, 0.1f};
    static float planes[3 * PIXELS], exposures[SG_EXPOSURE_FLOATS];
    static uint8_t photo[3 * PIXELS], mask[PIXELS];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_loss losses[] = {
        {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {0.2f, c->tolerance, c->low_pass}}},
        {SG_LOSS_ANISOTROPY, 40, {.anisotropy = c->anisotropy}},
        {SG_LOSS_TOTAL_VARIATION, 3, {.total_variation = c->penalty}},
    };
    struct sg_target target = {.exposure = c->exposed};
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        const float side = draw(31, i, 0, 1), v = draw(30, i, 0, 1);
        planes[i] = side < 0.3f ? 0.1f * v : side < 0.5f ? 1 - 0.1f * v : v;
        photo[i] = (uint8_t) (255 * planes[i]);
        mask[i % PIXELS] = i % 7 ? 255 : 0;
    }
    memcpy(exposures, exposure, sizeof(exposure));
    if (c->exposed)
        assert_int_equal(sg_engine_set_exposures(e, exposures, 1), SG_OK);
    if (c->planes)
        target.planes = planes;
    else
        assert_int_equal(
            sg_engine_photo_add(e, W, H, photo, c->masked ? mask : NULL, &target.photo), SG_OK);
    return step_against(e, m, &camera, &target, losses, c->n);
}

static void take_losses(sg_ctx *ctx)
{
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 53);
    for (int c = 0; c < TERMS; c++) {
        struct sg_engine *e = opened(ctx, m);
        const struct sg_step s = lose_terms(e, m, &terms[c]);
        double values[4 + SG_LOSSES] = {s.photometric.l1, s.photometric.ssim, s.photometric.mse,
                                        s.photometric.total};
        for (int k = 0; k < (int) terms[c].n; k++)
            values[4 + k] = s.loss[k];
        note("losses", c, 0, values, sizeof(values));
        if (terms[c].exposed)
            note("exposure", c, 0, s.exposure, sizeof(s.exposure));
        note_gradients("gradient", c, 0, e, m);
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
}

static void test_losses(void **state)
{
    (void) state;
    check(take_losses);
}

/* Spectra of lines of other lengths: one that is continued, a chirp, one that needs more room. */
static void transform(sg_ctx *ctx)
{
    static const int sizes[][2] = {{263, 30}, {101, 37}, {2060, 3}};
    static uint8_t photo[3 * 8000];
    const struct sg_loss losses[] = {
        {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {0.2f, 0, 0}}},
        {SG_LOSS_ANISOTROPY, 40, {.anisotropy = {SG_ANISOTROPY_DEFAULTS}}}};
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 43);
    struct sg_engine *e = opened(ctx, m);
    for (int i = 0; i < 3; i++) {
        const struct sg_camera camera = make_camera(sizes[i][0], sizes[i][1], 3);
        struct sg_target target = {0};
        for (size_t k = 0; k < sizeof(photo); k++)
            photo[k] = (uint8_t) draw(14, k, 0, 255.9f);
        assert_int_equal(
            sg_engine_photo_add(e, camera.width, camera.height, photo, NULL, &target.photo), SG_OK);
        const struct sg_step s = step_against(e, m, &camera, &target, losses, 2);
        note("anisotropy", sizes[i][0], sizes[i][1], &s.loss[1], sizeof(s.loss[1]));
        note_gradients("gradient", sizes[i][0], sizes[i][1], e, m);
    }
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
}

static void test_spectra(void **state)
{
    (void) state;
    check(transform);
}

/* ---- learning ---- */

/* Statistics of densification over two views. */
static void count(sg_ctx *ctx)
{
    static float weight[3 * PIXELS];
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 37);
    for (size_t i = 0; i < 3 * PIXELS; i++)
        weight[i] = draw(19, i, -1, 1);
    for (int kind = SG_GRADIENT_NORM; kind <= SG_GRADIENT_MIP; kind++) {
        const bool mip = kind == SG_GRADIENT_MIP;
        const struct sg_render_params params = {SG_RENDER_DEFAULTS, .mip_kernel = mip ? 0.1f : 0};
        float gradient[GAUSSIANS], absolute[GAUSSIANS], radius[GAUSSIANS];
        struct sg_engine *e = opened(ctx, m);
        assert_int_equal(sg_engine_set_statistic(e, (enum sg_gradient_statistic) kind), SG_OK);
        for (int view = 2; view < 4; view++) {
            const struct sg_camera camera = make_camera(W, H, view);
            assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, false), SG_OK);
            assert_int_equal(sg_engine_write_image_gradient(e, weight), SG_OK);
            assert_int_equal(sg_engine_raster_backward(e), SG_OK);
            assert_int_equal(sg_engine_count_radii(e), SG_OK);
            assert_int_equal(sg_engine_optimise(e, &(struct sg_update){.statistics = true}), SG_OK);
        }
        assert_int_equal(
            sg_engine_read_statistics(e, &(struct sg_statistics){.gradient = gradient,
                                                                 .radius = radius,
                                                                 .absolute = absolute}),
            SG_OK);
        note("statistic", kind, 0, gradient, sizeof(gradient));
        if (mip)
            note("absolute", kind, 0, absolute, sizeof(absolute));
        if (kind == SG_GRADIENT_NORM)
            note("radius", kind, 0, radius, sizeof(radius));
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
}

static void test_statistics(void **state)
{
    (void) state;
    check(count);
}

/* Steps with exposures, through the filter of Mip-Splatting and not; the second gathers gradients,
 * and the third takes them. */
static void learn(sg_ctx *ctx)
{
    static const struct sg_shape mip = {.name = "mip",
                                        .column = SG_C_FILTER,
                                        .forward = sg_mip_forward,
                                        .backward = sg_mip_backward};
    static float exposures[2 * SG_EXPOSURE_FLOATS];
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 54);
    for (int shaped = 0; shaped < 2; shaped++) {
        struct sg_engine *e = opened(ctx, m);
        const struct sg_camera camera = make_camera(W, H, 3), *views[] = {&camera};
        struct sg_update u = {.statistics = true, .mean_opacity = 0.1f, .mean_scale = 0.2f};
        for (int g = 0; g < SG_GROUPS; g++)
            u.rate[g] = 0.01f * (float) (g + 1), u.root[g] = 30;
        memset(exposures, 0, sizeof(exposures));
        for (int i = 0; i < 2 * SG_EXPOSURE; i++)
            exposures[i] = i % SG_EXPOSURE % 5 ? 0.1f * (float) i / SG_EXPOSURE : 1;
        assert_int_equal(sg_engine_set_exposures(e, exposures, 2), SG_OK);
        if (shaped) {
            assert_int_equal(sg_engine_filter(e, views, 1, &(struct sg_mip_filter){0.2, 0.15}),
                             SG_OK);
            assert_int_equal(sg_engine_set_shape(e, &mip), SG_OK);
        }
        for (int step = 0; step < 3; step++) {
            u.adam = step != 1, u.accumulate = step > 0;
            losses_against(e, m, NULL, 1 + (size_t) step % 2, 200, 1);
            assert_int_equal(sg_engine_raster_backward(e), SG_OK);
            assert_int_equal(sg_engine_learn_exposures(e, &(struct sg_exposure_update){0.01, 10}),
                             SG_OK);
            assert_int_equal(sg_engine_optimise(e, &u), SG_OK);
            if (step != 1)
                note_held("learned", shaped, step, e, DEGREE);
        }
        assert_int_equal(sg_engine_read_exposures(e), SG_OK);
        note("exposures", shaped, 0, exposures, sizeof(exposures));
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
}

static void test_learning(void **state)
{
    (void) state;
    check(learn);
}

/* Noise, relocation, limits, and an edit of so many that it puts them in order. */
static void change(sg_ctx *ctx)
{
    enum { N = 6000, ENTRIES = 60 };
    static uint8_t keep[N], kind[N], fresh[ENTRIES];
    static uint32_t source[N], to[ENTRIES], from[ENTRIES];
    static float opacity[ENTRIES], scale[ENTRIES];
    struct sg_model *m = make_model(ctx, N, 1, 55);
    struct sg_engine *e = opened(ctx, m);
    struct sg_edit edit = {.keep = keep, .source = source, .kind = kind, .seed = 5, .stream = 9};
    for (uint32_t i = 0; i < N; i++) {
        keep[i] = i % 3 != 1;
        edit.kept += keep[i];
        if (i % 4 == 1) {
            source[edit.appended] = i;
            kind[edit.appended++] = i % 8 == 1 ? SG_EDIT_CHILD : SG_EDIT_COPY;
        }
    }
    for (uint64_t k = 0; k < ENTRIES; k++) {
        to[k] = (uint32_t) draw(86, k, 0, N), from[k] = (uint32_t) draw(87, k, 0, N);
        opacity[k] = draw(88, k, -2, 2), scale[k] = draw(89, k, -1, 1);
        fresh[k] = k % 7 == 0;
    }
    losses_against(e, m, NULL, 0, 255, 1);
    assert_int_equal(sg_engine_raster_backward(e), SG_OK);
    assert_int_equal(sg_engine_optimise(e, &(struct sg_update){.adam = true, .statistics = true}),
                     SG_OK); /* it has moments and statistics */
    assert_int_equal(sg_engine_explore(e, &(struct sg_exploration){40, 100, 0.005f, 7, 9}), SG_OK);
    note_held("explored", 0, 0, e, 1);
    assert_int_equal(
        sg_engine_relocate(e, &(struct sg_relocation){ENTRIES, to, from, opacity, scale, fresh}),
        SG_OK);
    note_held("relocated", 0, 0, e, 1);
    assert_int_equal(sg_engine_edit(e, &edit), SG_OK);
    note_held("edited", 0, 0, e, 1);
    assert_int_equal(sg_engine_reset_opacity(e, 0.1f), SG_OK);
    assert_int_equal(sg_engine_floor_scale(e, 0.02f), SG_OK);
    note_held("limited", 0, 0, e, 1);
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
}

static void test_changes(void **state)
{
    (void) state;
    check(change);
}

/* ---- the attack ---- */

/* Images that are given: each form, with one bound and with one of each pixel, and with the
 * spectral term. */
static void ascend(sg_ctx *ctx)
{
    static float photo[3 * PIXELS], x[3 * PIXELS], scratch[3 * PIXELS], extra[3 * PIXELS];
    static float bound[PIXELS];
    struct sg_anisotropy *loss;
    struct sg_engine *e;
    assert_int_equal(sg_anisotropy_create(ctx, W, H, NULL, NULL, &loss), SG_OK);
    assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &e), SG_OK);
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        photo[i] = draw(11, i, 0.1f, 0.9f);
        bound[i % PIXELS] = draw(12, i, 0, 12 / 255.0f);
    }
    for (int form = SG_ATTACK_TV_VERTICAL2; form <= SG_ATTACK_TV_ISO; form++)
        for (int way = 0; way < 3; way++) {
            const struct ascent a = {.epsilon = 16 / 255.0f,
                                     .step = 2 / 255.0f,
                                     .steps = 5,
                                     .form = (enum sg_attack_tv) form,
                                     .bound = way == 1 ? bound : NULL,
                                     .spectral = way == 2 ? loss : NULL,
                                     .spectral_weight = 3,
                                     .extra = extra};
            memcpy(x, photo, sizeof(x));
            assert_int_equal(sg_ascend(e, &a, photo, W, H, x, scratch), SG_OK);
            note("ascended", form, way, x, sizeof(x));
        }
    sg_engine_destroy(&e);
    sg_anisotropy_destroy(&loss);
}

static void test_ascent(void **state)
{
    (void) state;
    check(ascend);
}

/* Views, of which the result is the target of the losses. */
static void ascend_views(sg_ctx *ctx)
{
    static uint8_t photo[3 * PIXELS];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    const struct sg_loss loss = {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {0.2f, 0, 0}}};
    const struct sg_target target = {.ascended = true};
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 56);
    struct sg_engine *e = opened(ctx, m);
    struct sg_step step;
    sg_photo handle;
    for (size_t i = 0; i < sizeof(photo); i++)
        photo[i] = (uint8_t) draw(14, i, 0, 255.9f);
    for (int form = SG_ATTACK_TV_VERTICAL2; form <= SG_ATTACK_TV_ISO && sg_engine_ascends_views(e);
         form++)
        for (int way = 0; way < 3; way++) {
            const struct sg_view_ascent a = {.epsilon = way == 1 ? INFINITY : 16 / 255.0f,
                                             .step = 2 / 255.0f,
                                             .steps = 3,
                                             .form = (enum sg_attack_tv) form,
                                             .spectral_weight = way == 2 ? 3 : 0};
            struct sg_view_ascent with = a;
            assert_int_equal(sg_engine_photo_add(e, W, H, photo, NULL, &handle), SG_OK);
            with.photo = handle;
            assert_int_equal(sg_engine_draw(e, &camera, DEGREE, &params, false), SG_OK);
            assert_int_equal(sg_engine_ascend_view(e, &with), SG_OK);
            assert_int_equal(sg_engine_losses(e, &target, &loss, 1), SG_OK);
            assert_int_equal(sg_engine_read_step(e, &step), SG_OK);
            sg_engine_photo_drop(e, handle);
            note("variation", form, way, &step.variation, sizeof(step.variation));
            note_gradients("towards", form, way, e, m);
        }
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
}

static void test_ascended_views(void **state)
{
    (void) state;
    check(ascend_views);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_views),          cmocka_unit_test(test_hits),
        cmocka_unit_test(test_losses),         cmocka_unit_test(test_spectra),
        cmocka_unit_test(test_statistics),     cmocka_unit_test(test_learning),
        cmocka_unit_test(test_changes),        cmocka_unit_test(test_ascent),
        cmocka_unit_test(test_ascended_views),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
