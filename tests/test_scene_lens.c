/* SPDX-License-Identifier: Apache-2.0 */
/* Distorted photos become pinhole views: against a photo computed from a known scene, through the
 * whole loader. */
#include "scene_files.h"

#include <math.h>

#include "scene/reader.h"

#define W 120
#define H 90

static const struct sg_lens lens = {
    .width = W,
    .height = H,
    .fx = 100,
    .fy = 95,
    .has_principal = true,
    .cx = 63,
    .cy = 41,
    .k1 = -0.18,
    .k2 = 0.03,
    .p1 = 0.004,
    .p2 = -0.003,
};

/* What is seen in direction (x, y, 1): smooth, so that interpolation is good. */
static double radiance(double x, double y, int c)
{
    return 128 + 60 * sin(7 * x + c) + 55 * cos(6 * y - 2 * c + x);
}

/* The distorted photo, by solving the lens equation for every pixel. */
static void take_photo(uint8_t *rgb)
{
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            double xd = (u + 0.5 - lens.cx) / lens.fx, yd = (v + 0.5 - lens.cy) / lens.fy, x = xd,
                   y = yd;
            for (int k = 0; k < 100; k++) { /* fixed point: converges fast for a mild lens */
                double r2 = x * x + y * y, d = 1 + lens.k1 * r2 + lens.k2 * r2 * r2;
                double tx = 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x * x);
                double ty = lens.p1 * (r2 + 2 * y * y) + 2 * lens.p2 * x * y;
                x = (xd - tx) / d;
                y = (yd - ty) / d;
            }
            for (int c = 0; c < 3; c++)
                rgb[(v * W + u) * 3 + c] = (uint8_t) lround(radiance(x, y, c));
        }
}

static void check_pinhole(const struct sg_view *view, int least_used)
{
    int used = 0;
    const struct sg_camera *cam = &view->camera;
    for (int v = 0; v < cam->height; v++)
        for (int u = 0; u < cam->width; u++) {
            int i = v * cam->width + u;
            if (view->mask && !view->mask[i])
                continue;
            used++;
            double x = (u + 0.5 - cam->cx) / cam->fx, y = (v + 0.5 - cam->cy) / cam->fy;
            for (int c = 0; c < 3; c++) {
                double expected = radiance(x, y, c);
                if (fabs(view->rgb[3 * i + c] - expected) > 3)
                    fail_msg("pixel %d,%d channel %d: %d is not %g", u, v, c, view->rgb[3 * i + c],
                             expected);
            }
        }
    assert_true(used >= least_used);
}

static void put_scene(struct fixture *f, const char *camera)
{
    static uint8_t photo[W * H * 3];
    char text[200];
    take_photo(photo);
    put_text(f, "sparse/0/cameras.txt", camera);
    snprintf(text, sizeof(text), "1 1 0 0 0 0 0 0 1 a.png\n\n");
    put_text(f, "sparse/0/images.txt", text);
    put(f, "images/a.png", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "images/a.png"), photo, W, H, 3), SG_OK);
}

static void opencv_photo_becomes_pinhole(void **state)
{
    struct fixture *f = *state;
    put_scene(f, "1 OPENCV 120 90 100 95 63 41 -0.18 0.03 0.004 -0.003\n");
    struct sg_scene *s = load(f, NULL);
    assert_true(s->train[0].camera.fx == 100 && s->train[0].camera.cy == 41);
    check_pinhole(&s->train[0], W * H * 9 / 10);
    sg_scene_destroy(&s);
    s = load(f, sg_scene_params(.resolution = 2)); /* camera and pixels stay in step when shrunk */
    assert_int_equal(s->train[0].camera.width, W / 2);
    check_pinhole(&s->train[0], W * H * 9 / 40);
    sg_scene_destroy(&s);
    /* the same lens, measured on a photo of three times the size */
    put_scene(f, "1 OPENCV 360 270 300 285 189 123 -0.18 0.03 0.004 -0.003\n");
    s = load(f, NULL);
    check_pinhole(&s->train[0], W * H * 9 / 10);
    sg_scene_destroy(&s);
}

