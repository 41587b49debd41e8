/* SPDX-License-Identifier: Apache-2.0 */
/* Losses and measures of whole images: total variation and SSIM in plain C, and anisotropy with the
 * transforms of each instruction set. */
#include "check.h"

#include "engine/ref/ref_losses.h"
#include "image/total_variation.h"
#include "spectral/anisotropy.h"

/* Values of one image by the oracle: the loss, and its gradient to `gradient`. */
static double oracle_loss(sg_ctx *ctx, const struct sg_loss *loss, const float *x, int w, int h,
                          double *gradient)
{
    double value;
    assert_int_equal(sg_ref_image_loss(ctx, loss, x, w, h, gradient, &value), SG_OK);
    return value;
}

/* The gradient was 1 before, and the loss has a weight of 3. */
static void compare(const char *what, int w, int h, double loss, double right, const float *found,
                    const double *expected)
{
    const size_t n = 3 * (size_t) w * (size_t) h;
    double largest = 0, off = 0;
    for (size_t i = 0; i < n; i++) {
        largest = fmax(largest, 3 * fabs(expected[i]));
        off = fmax(off, fabs((double) found[i] - 1 - 3 * expected[i]));
    }
    if (!(fabs(loss - right) <= 1e-5 * right + 1e-9) || !(off <= 1e-4 * largest + 3e-7))
        fail_msg("%s, %d x %d: loss %g, expected %g; gradient off by %g of %g", what, w, h, loss,
                 right, off, largest);
}

static void ones(float *p, size_t n)
{
    for (size_t i = 0; i < n; i++)
        p[i] = 1;
}

/* ---- total variation ---- */

static void compare_total_variation(const struct cpu_kernels *k)
{
    (void) k;
    static const int sizes[][2] = {{37, 23}, {64, 40}, {16, 2}, {17, 3}, {2, 19},
                                   {1, 9},   {9, 1},   {2, 2},  {1, 1}};
    enum { MOST = 3 * 64 * 40 };
    sg_ctx *ctx = make_context(2);
    float *x = random_floats(MOST, 81, 0, 1), *g = must(MOST, sizeof(float));
    double *expected = must(MOST, sizeof(double)), rows[6 * 40];
    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++)
        for (int norm = SG_TV_PENALTY_L2; norm <= SG_TV_PENALTY_HUBER; norm++) {
            const int w = sizes[s][0], h = sizes[s][1];
            const struct sg_loss loss = {
                SG_LOSS_TOTAL_VARIATION, 1, {.total_variation = (enum sg_tv_penalty) norm}};
            ones(g, MOST);
            const double found = sg_tv_loss(ctx, x, w, h, (enum sg_tv_penalty) norm, 3, g, rows);
            compare("total variation", w, h, found, oracle_loss(ctx, &loss, x, w, h, expected), g,
                    expected);
        }
    free(x), free(g), free(expected);
    sg_ctx_destroy(&ctx);
}

#define BENCH_W 160
#define BENCH_H 96
#define BENCH_VALUES (3 * BENCH_W * BENCH_H)

/* A variant's loss and gradient, or the oracle's. */
static double bench_loss(const struct sg_loss *loss, struct sg_anisotropy *plan, bool oracle)
{
    sg_ctx *ctx = make_context(1);
    float *x = random_floats(BENCH_VALUES, 82, 0, 1), *g = must(BENCH_VALUES, sizeof(float));
    double *expected = must(BENCH_VALUES, sizeof(double)), rows[6 * BENCH_H];
    struct timing t = {0};
    ones(g, BENCH_VALUES);
    while (timing_again(&t))
        if (oracle)
            oracle_loss(ctx, loss, x, BENCH_W, BENCH_H, expected);
        else if (plan)
            sg_anisotropy_loss(plan, x, 1, g);
        else
            sg_tv_loss(ctx, x, BENCH_W, BENCH_H, loss->total_variation, 1, g, rows);
    free(x), free(g), free(expected);
    sg_ctx_destroy(&ctx);
    return timing_result(&t, BENCH_W * BENCH_H);
}

static double bench_total_variation(const struct cpu_kernels *k)
{
    const struct sg_loss loss = {
        SG_LOSS_TOTAL_VARIATION, 1, {.total_variation = SG_TV_PENALTY_HUBER}};
    return bench_loss(&loss, NULL, !k);
}

/* ---- anisotropy ---- */

static void compare_anisotropy(const struct cpu_kernels *k)
{
    static const int sizes[][2] = {{12, 9}, {13, 11}, {40, 33}, {5, 521}, {263, 12}, {96, 64}};
    sg_ctx *ctx = make_context(2);
    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++) {
        const int w = sizes[s][0], h = sizes[s][1];
        const size_t n = 3 * (size_t) w * (size_t) h;
        const struct sg_loss loss = {
            SG_LOSS_ANISOTROPY, 1, {.anisotropy = sg_anisotropy_params_default()}};
        struct sg_anisotropy *plan;
        float *x = random_floats(n, 83, 0, 1), *g = must(n, sizeof(float));
        double *expected = must(n, sizeof(double));
        for (size_t i = 0; i < n; i++) /* some structure, so that the loss is not about 0 */
            x[i] *= i % 3 ? 0.3f : 1;
        ones(g, n);
        assert_int_equal(sg_anisotropy_create(ctx, w, h, &loss.anisotropy, &k->fft, &plan), SG_OK);
        const double found = sg_anisotropy_loss(plan, x, 3, g);
        compare(k->name, w, h, found, oracle_loss(ctx, &loss, x, w, h, expected), g, expected);
        sg_anisotropy_destroy(&plan);
        free(x), free(g), free(expected);
    }
    sg_ctx_destroy(&ctx);
}

