/* SPDX-License-Identifier: Apache-2.0 */
/* Smoothing of photos: known values, borders, masks, and the filters' definition evaluated in
 * double precision, pixel by pixel. */
#include "scene_files.h"

#include "image/smooth.h"

#include <math.h>

#define W 23
#define H 17

static void smooth(struct fixture *f, enum sg_smooth kind, const uint8_t *rgb, const uint8_t *mask,
                   int w, int h, uint8_t *out)
{
    uint8_t *parallel = calloc((size_t) (w * h), 3);
    memset(out, 0, (size_t) (w * h) * 3);
    assert_int_equal(sg_smooth(f->ctx, kind, rgb, mask, w, h, out), SG_OK);
    if (kind == SG_SMOOTH_BILATERAL) {
        assert_int_equal(sg_smooth_bilateral(f->ctx, 75, rgb, mask, w, h, parallel), SG_OK);
        assert_memory_equal(parallel, out, (size_t) (w * h) * 3);
    }
    free(parallel);
}

static void constant_images_stay(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[W * H * 3], out[W * H * 3];
    for (int value = 0; value < 256; value += 51) {
        memset(rgb, value, sizeof(rgb));
        for (enum sg_smooth kind = SG_SMOOTH_GAUSSIAN; kind <= SG_SMOOTH_WAVELET; kind++)
            for (int w = 1; w < 4; w++) { /* also narrower than the filters */
                smooth(f, kind, rgb, NULL, w, 2, out);
                assert_memory_equal(out, rgb, (size_t) (w * 2 * 3));
            }
        smooth(f, SG_SMOOTH_BILATERAL, rgb, NULL, W, H, out);
        assert_memory_equal(out, rgb, sizeof(rgb));
    }
}

/* So weak a filter that 2 sigma^2 is 0. */
static void least_sigma(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[W * H * 3], out[sizeof(rgb)];
    for (size_t i = 0; i < sizeof(rgb); i++)
        rgb[i] = (uint8_t) (i * 37);
    assert_int_equal(sg_smooth_bilateral(f->ctx, 1e-200, rgb, NULL, W, H, out), SG_OK);
    assert_memory_equal(out, rgb, sizeof(rgb));
}

static void impulse_through_the_gaussian(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[21 * 21 * 3] = {0}, out[sizeof(rgb)];
    memset(rgb + (10 * 21 + 10) * 3, 255, 3);
    smooth(f, SG_SMOOTH_GAUSSIAN, rgb, NULL, 21, 21, out);
    assert_int_equal(out[(10 * 21 + 10) * 3], 22); /* 0.29208172^2 x 255 = 21.75 */
    assert_int_equal(out[(10 * 21 + 11) * 3], 17); /* 0.29208172 x 0.23388076 x 255 = 17.42 */
    assert_int_equal(out[(11 * 21 + 11) * 3], 14); /* 0.23388076^2 x 255 = 13.95 */
    assert_int_equal(out[(10 * 21 + 13) * 3], 0);
}

/* As the filters are defined. The reflection is written out where the library computes it. */
static double expected(enum sg_smooth kind, const uint8_t *rgb, const uint8_t *mask, int x, int y,
                       int channel)
{
    const int radius = kind == SG_SMOOTH_GAUSSIAN ? 2 : 4;
    double sum = 0, weights = 0;
    for (int dy = -radius; dy <= radius; dy++)
        for (int dx = -radius; dx <= radius; dx++) {
            int qx = x + dx, qy = y + dy;
            qx = qx < 0 ? -qx : qx > W - 1 ? 2 * (W - 1) - qx : qx;
            qy = qy < 0 ? -qy : qy > H - 1 ? 2 * (H - 1) - qy : qy;
            const uint8_t *p = rgb + (y * W + x) * 3, *q = rgb + (qy * W + qx) * 3;
            const double d = abs(p[0] - q[0]) + abs(p[1] - q[1]) + abs(p[2] - q[2]);
            double w = exp(-(dx * dx + dy * dy) / (2 * 1.5 * 1.5));
            if (kind == SG_SMOOTH_BILATERAL)
                w = dx * dx + dy * dy > 16
                        ? 0
                        : exp(-(dx * dx + dy * dy) / (2 * 75.0 * 75)) * exp(-d * d / 11250);
            if (mask && !mask[qy * W + qx])
                w = 0;
            sum += w * q[channel];
            weights += w;
        }
    return sum / weights;
}

static void every_pixel_is_as_defined(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[W * H * 3], mask[W * H], out[W * H * 3];
    uint32_t random = 1;
    for (size_t i = 0; i < sizeof(rgb); i++)
        rgb[i] = (uint8_t) ((random = random * 1664525 + 1013904223) >> 24);
    for (size_t i = 0; i < sizeof(mask); i++)
        mask[i] = (random = random * 1664525 + 1013904223) >> 30 ? 255 : 0;
    for (int masked = 0; masked < 2; masked++)
        for (enum sg_smooth kind = SG_SMOOTH_GAUSSIAN; kind <= SG_SMOOTH_BILATERAL; kind++) {
            smooth(f, kind, rgb, masked ? mask : NULL, W, H, out);
            for (int i = 0; i < W * H; i++)
                for (int c = 0; c < 3; c++) {
                    const double e = masked && !mask[i] ? rgb[3 * i + c]
                                                        : expected(kind, rgb, masked ? mask : NULL,
                                                                   i % W, i / W, c);
                    assert_true(fabs(out[3 * i + c] - e) <= 0.5001);
                }
        }
}

