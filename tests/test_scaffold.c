/* SPDX-License-Identifier: Apache-2.0 */
/* Models of anchors (Scaffold-GS): gradients of the oracle by differences, the chain from the image
 * to anchors and networks, and the start. */
#include "anchor_models.h"
#include "engine/parity.h"
#include "engine/ref/ref_neural.h"
#include "engine/ref/render.h"
#include "engine/host/host_model.h"
#include "engine/scaffold/neural.h"
#include "races.h"

/* ---- the oracle in double precision ---- */

struct one {
    struct ref_weights w;
    struct ref_anchor a;
    struct ref_view view;
    double volume, factor[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
};

/* Of all that exists: a weighted sum of what is drawn, and the products of the scales. */
static double value_of(const struct one *o)
{
    double drawn[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES], sum = 0;
    bool exists[SG_ANCHOR_GAUSSIANS];
    ref_neural_forward(&o->w, &o->a, &o->view, drawn, exists);
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
        for (int p = 0; p < SG_NEURAL_PLANES && exists[k]; p++)
            sum += o->factor[k][p] * drawn[k][p];
        if (exists[k])
            sum += o->volume * exp(drawn[k][4] + drawn[k][5] + drawn[k][6]);
    }
    return sum;
}

static void compare_change(struct one *o, double *value, double gradient, const char *what, int i)
{
    const double kept = *value, step = 1e-6;
    *value = kept + step;
    const double above = value_of(o);
    *value = kept - step;
    const double change = (above - value_of(o)) / (2 * step);
    *value = kept;
    if (!(fabs(gradient - change) < 1e-6 + 1e-5 * fabs(change)))
        fail_msg("%s %d: gradient %g, expected %g", what, i, gradient, change);
}

static void check_oracle(unsigned parts)
{
    struct one *o = calloc(1, sizeof(*o));
    struct ref_weights *sum = calloc(1, sizeof(*sum));
    struct ref_anchor d;
    double *w = (double *) &o->w, *dw = (double *) sum, appearance[SG_APPEARANCE] = {0};
    assert_non_null(o);
    assert_non_null(sum);
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        w[i] = (double) draw(30, i, -0.3f, 0.3f);
    for (size_t i = 0; i < SG_A_PLANES; i++)
        o->a.anchor[i] = (double) draw(31, i, -1, 1);
    for (size_t k = 0; k < 3; k++) {
        o->a.position[k] = (double) draw(32, k, -1, 1);
        o->a.reach[k] = (double) draw(33, k, -2, 0);
        o->view.centre[k] = (double) draw(34, k, 2, 4);
    }
    for (size_t k = 0; k < SG_APPEARANCE; k++)
        o->view.appearance[k] = (double) draw(36, k, -1, 1);
    o->view.parts = parts;
    for (size_t k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
        for (size_t p = 0; p < SG_NEURAL_PLANES; p++)
            o->factor[k][p] = (double) draw(35, SG_NEURAL_PLANES * k + p, -1, 1);
    o->volume = 0.7;
    ref_neural_backward(&o->w, &o->a, &o->view, o->factor, o->volume, &d, sum, appearance);
    for (int k = 0; k < 3; k++)
        compare_change(o, &o->a.reach[k], d.reach[k], "reach", k);
    for (int p = 0; p < SG_A_PLANES; p++)
        compare_change(o, &o->a.anchor[p], d.anchor[p], "anchor", p);
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        compare_change(o, &w[i], dw[i], "weight", (int) i);
    for (int k = 0; k < SG_APPEARANCE; k++)
        compare_change(o, &o->view.appearance[k], appearance[k], "appearance", k);
    /* Weights of a part have a gradient where it is there, else none. */
    for (size_t h = 0; h < SG_HIDDEN; h++)
        assert_true(parts & SG_PART_DISTANCE || sum->distance[h] == 0);
    for (int j = 0; j < SG_BANK_OUTPUTS; j++)
        assert_true((sum->bank_bias[j] != 0) == (bool) (parts & SG_PART_BANK));
    assert_true((appearance[0] != 0) == (bool) (parts & SG_PART_APPEARANCE));
    free(o);
    free(sum);
}

static void test_oracle(void **state)
{
    (void) state;
    for (unsigned parts = 0; parts <= ALL_PARTS; parts++)
        check_oracle(parts);
}

/* With all of one copy's share a feature is that copy, in the order of the released code. */
static void test_bank(void **state)
{
    (void) state;
    struct ref_weights *w = calloc(1, sizeof(*w));
    struct ref_anchor a;
    struct ref_neural n;
    const struct ref_view view = {.centre = {1, 2, 3}, .parts = SG_PART_BANK};
    assert_non_null(w);
    for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
        a.anchor[SG_A_FEATURE + f] = f;
    memset(a.position, 0, sizeof(a.position));
    for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
        for (int k = 0; k < SG_BANK_OUTPUTS; k++)
            w->bank_bias[k] = k == j ? 0 : -1000;
        ref_networks(w, &a, &view, &n);
        for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
            assert_true(n.input[f] == (j == 0 ? 4 * (f % 8) : j == 1 ? 2 * (f % 16) : f));
    }
    for (int k = 0; k < SG_BANK_OUTPUTS; k++)
        w->bank_bias[k] = 7;
    ref_networks(w, &a, &view, &n);
    assert_true(fabs(n.input[9] - (4 + 18 + 9) / 3.0) < 1e-12);
    free(w);
}