static double bench_anisotropy(const struct cpu_kernels *k)
{
    const struct sg_loss loss = {
        SG_LOSS_ANISOTROPY, 1, {.anisotropy = sg_anisotropy_params_default()}};
    sg_ctx *ctx = make_context(1);
    struct sg_anisotropy *plan;
    assert_int_equal(
        sg_anisotropy_create(ctx, BENCH_W, BENCH_H, &loss.anisotropy, k ? &k->fft : NULL, &plan),
        SG_OK);
    const double time = bench_loss(&loss, plan, !k);
    sg_anisotropy_destroy(&plan);
    sg_ctx_destroy(&ctx);
    return time;
}

/* ---- SSIM ---- */

static double at(const uint8_t *p, int width, int height, int x, int y, int ch)
{
    return x < 0 || y < 0 || x >= width || y >= height ? 0 : p[3 * (y * width + x) + ch] / 255.0;
}

/* The definition, position by position with the two-dimensional window. */
static double direct_ssim(const uint8_t *a, const uint8_t *b, int width, int height)
{
    double window[11], total = 0, sum = 0;
    for (int k = 0; k < 11; k++)
        total += window[k] = exp(-(k - 5) * (k - 5) / 4.5);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            for (int ch = 0; ch < 3; ch++) {
                double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
                for (int j = 0; j < 11; j++)
                    for (int i = 0; i < 11; i++) {
                        const double w = window[i] * window[j] / (total * total);
                        const double u = at(a, width, height, x + i - 5, y + j - 5, ch);
                        const double v = at(b, width, height, x + i - 5, y + j - 5, ch);
                        ma += w * u, mb += w * v, aa += w * u * u, bb += w * v * v, ab += w * u * v;
                    }
                sum += (2 * ma * mb + 1e-4) * (2 * (ab - ma * mb) + 9e-4) /
                       ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
            }
    return sum / (width * height * 3);
}

/* A photo of noise, the second near the first. */
static uint8_t *noise(size_t n, uint64_t seed)
{
    uint8_t *p = must(n, 1);
    for (size_t i = 0; i < n; i++)
        p[i] = (uint8_t) (draw(84, i, 0, 200) + draw(seed, i, 0, 55.9f));
    return p;
}

static void compare_ssim(const struct cpu_kernels *k)
{
    (void) k;
    static const int sizes[][2] = {{1, 1}, {3, 17}, {11, 11}, {40, 4}, {33, 37}};
    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++) {
        const int w = sizes[s][0], h = sizes[s][1];
        const size_t n = 3 * (size_t) w * (size_t) h;
        uint8_t *a = noise(n, 85), *b = noise(n, 86);
        const double expected = direct_ssim(a, b, w, h);
        double first = 0;
        for (int threads = 1; threads <= 7; threads += 3) {
            sg_ctx *ctx = make_context(threads);
            double found = 0, same = 0;
            assert_int_equal(sg_ssim_u8(ctx, a, b, w, h, &found), SG_OK);
            assert_int_equal(sg_ssim_u8(ctx, a, a, w, h, &same), SG_OK);
            assert_float_equal(found, expected, 1e-6);
            assert_float_equal(same, 1, 1e-9);
            if (threads == 1)
                first = found;
            assert_memory_equal(&found, &first, sizeof(found)); /* whatever the threads */
            assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
            sg_ctx_destroy(&ctx);
        }
        free(a), free(b);
    }
}

static double bench_ssim(const struct cpu_kernels *k)
{
    sg_ctx *ctx = make_context(1);
    uint8_t *a = noise(BENCH_VALUES, 85), *b = noise(BENCH_VALUES, 86);
    struct timing t = {0};
    volatile double sink = 0;
    double found = 0;
    while (timing_again(&t))
        if (k)
            sg_ssim_u8(ctx, a, b, BENCH_W, BENCH_H, &found);
        else
            sink = direct_ssim(a, b, BENCH_W, BENCH_H);
    (void) sink;
    free(a), free(b);
    sg_ctx_destroy(&ctx);
    return timing_result(&t, BENCH_W * BENCH_H);
}

const struct kernel_check check_total_variation = {"total_variation", "pixel", true,
                                                   compare_total_variation, bench_total_variation};
const struct kernel_check check_anisotropy = {"anisotropy", "pixel", false, compare_anisotropy,
                                              bench_anisotropy};
const struct kernel_check check_ssim = {"ssim", "pixel", true, compare_ssim, bench_ssim};
