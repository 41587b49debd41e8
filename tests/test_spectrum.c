/* SPDX-License-Identifier: Apache-2.0 */
/* Where an image's energy is: against known images, and the whole transform written out. */
#include "splatguard/audit.h"
#include "splatguard/spectrum.h"

#include <complex.h>
#include <limits.h>
#include <unistd.h>

#include "models.h"
#include "nearness.h"
#include "engine/host/image_losses.h"
#include "engine/ref/ref_losses.h"
#include "image/total_variation.h"

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
    /* Rows that alternate: all energy at +-90 degrees, that is at a quarter and three quarters of
     * the circle. */
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
    for (int ring = 20; ring < SG_SPECTRUM_RINGS;
         ring++) /* nor a preferred radius: its variance is everywhere */
        assert_float_equal(s.radial[ring], 1.0 / 12, 0.15 / 12);
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
        double angular[12] = {0}, band = 0, total = 0, expected[200];
        for (int u = 0; u < h; u++)
            for (int v = 0; v < w; v++) {
                double complex f = 0;
                for (int y = 0; y < h; y++)
                    for (int x = 0; x < w; x++)
                        f += rgb[3 * (y * w + x)] / 255.0 *
                             cexp(-I * 6.283185307179586 *
                                  ((double) u * y / h + (double) v * x / w));
                const double fu = (double) (2 * u < h ? u : u - h) / h,
                             fv = (double) (2 * v < w ? v : v - w) / w;
                const double r = 2 * hypot(fu, fv), e = 3 * creal(f * conj(f));
                total += r > 0 ? e : 0;
                expected[(u + h / 2) % h * w + (v + w / 2) % w] =
                    log1p(cabs(f)); /* 0 in the middle */
                if (!(r >= 0.2 && r <= 0.95) || 2 * u == h || 2 * v == w)
                    continue;
                angular[(int) floor((atan2(fu, fv) + M_PI) * bins / (2 * M_PI) + 1e-9) % bins] += e;
                band += e;
            }
        struct sg_spectrum s;
        float amplitude[200];
        assert_int_equal(
            sg_spectrum_measure(ctx, rgb, w, h,
                                sg_spectrum_params(.low = 0.2, .high = 0.95, .bins = bins), &s,
                                amplitude),
            SG_OK);
        for (int b = 0; b < bins && band > 0; b++)
            if (fabs(s.angular[b] - angular[b] / band) > 1e-5)
                fail_msg("%d x %d, bin %d: %g, expected %g", w, h, b, s.angular[b],
                         angular[b] / band);
        assert_float_equal(s.band_share, band / total, 1e-5);
        for (int i = 0; i < w * h; i++)
            assert_float_equal((double) amplitude[i], expected[i], 1e-4);
        free(rgb);
    }
    uint8_t one[3] = {0};
    struct sg_spectrum s;
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, sg_spectrum_params(.bins = 7), &s, NULL),
                     SG_ERR_USAGE);
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, sg_spectrum_params(.bins = 256), &s, NULL),
                     SG_ERR_USAGE);
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, sg_spectrum_params(.low = 2), &s, NULL),
                     SG_ERR_USAGE);
    assert_int_equal(sg_spectrum_measure(ctx, one, 1, 1, NULL, &s, NULL), SG_OK);
    sg_ctx_destroy(&ctx);
}

/* ---- the anisotropy loss ---- */

static double loss_of(sg_ctx *ctx, int w, int h, const struct sg_anisotropy_params *p,
                      const float *x, float *gradient)
{
    struct sg_anisotropy *a;
    assert_int_equal(sg_anisotropy_create(ctx, w, h, p, NULL, &a), SG_OK);
    if (gradient)
        memset(gradient, 0, 3 * (size_t) w * (size_t) h * sizeof(float));
    const double loss = sg_anisotropy_loss(a, x, 1, gradient);
    sg_anisotropy_destroy(&a);
    return loss;
}

static double oracle(sg_ctx *ctx, int w, int h, const struct sg_anisotropy_params *p,
                     const float *x, double *gradient)
{
    double loss;
    const struct sg_loss what = {SG_LOSS_ANISOTROPY, 1, {.anisotropy = *p}};
    assert_int_equal(sg_ref_image_loss(ctx, &what, x, w, h, gradient, &loss), SG_OK);
    return loss;
}