/* ---- an engine ---- */

#define ANCHORS 3

#define W 37
#define H 29
#define PIXELS ((size_t) W * H)
#define GRID(n) (((n) + SG_TILE - 1) / SG_TILE)
#define DRAWN (ANCHORS * SG_ANCHOR_GAUSSIANS)

/* The whole chain in double precision: anchors and weights, their Gaussians, the image, and as the
 * loss a weighted sum of it and the regulariser. */
struct chain {
    struct ref_weights w;
    struct ref_anchor a[ANCHORS];
    unsigned parts;
    double volume; /* weight of the regulariser */
    double appearance[SG_APPEARANCE];
    struct sg_camera camera;
    double weight[3 * W * H];
    struct ref_splat splats[DRAWN];
    double drawn[DRAWN][SG_PARAMS_MAX];
    size_t source[DRAWN], count; /* source: anchor and number of each that is drawn */
};

static struct ref_view view_of(const struct chain *c)
{
    const struct pinhole view = view_make(&c->camera);
    struct ref_view out = {{view.centre[0], view.centre[1], view.centre[2]}, c->parts, {0}};
    memcpy(out.appearance, c->appearance, sizeof(out.appearance));
    return out;
}

/* *events: a number that changes where a cut-off is crossed and the loss jumps. */
static double evaluate(struct chain *c, bool backward, unsigned long *events)
{
    static double rgb[3 * W * H], transmittance[W * H], depth[W * H];
    static int last[W * H];
    static const float black[3];
    struct ref_image image = {W, H, rgb, transmittance, depth, last};
    const struct pinhole view = view_make(&c->camera);
    struct ref_entry list[DRAWN];
    double loss = 0, volume = 0;
    c->count = 0;
    *events = 0;
    for (size_t i = 0; i < ANCHORS; i++) {
        double drawn[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
        bool exists[SG_ANCHOR_GAUSSIANS];
        const struct ref_view of = view_of(c);
        ref_neural_forward(&c->w, &c->a[i], &of, drawn, exists);
        for (size_t k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
            if (!exists[k])
                continue;
            memcpy(c->drawn[c->count], drawn[k], sizeof(drawn[k]));
            c->source[c->count] = i * SG_ANCHOR_GAUSSIANS + k;
            *events = *events * 31 + c->source[c->count++];
            volume += exp(drawn[k][4] + drawn[k][5] + drawn[k][6]);
        }
    }
    for (size_t i = 0; i < c->count; i++)
        ref_project(&view, c->drawn[i], 0, GRID(W), GRID(H), &c->splats[i]);
    for (int ty = 0; ty < GRID(H); ty++)
        for (int tx = 0; tx < GRID(W); tx++) {
            const size_t m = ref_tile_list(c->splats, c->count, tx, ty, list);
            for (int y = ty * SG_TILE; y < (ty + 1) * SG_TILE && y < H; y++)
                for (int x = tx * SG_TILE; x < (tx + 1) * SG_TILE && x < W; x++) {
                    ref_pixel_forward(c->splats, list, m, x, y, black, &image);
                    *events += 1000 * (unsigned long) last[y * W + x];
                    for (size_t k = 0; k < m; k++) {
                        double dx, dy, gauss, alpha;
                        *events += ref_pair(&c->splats[list[k].id], x, y, &dx, &dy, &gauss, &alpha);
                    }
                    if (backward)
                        ref_pixel_backward(c->splats, list, x, y, black, &image, c->weight);
                }
        }
    for (int i = 0; i < 3 * W * H; i++)
        loss += c->weight[i] * rgb[i];
    return loss + c->volume * volume / (double) c->count;
}

/* The gradient by the oracle, after evaluate with backward. */
static void pull(const struct chain *c, struct ref_anchor out[ANCHORS], struct ref_weights *sum,
                 double appearance[SG_APPEARANCE])
{
    const struct pinhole view = view_make(&c->camera);
    const struct ref_view of = view_of(c);
    double drawn[ANCHORS][SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
    memset(sum, 0, sizeof(*sum));
    memset(appearance, 0, SG_APPEARANCE * sizeof(double));
    memset(drawn, 0, sizeof(drawn));
    for (size_t i = 0; i < c->count; i++) {
        double g[SG_PARAMS_MAX];
        ref_parameter_gradient(&view, &c->splats[i], c->drawn[i], 0, g);
        memcpy(drawn[c->source[i] / SG_ANCHOR_GAUSSIANS][c->source[i] % SG_ANCHOR_GAUSSIANS], g,
               sizeof(drawn[0][0]));
    }
    for (size_t i = 0; i < ANCHORS; i++)
        ref_neural_backward(&c->w, &c->a[i], &of, drawn[i], c->volume / (double) c->count, &out[i],
                            sum, appearance);
}

static struct chain *make_chain(const struct sg_model *m)
{
    struct chain *c = calloc(1, sizeof(*c));
    assert_non_null(c);
    oracle_anchors(m, c->a, &c->w);
    c->parts = m->columns->networks->parts;
    c->volume = (double) SG_ANCHOR_VOLUME;
    for (int k = 0; k < SG_APPEARANCE; k++)
        c->appearance[k] = (double) m->columns->networks->appearance[1].value[k];
    c->camera = make_camera(W, H, 2.2);
    for (size_t i = 0; i < 3 * W * H; i++)
        c->weight[i] = (double) draw(45, i, -1, 1);
    return c;
}

/* Compares a gradient with differences; counts values at which every step crosses a cut-off. */
static void compare_chain(struct chain *c, double *value, double gradient, const char *what,
                          size_t i, int *crossed)
{
    const double kept = *value;
    double step = 1e-5, change = 0;
    unsigned long here, above, below;
    evaluate(c, false, &here);
    for (int attempt = 0; attempt < 4; attempt++, step /= 8) {
        *value = kept + step;
        change = evaluate(c, false, &above);
        *value = kept - step;
        change = (change - evaluate(c, false, &below)) / (2 * step);
        *value = kept;
        if (above == here && below == here)
            break;
    }
    if (above != here || below != here)
        ++*crossed;
    else if (!(fabs(gradient - change) < 1e-4 + 1e-4 * fabs(change)))
        fail_msg("%s %zu: gradient %g, expected %g", what, i, gradient, change);
}

/* An anchor's six scales, offsets and feature, and weights, through the image. */
static void check_chain(unsigned parts)
{
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_anchors(ctx, ANCHORS, 40);
    m->columns->networks->parts = parts;
    struct chain *c = make_chain(m);
    struct ref_weights *sum = calloc(1, sizeof(*sum));
    struct ref_anchor g[ANCHORS];
    unsigned long events;
    double appearance[SG_APPEARANCE];
    int crossed = 0;
    assert_non_null(sum);
    evaluate(c, true, &events);
    assert_in_range(c->count, 8, DRAWN - 4);
    pull(c, g, sum, appearance);
    for (size_t k = 0; k < SG_APPEARANCE && parts; k++)
        compare_chain(c, &c->appearance[k], appearance[k], "appearance", k, &crossed);
    for (size_t i = 0; i < ANCHORS; i++) {
        for (size_t k = 0; k < 3; k++)
            compare_chain(c, &c->a[i].reach[k], g[i].reach[k], "reach", k, &crossed);
        for (size_t p = 0; p < SG_A_PLANES; p++)
            compare_chain(c, &c->a[i].anchor[p], g[i].anchor[p], "anchor", p, &crossed);
    }
    for (size_t i = 0; i < SG_WEIGHTS; i += i < SG_WEIGHTS_PLAIN ? 31 : 5)
        compare_chain(c, (double *) &c->w + i, ((double *) sum)[i], "weight", i, &crossed);
    assert_in_range(crossed, 0, 5);
    free(sum);
    free(c);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_chain(void **state)
{
    (void) state;
    check_chain(0);
    check_chain(ALL_PARTS);
}

/* Values of the engine against the oracle's, as a part of the largest. */
static void compare_values(const char *name, const char *what, const float *found,
                           const double *expected, size_t n)
{
    double most = 0;
    for (size_t i = 0; i < n; i++)
        most = fmax(most, fabs(expected[i]));
    assert_true(most > 0);
    for (size_t i = 0; i < n; i++)
        if (!(fabs((double) found[i] - expected[i]) < 2e-3 * most))
            fail_msg("%s: %s %zu: gradient %g, expected %g", name, what, i, (double) found[i],
                     expected[i]);
}

static void check_engines(unsigned parts, float volume)
{
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    for (int k = 0; k < n; k++) {
        sg_ctx *ctx = make_context(2);
        struct sg_model *m = make_anchors(ctx, ANCHORS, 40),
                        *found = make_anchors(ctx, ANCHORS, 41);
        m->columns->networks->parts = parts;
        struct chain *c = make_chain(m);
        struct ref_weights *sum = calloc(1, sizeof(*sum));
        struct ref_anchor g[ANCHORS];
        struct sg_engine *e = make_scaffold(ctx, cases[k], m);
        struct sg_render_params params = sg_render_params_default();
        double appearance[SG_APPEARANCE];
        params.appearance = 1;
        c->volume = (double) volume;
        sg_engine_set_volume(e, volume);
        static float weights[3 * W * H];
        unsigned long events;
        assert_non_null(sum);
        for (size_t i = 0; i < 3 * W * H; i++)
            weights[i] = (float) c->weight[i];
        evaluate(c, true, &events);
        pull(c, g, sum, appearance);
        assert_int_equal(sg_engine_draw(e, &c->camera, 0, &params, false), SG_OK);
        assert_int_equal(sg_engine_write_image_gradient(e, weights), SG_OK);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        assert_int_equal(sg_engine_project_backward(e, true), SG_OK);
        assert_int_equal(sg_engine_read_gradients(e, found), SG_OK);
        for (size_t i = 0; i < ANCHORS; i++) {
            float reach[3], anchor[SG_A_PLANES];
            for (int axis = 0; axis < 3; axis++)
                reach[axis] = *sg_model_at(found, i, SG_P_SCALE + axis);
            for (int p = 0; p < SG_A_PLANES; p++)
                anchor[p] = found->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, p)];
            compare_values(case_name(cases[k]), "reach", reach, g[i].reach, 3);
            compare_values(case_name(cases[k]), "anchor", anchor, g[i].anchor, SG_A_PLANES);
        }
        compare_values(case_name(cases[k]), "weight",
                       (const float *) &found->columns->networks->value, (const double *) sum,
                       SG_WEIGHTS);
        const struct sg_appearance *rows = found->columns->networks->appearance;
        for (int i = 0; i < SG_APPEARANCE; i++)
            assert_true(rows[0].value[i] == 0 && rows[2].value[i] == 0);
        if (parts)
            compare_values(case_name(cases[k]), "appearance", rows[1].value, appearance,
                           SG_APPEARANCE);
        sg_engine_destroy(&e);
        free(sum);
        free(c);
        sg_model_destroy(&m);
        sg_model_destroy(&found);
        sg_ctx_destroy(&ctx);
    }
}

static void test_engines(void **state)
{
    (void) state;
    check_engines(0, SG_ANCHOR_VOLUME);
    check_engines(ALL_PARTS, SG_ANCHOR_VOLUME);
    check_engines(0, 1e4f); /* more than the image counts */
}

#define MANY 2200

/* Gradients, a step of Adam and the statistics of growth of several blocks of anchors. */
struct results {
    struct sg_model *gradient, *learned;
    float *statistics;
};

static struct results learn(sg_ctx *ctx, struct engine_case c, const struct sg_model *m)
{
    static float weights[3 * W * H];
    struct sg_engine *e = make_scaffold(ctx, c, m);
    const struct sg_camera camera = make_camera(W, H, 2.2);
    struct sg_render_params params = sg_render_params_default();
    struct sg_update update = {.adam = true};
    struct sg_network_update networks = {.rate = {1e-3f, 2e-3f, 3e-3f, 4e-3f, 5e-3f}, .root = 1};
    struct results out;
    params.appearance = 1;
    for (int g = 0; g < SG_GROUPS; g++)
        update.rate[g] = 1e-3f * (float) (g + 1), update.root[g] = 1;
    for (size_t i = 0; i < 3 * PIXELS; i++)
        weights[i] = draw(46, i, -1, 1);
    out.gradient = make_anchors(ctx, m->count, 41);
    out.learned = make_anchors(ctx, m->count, 41);
    out.statistics =
        sg_alloc(ctx, SG_MEM_MISC, sg_blocks(m->count), SG_A_STATISTICS * SG_LANES * sizeof(float));
    assert_non_null(out.statistics);
    for (int step = 0; step < 2; step++) {
        assert_int_equal(sg_engine_draw(e, &camera, 0, &params, false), SG_OK);
        assert_int_equal(sg_engine_write_image_gradient(e, weights), SG_OK);
        assert_int_equal(sg_engine_raster_backward(e), SG_OK);
        assert_int_equal(sg_engine_project_backward(e, true), SG_OK);
        if (step == 0)
            assert_int_equal(sg_engine_read_gradients(e, out.gradient), SG_OK);
        assert_int_equal(sg_engine_optimise(e, &update), SG_OK);
        assert_int_equal(sg_engine_learn_networks(e, &networks), SG_OK);
        assert_int_equal(sg_engine_learn_networks(e, &networks), SG_ERR_INTERNAL);
        sg_clear_error(ctx);
        if (step == 0)
            assert_int_equal(sg_engine_download(e, out.learned, out.learned->columns), SG_OK);
    }
    struct sg_columns statistics = {0};
    statistics.at[SG_C_ANCHOR_STATISTICS] = out.statistics;
    assert_int_equal(sg_engine_download(e, NULL, &statistics), SG_OK);
    sg_engine_destroy(&e);
    return out;
}

/* The largest difference as a share of the largest value. */
static void compare_arrays(const char *name, const char *what, const float *found,
                           const float *expected, size_t n, double bound)
{
    const double most = largest_of(expected, n);
    assert_true(most > 0);
    assert_within(name, what, difference_of(found, expected, n, NULL, 1) / most, bound);
}

static void compare_gradients(const char *name, const struct results *r,
                              const struct results *expected, unsigned parts)
{
    const size_t anchors = expected->gradient->capacity;
    const struct sg_columns *found = r->gradient->columns, *right = expected->gradient->columns;
    compare_arrays(name, "anchors: gradient of reach", r->gradient->params,
                   expected->gradient->params, anchors * SG_DRAWN_PLANES, 1e-4);
    compare_arrays(name, "anchors: gradient of features and offsets", found->at[SG_C_ANCHOR],
                   right->at[SG_C_ANCHOR], anchors * SG_A_PLANES, 1e-4);
    compare_arrays(name, "anchors: gradient of weights", (const float *) &found->networks->value,
                   (const float *) &right->networks->value, SG_WEIGHTS, 1e-4);
    if (parts & SG_PART_APPEARANCE)
        compare_arrays(name, "anchors: gradient of appearances",
                       found->networks->appearance[1].value, right->networks->appearance[1].value,
                       SG_APPEARANCE, 1e-4);
}

static void compare_results(const char *name, const struct results *r,
                            const struct results *expected, unsigned parts)
{
    const size_t anchors = expected->gradient->capacity;
    compare_gradients(name, r, expected, parts);
    compare_arrays(name, "anchors: statistics", r->statistics, expected->statistics,
                   anchors * SG_A_STATISTICS, 1e-4);
    /* Adam makes a whole step of the least gradient: only its moments can be compared. */
    compare_arrays(name, "anchors: moments of weights",
                   (const float *) &r->learned->columns->networks->moment1,
                   (const float *) &expected->learned->columns->networks->moment1, SG_WEIGHTS,
                   1e-4);
}

static void clear_results(struct results *r)
{
    sg_model_destroy(&r->gradient);
    sg_model_destroy(&r->learned);
    sg_free(r->statistics);
}

/* Every engine against the oracle. */
static void test_many(void **state)
{
    (void) state;
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_anchors(ctx, MANY, 50);
    const struct sg_camera camera = make_camera(W, H, 2.2);
    const struct pinhole view = view_make(&camera);
    for (size_t i = 0; i < MANY; i++) /* small; most of them behind the camera, some beside it */
        for (int k = 0; k < 3; k++) {
            float *position = sg_model_at(m, i, SG_P_XYZ + k);
            *position = i % 8   ? (float) (2 * view.centre[k]) - *position
                        : i % 5 ? *position
                                : 20 * *position;
            m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, SG_A_SIZE + k)] -= 1.5f;
        }
    for (size_t i = 0; i < MANY; i += 3) /* of some anchors a Gaussian is hidden */
        for (int k = 0; k < 3; k++) {
            const int plane = SG_A_OFFSET + 3 * (int) (i % SG_ANCHOR_GAUSSIANS) + k;
            m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, plane)] = SG_OFFSET_HIDDEN;
        }
    for (int some = 0; some < 4; some++) { /* none, each way of a part alone, all */
        const unsigned parts = some == 3 ? ALL_PARTS : (unsigned) some;
        struct results expected = {0};
        m->columns->networks->parts = parts;
        for (int k = n - 1; k >= 0; k--) { /* the oracle first */
            struct results r = learn(ctx, cases[k], m);
            if (k == n - 1)
                expected = r;
            else {
                compare_results(case_name(cases[k]), &r, &expected, parts);
                clear_results(&r);
            }
        }
        clear_results(&expected);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* More anchors are seen than 128 workgroups of the Vulkan engine take at once, 16 each: gradients
 * are sums over all of them. Most have one Gaussian that is not hidden, the others nine. */
static void test_many_seen(void **state)
{
    (void) state;
    enum { COUNT = 2200, AT_ONCE = 128 * 16 };
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_anchors(ctx, COUNT, 51);
    struct results expected = {0};
    for (size_t i = 0; i < COUNT; i++)
        for (size_t g = 0; g < SG_ANCHOR_GAUSSIANS; g++)
            for (int k = 0; k < 3 && (g == i / 8 % SG_ANCHOR_GAUSSIANS) == (i % 8 == 0); k++) {
                const int plane = SG_A_OFFSET + 3 * (int) g + k;
                m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, plane)] =
                    SG_OFFSET_HIDDEN;
            }
    for (size_t i = 0; i < COUNT; i++) /* small */
        for (int k = 0; k < 3; k++)
            m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, SG_A_SIZE + k)] -= 1.5f;
    m->columns->networks->parts = ALL_PARTS;
    for (int k = n - 1; k >= 0; k--) { /* the oracle first */
        struct results r = learn(ctx, cases[k], m);
        if (k < n - 1) {
            compare_gradients(case_name(cases[k]), &r, &expected, ALL_PARTS);
            clear_results(&r);
            continue;
        }
        size_t seen = 0;
        for (size_t i = 0; i < COUNT; i++)
            seen += r.statistics[sg_param_index(SG_A_STATISTICS, i, SG_A_SEEN)] > 0;
        assert_in_range(seen, AT_ONCE + 16, COUNT);
        expected = r;
    }
    clear_results(&expected);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void draw_anchors(struct sg_engine *e, int appearance, float rgb[3 * PIXELS])
{
    const struct sg_camera camera = make_camera(W, H, 2.2);
    struct sg_render_params params = sg_render_params_default();
    params.appearance = appearance;
    assert_int_equal(sg_engine_draw(e, &camera, 0, &params, false), SG_OK);
    assert_int_equal(sg_engine_read_image(e, rgb, NULL, NULL), SG_OK);
}

