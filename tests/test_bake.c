/* SPDX-License-Identifier: Apache-2.0 */
/* What a viewer sees of models of anchors: the appearance of a photo, and Gaussians baked from the
 * views that drew them. */
#include "anchor_models.h"
#include "engine/ref/render.h"
#include "splatguard/format.h"

#define ANCHORS 3
#define DRAWN (ANCHORS * SG_ANCHOR_GAUSSIANS)
#define W 37
#define H 29

/* Renders have the appearance of the photo that is asked for, of the view's number in a list, the
 * mean of all, or none. */
static void test_appearance(void **state)
{
    (void) state;
    enum { RENDERS = 7 };
    static float rgb[RENDERS][3 * W * H];
    static const struct {
        int appearance;
        size_t index;
    } asked[RENDERS] = {{1, SIZE_MAX},
                        {2, 0},
                        {SG_APPEARANCE_INDEX, 1},
                        {SG_APPEARANCE_INDEX, SIZE_MAX},
                        {SG_APPEARANCE_INDEX, PHOTOS},
                        {SG_APPEARANCE_MEAN, 1},
                        {PHOTOS, 1}};
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_anchors(ctx, ANCHORS, 40);
    struct sg_appearance *rows = m->columns->networks->appearance;
    const struct sg_camera camera = make_camera(W, H, 2.2);
    m->columns->networks->parts = SG_PART_APPEARANCE;
    for (int k = 0; k < SG_APPEARANCE; k++) /* the mean is photo 0's */
        rows[0].value[k] = 0.5f, rows[1].value[k] = k % 2, rows[2].value[k] = 1 - k % 2;
    for (int i = 0; i < RENDERS; i++) {
        struct sg_render_params params = sg_render_params_default();
        sg_renderer *r;
        params.appearance = asked[i].appearance;
        assert_int_equal(sg_renderer_create(ctx, NULL, NULL, m, &params, &r), SG_OK);
        sg_renderer_set_index(r, asked[i].index);
        assert_int_equal(sg_render(r, &camera, rgb[i], NULL, NULL, NULL), SG_OK);
        sg_renderer_destroy(&r);
    }
    assert_memory_equal(rgb[2], rgb[0], sizeof(rgb[0]));
    assert_true(memcmp(rgb[1], rgb[0], sizeof(rgb[0])) != 0);
    for (int i = 3; i < RENDERS; i++) {
        assert_memory_equal(rgb[i], rgb[3], sizeof(rgb[3]));
        assert_true(memcmp(rgb[i], rgb[0], sizeof(rgb[0])) != 0);
    }
    struct sg_render_params params = sg_render_params_default();
    sg_renderer *r;
    params.appearance = 0;
    assert_int_equal(sg_renderer_create(ctx, NULL, NULL, m, &params, &r), SG_OK);
    const size_t photos[] = {2, PHOTOS, SIZE_MAX}; /* they win over the parameters */
    for (int i = 0; i < 3; i++) {
        sg_renderer_set_photo(r, photos[i]);
        assert_int_equal(sg_render(r, &camera, rgb[4], NULL, NULL, NULL), SG_OK);
        if (i < 2)
            assert_memory_equal(rgb[4], rgb[i ? 3 : 1], sizeof(rgb[0]));
    }
    assert_int_equal(sg_render(r, &camera, rgb[0], NULL, NULL, NULL), SG_OK);
    assert_memory_equal(rgb[4], rgb[0], sizeof(rgb[0]));
    for (int i = 0; i < 3 * W * H; i++)
        assert_true(fabsf(rgb[0][i] - rgb[3][i]) < 1e-5f);
    sg_renderer_destroy(&r);
    memset(&rows[2], 0, sizeof(rows[2]));
    for (int i = 0; i < 3; i++) { /* zeros are those of photo 2, and not the mean */
        params.appearance = (const int[]){2, SG_APPEARANCE_ZERO, SG_APPEARANCE_MEAN}[i];
        assert_int_equal(sg_renderer_create(ctx, main_engine(), NULL, m, &params, &r), SG_OK);
        sg_renderer_set_index(r, 1);
        assert_int_equal(sg_render(r, &camera, rgb[i], NULL, NULL, NULL), SG_OK);
        sg_renderer_destroy(&r);
    }
    assert_memory_equal(rgb[1], rgb[0], sizeof(rgb[0]));
    assert_true(memcmp(rgb[2], rgb[0], sizeof(rgb[0])) != 0);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Networks that do not depend on what they read make the same Gaussians in each view: baked, they
 * look the same. */
static void test_bake(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_anchors(ctx, ANCHORS, 40), *baked, *again;
    struct sg_view views[3] = {{.camera = make_camera(W, H, 2.2)},
                               {.camera = make_camera(W, H, 2.6)},
                               {.camera = make_camera(W, H, 3)}};
    memset(m->columns->networks->value.input, 0, sizeof(m->columns->networks->value.input));
    float *bias = m->columns->networks->value.bias;
    for (size_t o = 0; o < SG_OUTPUTS; o++)
        bias[o] = draw(60, o, -1, 1);
    bias[SG_O_OPACITY + 4] = -1, bias[SG_O_OPACITY + 5] = 0.5f;
    assert_int_equal(sg_model_bake(ctx, m, views, 3, NULL, SG_APPEARANCE_MEAN, &baked), SG_OK);
    assert_true(baked->count % ANCHORS == 0 && baked->count < DRAWN);
    assert_int_equal(sg_model_bake(ctx, baked, views, 3, NULL, SG_APPEARANCE_MEAN, &again),
                     SG_ERR_USAGE);
    sg_clear_error(ctx);
    static float rgb[2][3 * W * H];
    const struct sg_model *const models[2] = {m, baked};
    for (int k = 0; k < 2; k++) {
        sg_renderer *r;
        assert_int_equal(sg_renderer_create(ctx, NULL, NULL, models[k], NULL, &r), SG_OK);
        assert_int_equal(sg_render(r, &views[1].camera, rgb[k], NULL, NULL, NULL), SG_OK);
        sg_renderer_destroy(&r);
    }
    float most = 0;
    for (int i = 0; i < 3 * W * H; i++) {
        most = fmaxf(most, rgb[0][i]);
        if (!(fabsf(rgb[0][i] - rgb[1][i]) < 2e-3f))
            fail_msg("value %d: %g, baked %g", i, (double) rgb[0][i], (double) rgb[1][i]);
    }
    assert_true(most > 0.2f);
    /* None that is no number */
    sg_model_destroy(&baked);
    const float turn = bias[SG_O_COVARIANCE + 3];
    bias[SG_O_COVARIANCE + 3] = NAN;
    assert_int_equal(sg_model_bake(ctx, m, views, 3, NULL, SG_APPEARANCE_MEAN, &baked),
                     SG_ERR_INPUT);
    assert_null(baked);
    bias[SG_O_COVARIANCE + 3] = turn;
    /* None that no view draws */
    for (int o = 0; o < SG_ANCHOR_GAUSSIANS; o++)
        bias[SG_O_OPACITY + o] = -1;
    memset(m->columns->networks->value.output, 0, sizeof(m->columns->networks->value.output));
    sg_model_destroy(&baked);
    assert_int_equal(sg_model_bake(ctx, m, views, 3, NULL, SG_APPEARANCE_MEAN, &baked),
                     SG_ERR_INPUT);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Looks at the origin from an angle about the y axis. */
static struct sg_camera look_from(double angle)
{
    struct sg_camera c = make_camera(W, H, 2.2);
    const double R[9] = {cos(angle), 0, sin(angle), 0, 1, 0, -sin(angle), 0, cos(angle)};
    memcpy(c.R, R, sizeof(R));
    return c;
}

/* A Gaussian that views drew: their mean, weighted by opacity, apart from that itself. */
struct drawn_mean {
    double sums[SG_NEURAL_PLANES], opacity;
    int views, turned; /* turned: to the other sign of their rotation */
};

static void add_drawn(struct drawn_mean *m, const double *drawn)
{
    const double o = 1 / (1 + exp(-drawn[SG_P_OPACITY]));
    double dot = 0, length = 0;
    for (int k = 0; k < 4; k++) {
        dot += m->sums[SG_P_ROT + k] * drawn[SG_P_ROT + k];
        length += drawn[SG_P_ROT + k] * drawn[SG_P_ROT + k];
    }
    for (int p = 0; p < SG_NEURAL_PLANES; p++) { /* q and -q are the same rotation */
        const bool rotation = p >= SG_P_ROT && p < SG_P_ROT + 4;
        m->sums[p] += rotation ? (dot < 0 ? -o : o) * drawn[p] / sqrt(length) : o * drawn[p];
    }
    m->opacity += o;
    m->turned += dot < 0;
    m->views++;
}

/* What depends on the view is replaced by its mean over the views that drew it, and that can be
 * seen. Views have the appearances of their photos, or of those of their index. */
static void check_bake(unsigned parts, bool by_photo)
{
    static struct drawn_mean means[DRAWN];
    static float rgb[2][3 * W * H];
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_anchors(ctx, ANCHORS, 40), *baked;
    struct sg_view views[PHOTOS];
    size_t photos[PHOTOS];
    m->columns->networks->parts = parts;
    for (int axis = 0; axis < 3; axis++) /* the direction of view counts a lot */
        for (int h = 0; h < SG_HIDDEN; h++)
            m->columns->networks->value.input[SG_ANCHOR_FEATURES + axis][h] *= 8;
    static struct ref_weights weights;
    struct ref_anchor anchors[ANCHORS];
    oracle_anchors(m, anchors, &weights);
    memset(means, 0, sizeof(means));
    for (int v = 0; v < PHOTOS; v++) {
        views[v] = (struct sg_view){.camera = look_from(2.1 * v)};
        photos[v] = (size_t) (by_photo ? PHOTOS - 1 - v : v);
        const struct pinhole camera = view_make(&views[v].camera);
        struct ref_view of = {{camera.centre[0], camera.centre[1], camera.centre[2]}, parts, {0}};
        for (int k = 0; k < SG_APPEARANCE; k++)
            of.appearance[k] = (double) m->columns->networks->appearance[photos[v]].value[k];
        for (size_t i = 0; i < ANCHORS; i++) {
            double drawn[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
            bool exists[SG_ANCHOR_GAUSSIANS];
            ref_neural_forward(&weights, &anchors[i], &of, drawn, exists);
            for (size_t k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
                if (exists[k])
                    add_drawn(&means[i * SG_ANCHOR_GAUSSIANS + k], drawn[k]);
        }
    }
    assert_int_equal(
        sg_model_bake(ctx, m, views, PHOTOS, by_photo ? photos : NULL, SG_APPEARANCE_INDEX, &baked),
        SG_OK);
    size_t at = 0, some = 0, turned = 0;
    for (size_t i = 0; i < DRAWN; i++) {
        const struct drawn_mean *mean = &means[i];
        const double o = mean->views ? mean->opacity / mean->views : 0;
        some += mean->views > 0 && mean->views < PHOTOS;
        turned += mean->turned > 0;
        if (o < 1 / 255.0)
            continue;
        assert_true(at < baked->count);
        for (int p = 0; p < SG_NEURAL_PLANES; p++) {
            const double expected =
                p == SG_P_OPACITY ? log(o / (1 - o)) : mean->sums[p] / mean->opacity;
            const double found = (double) *sg_model_at(baked, at, p);
            if (!(fabs(found - expected) < 1e-4 * fmax(fabs(expected), 1)))
                fail_msg("Gaussian %zu, plane %d: found %g, expected %g", i, p, found, expected);
        }
        at++;
    }
    assert_int_equal(at, baked->count);
    assert_true(some > 2 && turned > 0); /* not all views drew all of them */
    const struct sg_model *const models[2] = {m, baked};
    for (int k = 0; k < 2; k++) {
        struct sg_render_params params = sg_render_params_default();
        sg_renderer *r;
        params.appearance = 1;
        assert_int_equal(sg_renderer_create(ctx, NULL, NULL, models[k], &params, &r), SG_OK);
        assert_int_equal(sg_render(r, &views[1].camera, rgb[k], NULL, NULL, NULL), SG_OK);
        sg_renderer_destroy(&r);
    }
    double lost = 0;
    for (int i = 0; i < 3 * W * H; i++)
        lost += fabs((double) rgb[0][i] - (double) rgb[1][i]) / (3 * W * H);
    if (!(lost > 0.005))
        fail_msg("the mean of the views looks like view 1 but for %g", lost);
    sg_model_destroy(&baked);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_bake_views(void **state)
{
    (void) state;
    check_bake(0, false);
    check_bake(ALL_PARTS, false);
    check_bake(ALL_PARTS, true);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_appearance),
        cmocka_unit_test(test_bake),
        cmocka_unit_test(test_bake_views),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