/* Every value of the gradient, for every option: half spectra, single precision and the
 * continuation against that. */
static void test_oracle(void **state)
{
    (void) state;
    static const struct {
        int w, h, bins;
        double low, high;
    } cases[] = {{12, 9, 36, 0.3, 0.9},   {9, 12, 12, 0.1, 1},     {13, 11, 2, 0.3, 0.9},
                 {16, 16, 254, 0, 1},     {1063, 3, 36, 0.3, 0.9}, {5, 521, 36, 0.3, 0.9},
                 {263, 12, 36, 0.3, 0.9}, {20, 257, 4, 0.5, 0.6},  {262, 263, 36, 0.2, 0.95}};
    sg_ctx *ctx = make_context(2);
    const size_t most = 3 * 262 * 263;
    float *x = malloc(most * sizeof(float)), *g = malloc(most * sizeof(float));
    double *expected = malloc(most * sizeof(double));
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++)
        for (int option = 0; option < (k == 8 ? 1 : 8); option++) {
            const int w = cases[k].w, h = cases[k].h, n = 3 * w * h;
            const struct sg_anisotropy_params *p = sg_anisotropy_params(
                    .band = {.low = cases[k].low, .high = cases[k].high, .bins = cases[k].bins},
                    .energy = (enum sg_energy)(option & 1),
                    .channels = (enum sg_channels)(option >> 1 & 1), .exact_size = option >> 2);
            for (int i = 0; i < n; i++)
                x[i] = draw(11, (uint64_t) i, 0, 1) * (i % 3 ? 0.3f : 1);
            const double loss = loss_of(ctx, w, h, p, x, g),
                         right = oracle(ctx, w, h, p, x, expected);
            double largest = 0, off = 0;
            for (int i = 0; i < n; i++) {
                largest = fmax(largest, fabs(expected[i]));
                off = fmax(off, fabs((double) g[i] - expected[i]));
            }
            if (fabs(loss - right) > 1e-5 * right + 1e-9 || !(off <= 1e-4 * largest + 1e-9))
                fail_msg("%d x %d, option %d: loss %g, expected %g; gradient off by %g of %g", w, h,
                         option, loss, right, off, largest);
        }
    free(x), free(g), free(expected);
    sg_ctx_destroy(&ctx);
}

/* Against differences of the loss itself along random directions, for every option at odd, even,
 * prime and continued sides; and it does not change with the image's scale. */
static void test_gradient(void **state)
{
    (void) state;
    static const int sizes[][2] = {{12, 9},  {9, 12},   {13, 11},  {16, 16},
                                   {33, 40}, {263, 12}, {20, 257}, {263, 257}};
    sg_ctx *ctx = make_context(2);
    const size_t most = 3 * 263 * 257;
    float *x = malloc(most * sizeof(float)), *g = malloc(most * sizeof(float)),
          *moved = malloc(most * sizeof(float));
    for (int k = 0; k < 8; k++)
        for (int option = 0; option < 8; option++) {
            const int w = sizes[k][0], h = sizes[k][1], n = 3 * w * h;
            const struct sg_anisotropy_params *p =
                sg_anisotropy_params(.energy = (enum sg_energy)(option & 1),
                                     .channels = (enum sg_channels)(option >> 1 & 1),
                                     .exact_size = option >> 2);
            for (int i = 0; i < n; i++) /* structure in it, so that the loss has somewhere to go */
                x[i] = draw(7, (uint64_t) i, 0, 1) * (i % 3 ? 0.3f : 1);
            const double loss = loss_of(ctx, w, h, p, x, g);
            assert_true(loss > 0 && loss < 1);
            double along = 0, size = 0;
            for (int i = 0; i < n; i++)
                along += (double) x[i] * (double) g[i], size += (double) fabsf(g[i]);
            assert_true(fabs(along) < 1e-3 * size);
            for (uint64_t d = 0; d < 4; d++) {
                const double step = 0.01 / sqrt(n);
                double slope = 0, change = 0, scale = 0;
                for (int side = -1; side <= 1; side += 2) {
                    for (int i = 0; i < n;
                         i++) /* half along the gradient's signs: a slope well above rounding */
                        moved[i] = x[i] + (float) (side * step) *
                                              ((g[i] > 0 ? 1 : -1) + draw(d, (uint64_t) i, -1, 1));
                    change += side * loss_of(ctx, w, h, p, moved, NULL);
                }
                for (int i = 0; i < n; i++) {
                    const double by = (g[i] > 0 ? 1 : -1) + (double) draw(d, (uint64_t) i, -1, 1);
                    slope += by * (double) g[i], scale += fabs(by * (double) g[i]);
                }
                change /= 2 * step;
                if (fabs(change - slope) > 2e-2 * scale)
                    fail_msg("%d x %d, option %d: %g, expected %g", w, h, option, slope, change);
            }
        }
    free(x), free(g), free(moved);
    sg_ctx_destroy(&ctx);
}