/* The mean of all appearances, also in place of that of a photo that there is not, and zeros: as
 * those of a photo. */
static void test_appearances(void **state)
{
    (void) state;
    skip_without_races();
    enum { OWN, MEAN, OTHER, ZERO, KINDS };
    static const int asked[KINDS] = {0, SG_APPEARANCE_MEAN, PHOTOS, SG_APPEARANCE_ZERO};
    static float found[KINDS][3 * PIXELS], right[3 * PIXELS];
    struct engine_case cases[ENGINE_CASES];
    const int n = engine_cases(cases);
    for (int k = 0; k < n; k++) {
        sg_ctx *ctx = make_context(1);
        struct sg_model *m = make_anchors(ctx, 20, 62);
        struct sg_networks *networks = m->columns->networks;
        networks->parts = SG_PART_APPEARANCE;
        struct sg_engine *e = make_scaffold(ctx, cases[k], m);
        for (int kind = 0; kind < KINDS; kind++)
            draw_anchors(e, asked[kind], found[kind]);
        sg_engine_destroy(&e);
        assert_memory_equal(found[OTHER], found[MEAN], sizeof(found[MEAN]));
        for (int kind = MEAN; kind < KINDS; kind += ZERO - MEAN) {
            for (int i = 0; i < SG_APPEARANCE; i++) {
                const struct sg_appearance *a = networks->appearance;
                networks->appearance[0].value[i] =
                    kind == MEAN ? (a[0].value[i] + a[1].value[i] + a[2].value[i]) / PHOTOS : 0;
            }
            e = make_scaffold(ctx, cases[k], m);
            draw_anchors(e, 0, right);
            sg_engine_destroy(&e);
            assert_true(difference_of(found[kind], right, 3 * PIXELS, NULL, 1) < 1e-5);
            assert_true(difference_of(found[kind], found[kind - 1], 3 * PIXELS, NULL, 1) > 1e-2);
        }
        sg_model_destroy(&m);
        sg_ctx_destroy(&ctx);
    }
}

