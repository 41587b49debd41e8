/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle's gradients against central differences of the oracle itself, in double precision. */
#include "math/real_f64.h"

#include "engine/ref/render.h"
#include "math/photometric.h"
#include "models.h"

#define WIDTH 37
#define HEIGHT 29
#define PIXELS (WIDTH * HEIGHT)
#define MOST 6

#define assert_near(a, b, tolerance)                                                               \
    do {                                                                                           \
        const double a_ = (a), b_ = (b), t_ = (tolerance);                                         \
        if (!(fabs(a_ - b_) <= t_))                                                                \
            fail_msg("%s: found %.9g, expected %.9g within %.3g", #a, a_, b_, t_);                 \
    } while (0)

/* A stream of random numbers. */
struct dice {
    uint64_t seed, at;
};

static double dice(struct dice *d, double low, double high)
{
    return (double) draw(d->seed, d->at++, (float) low, (float) high);
}

static const float background[3] = {0.7f, 0.2f, 0.4f};

struct setup {
    struct sg_camera camera;
    int degree;
    size_t count;
    double params[MOST][SG_PARAMS_MAX];
    bool mip;
    double weight[3 * PIXELS]; /* the loss is sum of weight x image */
};

static struct ref_splat splats[MOST];
static double rgb[3 * PIXELS], transmittance[PIXELS], depth[PIXELS];
static int last[PIXELS];
static struct ref_image image = {WIDTH, HEIGHT, rgb, transmittance, depth, last};

#define GRID(n) (((n) + SG_TILE - 1) / SG_TILE)

static struct pinhole view_of(const struct setup *s)
{
    return view_make_mip(&s->camera, s->mip ? 0.1f : 0);
}

/* Loss; with backward, the splats hold their gradients afterwards. Counts the blended pairs in
 * *blended: where a parameter step changes it, a cut-off was crossed and the loss jumps. */
static double evaluate(const struct setup *s, bool backward, long *blended)
{
    const struct pinhole view = view_of(s);
    struct ref_entry list[MOST];
    double loss = 0;
    long pairs = 0;
    for (size_t i = 0; i < s->count; i++)
        ref_project(&view, s->params[i], s->degree, GRID(WIDTH), GRID(HEIGHT), &splats[i]);
    for (int ty = 0; ty < GRID(HEIGHT); ty++)
        for (int tx = 0; tx < GRID(WIDTH); tx++) {
            const size_t m = ref_tile_list(splats, s->count, tx, ty, list);
            for (int y = ty * SG_TILE; y < (ty + 1) * SG_TILE && y < HEIGHT; y++)
                for (int x = tx * SG_TILE; x < (tx + 1) * SG_TILE && x < WIDTH; x++) {
                    ref_pixel_forward(splats, list, m, x, y, background, &image);
                    pairs += 1000 * last[y * WIDTH + x];
                    for (size_t k = 0; k < m; k++) {
                        double dx, dy, gauss, alpha;
                        pairs += ref_pair(&splats[list[k].id], x, y, &dx, &dy, &gauss, &alpha);
                    }
                    if (backward)
                        ref_pixel_backward(splats, list, x, y, background, &image, s->weight);
                }
        }
    for (int i = 0; i < 3 * PIXELS; i++)
        loss += s->weight[i] * rgb[i];
    for (size_t i = 0; i < s->count; i++)
        for (int ch = 0; ch < 3; ch++)
            pairs += 7919L * splats[i].clamped[ch];
    if (blended)
        *blended = pairs;
    return loss;
}

static void make_setup(struct setup *s, size_t count, int degree, uint64_t seed)
{
    struct dice d = {seed, 0};
    *s = (struct setup){.camera = make_camera(WIDTH, HEIGHT, 4), .degree = degree, .count = count};
    for (size_t i = 0; i < count; i++) {
        double *p = s->params[i];
        for (int k = 0; k < 3; k++) {
            p[SG_P_XYZ + k] = dice(&d, -0.8, 0.8);
            p[SG_P_SCALE + k] = dice(&d, -2.5, -0.9);
        }
        for (int k = 0; k < 4; k++)
            p[SG_P_ROT + k] = dice(&d, -1.5, 1.5);
        p[SG_P_OPACITY] = dice(&d, -1, 1.5);
        for (int k = SG_P_SH; k < SG_PARAMS_MAX; k++)
            p[k] = dice(&d, -0.4, 0.4);
    }
    for (int i = 0; i < 3 * PIXELS; i++)
        s->weight[i] = dice(&d, -1, 1);
}

static const char *group_name(int p)
{
    return p < SG_P_OPACITY ? "xyz"
           : p < SG_P_SCALE ? "logit"
           : p < SG_P_ROT   ? "scale"
           : p < SG_P_SH    ? "rot"
                            : "sh";
}

/* Every parameter of every Gaussian. A step that crosses a cut-off is halved, up to 12 times; few
 * may stay crossed. */
static void check_all(struct setup *s)
{
    const struct pinhole view = view_of(s);
    double gradient[MOST][SG_PARAMS_MAX], largest[SG_PARAMS_MAX] = {0};
    long here;
    evaluate(s, true, &here);
    for (size_t i = 0; i < s->count; i++) {
        ref_parameter_gradient(&view, &splats[i], s->params[i], s->degree, gradient[i]);
        for (int p = 0; p < SG_PARAMS_MAX; p++)
            largest[p] = fmax(largest[p], fabs(gradient[i][p]));
    }
    int crossed = 0, checked = 0, nonzero = 0;
    for (size_t i = 0; i < s->count; i++)
        for (int p = 0; p < SG_PARAMS_MAX; p++) {
            const double at = s->params[i][p];
            double up = 0, down = 0, step = 1e-4;
            long above = here + 1, below = here;
            for (int attempt = 0; attempt < 12 && (above != here || below != here); attempt++) {
                step *= 0.5;
                s->params[i][p] = at + step;
                up = evaluate(s, false, &above);
                s->params[i][p] = at - step;
                down = evaluate(s, false, &below);
            }
            s->params[i][p] = at;
            if (above != here || below != here) {
                crossed++;
                continue;
            }
            const double found = gradient[i][p], expected = (up - down) / (2 * step);
            /* The published backward pass adds 1e-7 to the squared determinant: hence not
             * tighter. */
            if (fabs(found - expected) > 1e-3 * fabs(expected) + 1e-5 * largest[p] + 1e-7)
                fail_msg(
                    "degree %d, Gaussian %zu, plane %d (%s): gradient %.9g, by differences %.9g",
                    s->degree, i, p, group_name(p), found, expected);
            checked++;
            nonzero += fabs(expected) > 1e-6;
        }
    assert_true(crossed * 20 < checked);
    assert_true(nonzero > (int) s->count * (SG_P_SH + 3) / 2);
}

static void gradients_of_every_parameter(void **state)
{
    (void) state;
    static struct setup s;
    for (int degree = 0; degree <= 3; degree++) {
        make_setup(&s, 4, degree, 100 + (uint64_t) degree);
        check_all(&s);
    }
}

/* Through the compensation of the 2D filter, for Gaussians of a few pixels and of less than one. */
static void gradients_with_the_mip_filter(void **state)
{
    (void) state;
    static struct setup s;
    for (int degree = 0; degree <= 1; degree++) {
        make_setup(&s, 4, degree, 110 + (uint64_t) degree);
        s.mip = true;
        for (size_t i = 0; i < s.count; i++)
            for (int k = 0; k < 3; k++)
                s.params[i][SG_P_SCALE + k] -= 0.6 * (double) i;
        for (size_t i = 0; i < s.count; i++)
            s.params[i][SG_P_OPACITY] += 1;
        check_all(&s);
    }
}

/* Values that the released code gives. */
static void gains_of_the_mip_filter(void **state)
{
    (void) state;
    static const double cases[][4] = {{1, 0, 1, 0.909091083},
                                      {4, 1, 2, 0.959084559},
                                      {0.1, 0, 0.1, 0.49999475},
                                      {0.01, 0, 0.01, 0.0909108346},
                                      {0.001, 0, 0.001, 0}};
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const double a = cases[i][0], b = cases[i][1], c = cases[i][2];
        assert_near(mip_gain(a * c - b * b, (a + 0.1) * (c + 0.1) - b * b), cases[i][3], 1e-8);
    }
}