/* The continued image's loss and gradient stay near those of the exact size: where texture is what
 * they are made of, and where it is the jump from one border to the other, as in smooth photos. */
static void test_friendly(void **state)
{
    (void) state;
    static const int sizes[][2] = {{521, 347}, {389, 400}, {262, 257}};
    assert_int_equal(sg_anisotropy_width(1559, false), 1560);
    assert_int_equal(sg_anisotropy_height(1039, false), 1040);
    assert_int_equal(sg_anisotropy_height(1039, true), 1039);
    assert_int_equal(sg_anisotropy_width(251, false), 251);
    assert_int_equal(sg_anisotropy_width(400, false), 400);
    assert_int_equal(sg_anisotropy_width(525, false), 528);
    assert_int_equal(sg_anisotropy_height(525, false), 525);
    sg_ctx *ctx = make_context(1);
    for (int k = 0; k < 6; k++) {
        const int w = sizes[k / 2][0], h = sizes[k / 2][1], n = 3 * w * h, smooth = k % 2;
        float *x = malloc((size_t) n * sizeof(float));
        for (int i = 0; i < n; i++) {
            const int at = i % (w * h), px = at % w, py = at / w;
            if (smooth) /* light from above, and a little noise */
                x[i] =
                    0.9f - 0.7f * (float) py / (float) h + draw(3, (uint64_t) i, -0.002f, 0.002f);
            else /* edges, a texture of rows, some noise */
                x[i] = 0.5f + 0.2f * (float) ((px / 37 + py / 23) % 2) +
                       0.05f * (float) cos(1.7 * py + 0.1 * px) +
                       draw(3, (uint64_t) i, -0.03f, 0.03f);
        }
        const struct nearness near = against_exact(ctx, w, h, x);
        if (!(fabs(near.loss - 1) < 0.15 && near.cosine > 0.85 && fabs(near.length - 1) < 0.15))
            fail_msg("%d x %d, %s: of the exact loss %g, cosine %g, of the exact length %g", w, h,
                     smooth ? "smooth" : "textured", near.loss, near.cosine, near.length);
        free(x);
    }
    sg_ctx_destroy(&ctx);
}