/* Unused pixels have no influence, whatever they hold. */
static void masked_pixels_do_not_leak(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[W * H * 3], mask[W * H], out[W * H * 3];
    for (int i = 0; i < W * H; i++) {
        mask[i] = i % W < W / 2 ? 255 : 0;
        memset(rgb + 3 * i, mask[i] ? 100 : 200 + i % 50, 3);
    }
    for (enum sg_smooth kind = SG_SMOOTH_GAUSSIAN; kind <= SG_SMOOTH_WAVELET; kind++) {
        smooth(f, kind, rgb, mask, W, H, out);
        assert_memory_equal(out, rgb, sizeof(rgb));
    }
}

/* Noise of +-16 on a ramp with an edge: most of it goes and the edge stays. Without noise nothing
 * changes. */
static void wavelets_remove_noise(void **state)
{
    enum { SIDE = 64 };
    struct fixture *f = *state;
    static uint8_t clean[SIDE * SIDE * 3], noisy[sizeof(clean)], out[sizeof(clean)];
    uint32_t random = 1;
    for (size_t i = 0; i < sizeof(clean); i++) {
        const size_t x = i / 3 % SIDE;
        random = random * 1664525 + 1013904223;
        clean[i] = (uint8_t) (x < SIDE / 2 ? 40 + x : 150 + x);
        noisy[i] = (uint8_t) (clean[i] + (random >> 30 & 1 ? 16 : -16));
    }
    smooth(f, SG_SMOOTH_WAVELET, clean, NULL, SIDE, SIDE, out);
    assert_memory_equal(out, clean, sizeof(out));
    smooth(f, SG_SMOOTH_WAVELET, noisy, NULL, SIDE, SIDE, out);
    double error = 0, edge = 0;
    for (size_t i = 0; i < sizeof(clean); i++) {
        error += (out[i] - clean[i]) * (double) (out[i] - clean[i]);
        edge += i / 3 % SIDE == SIDE / 2 ? out[i] - out[i - 3] : 0;
    }
    assert_true(sqrt(error / sizeof(clean)) < 6); /* of 16 */
    assert_true(edge / (3 * SIDE) > 70);          /* of 111 */
}

/* A background of one colour, which is most of the photo, does not hide the noise. */
static void wavelets_see_noise_beside_a_background(void **state)
{
    enum { SIDE = 64 };
    struct fixture *f = *state;
    static uint8_t noisy[SIDE * SIDE * 3], out[sizeof(noisy)];
    uint32_t random = 1;
    double error = 0;
    for (size_t i = 0; i < sizeof(noisy); i++) {
        random = random * 1664525 + 1013904223;
        noisy[i] = i / 3 % SIDE < 40 ? 0 : (uint8_t) (random >> 30 & 1 ? 116 : 84);
    }
    smooth(f, SG_SMOOTH_WAVELET, noisy, NULL, SIDE, SIDE, out);
    for (size_t i = 0; i < sizeof(noisy); i++)
        error += i / 3 % SIDE < 48 ? 0 : (out[i] - 100) * (double) (out[i] - 100);
    assert_true(sqrt(error / (16 * SIDE * 3)) < 8); /* of 16 */
}

/* Training photos are smoothed after they were resized; test photos and other scenes are not. */
static void training_photos_of_a_scene(void **state)
{
    struct fixture *f = *state;
    const char *frame = "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"%s\","
                        "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}]}";
    char text[512];
    snprintf(text, sizeof(text), frame, "./a");
    put_text(f, "transforms_train.json", text);
    snprintf(text, sizeof(text), frame, "./b");
    put_text(f, "transforms_test.json", text);
    put_png(f, "a.png", 20, 10, 3, 1);
    put_png(f, "b.png", 20, 10, 3, 2);
    struct sg_scene *plain = load(f, sg_scene_params(.eval = true, .downscale = 2));
    for (enum sg_smooth kind = SG_SMOOTH_GAUSSIAN; kind <= SG_SMOOTH_WAVELET; kind++) {
        struct sg_scene *s = load(f, sg_scene_params(.eval = true, .downscale = 2, .smooth = kind));
        uint8_t out[10 * 5 * 3];
        smooth(f, kind, plain->train[0].rgb, NULL, 10, 5, out);
        assert_memory_equal(s->train[0].rgb, out, sizeof(out));
        assert_memory_not_equal(out, plain->train[0].rgb, sizeof(out));
        assert_memory_equal(s->test[0].rgb, plain->test[0].rgb, sizeof(out));
        sg_scene_destroy(&s);
    }
    sg_scene_destroy(&plain);
    expect_failure(f, sg_scene_params(.smooth = 4), SG_ERR_USAGE, "smooth: found 4", NULL);
}

static void out_of_memory(void **state)
{
    (void) state;
    sg_ctx *small;
    uint8_t rgb[W * H * 3] = {0}, out[W * H * 3];
    assert_int_equal(
        sg_ctx_create(&small, &(struct sg_ctx_params){.threads = 1, .max_memory = 100}), SG_OK);
    for (enum sg_smooth kind = SG_SMOOTH_GAUSSIAN; kind <= SG_SMOOTH_WAVELET; kind++)
        assert_int_equal(sg_smooth(small, kind, rgb, NULL, W, H, out), SG_ERR_BUDGET);
    sg_ctx_destroy(&small);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(constant_images_stay),
        scene_test(least_sigma),
        scene_test(impulse_through_the_gaussian),
        scene_test(every_pixel_is_as_defined),
        scene_test(masked_pixels_do_not_leak),
        scene_test(wavelets_remove_noise),
        scene_test(wavelets_see_noise_beside_a_background),
        scene_test(training_photos_of_a_scene),
        scene_test(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
