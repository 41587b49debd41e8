/* SPDX-License-Identifier: Apache-2.0 */
/* Distorted photos become pinhole views: against a photo computed from a known scene, through the whole loader. */
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
            double xd = (u + 0.5 - lens.cx) / lens.fx, yd = (v + 0.5 - lens.cy) / lens.fy, x = xd, y = yd;
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
                    fail_msg("pixel %d,%d channel %d: %d is not %g", u, v, c, view->rgb[3 * i + c], expected);
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
    put_scene(f, "1 SIMPLE_RADIAL 120 90 100 60 45 0.5\n"); /* reaches beyond the photo at the corners */
    struct sg_scene *s = load(f, NULL);
    const struct sg_view *view = &s->train[0];
    assert_non_null(view->mask);
    assert_int_equal(view->mask[0], 0);
    assert_int_equal(view->rgb[0], 0);
    assert_int_equal(view->mask[45 * W + 60], 255);
    for (int i = 0; i < W * H; i++) {
        double x = (i % W + 0.5 - 60) / 100, y = (i / W + 0.5 - 45) / 100, d = 1 + 0.5 * (x * x + y * y);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(opencv_photo_becomes_pinhole),  scene_test(outside_is_masked_and_black), scene_test(folding_lens),
        scene_test(straight_lens_changes_nothing), scene_test(absurd_coefficients),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
