/* SPDX-License-Identifier: Apache-2.0 */
/* Every gradient of the oracle against central differences, in double precision. */
#include "math/real_f64.h"

#include "backend/ref/render.h"
#include "math/photometric.h"
#include "support.h"

#define W 37
#define H 29
#define N 4
#define PIXELS (W * H)

static const float background[3] = {0.2f, 0.5f, 0.7f};

struct scene {
    struct sg_camera camera;
    int degree;
    double params[N][SG_PARAMS_MAX];
    double weight[3 * PIXELS]; /* the loss is the weighted sum of the image */
    struct ref_splat splats[N];
    double rgb[3 * PIXELS], t[PIXELS], depth[PIXELS];
    int last[PIXELS];
};

static void each_tile(struct scene *s, struct ref_image *image, bool backward)
{
    struct ref_entry list[N];
    for (int ty = 0; ty < (H + 15) / 16; ty++)
        for (int tx = 0; tx < (W + 15) / 16; tx++) {
            const size_t n = ref_tile_list(s->splats, N, tx, ty, list);
            for (int y = ty * 16; y < ty * 16 + 16 && y < H; y++)
                for (int x = tx * 16; x < tx * 16 + 16 && x < W; x++)
                    if (backward)
                        ref_pixel_backward(s->splats, list, x, y, background, image, s->weight);
                    else
                        ref_pixel_forward(s->splats, list, n, x, y, background, image);
        }
}

static double evaluate(struct scene *s, bool backward)
{
    const struct view v = view_make(&s->camera);
    struct ref_image image = {W, H, s->rgb, s->t, s->depth, s->last};
    for (int i = 0; i < N; i++)
        ref_project(&v, s->params[i], s->degree, (W + 15) / 16, (H + 15) / 16, &s->splats[i]);
    each_tile(s, &image, false);
    if (backward)
        each_tile(s, &image, true);
    double sum = 0;
    for (int i = 0; i < 3 * PIXELS; i++)
        sum += s->weight[i] * s->rgb[i];
    return sum;
}

/* Big soft Gaussians: no pixel sits at a cut-off of alpha, so that the loss is smooth. */
static void fill(struct scene *s, int degree, uint64_t seed)
{
    uint64_t k = 0;
    *s = (struct scene){.camera = make_camera(W, H, 4), .degree = degree};
    for (int i = 0; i < N; i++)
        for (int p = 0; p < SG_PARAMS_MAX; p++)
            s->params[i][p] = (double) (p < 3    ? draw(seed, k++, -0.5f, 0.5f)
                                        : p == 3 ? draw(seed, k++, -0.5f, 0.5f)
                                        : p < 7  ? draw(seed, k++, 0.6f, 1.4f)
                                        : p < 11 ? draw(seed, k++, -1, 1)
                                        : p < 14 ? draw(seed, k++, 0.2f, 1.0f)
                                                 : draw(seed, k++, -0.2f, 0.2f));
    for (int i = 0; i < 3 * PIXELS; i++)
        s->weight[i] = (double) draw(seed, k++, -1, 1);
}

static void compare_all(struct scene *s)
{
    const struct view v = view_make(&s->camera);
    evaluate(s, true);
    for (int i = 0; i < N; i++) {
        double analytic[SG_PARAMS_MAX];
        ref_parameter_gradient(&v, &s->splats[i], s->params[i], s->degree, analytic);
        for (int p = 0; p < SG_PARAMS_MAX; p++) {
            struct scene *copy = malloc(sizeof(*copy));
            const double step = 1e-5;
            double value[2];
            for (int side = 0; side < 2; side++) {
                *copy = *s;
                copy->params[i][p] += side ? step : -step;
                value[side] = evaluate(copy, false);
            }
            free(copy);
            const double numeric = (value[1] - value[0]) / (2 * step);
            if (fabs(numeric - analytic[p]) > 1e-3 * fabs(numeric) + 2e-4)
                fail_msg("degree %d, Gaussian %d, plane %d: numeric %.9g, analytic %.9g", s->degree, i, p, numeric,
                         analytic[p]);
        }
    }
}

static void test_parameters(void **state)
{
    (void) state;
    struct scene *s = malloc(sizeof(*s));
    for (int degree = 0; degree <= 3; degree++)
        for (uint64_t seed = 1; seed <= 3; seed++) {
            fill(s, degree, seed);
            compare_all(s);
        }
    free(s);
}

/* Opacity 1 at the centre: alpha stays at 0.99, and the logit still has a gradient, as in the reference. */
static void test_saturation(void **state)
{
    (void) state;
    struct scene *s = malloc(sizeof(*s));
    fill(s, 0, 1);
    for (int i = 1; i < N; i++)
        s->params[i][SG_P_OPACITY] = -20; /* out of the way */
    s->params[0][SG_P_OPACITY] = 10;
    for (int p = 0; p < 3; p++)
        s->params[0][p] = 0;
    evaluate(s, true);
    const int cx = (int) (s->splats[0].s.x + 0.5), cy = (int) (s->splats[0].s.y + 0.5);
    assert_float_equal(s->t[cy * W + cx], 0.01, 1e-6);
    const struct view v = view_make(&s->camera);
    double g[SG_PARAMS_MAX];
    ref_parameter_gradient(&v, &s->splats[0], s->params[0], 0, g);
    assert_true(fabs(g[SG_P_OPACITY]) > 1e-6);
    free(s);
}

static void test_sh_direction(void **state)
{
    (void) state;
    double w[16], d[3];
    for (int k = 0; k < 16; k++)
        w[k] = 0.3 * k - 2;
    const double at[3] = {0.36, -0.48, 0.8};
    sh_direction_gradient(3, at[0], at[1], at[2], w, d);
    for (int axis = 0; axis < 3; axis++) {
        double sum[2] = {0};
        for (int side = 0; side < 2; side++) {
            double p[3] = {at[0], at[1], at[2]}, basis[16];
            p[axis] += side ? 1e-6 : -1e-6;
            sh_basis(3, p[0], p[1], p[2], basis);
            for (int k = 0; k < 16; k++)
                sum[side] += w[k] * basis[k];
        }
        assert_float_equal((sum[1] - sum[0]) / 2e-6, d[axis], 1e-7);
    }
}

static void test_ssim_point(void **state)
{
    (void) state;
    const double m[5] = {0.4, 0.55, 0.21, 0.36, 0.25};
    double g[3], unused[3];
    assert_true(ssim_point(m[0], m[1], m[2], m[3], m[4], &g[0], &g[1], &g[2]) < 1);
    static const int plane[3] = {0, 2, 4};
    for (int k = 0; k < 3; k++) {
        double v[2];
        for (int side = 0; side < 2; side++) {
            double p[5];
            memcpy(p, m, sizeof(p));
            p[plane[k]] += side ? 1e-7 : -1e-7;
            v[side] = ssim_point(p[0], p[1], p[2], p[3], p[4], &unused[0], &unused[1], &unused[2]);
        }
        assert_float_equal((v[1] - v[0]) / 2e-7, g[k], 1e-5 * fabs(g[k]) + 1e-7);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_parameters),
        cmocka_unit_test(test_saturation),
        cmocka_unit_test(test_sh_direction),
        cmocka_unit_test(test_ssim_point),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