static void outside_is_masked_and_black(void **state)
{
    struct fixture *f = *state;
    put_scene(
        f, "1 SIMPLE_RADIAL 120 90 100 60 45 0.5\n"); /* reaches beyond the photo at the corners */
    struct sg_scene *s = load(f, NULL);
    const struct sg_view *view = &s->train[0];
    assert_non_null(view->mask);
    assert_int_equal(view->mask[0], 0);
    assert_int_equal(view->rgb[0], 0);
    assert_int_equal(view->mask[45 * W + 60], 255);
    for (int i = 0; i < W * H; i++) {
        double x = (i % W + 0.5 - 60) / 100, y = (i / W + 0.5 - 45) / 100,
               d = 1 + 0.5 * (x * x + y * y);
        double px = x * d * 100 + 60, py = y * d * 100 + 45;
        assert_int_equal(view->mask[i], px >= 0 && px <= W && py >= 0 && py <= H ? 255 : 0);
    }
    sg_scene_destroy(&s);
}

/* r (1 - r^2) turns back at r = 0.577: beyond, the photo must not appear a second time. */
static void folding_lens(void **state)
{
    struct fixture *f = *state;
    static uint8_t src[W * H * 3], dst[W * H * 3], valid[W * H];
    memset(src, 255, sizeof(src));
    struct sg_lens strong = {.fx = 50, .fy = 50, .cx = 60, .cy = 45, .k1 = -1};
    size_t lost;
    assert_int_equal(sg_undistort(f->ctx, &strong, W, H, src, dst, valid, NULL, &lost), SG_OK);
    for (int i = 0; i < W * H; i++) {
        double x = (i % W + 0.5 - 60) / 50, y = (i / W + 0.5 - 45) / 50;
        assert_int_equal(valid[i], x * x + y * y < 1 / 3.0 ? 255 : 0);
        assert_int_equal(dst[3 * i], valid[i]);
    }
}

static void straight_lens_changes_nothing(void **state)
{
    struct fixture *f = *state;
    static uint8_t src[W * H * 3], dst[W * H * 3], valid[W * H], mask[W * H];
    take_photo(src);
    for (int i = 0; i < W * H; i++)
        mask[i] = i % 3 ? 255 : 0;
    struct sg_lens none = {.fx = 77, .fy = 88, .cx = 60, .cy = 45};
    size_t lost;
    assert_int_equal(sg_undistort(f->ctx, &none, W, H, src, dst, valid, mask, &lost), SG_OK);
    assert_int_equal(lost, 0);
    assert_memory_equal(src, dst, sizeof(src));
    for (int i = 0; i < W * H; i++)
        assert_int_equal(mask[i], i % 3 ? 255 : 0);
}

static void absurd_coefficients(void **state)
{
    struct fixture *f = *state;
    put_scene(f, "1 OPENCV 120 90 100 95 63 41 1e300 1e300 1e300 -1e300\n");
    expect_failure(f, NULL, SG_ERR_INPUT, "a.png", "distortion", NULL);
    put_scene(f, "1 OPENCV 120 90 100 95 63 41 nan 0 0 0\n");
    expect_failure(f, NULL, SG_ERR_INPUT, "cameras.txt", "distortion", NULL);
}

/* ---- every camera model of COLMAP ---- */

/* As COLMAP's documentation writes it, from a direction to a pixel; independent of the library's
 * own formulas. */
static void project(int model, const double *p, double x, double y, double *px, double *py)
{
    const double r = sqrt(x * x + y * y), t = atan(r), t2 = t * t, s = r * r;
    const double fx = p[0], fy = model == 8 || model == 9 ? p[0] : p[1];
    const double *c = p + (model == 8 || model == 9 ? 1 : 2), *k = c + 2;
    double u = x, v = y, u2, v2;
    switch (model) {
    case 5: /* OPENCV_FISHEYE */
        u = x / r * t * (1 + k[0] * t2 + k[1] * t2 * t2 + k[2] * pow(t, 6) + k[3] * pow(t, 8));
        v = u * y / x;
        break;
    case 6: /* FULL_OPENCV: k1 k2 p1 p2 k3 k4 k5 k6 */
        u = x * (1 + k[0] * s + k[1] * s * s + k[4] * s * s * s) /
            (1 + k[5] * s + k[6] * s * s + k[7] * s * s * s);
        v = y * (u / x);
        u += 2 * k[2] * x * y + k[3] * (s + 2 * x * x);
        v += 2 * k[3] * x * y + k[2] * (s + 2 * y * y);
        break;
    case 7: /* FOV */
        u = x / r * atan(2 * r * tan(k[0] / 2)) / k[0];
        v = u * y / x;
        break;
    case 8: /* SIMPLE_RADIAL_FISHEYE */
        u = x / r * t * (1 + k[0] * t2);
        v = u * y / x;
        break;
    case 9: /* RADIAL_FISHEYE */
        u = x / r * t * (1 + k[0] * t2 + k[1] * t2 * t2);
        v = u * y / x;
        break;
    case 10: /* THIN_PRISM_FISHEYE: k1 k2 p1 p2 k3 k4 sx1 sy1 */
        u2 = x / r * t, v2 = y / r * t;
        u = u2 * (1 + k[0] * t2 + k[1] * t2 * t2 + k[4] * pow(t, 6) + k[5] * pow(t, 8)) +
            2 * k[2] * u2 * v2 + k[3] * (t2 + 2 * u2 * u2) + k[6] * t2;
        v = v2 * (1 + k[0] * t2 + k[1] * t2 * t2 + k[4] * pow(t, 6) + k[5] * pow(t, 8)) +
            2 * k[3] * u2 * v2 + k[2] * (t2 + 2 * v2 * v2) + k[7] * t2;
        break;
    }
    *px = fx * u + c[0];
    *py = fy * v + c[1];
}

