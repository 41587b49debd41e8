/* SPDX-License-Identifier: Apache-2.0 */
/* Where an image's energy is: against known images, and the whole transform written out. */
#include "splatguard/spectrum.h"

#include <complex.h>

#include "models.h"

static uint8_t *image_of(int w, int h, double (*value)(int x, int y))
{
    uint8_t *rgb = malloc(3 * (size_t) w * (size_t) h);
    for (int i = 0; i < w * h; i++)
        memset(rgb + 3 * i, (int) (value(i % w, i / w) + 0.5), 3);
    return rgb;
}

static double down(int x, int y)
{
    (void) x;
    return 127.5 + 100 * cos(6.283185307179586 * 0.25 * y);
}
static double across(int x, int y)
{
    return down(y, x);
}
static double noise(int x, int y)
{
    return (double) draw(1, (uint64_t) (x + 4096 * y), 0, 255);
}
static double flat(int x, int y)
{
    (void) x, (void) y;
    return 90;
}

static struct sg_spectrum measure(sg_ctx *ctx, int w, int h, double (*value)(int x, int y))
{
    struct sg_spectrum s;
    uint8_t *rgb = image_of(w, h, value);
    assert_int_equal(sg_spectrum_measure(ctx, rgb, w, h, NULL, &s, NULL), SG_OK);
    free(rgb);
    return s;
}

static void test_known(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    /* Rows that alternate: all energy at +-90 degrees, that is at a quarter and three quarters of the circle. */
    struct sg_spectrum s = measure(ctx, 48, 64, down);
    assert_true(s.angular[9] + s.angular[27] > 0.999 && fabs(s.angular[9] - s.angular[27]) < 1e-6);
    assert_float_equal(s.anisotropy, 1 - log(2) / log(36), 1e-3);
    assert_true(s.band_share > 0.99);
    assert_true(s.radial[32] > 100 * s.radial[31]);
    s = measure(ctx, 64, 48, across);
    assert_true(s.angular[0] + s.angular[18] > 0.999);
    /* Noise has no direction, whatever the sides. */
    s = measure(ctx, 401, 307, noise);
    assert_true(s.anisotropy < 1e-3);
    /* The annulus has pi (0.45^2 - 0.15^2) of the square. */
    assert_float_equal(s.band_share, 0.5655, 0.01);
    s = measure(ctx, 31, 17, flat);
    assert_true(s.anisotropy == 0 && s.band_share == 0 && s.angular[3] == 0);
    sg_ctx_destroy(&ctx);
}

/* Odd and even sides against a sum over every frequency of the whole spectrum. */
static void test_whole(void **state)
{
    (void) state;
    static const int sizes[][2] = {{12, 9}, {9, 12}, {11, 13}, {1, 7}, {8, 1}, {10, 10}};
    sg_ctx *ctx = make_context(1);
    for (int k = 0; k < 6; k++) {
        const int w = sizes[k][0], h = sizes[k][1], bins = 12;
        uint8_t *rgb = image_of(w, h, noise);
        double angular[12] = {0}, band = 0, total = 0;
        for (int u = 0; u < h; u++)
            for (int v = 0; v < w; v++) {
                double complex f = 0;
                for (int y = 0; y < h; y++)
                    for (int x = 0; x < w; x++)
                        f += rgb[3 * (y * w + x)] / 255.0 *
                             cexp(-I * 6.283185307179586 * ((double) u * y / h + (double) v * x / w));
                const double fu = (double) (2 * u < h ? u : u - h) / h, fv = (double) (2 * v < w ? v : v - w) / w;
                const double r = 2 * hypot(fu, fv), e = 3 * creal(f * conj(f));
                total += r > 0 ? e : 0;
                if (!(r >= 0.2 && r <= 0.95) || 2 * u == h || 2 * v == w)
                    continue;
                angular[(int) floor((atan2(fu, fv) + M_PI) * bins / (2 * M_PI) + 1e-9) % bins] += e;
                band += e;
            }
        struct sg_spectrum s;
        float amplitude[200];
        assert_int_equal(sg_spectrum_measure(ctx, rgb, w, h, sg_spectrum_params(.low = 0.2, .high = 0.95, .bins = bins),
                                             &s, amplitude),
                         SG_OK);
        for (int b = 0; b < bins && band > 0; b++)
            if (fabs(s.angular[b] - angular[b] / band) > 1e-5)
                fail_msg("%d x %d, bin %d: %g, expected %g", w, h, b, s.angular[b], angular[b] / band);
        assert_float_equal(s.band_share, band / total, 1e-5);
        double sum = 0;
        for (int i = 0; i < w * h; i++)
            sum += rgb[3 * i] / 255.0;
        assert_float_equal((double) amplitude[h / 2 * w + w / 2], log1p(sum), 1e-4);
        free(rgb);
    }
    uint8_t one[3] = {0};
    struct sg_spectrum s;
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, sg_spectrum_params(.bins = 7), &s, NULL), SG_ERR_USAGE);
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, sg_spectrum_params(.low = 2), &s, NULL), SG_ERR_USAGE);
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, NULL, &s, NULL), SG_OK);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_known), cmocka_unit_test(test_whole)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