static void test_loss(void **state)
{
    (void) state;
    enum { N = 512 };
    sg_ctx *ctx = make_context(1), *three = make_context(3);
    float *x = malloc(3 * N * N * sizeof(float)), *turned = malloc(3 * N * N * sizeof(float));
    float *g = malloc(3 * N * N * sizeof(float)), *again = malloc(3 * N * N * sizeof(float));
    for (uint64_t i = 0; i < 3 * N * N; i++)
        x[i] = draw(8, i, 0, 1);
    assert_true(loss_of(ctx, N, N, NULL, x, g) < 1e-3); /* white noise */
    loss_of(three, N, N, NULL, x, again);
    assert_memory_equal(g, again, 3 * N * N * sizeof(float));
    for (int i = 0; i < 3 * N * N;
         i++) /* across at 0.3 cycles a pixel, as near as the side allows */
        x[i] = 0.5f + 0.4f * (float) cos(6.283185307179586 * 154 / N * (i % N));
    assert_float_equal(loss_of(ctx, N, N, NULL, x, NULL), 1 - log(2) / log(36), 1e-4);
    for (int ch = 0; ch < 3; ch++)
        for (int i = 0; i < N * N; i++) {
            const float v = i % N > 200 && i % N < 260 ? draw(9, (uint64_t) (i / N), 0, 1) : 0.2f;
            x[ch * N * N + i] = turned[ch * N * N + i % N * N + (N - 1 - i / N)] = v;
        }
    assert_float_equal(loss_of(ctx, N, N, NULL, x, NULL), loss_of(ctx, N, N, NULL, turned, NULL),
                       1e-5);
    for (int i = 0; i < 3 * N * N; i++)
        x[i] = 0.3f;
    assert_true(loss_of(ctx, N, N, NULL, x, g) == 0 && g[5] == 0);
    /* The picture of `spectrum` and the loss agree. */
    uint8_t *rgb = malloc(3 * 60 * 44);
    for (int i = 0; i < 60 * 44; i++)
        for (int ch = 0; ch < 3; ch++) {
            rgb[3 * i + ch] = (uint8_t) (i * 7 % 60 * (ch + 1) + i / 60);
            x[ch * 60 * 44 + i] = (float) rgb[3 * i + ch] / 255;
        }
    struct sg_spectrum s;
    assert_int_equal(sg_spectrum_measure(ctx, rgb, 60, 44, NULL, &s, NULL), SG_OK);
    assert_float_equal(loss_of(ctx, 60, 44, NULL, x, NULL), s.anisotropy, 1e-5);
    free(rgb), free(x), free(turned), free(g), free(again);
    sg_ctx_destroy(&ctx);
    sg_ctx_destroy(&three);
}

/* An image without energy in the band, or in some directions of it, has a loss and a gradient all
 * the same: of a flat one, at sides that do not divide evenly too, nothing. */
static void test_empty(void **state)
{
    (void) state;
    static const int sizes[][2] = {{64, 64}, {37, 23}, {100, 75}, {263, 257}};
    enum { MOST = 3 * 263 * 257 };
    sg_ctx *ctx = make_context(1);
    float *x = malloc(MOST * sizeof(float)), *g = malloc(MOST * sizeof(float));
    for (int k = 0; k < 4; k++)
        for (int option = 0; option < 2; option++) {
            const int w = sizes[k][0], h = sizes[k][1], n = 3 * w * h;
            const struct sg_anisotropy_params *p =
                sg_anisotropy_params(.energy = (enum sg_energy) option);
            for (int grey = 1; grey < 4; grey++) {
                for (int i = 0; i < n; i++)
                    x[i] = 0.3f * (float) grey;
                assert_true(loss_of(ctx, w, h, p, x, g) == 0);
                for (int i = 0; i < n; i++)
                    assert_true(g[i] == 0);
            }
            for (int i = 0; i < n; i++) /* stripes */
                x[i] = i % (w * h) / w % 2 ? 0.2f : i % (w * h) / w % 4 ? 0.7f : 0.4f;
            assert_true(loss_of(ctx, w, h, p, x, g) > 0);
            for (int i = 0; i < n; i++)
                assert_true(isfinite(g[i]));
        }
    free(x), free(g);
    sg_ctx_destroy(&ctx);
}