/* The direction of a pixel, by Newton's method on the projection. */
static void unproject(int model, const double *p, double px, double py, double *x, double *y)
{
    *x = (px - 63) / p[0], *y = (py - 41) / p[0];
    for (int k = 0; k < 60; k++) {
        const double h = 1e-6;
        double a, b, ax, bx, ay, by;
        project(model, p, *x, *y, &a, &b);
        project(model, p, *x + h, *y, &ax, &bx);
        project(model, p, *x, *y + h, &ay, &by);
        const double j[4] = {(ax - a) / h, (ay - a) / h, (bx - b) / h, (by - b) / h},
                     det = j[0] * j[3] - j[1] * j[2];
        *x -= (j[3] * (a - px) - j[1] * (b - py)) / det;
        *y -= (j[0] * (b - py) - j[2] * (a - px)) / det;
    }
}

static const struct model {
    int number;
    const char *camera;
    double params[12];
} models[] = {
    {5,
     "1 OPENCV_FISHEYE 120 90 80 78 63 41 -0.05 0.01 -0.004 0.001\n",
     {80, 78, 63, 41, -0.05, 0.01, -0.004, 0.001}},
    {5, "1 OPENCV_FISHEYE 120 90 80 78 63 41 0 0 0 0\n", {80, 78, 63, 41}},
    {6,
     "1 FULL_OPENCV 120 90 100 95 63 41 0.1 0.02 0.004 -0.003 0.01 0.3 0.05 0.002\n",
     {100, 95, 63, 41, 0.1, 0.02, 0.004, -0.003, 0.01, 0.3, 0.05, 0.002}},
    {7, "1 FOV 120 90 90 88 63 41 0.9\n", {90, 88, 63, 41, 0.9}},
    {8, "1 SIMPLE_RADIAL_FISHEYE 120 90 80 63 41 0.03\n", {80, 63, 41, 0.03}},
    {9, "1 RADIAL_FISHEYE 120 90 80 63 41 0.03 -0.02\n", {80, 63, 41, 0.03, -0.02}},
    {10,
     "1 THIN_PRISM_FISHEYE 120 90 80 78 63 41 -0.05 0.01 0.003 -0.002 0.001 -0.001 0.002 -0.003\n",
     {80, 78, 63, 41, -0.05, 0.01, 0.003, -0.002, 0.001, -0.001, 0.002, -0.003}},
};

/* A photo taken with each lens, through the loader, is the pinhole's; a point goes to the pixel and
 * back. */
static void every_model_becomes_pinhole(void **state)
{
    struct fixture *f = *state;
    static uint8_t photo[W * H * 3];
    for (size_t m = 0; m < sizeof(models) / sizeof(*models); m++) {
        for (int v = 0; v < H; v++)
            for (int u = 0; u < W; u++) {
                double x, y, px, py;
                unproject(models[m].number, models[m].params, u + 0.5, v + 0.5, &x, &y);
                project(models[m].number, models[m].params, x, y, &px, &py);
                if (!(fabs(px - u - 0.5) < 1e-6 && fabs(py - v - 0.5) < 1e-6))
                    fail_msg("%s: pixel %d,%d comes back as %g,%g", models[m].camera, u, v, px, py);
                for (int c = 0; c < 3; c++)
                    photo[(v * W + u) * 3 + c] = (uint8_t) lround(radiance(x, y, c));
            }
        put_text(f, "sparse/0/cameras.txt", models[m].camera);
        put_text(f, "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n");
        put(f, "images/a.png", "", 0);
        assert_int_equal(sg_image_write_png(f->ctx, at(f, "images/a.png"), photo, W, H, 3), SG_OK);
        struct sg_scene *s = load(f, NULL);
        assert_true(s->train[0].undistorted);
        check_pinhole(&s->train[0], W * H * 9 / 10);
        sg_scene_destroy(&s);
    }
}