static void gradients_when_layers_hide_each_other(void **state)
{
    (void) state;
    static struct setup s;
    make_setup(&s, MOST, 3, 7);
    for (size_t i = 0; i < s.count; i++) /* nearly opaque, one behind the other */
        s.params[i][SG_P_OPACITY] = 2 + 0.3 * (double) i;
    check_all(&s);
}

static void gradients_of_needles_and_specks(void **state)
{
    (void) state;
    static struct setup s;
    make_setup(&s, 3, 1, 21);
    s.params[0][SG_P_SCALE] = -1, s.params[0][SG_P_SCALE + 1] = s.params[0][SG_P_SCALE + 2] = -6;
    s.params[1][SG_P_SCALE] = s.params[1][SG_P_SCALE + 1] = s.params[1][SG_P_SCALE + 2] =
        -7; /* only the blur */
    check_all(&s);
}

/* What the published gradient of the depth has beyond the exact one: the part of a clamped tangent
 * a second time. Were it not clamped, x would have that part times -z / x, and y times -z / y. */
static double clamped_part(const struct pinhole *v, const struct ref_splat *s)
{
    struct projection open_ = s->p;
    double at[2][3], scale[3], rotation[4];
    open_.in_x = open_.in_y = true;
    project_backward(v, &s->p, &s->s, &s->g, at[0], scale, rotation);
    project_backward(v, &open_, &s->s, &s->g, at[1], scale, rotation);
    return -((at[1][0] - at[0][0]) * s->p.tx + (at[1][1] - at[0][1]) * s->p.ty) / s->s.z;
}

