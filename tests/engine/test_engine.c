/* SPDX-License-Identifier: Apache-2.0 */
/* Every engine and variant against the scalar oracle through the stage table, on random and on
 * nasty models. */
#include "edges.h"
#include "parity.h"

#include "engine/engine.h"

struct outcome {
    int width, height;
    float *rgb, *alpha, *depth;
    struct sg_render_stats stats;
    struct sg_photometric_value loss;
    struct sg_model *gradients, *updated;
    float *mean_gradient;
};

static void *must(size_t n, size_t size)
{
    void *p = calloc(n ? n : 1, size);
    assert_non_null(p);
    return p;
}

/* counted: the mask of the photo, or NULL. */
static struct outcome run(sg_ctx *ctx, const char *engine, const char *cpu,
                          const struct sg_model *m, const struct sg_camera *camera,
                          struct sg_render_params params, const uint8_t *counted)
{
    const size_t pixels = (size_t) camera->width * (size_t) camera->height;
    struct outcome o = {.width = camera->width, .height = camera->height};
    struct sg_engine *b = make_engine(ctx, engine, cpu, m, NULL);
    o.rgb = must(3 * pixels, sizeof(float)), o.alpha = must(pixels, sizeof(float)),
    o.depth = must(pixels, sizeof(float));
    o.mean_gradient = must(m->count, sizeof(float));
    uint8_t *target = must(3 * pixels, 1);
    for (size_t i = 0; i < 3 * pixels; i++)
        target[i] = (uint8_t) draw(9, i, 0, 255);
    assert_int_equal(sg_engine_draw(b, camera, m->sh_degree, &params, true), SG_OK);
    o.stats = stats_of(b);
    assert_int_equal(sg_engine_read_image(b, o.rgb, o.alpha, o.depth), SG_OK);
    o.loss = lose(b, &(struct loss_case){.lambda_dssim = 0.2f, .target = target, .mask = counted});
    assert_int_equal(sg_engine_raster_backward(b), SG_OK);
    assert_int_equal(sg_model_create(ctx, m->count, m->sh_degree, &o.gradients), SG_OK);
    assert_int_equal(sg_engine_read_gradients(b, o.gradients), SG_OK);
    struct sg_update u = {.adam = true, .statistics = true};
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = 0.01f * (float) (g + 1), u.root[g] = 30;
    assert_int_equal(sg_engine_optimise(b, &u), SG_OK);
    assert_int_equal(stats_of(b).pairs, o.stats.pairs); /* those of the image alone */
    assert_int_equal(sg_model_create(ctx, m->count, m->sh_degree, &o.updated), SG_OK);
    assert_int_equal(sg_engine_download(b, o.updated, NULL), SG_OK);
    assert_int_equal(
        sg_engine_read_statistics(b, &(struct sg_statistics){.gradient = o.mean_gradient}), SG_OK);
    sg_engine_destroy(&b);
    free(target);
    return o;
}

static void clear(struct outcome *o)
{
    free(o->rgb);
    free(o->alpha);
    free(o->depth);
    free(o->mean_gradient);
    sg_model_destroy(&o->gradients);
    sg_model_destroy(&o->updated);
}

/* edges: pixels where a Gaussian may be there or not, which are masked in the loss. An image is
 * right to 1e-5 elsewhere, and a gradient to 1e-4 of the largest of its parameter. Vulkan lets a
 * device's exp be wrong by 3 + 2 |x| units in the last place, which is 1e-6 at the cut-off. */