/* Points of closed form: an equidistant fisheye lens sees the angle, a lens of field of view omega
 * its tangent. */
static void closed_forms(void **state)
{
    (void) state;
    const struct sg_lens fisheye = {.kind = SG_LENS_FISHEYE},
                         fov = {.kind = SG_LENS_FOV, .omega = 1},
                         rational = {.kind = SG_LENS_RATIONAL, .k1 = 1, .k4 = 3};
    double x, y;
    sg_lens_distort(&fisheye, 1, 0, &x, &y);
    assert_float_equal(x, M_PI / 4, 1e-15);
    sg_lens_distort(&fisheye, 3, 4, &x, &y);
    assert_float_equal(x, 0.6 * atan(5), 1e-15);
    assert_float_equal(y, 0.8 * atan(5), 1e-15);
    sg_lens_distort(&fisheye, 0, 0, &x, &y);
    assert_true(x == 0 && y == 0);
    sg_lens_distort(&fov, 0, tan(0.5) / (2 * tan(0.5)), &x, &y);
    assert_float_equal(y, 0.5,
                       1e-15); /* the radius 0.5 is omega / 2 away, by the model's definition */
    sg_lens_distort(&rational, 0.5, 0, &x, &y);
    assert_float_equal(x, 0.5 * 1.25 / 1.75, 1e-15);
}

/* Against the sign of the slope, sampled finely: where a lens first turns back. */
static void folds(void **state)
{
    (void) state;
    static const struct sg_lens lenses[] = {
        {.k1 = -1},
        {.k1 = 0.2, .k2 = -0.3},
        {.k1 = -0.5, .k2 = 0.05},
        {.k1 = 0.3, .k2 = 0.1, .k3 = -0.2},
        {.kind = SG_LENS_FISHEYE, .k1 = -0.3},
        {.kind = SG_LENS_FISHEYE, .k1 = 0.1, .k4 = -0.05},
        {.kind = SG_LENS_RATIONAL, .k1 = 0.1, .k4 = -0.5},
        {.kind = SG_LENS_RATIONAL, .k1 = -0.8, .k5 = 0.2},
    };
    for (size_t i = 0; i < sizeof(lenses) / sizeof(*lenses); i++) {
        double before = 0, turn = INFINITY;
        for (double r = 1e-4; r < 3 && turn == INFINITY; r += 1e-4) {
            double x, y;
            sg_lens_distort(&lenses[i], r, 0, &x, &y);
            if (x < before)
                turn = r;
            before = x;
        }
        const double fold = sg_lens_fold(&lenses[i], 9);
        assert_true(turn < INFINITY);
        assert_float_equal(sqrt(fold), turn, 3e-4);
    }
    assert_true(isinf(sg_lens_fold(&(struct sg_lens){.kind = SG_LENS_FISHEYE, .k1 = 0.1}, 9)));
    assert_true(isinf(sg_lens_fold(&(struct sg_lens){.k1 = -0.01}, 9)));
}

/* Coefficients that mirror parts of the photo, or turn it back at once: no pixel is shown twice, or
 * there is an error. */
static void lenses_that_cannot_be(void **state)
{
    struct fixture *f = *state;
    static const char *const cameras[] = {
        "1 OPENCV_FISHEYE 120 90 100 95 63 41 1e300 -1e300 1e300 -1e300\n",
        "1 OPENCV_FISHEYE 120 90 100 95 63 41 -1e9 0 0 0\n",
        "1 FULL_OPENCV 120 90 100 95 63 41 0 0 0 0 0 -1e9 0 0\n",
        "1 THIN_PRISM_FISHEYE 120 90 100 95 63 41 0 0 1e9 1e9 0 0 1e9 1e9\n",
        "1 RADIAL 120 90 100 63 41 -1e12 1e30\n",
        "1 SIMPLE_RADIAL_FISHEYE 120 90 1e-3 63 41 1e6\n",
    };
    for (size_t i = 0; i < sizeof(cameras) / sizeof(*cameras); i++) {
        put_scene(f, cameras[i]);
        expect_failure(f, NULL, SG_ERR_INPUT, "a.png", "distortion", "camera id 1", NULL);
    }
    assert_true(sg_lens_keeps_sides(&(struct sg_lens){.p1 = 0.01}, 0.5, -0.5));
    assert_false(sg_lens_keeps_sides(&(struct sg_lens){.p1 = 1}, 0.5, -0.5));
}