/* Total variation: known values, and its gradient against differences. */
static void test_total_variation(void **state)
{
    (void) state;
    static const int sizes[][2] = {{37, 23}, {64, 40}, {16, 2}, {17, 3},
                                   {2, 19},  {1, 9},   {9, 1},  {2, 2}};
    enum { MOST = 3 * 64 * 40 };
    sg_ctx *ctx = make_context(2);
    float x[MOST], g[MOST];
    double rows[6 * 64];
    for (int turned = 0; turned < 2; turned++) { /* a ramp down and one across */
        const int w = turned ? 23 : 37, h = turned ? 37 : 23;
        for (int i = 0; i < 3 * 37 * 23; i++)
            x[i] = 0.01f * (float) (turned ? i % w : i % (w * h) / w);
        assert_float_equal(sg_tv_loss(ctx, x, w, h, SG_TV_PENALTY_L1, 1, NULL, rows), 0.01, 1e-6);
        assert_float_equal(sg_tv_loss(ctx, x, w, h, SG_TV_PENALTY_L2, 1, NULL, rows), 1e-4, 1e-8);
        assert_float_equal(sg_tv_loss(ctx, x, w, h, SG_TV_PENALTY_HUBER, 1, NULL, rows), 1e-4,
                           1e-8);
    }
    const float jump[] = {0,    0.5f, 0,
                          0.5f, 0,    0.5f}; /* beyond Huber's edge, from where on it is straight */
    const double edge = (double) SG_TV_EDGE;
    assert_float_equal(sg_tv_loss(ctx, jump, 2, 1, SG_TV_PENALTY_HUBER, 1, NULL, rows),
                       edge - edge * edge, 1e-6);
    for (int i = 0; i < MOST; i++)
        x[i] = draw(4, (uint64_t) i, 0, 1);
    for (int k = 0; k < 8; k++)
        for (int norm = SG_TV_PENALTY_L2; norm <= SG_TV_PENALTY_HUBER; norm++) {
            const int w = sizes[k][0], h = sizes[k][1], n = 3 * w * h;
            memset(g, 0, sizeof(g));
            sg_tv_loss(ctx, x, w, h, (enum sg_tv_penalty) norm, 3, g, rows);
            float steepest = 0;
            for (int i = 0; i < n; i++)
                steepest = fmaxf(steepest, fabsf(g[i]));
            for (int i = 0, step_of = n > 500 ? 41 : 1; i < n; i += step_of) {
                const float kept = x[i],
                            step = norm == SG_TV_PENALTY_L2 ? 0.01f : 1e-4f; /* no kink within it */
                double change = 0;
                for (int side = -1; side <= 1; side += 2) {
                    x[i] = kept + (float) side * step;
                    change += 3 * side *
                              sg_tv_loss(ctx, x, w, h, (enum sg_tv_penalty) norm, 3, NULL, rows);
                }
                x[i] = kept;
                change /= 2 * (double) step;
                if (fabs(change - (double) g[i]) > 0.01 * (double) steepest)
                    fail_msg("%d x %d, norm %d, value %d: %g, expected %g", w, h, norm, i,
                             (double) g[i], change);
            }
        }
    const float one[3] = {0.1f, 0.2f, 0.3f}; /* a single pixel varies nowhere */
    assert_true(sg_tv_loss(ctx, one, 1, 1, SG_TV_PENALTY_L2, 1, NULL, rows) == 0);
    sg_ctx_destroy(&ctx);
}