static void compare(const char *name, const struct outcome *o, const struct outcome *ref,
                    const uint8_t *edges)
{
    const size_t pixels = (size_t) o->width * (size_t) o->height, n = o->gradients->count;
    assert_within(name, "image", difference_of(o->rgb, ref->rgb, 3 * pixels, edges, pixels), 1e-5);
    assert_within(name, "image, with cut-offs",
                  difference_of(o->rgb, ref->rgb, 3 * pixels, NULL, 1), 0.02);
    assert_within(name, "alpha", difference_of(o->alpha, ref->alpha, pixels, edges, pixels), 1e-5);
    assert_within(name, "depth",
                  difference_of(o->depth, ref->depth, pixels, edges, pixels) /
                      (1 + largest_of(ref->depth, pixels)),
                  1e-5);
    assert_within(name, "visible Gaussians",
                  fabs((double) o->stats.visible - (double) ref->stats.visible), 0);
    assert_within(name, "loss: L1", fabs(o->loss.l1 - ref->loss.l1), 1e-6);
    assert_within(name, "loss: SSIM", fabs(o->loss.ssim - ref->loss.ssim), 1e-6);
    assert_within(name, "loss: squares", fabs(o->loss.mse - ref->loss.mse), 1e-6);
    assert_gradients(name, "gradient", o->gradients, ref->gradients, 1e-4);
    assert_within(name, "statistic of densification",
                  difference_of(o->mean_gradient, ref->mean_gradient, n, NULL, 1) /
                      (1e-9 + largest_of(ref->mean_gradient, n)),
                  1e-4);
}

/* All variants on one model; the first two render parameter sets must agree with each other too. */
static void check_model(const struct sg_model *m, const struct sg_camera *camera, bool masked)
{
    sg_ctx *ctx = make_context(2);
    struct sg_render_params params = {SG_RENDER_DEFAULTS, .background = {0.1f, 0.4f, 0.8f}};
    const size_t pixels = (size_t) camera->width * (size_t) camera->height;
    uint8_t *edges = must(pixels, 1), *counted = must(pixels, 1);
    assert_true(find_edges(m, camera, &params, 1e-3, edges) <= pixels / 100);
    for (size_t i = 0; i < pixels; i++)
        counted[i] = edges[i] || (masked && i % 7 >= 5) ? 0 : 255;
    struct outcome ref = run(ctx, "ref", NULL, m, camera, params, counted);
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases) - 1; /* the last is the oracle */
    for (int i = 0; i < n; i++) {
        struct outcome o = run(ctx, cases[i].engine, cases[i].variant, m, camera, params, counted);
        compare(case_name(cases[i]), &o, &ref, edges);
        params.reference_tiles = true;
        struct outcome tiles =
            run(ctx, cases[i].engine, cases[i].variant, m, camera, params, counted);
        params.reference_tiles = false;
        assert_int_equal(tiles.stats.visible, ref.stats.visible);
        assert_true(o.stats.instances <= tiles.stats.instances);
        assert_memory_equal(o.rgb, tiles.rgb, 3 * pixels * sizeof(float));
        clear(&o);
        clear(&tiles);
    }
    clear(&ref);
    free(edges);
    free(counted);
    sg_ctx_destroy(&ctx);
}

static void test_random(void **state)
{
    (void) state;
    static const int sizes[][2] = {{100, 75}, {17, 33}, {1, 1}, {64, 48}};
    sg_ctx *ctx = make_context(1);
    for (int i = 0; i < 4; i++)
        for (int degree = 0; degree <= 3; degree += 3) {
            struct sg_model *m = make_model(ctx, 301, degree, (uint64_t) (10 + i));
            const struct sg_camera c = make_camera(sizes[i][0], sizes[i][1], 3);
            check_model(m, &c, i % 2 == 1);
            sg_model_destroy(&m);
        }
    sg_ctx_destroy(&ctx);
}