/* nerfstudio's fisheye lens is COLMAP's OPENCV_FISHEYE. */
static void nerfstudio_fisheye(void **state)
{
    struct fixture *f = *state;
    static uint8_t photo[W * H * 3];
    const double p[8] = {80, 78, 63, 41, -0.05, 0.01, -0.004, 0.001};
    for (int i = 0; i < W * H; i++) {
        double x, y;
        unproject(5, p, i % W + 0.5, i / W + 0.5, &x, &y);
        for (int c = 0; c < 3; c++)
            photo[3 * i + c] = (uint8_t) lround(radiance(x, y, c));
    }
    put(f, "a.png", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "a.png"), photo, W, H, 3), SG_OK);
    static const char *const names[] = {"\"camera_model\":\"OPENCV_FISHEYE\"",
                                        "\"is_fisheye\":true"};
    for (int i = 0; i < 2; i++) {
        char text[512];
        snprintf(
            text, sizeof(text),
            "\xef\xbb\xbf{%s,\"w\":120,\"h\":90,\"fl_x\":80,\"fl_y\":78,\"cx\":63,\"cy\":41,\"k1\":"
            "-0.05,"
            "\"k2\":0.01,\"k3\":-0.004,\"k4\":0.001,\"p1\":0,\"frames\":[{\"file_path\":\"a.png\","
            "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}",
            names[i]);
        put_text(f, "transforms.json", text);
        struct sg_scene *s = load(f, NULL);
        check_pinhole(&s->train[0], W * H * 9 / 10);
        sg_scene_destroy(&s);
    }
}

/* ---- cameras and photos of different sizes ---- */

static void sizes(void **state)
{
    struct fixture *f = *state;
    static const struct {
        int width, height;
        bool same;
    } cases[] = {{120, 90, true},   {240, 180, true}, {60, 45, true},   {361, 270, true},
                 {479, 359, true},  {16, 12, true},   {119, 90, true},  {90, 120, false},
                 {1200, 90, false}, {120, 95, false}, {240, 170, false}};
    for (size_t i = 0; i < sizeof(cases) / sizeof(*cases); i++) {
        char text[200];
        snprintf(text, sizeof(text), "1 PINHOLE %d %d 100 95 60 45\n", cases[i].width,
                 cases[i].height);
        put_scene(f, text);
        f->warnings = 0;
        const bool scaled = cases[i].width != W || cases[i].height != H;
        if (!cases[i].same) {
            snprintf(text, sizeof(text), "%d x %d", cases[i].width, cases[i].height);
            expect_failure(f, NULL, SG_ERR_INPUT, "a.png", "120 x 90", text, "camera id 1", NULL);
            continue;
        }
        struct sg_scene *s = load(f, NULL);
        assert_int_equal(f->warnings, 1 + scaled); /* there is one camera */
        assert_true(fabs(s->train[0].camera.fx - 100.0 * W / cases[i].width) < 1e-9);
        sg_scene_destroy(&s);
        if (scaled)
            expect_failure(f, sg_scene_params(.strict = true), SG_ERR_INPUT, "a.png", "120 x 90",
                           "camera id 1", NULL);
        f->warnings = 0;
        s = load(f, sg_scene_params(.images = "images", .strict = true)); /* where it is meant */
        assert_int_equal(f->warnings, 1);
        sg_scene_destroy(&s);
    }
    put_scene(f, "1 PINHOLE 120 90 100 95 60 45\n");
    put_png(f, "masks/a.png", 60, 45, 1, 0);
    struct sg_scene *s = load(f, NULL);
    sg_scene_destroy(&s);
    put_png(f, "masks/a.png", 90, 120, 1, 0);
    expect_failure(f, NULL, SG_ERR_INPUT, "masks/a.png", "90 x 120", "120 x 90", NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(opencv_photo_becomes_pinhole),
        scene_test(outside_is_masked_and_black),
        scene_test(folding_lens),
        scene_test(straight_lens_changes_nothing),
        scene_test(absurd_coefficients),
        scene_test(every_model_becomes_pinhole),
        scene_test(closed_forms),
        scene_test(folds),
        scene_test(lenses_that_cannot_be),
        scene_test(nerfstudio_fisheye),
        scene_test(sizes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