/* Both after one another, over more sizes than are remembered. */
static void test_image_losses(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_image_losses losses = {0};
    const struct sg_loss each[2] = {
        {SG_LOSS_ANISOTROPY, 2, {.anisotropy = {SG_ANISOTROPY_DEFAULTS}}},
        {SG_LOSS_TOTAL_VARIATION, 3, {.total_variation = SG_TV_PENALTY_HUBER}},
    };
    float x[3 * 400], g[3 * 400], expected[3 * 400];
    double rows[6 * 40], found[2];
    for (int i = 0; i < 3 * 400; i++)
        x[i] = draw(5, (uint64_t) i, 0, 1);
    for (int round = 0; round < 2; round++)
        for (int side = 8; side < 8 + SG_PLANS + 2; side++) {
            const int n = 3 * side * 20;
            struct sg_anisotropy *a;
            for (int i = 0; i < n; i++)
                g[i] = expected[i] = 0.5f;
            assert_int_equal(sg_anisotropy_create(ctx, side, 20, NULL, NULL, &a), SG_OK);
            const double ani = sg_anisotropy_loss(a, x, 2, expected);
            const double tv = sg_tv_loss(ctx, x, side, 20, SG_TV_PENALTY_HUBER, 3, expected, rows);
            sg_anisotropy_destroy(&a);
            for (int k = 0; k < 2; k++)
                assert_int_equal(
                    sg_image_loss(ctx, &losses, &each[k], x, side, 20, NULL, g, &found[k]), SG_OK);
            assert_true(found[0] == ani && found[1] == tv);
            assert_memory_equal(g, expected, (size_t) n * sizeof(float));
            /* Masked pixels have no gradient. */
            uint8_t mask[400];
            for (int i = 0; i < n / 3; i++)
                mask[i] = i % 3 ? 255 : 0;
            for (int i = 0; i < n; i++)
                g[i] = mask[i % (n / 3)] ? 0.5f : 0;
            for (int k = 0; k < 2; k++)
                assert_int_equal(
                    sg_image_loss(ctx, &losses, &each[k], x, side, 20, mask, g, &found[k]), SG_OK);
            for (int i = 0; i < n; i++)
                assert_true(g[i] == (mask[i % (n / 3)] ? expected[i] : 0));
        }
    sg_image_losses_clear(&losses);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Sides are checked before anything is read or planned. */
static void test_sides(void **state)
{
    (void) state;
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    static const int sides[][2] = {{0, 10}, {10, 0}, {0, 0}, {-1, 4}, {16385, 1}};
    struct sg_spectrum spectrum;
    struct sg_audit_features features;
    for (size_t i = 0; i < sizeof(sides) / sizeof(sides[0]); i++) {
        const uint8_t rgb[3] = {0};
        assert_int_equal(
            sg_spectrum_measure(ctx, rgb, sides[i][0], sides[i][1], NULL, &spectrum, NULL),
            SG_ERR_USAGE);
        assert_int_equal(
            sg_audit_measure(ctx, rgb, NULL, sides[i][0], sides[i][1], &features, NULL),
            SG_ERR_USAGE);
    }
    /* An earlier error is not taken for its own. */
    assert_null(sg_mem_alloc(ctx, SG_MEM_MISC, SIZE_MAX, 2));
    assert_int_equal(sg_audit_measure(ctx, NULL, NULL, 0, 10, &features, NULL), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "found an image of 0 x 10"));
    sg_ctx_destroy(&ctx);
}

/* What is beyond an image is not read. */
static void test_crops(void **state)
{
    (void) state;
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    enum { W = 12, H = 8 };
    uint8_t rgb[W * H * 3];
    float amplitude[W * H];
    struct sg_spectrum_image image[2] = {
        {.title = "A", .picture = {W, H, rgb}, .amplitude = amplitude},
        {.title = "B", .picture = {W - 1, H, rgb}, .amplitude = amplitude}};
    for (int i = 0; i < W * H * 3; i++)
        rgb[i] = (uint8_t) (i * i);
    assert_int_equal(sg_spectrum_measure(ctx, rgb, W, H, NULL, &image[0].spectrum, amplitude),
                     SG_OK);
    image[1].spectrum = image[0].spectrum;
    char path[] = "/tmp/sg_spectrum_XXXXXX";
    close(mkstemp(path));
    unlink(path);
    static const struct sg_spectrum_crop inside = {0, 0, W, H},
                                         outside[] = {{-1, 0, 2, 2},      {0, -1, 2, 2},
                                                      {W - 1, 0, 2, 2},   {0, H - 1, 2, 2},
                                                      {0, 0, W + 1, 2},   {0, 0, 2, H + 1},
                                                      {0, 0, -2, 2},      {0, 0, 2, 0},
                                                      {INT_MAX, 0, 2, 2}, {0, 0, INT_MAX, 2}};
    for (size_t i = 0; i < sizeof(outside) / sizeof(outside[0]); i++) {
        assert_int_equal(sg_spectrum_write_picture(ctx, path, image, 1, 1, &outside[i]),
                         SG_ERR_USAGE);
        assert_int_equal(access(path, F_OK), -1);
    }
    assert_int_equal(sg_spectrum_write_picture(ctx, path, image, 2, 1, &inside), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "within the 11 x 8 of image 1"));
    assert_int_equal(access(path, F_OK), -1);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_crops),
                                       cmocka_unit_test(test_known),
                                       cmocka_unit_test(test_whole),
                                       cmocka_unit_test(test_oracle),
                                       cmocka_unit_test(test_gradient),
                                       cmocka_unit_test(test_friendly),
                                       cmocka_unit_test(test_loss),
                                       cmocka_unit_test(test_empty),
                                       cmocka_unit_test(test_total_variation),
                                       cmocka_unit_test(test_image_losses),
                                       cmocka_unit_test(test_sides)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