static void test_reference_instances(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 500, 1, 3);
    const struct sg_camera c = make_camera(150, 110, 3);
    struct sg_render_params params = {SG_RENDER_DEFAULTS, .reference_tiles = true};
    struct outcome ref = run(ctx, "ref", NULL, m, &c, params, NULL);
    struct engine_case cases[ENGINE_CASES];
    for (int i = 0, n = engine_cases(cases) - 1; i < n; i++) {
        struct outcome o = run(ctx, cases[i].engine, cases[i].variant, m, &c, params, NULL);
        /* The oracle lists Gaussians that are too transparent to be drawn; the kernels do not. */
        size_t faint = 0;
        for (size_t k = 0; k < m->count; k++)
            faint += *sg_model_at(m, k, SG_P_OPACITY) < -5.5f;
        assert_int_equal(faint, 0);
        assert_within(case_name(cases[i]), "instances",
                      fabs((double) o.stats.instances - (double) ref.stats.instances), 0);
        assert_int_equal(o.stats.max_tile, ref.stats.max_tile);
        clear(&o);
    }
    clear(&ref);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* What files from strangers may hold. Nothing may crash, and sound Gaussians must not suffer. */
static void test_nasty(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    const float bad[] = {NAN, INFINITY, -INFINITY, 1e38f, -1e38f, 1e-38f, 0};
    const size_t count = sizeof(bad) / sizeof(bad[0]);
    struct sg_model *m = make_model(ctx, SG_PARAMS_MAX * count + 40, 3, 5);
    for (int p = 0; p < SG_PARAMS_MAX; p++)
        for (size_t k = 0; k < count; k++)
            *sg_model_at(m, (size_t) p * count + k, p) = bad[k];
    for (size_t i = 0; i < 10;
         i++) { /* behind and inside the camera, needles, a zero quaternion, certain opacity */
        const size_t at = SG_PARAMS_MAX * count + i;
        *sg_model_at(m, at, SG_P_XYZ + 2) = i < 3 ? -3.0f - (float) i * 0.1f : 0.2f;
        *sg_model_at(m, at, SG_P_SCALE) = i == 4 ? 4.0f : -3.0f;
        *sg_model_at(m, at, SG_P_SCALE + 1) = i == 5 ? -20.0f : -3.0f;
        if (i == 6)
            for (int k = 0; k < 4; k++)
                *sg_model_at(m, at, SG_P_ROT + k) = 0;
        if (i == 7)
            *sg_model_at(m, at, SG_P_OPACITY) = 40;
        if (i == 8)
            *sg_model_at(m, at, SG_P_OPACITY) = -40;
    }
    const struct sg_camera c = make_camera(61, 47, 3);
    struct engine_case cases[ENGINE_CASES];
    for (int i = 0, n = engine_cases(cases) - 1; i < n; i++) {
        struct outcome o = run(ctx, cases[i].engine, cases[i].variant, m, &c,
                               (struct sg_render_params){SG_RENDER_DEFAULTS}, NULL);
        for (size_t k = 0; k < 3u * 61 * 47; k++)
            assert_true(isfinite(o.rgb[k]));
        for (size_t k = SG_PARAMS_MAX * count + 10; k < m->count; k++)
            for (int p = 0; p < SG_PARAMS_MAX; p++)
                assert_true(isfinite(*sg_model_at(o.gradients, k, p)));
        clear(&o);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_nothing_visible(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 33, 1, 2);
    for (size_t i = 0; i < m->count; i++)
        *sg_model_at(m, i, SG_P_XYZ + 2) = -50;
    const struct sg_camera c = make_camera(40, 30, 3);
    check_model(m, &c, false);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* However small the bands: the very same bytes, and counts. */
static void test_bands(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, 400, 2, 8);
    for (size_t i = 0; i < 5; i++) /* all over the image */
        *sg_model_at(m, i, SG_P_SCALE) = *sg_model_at(m, i, SG_P_SCALE + 1) = 1;
    const struct sg_camera c = make_camera(120, 90, 3);
    struct sg_render_params params = {SG_RENDER_DEFAULTS};
    struct outcome one = run(ctx, main_engine(), NULL, m, &c, params, NULL);
    assert_int_equal(one.stats.bands, 1);
    static const uint64_t limits[] = {1, 7, 100, 500};
    for (int i = 0; i < 4; i++) {
        params.max_instances = limits[i];
        struct outcome o = run(ctx, main_engine(), NULL, m, &c, params, NULL);
        assert_true(o.stats.bands > 1);
        assert_int_equal(o.stats.visible, one.stats.visible);
        assert_int_equal(o.stats.instances, one.stats.instances);
        assert_int_equal(o.stats.pairs, one.stats.pairs);
        assert_int_equal(o.stats.max_tile, one.stats.max_tile);
        assert_memory_equal(o.rgb, one.rgb, 3 * 120 * 90 * sizeof(float));
        assert_memory_equal(o.gradients->params, one.gradients->params,
                            m->count * (size_t) sg_param_count(2) * sizeof(float));
        assert_memory_equal(o.updated->params, one.updated->params,
                            m->count * (size_t) sg_param_count(2) * sizeof(float));
        clear(&o);
    }
    clear(&one);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Where memory was short for a band, the stage can be called again. */
static void test_bands_again(void **state)
{
    (void) state;
    static float expected[3 * 120 * 90], found[3 * 120 * 90];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, 400, 2, 8);
    const struct sg_camera c = make_camera(120, 90, 3);
    struct sg_render_params params = {SG_RENDER_DEFAULTS};
    params.max_instances = 100;
    bool failed = true;
    for (uint64_t nth = 0; failed; nth++) { /* at first nothing fails */
        struct sg_engine *e = make_engine(ctx, main_engine(), NULL, m, NULL);
        assert_int_equal(sg_engine_project(e, &c, 2, &params), SG_OK);
        assert_int_equal(sg_engine_bin(e), SG_OK);
        sg_fail_allocation(ctx, nth);
        const int code = sg_engine_raster(e, false);
        failed = sg_fail_allocation(ctx, 0) || !nth;
        if (code) {
            assert_int_equal(code, SG_ERR_BUDGET);
            sg_clear_error(ctx);
            assert_int_equal(sg_engine_raster(e, false), SG_OK);
        }
        assert_int_equal(sg_engine_read_image(e, nth ? found : expected, NULL, NULL), SG_OK);
        if (nth)
            assert_memory_equal(found, expected, sizeof(found));
        sg_engine_destroy(&e);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Against brute force in the oracle, on a model none of whose pixels hangs on rounding; the sum
 * over the Gaussians is that over the pixels; bands change nothing. */
static void test_hits(void **state)
{
    (void) state;
    static const struct {
        const char *what;
        double bound; /* of a share */
    } kinds[] = {[SG_HIT_PIXELS] = {"hits: pixels", 0},
                 [SG_HIT_VIEWS] = {"hits: views", 0},
                 [SG_HIT_WEIGHT] = {"hits: weight", 2e-5},
                 [SG_HIT_TRANSMITTANCE] = {"hits: transmittance", 2e-5}};
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, 700, 1, 50);
    *sg_model_at(m, 5, SG_P_XYZ) = 1000; /* nobody sees it */
    const struct sg_camera cameras[] = {make_camera(90, 70, 3), make_camera(49, 33, 2),
                                        make_camera(64, 64, 40)};
    const struct sg_camera *const views[] = {&cameras[0], &cameras[1], &cameras[2]};
    struct engine_case cases[ENGINE_CASES];
    double *ref = must(m->count, sizeof(double)), *hits = must(m->count, sizeof(double));
    struct sg_render_params params = {SG_RENDER_DEFAULTS};
    for (int v = 0; v < 3; v++)
        assert_int_equal(find_edges(m, views[v], &params, 1e-4, NULL), 0);
    for (int kind = SG_HIT_PIXELS; kind <= SG_HIT_TRANSMITTANCE; kind++) {
        double blended = 0;
        struct sg_engine *b = make_engine(ctx, "ref", NULL, m, NULL);
        assert_int_equal(sg_engine_count_hits(b, views, 3, &params, (enum sg_hit) kind, ref),
                         SG_OK);
        for (int v = 0; v < 3 && kind == SG_HIT_WEIGHT;
             v++) { /* weights of a pixel add up to its alpha */
            const size_t pixels = (size_t) cameras[v].width * (size_t) cameras[v].height;
            float *rgb = must(3 * pixels, sizeof(float)), *alpha = must(pixels, sizeof(float));
            assert_int_equal(sg_engine_draw(b, views[v], 0, &params, true), SG_OK);
            assert_int_equal(sg_engine_read_image(b, rgb, alpha, NULL), SG_OK);
            for (size_t i = 0; i < pixels; i++)
                blended += (double) alpha[i];
            free(rgb);
            free(alpha);
        }
        sg_engine_destroy(&b);
        double sum = 0, zeros = 0;
        for (size_t i = 0; i < m->count; i++)
            sum += ref[i], zeros += ref[i] == 0;
        assert_true(sum > 100 && zeros >= 1 && ref[5] == 0);
        if (kind == SG_HIT_WEIGHT)
            assert_float_equal(sum, blended, 1e-4 * blended);
        for (int k = 0, n = engine_cases(cases) - 1; k < n; k++)
            for (uint64_t limit = 1 << 20; limit; limit = limit > 40 ? 40 : 0) {
                double most = 0;
                params.max_instances = limit;
                b = make_engine(ctx, cases[k].engine, cases[k].variant, m, NULL);
                assert_int_equal(
                    sg_engine_count_hits(b, views, 3, &params, (enum sg_hit) kind, hits), SG_OK);
                for (size_t i = 0; i < m->count; i++)
                    most = fmax(most, fabs(hits[i] - ref[i]) / (1 + ref[i]));
                assert_within(case_name(cases[k]), kinds[kind].what, most, kinds[kind].bound);
                sg_engine_destroy(&b);
            }
        params.max_instances = 1 << 20;
    }
    free(ref);
    free(hits);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Where no pixel is ever full, a Gaussian is hit where it would be seen alone: as many times,
 * exactly. */
static void test_hits_alone(void **state)
{
    (void) state;
    enum { N = 50, W = 90, H = 70 };
    const char *const names[] = {main_engine(), "ref"};
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, N, 0, 12), *one = make_model(ctx, 1, 0, 12);
    const struct sg_camera camera = make_camera(W, H, 3), *const view = &camera;
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    float *rgb = must(3 * W * H, sizeof(float)), *alpha = must(W * H, sizeof(float));
    for (size_t i = 0; i < N; i++)
        *sg_model_at(m, i, SG_P_OPACITY) = -2 - (float) (i % 3); /* 0.88^50 > 1e-4 */
    for (int k = 0; k < 2; k++) {
        double hits[N], sum = 0, events = 0;
        struct sg_engine *b = make_engine(ctx, names[k], NULL, m, NULL);
        assert_int_equal(sg_engine_count_hits(b, &view, 1, &params, SG_HIT_PIXELS, hits), SG_OK);
        for (size_t i = 0; i < N; i++) {
            size_t seen = 0;
            for (int p = 0; p < sg_param_count(0); p++)
                *sg_model_at(one, 0, p) = *sg_model_at(m, i, p);
            assert_int_equal(sg_engine_upload(b, one, NULL), SG_OK);
            assert_int_equal(sg_engine_draw(b, &camera, 0, &params, true), SG_OK);
            assert_int_equal(sg_engine_read_image(b, rgb, alpha, NULL), SG_OK);
            for (size_t p = 0; p < W * H; p++)
                seen += alpha[p] > 0;
            assert_true(hits[i] == (double) seen);
            sum += hits[i], events += (double) seen;
        }
        assert_true(sum == events && sum > 1000);
        sg_engine_destroy(&b);
    }
    free(rgb);
    free(alpha);
    sg_model_destroy(&one);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_floor(void **state)
{
    (void) state;
    const char *const names[] = {main_engine(), "ref"};
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 70, 0, 2), *after;
    assert_int_equal(sg_model_create(ctx, 70, 0, &after), SG_OK);
    for (int k = 0; k < 2; k++) {
        struct sg_engine *b = make_engine(ctx, names[k], NULL, m, NULL);
        assert_int_equal(sg_engine_floor_scale(b, 0.05f), SG_OK);
        assert_int_equal(sg_engine_download(b, after, NULL), SG_OK);
        for (size_t i = 0; i < 70; i++)
            for (int p = 0; p < sg_param_count(0); p++) {
                const float v = *sg_model_at(m, i, p);
                assert_float_equal(*sg_model_at(after, i, p),
                                   p >= SG_P_SCALE && p < SG_P_ROT ? fmaxf(v, logf(0.05f)) : v, 0);
            }
        sg_engine_destroy(&b);
    }
    sg_model_destroy(&m);
    sg_model_destroy(&after);
    sg_ctx_destroy(&ctx);
}

/* Stages out of order, targets and lists that make no sense: refused by their name, and nothing is
 * lost. */
static void test_front_end(void **state)
{
    (void) state;
    enum { W = 20, H = 12 };
    struct engine_case cases[ENGINE_CASES];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    const struct sg_loss photometric = {
        SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
    const struct sg_loss wrong[] = {
        {SG_LOSS_TOTAL_VARIATION, 1, {.total_variation = SG_TV_PENALTY_L1}}, photometric};
    static uint8_t rgb[3 * W * H];
    static float planes[3 * W * H];
    for (int v = 0, n = engine_cases(cases); v < n; v++) {
        sg_ctx *ctx = make_context(1);
        struct sg_model *m = make_model(ctx, 30, 1, 4);
        struct sg_engine *b = make_engine(ctx, cases[v].engine, cases[v].variant, m, NULL);
        sg_photo photo, other;
        struct sg_step step;
        assert_int_equal(sg_engine_photo_add(b, W, H, rgb, NULL, &photo), SG_OK);
        assert_int_equal(sg_engine_photo_add(b, H, W, rgb, NULL, &other), SG_OK);
        const struct sg_target target = {.photo = photo}, none = {0}, turned = {.photo = other},
                               unknown = {.photo = 77};
        const struct sg_update update = {.adam = true};
#define REFUSED(code, call, text)                                                                  \
    do {                                                                                           \
        sg_clear_error(ctx);                                                                       \
        assert_int_equal(call, code);                                                              \
        assert_non_null(strstr(sg_last_error(ctx), text));                                         \
    } while (0)
        REFUSED(SG_ERR_INTERNAL, sg_engine_bin(b), "bin: found no projection");
        assert_int_equal(sg_engine_project(b, &camera, 1, &params), SG_OK);
        REFUSED(SG_ERR_INTERNAL, sg_engine_raster(b, false), "raster: found no tile lists");
        REFUSED(SG_ERR_INTERNAL, sg_engine_losses(b, &target, &photometric, 1),
                "losses: found no image");
        REFUSED(SG_ERR_INTERNAL, sg_engine_read_image(b, planes, NULL, NULL),
                "read_image: found no image");
        assert_int_equal(sg_engine_draw(b, &camera, 1, &params, false), SG_OK);
        REFUSED(SG_ERR_INTERNAL, sg_engine_raster_backward(b), "found no gradient of the image");
        REFUSED(SG_ERR_USAGE, sg_engine_losses(b, &none, &photometric, 1), "found no target");
        REFUSED(SG_ERR_USAGE, sg_engine_losses(b, &unknown, &photometric, 1), "photo 77");
        REFUSED(SG_ERR_USAGE, sg_engine_losses(b, &turned, &photometric, 1),
                "12 x 20, expected 20 x 12");
        REFUSED(SG_ERR_USAGE, sg_engine_losses(b, &target, wrong, 2), "once and first");
        sg_engine_photo_drop(b, other);
        REFUSED(SG_ERR_USAGE, sg_engine_losses(b, &turned, &photometric, 1), "has not been added");
        assert_int_equal(sg_engine_losses(b, &target, &photometric, 1), SG_OK);
        REFUSED(SG_ERR_INTERNAL, sg_engine_optimise(b, &update),
                "found no gradients of the splats");
        assert_int_equal(sg_engine_raster_backward(b), SG_OK);
        assert_int_equal(sg_engine_optimise(b, &update), SG_OK);
        REFUSED(SG_ERR_INTERNAL, sg_engine_raster_backward(b),
                "raster_backward"); /* the model has moved */
        assert_int_equal(sg_engine_read_image(b, planes, NULL, NULL), SG_OK);
        assert_int_equal(sg_engine_read_step(b, &step), SG_OK);
        assert_true(step.loss[SG_LOSS_PHOTOMETRIC] == step.photometric.total &&
                    step.photometric.l1 > 0);
        assert_true(isnan(step.loss[SG_LOSS_ANISOTROPY]) &&
                    isnan(step.loss[SG_LOSS_TOTAL_VARIATION]));
        assert_int_equal(sg_engine_photo_add(b, H, W, rgb, NULL, &other),
                         SG_OK); /* the free handle */
        assert_int_equal(other, turned.photo);
        sg_engine_stop_clocks(b, true);
        const struct sg_engine_times before = sg_engine_times(b);
        assert_int_equal(sg_engine_draw(b, &camera, 1, &params, false), SG_OK);
        assert_true(sg_engine_times(b).raster == before.raster && before.raster > 0 &&
                    before.optimise > 0);
        sg_engine_destroy(&b);
        REFUSED(SG_ERR_USAGE, sg_engine_create(ctx, "gpu", NULL, &b),
                "expected auto, cpu, vulkan or ref");
        REFUSED(SG_ERR_USAGE, sg_engine_create(ctx, "cpu", "mmx", &b), "cpu: found \"mmx\"");
        sg_model_destroy(&m);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
#undef REFUSED
}

/* Each engine and variant that is listed can be created where it is available, and is refused where
 * it is not; one of each engine is chosen, and that is what runs. */
static void test_list(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_engine_info e;
    size_t n = 0;
    int chosen[2] = {0}; /* of cpu and ref */
    for (; sg_engine_list(n, &e); n++) {
        struct sg_engine *engine;
        assert_true(e.description[0] && e.available == !e.missing);
        const int code = sg_engine_create(ctx, e.engine, e.variant, &engine);
        assert_int_equal(code, e.available ? SG_OK : SG_ERR_USAGE);
        if (!code && e.variant)
            assert_string_equal(sg_engine_variant(engine), e.variant);
        sg_engine_destroy(&engine);
        if (!e.chosen || !strcmp(e.engine, "vulkan"))
            continue;
        chosen[!strcmp(e.engine, "ref")]++;
        assert_int_equal(sg_engine_create(ctx, e.engine, NULL, &engine), SG_OK);
        assert_string_equal(sg_engine_variant(engine), e.variant ? e.variant : e.engine);
        sg_engine_destroy(&engine);
    }
    assert_true(n >= 2 && chosen[0] == 1 && chosen[1] == 1);
    assert_null(e.engine);
    assert_false(sg_engine_list((size_t) -1, &e));
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_list),
        cmocka_unit_test(test_random),
        cmocka_unit_test(test_reference_instances),
        cmocka_unit_test(test_nasty),
        cmocka_unit_test(test_nothing_visible),
        cmocka_unit_test(test_bands),
        cmocka_unit_test(test_bands_again),
        cmocka_unit_test(test_hits),
        cmocka_unit_test(test_hits_alone),
        cmocka_unit_test(test_floor),
        cmocka_unit_test(test_front_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