/* Beyond 1.3 half fields of view the tangents are clamped. The world is the camera's here. */
static void gradients_outside_the_tangent_clamp(void **state)
{
    (void) state;
    static struct setup s;
    make_setup(&s, 2, 0, 3);
    memcpy(s.camera.R, (double[9]){1, 0, 0, 0, 1, 0, 0, 0, 1}, sizeof(s.camera.R));
    memset(s.camera.t, 0, sizeof(s.camera.t));
    s.camera.cx = WIDTH / 2.0, s.camera.cy = HEIGHT / 2.0;
    const double tangent = WIDTH / (2 * s.camera.fx);
    memcpy(s.params[0], (double[3]){1.5 * tangent * 2, 0.1, 2}, 3 * sizeof(double));
    memcpy(s.params[1], (double[3]){-0.1, 1.6 * HEIGHT / (2 * s.camera.fy) * 3, 3},
           3 * sizeof(double));
    for (size_t i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            s.params[i][SG_P_SCALE + k] = -0.9 - 0.2 * k;
    const struct pinhole view = view_make(&s.camera);
    long here, above, below;
    evaluate(&s, true, &here);
    assert_false(splats[0].p.in_x);
    assert_true(splats[0].p.in_y);
    assert_true(splats[1].p.in_x);
    assert_false(splats[1].p.in_y);
    double gradient[2][SG_PARAMS_MAX], twice[2];
    for (size_t i = 0; i < 2; i++) {
        ref_parameter_gradient(&view, &splats[i], s.params[i], 0, gradient[i]);
        twice[i] = clamped_part(&view, &splats[i]);
        assert_true(fabs(twice[i]) > 0.01 * fabs(gradient[i][SG_P_XYZ + 2]));
    }
    for (size_t i = 0; i < 2; i++)
        for (int p = 0; p < SG_P_SH; p++) {
            const double at = s.params[i][p], step = 1e-7;
            s.params[i][p] = at + step;
            const double up = evaluate(&s, false, &above);
            s.params[i][p] = at - step;
            const double down = evaluate(&s, false, &below);
            s.params[i][p] = at;
            assert_int_equal(above, here);
            assert_int_equal(below, here);
            const double expected = (up - down) / (2 * step) + (p == SG_P_XYZ + 2 ? twice[i] : 0);
            assert_near(gradient[i][p], expected, 1e-3 * fabs(expected) + 1e-5);
        }
}

/* One opaque Gaussian on a pixel: alpha stops at 0.99, its gradient does not. */
static void saturated_alpha_keeps_its_gradient(void **state)
{
    (void) state;
    static struct setup s;
    make_setup(&s, 1, 0, 1);
    memcpy(s.camera.R, (double[9]){1, 0, 0, 0, 1, 0, 0, 0, 1}, sizeof(s.camera.R));
    memset(s.camera.t, 0, sizeof(s.camera.t));
    s.camera.cx = 18.5, s.camera.cy = 14.5; /* the centre of pixel (18, 14) */
    memcpy(s.params[0], (double[3]){0, 0, 3}, 3 * sizeof(double));
    s.params[0][SG_P_OPACITY] = 10;
    memset(s.weight, 0, sizeof(s.weight));
    const int at = 14 * WIDTH + 18;
    s.weight[at] = 1;
    evaluate(&s, true, NULL);
    assert_near(1 - transmittance[at], (double) SG_ALPHA_MAX, 1e-12);
    double gradient[SG_PARAMS_MAX];
    const struct pinhole view = view_make(&s.camera);
    ref_parameter_gradient(&view, &splats[0], s.params[0], 0, gradient);
    const double o = 1 / (1 + exp(-10.0));
    const double expected = (splats[0].rgb[0] - (double) background[0]) * o * (1 - o);
    assert_true(fabs(expected) > 1e-6);
    /* The background's share is divided by 1 - 0.99, which multiplies T_final back to 1. */
    assert_near(gradient[SG_P_OPACITY], expected, 1e-9);
}

/* ---- photometric loss: math/photometric.h as the engines use it ---- */

#define SIDE 17 /* wider and narrower than the window */
#define TALL 9

static double ssim_mean(const double *x, const double *y, double *gradient)
{
    static double M[SIDE * TALL], XX[SIDE * TALL], XY[SIDE * TALL];
    double sum = 0;
    for (int r = 0; r < TALL; r++)
        for (int c = 0; c < SIDE; c++) {
            double m1 = 0, m2 = 0, xx = 0, yy = 0, xy = 0;
            for (int j = -SG_SSIM_RADIUS; j <= SG_SSIM_RADIUS; j++)
                for (int i = -SG_SSIM_RADIUS; i <= SG_SSIM_RADIUS; i++) {
                    if (r + j < 0 || r + j >= TALL || c + i < 0 || c + i >= SIDE)
                        continue;
                    const double a = x[(r + j) * SIDE + c + i], b = y[(r + j) * SIDE + c + i];
                    const double k = (double) sg_ssim_window[i + SG_SSIM_RADIUS] *
                                     (double) sg_ssim_window[j + SG_SSIM_RADIUS];
                    m1 += k * a, m2 += k * b, xx += k * a * a, yy += k * b * b, xy += k * a * b;
                }
            const int at = r * SIDE + c;
            const struct ssim s = ssim_point(m1, m2, xx + yy, xy);
            sum += s.s;
            M[at] = s.d_m, XX[at] = s.d_xx, XY[at] = s.d_xy;
        }
    for (int r = 0; gradient && r < TALL; r++)
        for (int c = 0; c < SIDE; c++) {
            double s[3] = {0};
            for (int j = -SG_SSIM_RADIUS; j <= SG_SSIM_RADIUS; j++)
                for (int i = -SG_SSIM_RADIUS; i <= SG_SSIM_RADIUS; i++) {
                    if (r + j < 0 || r + j >= TALL || c + i < 0 || c + i >= SIDE)
                        continue;
                    const int at = (r + j) * SIDE + c + i;
                    const double k = (double) sg_ssim_window[i + SG_SSIM_RADIUS] *
                                     (double) sg_ssim_window[j + SG_SSIM_RADIUS];
                    s[0] += k * M[at], s[1] += k * XX[at], s[2] += k * XY[at];
                }
            const int at = r * SIDE + c;
            gradient[at] = (s[0] + 2 * x[at] * s[1] + y[at] * s[2]) / (SIDE * TALL);
        }
    return sum / (SIDE * TALL);
}

static void ssim_gradient_by_differences(void **state)
{
    (void) state;
    double x[SIDE * TALL], y[SIDE * TALL], gradient[SIDE * TALL];
    struct dice d = {13, 0};
    for (int i = 0; i < SIDE * TALL; i++) {
        x[i] = dice(&d, 0, 1);
        y[i] = dice(&d, 0, 1);
    }
    ssim_mean(x, y, gradient);
    for (int i = 0; i < SIDE * TALL; i++) {
        const double at = x[i], step = 1e-6;
        x[i] = at + step;
        const double up = ssim_mean(x, y, NULL);
        x[i] = at - step;
        const double down = ssim_mean(x, y, NULL);
        x[i] = at;
        const double expected = (up - down) / (2 * step);
        assert_near(gradient[i], expected, 1e-6 * fabs(expected) + 1e-9);
    }
}

static void ssim_window_is_the_published_one(void **state)
{
    (void) state;
    double sum = 0;
    for (int i = 0; i < SG_SSIM_TAPS; i++)
        sum += exp(-(i - SG_SSIM_RADIUS) * (i - SG_SSIM_RADIUS) / (2 * 1.5 * 1.5));
    for (int i = 0; i < SG_SSIM_TAPS; i++)
        assert_near((double) sg_ssim_window[i],
                    exp(-(i - SG_SSIM_RADIUS) * (i - SG_SSIM_RADIUS) / (2 * 1.5 * 1.5)) / sum,
                    2e-8);
}

static void ssim_of_an_image_with_itself(void **state)
{
    (void) state;
    double x[SIDE * TALL], gradient[SIDE * TALL];
    struct dice d = {14, 0};
    for (int i = 0; i < SIDE * TALL; i++)
        x[i] = dice(&d, 0, 1);
    assert_near(ssim_mean(x, x, gradient), 1, 1e-12);
    for (int i = 0; i < SIDE * TALL; i++)
        assert_near(gradient[i], 0, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_of_every_parameter),
        cmocka_unit_test(gradients_with_the_mip_filter),
        cmocka_unit_test(gains_of_the_mip_filter),
        cmocka_unit_test(gradients_when_layers_hide_each_other),
        cmocka_unit_test(gradients_of_needles_and_specks),
        cmocka_unit_test(gradients_outside_the_tangent_clamp),
        cmocka_unit_test(saturated_alpha_keeps_its_gradient),
        cmocka_unit_test(ssim_gradient_by_differences),
        cmocka_unit_test(ssim_window_is_the_published_one),
        cmocka_unit_test(ssim_of_an_image_with_itself),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