/* Networks do not learn from a view of another model. */
static void test_learn_from_another(void **state)
{
    (void) state;
    static const float gradient[3 * PIXELS];
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_anchors(ctx, 20, 62);
    struct sg_engine *e = make_scaffold(ctx, (struct engine_case){main_engine(), NULL}, m);
    const struct sg_camera camera = make_camera(W, H, 2.2);
    const struct sg_render_params params = sg_render_params_default();
    const struct sg_network_update networks = {.root = 1};
    assert_int_equal(sg_engine_draw(e, &camera, 0, &params, false), SG_OK);
    assert_int_equal(sg_engine_write_image_gradient(e, gradient), SG_OK);
    assert_int_equal(sg_engine_raster_backward(e), SG_OK);
    assert_int_equal(sg_engine_optimise(e, &(struct sg_update){.adam = true}), SG_OK);
    assert_int_equal(sg_engine_upload(e, m, m->columns), SG_OK);
    assert_int_equal(sg_engine_learn_networks(e, &networks), SG_ERR_INTERNAL);
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* A model that an edit has changed without the memory for all of it is still one. */
static void test_edit_without_memory(void **state)
{
    (void) state;
    enum { COUNT = 40, KEPT = 35 };
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_anchors(ctx, COUNT, 60);
    struct sg_columns columns;
    uint8_t keep[COUNT];
    bool failed = true, edited = false;
    assert_int_equal(
        sg_columns_create(ctx, COUNT, 0, SG_COLUMN_SAVED | SG_COLUMN_ANCHORS, &columns), SG_OK);
    memcpy(columns.at[SG_C_ANCHOR], m->columns->at[SG_C_ANCHOR],
           m->capacity * SG_A_PLANES * sizeof(float));
    columns.networks = m->columns->networks;
    for (size_t i = 0; i < COUNT; i++)
        keep[i] = i >= COUNT - KEPT;
    for (uint64_t nth = 1; failed; nth++) {
        struct sg_engine *e = make_scaffold(ctx, (struct engine_case){main_engine(), NULL}, m);
        struct sg_model *found = make_anchors(ctx, COUNT, 61);
        assert_int_equal(sg_engine_upload(e, m, &columns), SG_OK);
        sg_fail_allocation(ctx, nth);
        const int code = sg_engine_edit(e, &(struct sg_edit){.keep = keep, .kept = KEPT});
        failed = sg_fail_allocation(ctx, 0);
        assert_int_equal(code, failed ? SG_ERR_BUDGET : SG_OK);
        sg_clear_error(ctx);
        const size_t count = sg_engine_count(e), first = COUNT - count;
        assert_true(count == COUNT || count == KEPT);
        edited |= failed && count == KEPT;
        assert_int_equal(sg_engine_download(e, found, found->columns), SG_OK);
        for (size_t i = 0; i < count; i++) {
            assert_true(*sg_model_at(found, i, SG_P_XYZ) == *sg_model_at(m, first + i, SG_P_XYZ));
            for (int p = 0; p < SG_A_PLANES; p++)
                assert_true(found->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, p)] ==
                            m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, first + i, p)]);
        }
        sg_model_destroy(&found);
        sg_engine_destroy(&e);
    }
    assert_true(edited);
    columns.networks = NULL; /* the model's */
    sg_columns_clear(&columns);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_oracle),
        cmocka_unit_test(test_bank),
        cmocka_unit_test(test_chain),
        cmocka_unit_test(test_engines),
        cmocka_unit_test(test_many),
        cmocka_unit_test(test_many_seen),
        cmocka_unit_test(test_appearances),
        cmocka_unit_test(test_learn_from_another),
        cmocka_unit_test(test_edit_without_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
