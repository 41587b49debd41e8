/* SPDX-License-Identifier: Apache-2.0 */
/* The photometric loss and its gradient, by rows as the engine calls it. */
#include "math/real_f64.h"

#include "check.h"
#include "math/photometric.h"

struct exact_loss {
    double l1, mse, ssim, *gradient;
};

static double window(int i, int j)
{
    return (double) sg_ssim_window[i + SG_SSIM_RADIUS] *
           (double) sg_ssim_window[j + SG_SSIM_RADIUS];
}

static struct exact_loss exact(const float *rgb, const uint8_t *target, const uint8_t *used, int w,
                               int h, double lambda)
{
    const size_t n = (size_t) w * (size_t) h;
    struct exact_loss o = {.gradient = calloc(3 * n, sizeof(double))};
    double *maps = malloc(3 * n * sizeof(double)), *y = malloc(n * sizeof(double));
    assert_true(o.gradient && maps && y);
    for (size_t ch = 0; ch < 3; ch++) {
        const float *x = rgb + ch * n;
        for (size_t i = 0; i < n; i++) {
            y[i] = used && !used[i] ? (double) x[i] : target[3 * i + ch] / 255.0;
            o.l1 += fabs((double) x[i] - y[i]);
            o.mse += ((double) x[i] - y[i]) * ((double) x[i] - y[i]);
        }
        for (int at = 0; at < w * h; at++) {
            double m[5] = {0};
            for (int j = -5; j <= 5; j++)
                for (int i = -5; i <= 5; i++) {
                    const int c = at % w + i, r = at / w + j;
                    if (c < 0 || c >= w || r < 0 || r >= h)
                        continue;
                    const double a = (double) x[r * w + c], b = y[r * w + c], k = window(i, j);
                    m[0] += k * a, m[1] += k * b, m[2] += k * a * a, m[3] += k * b * b,
                        m[4] += k * a * b;
                }
            const struct ssim s = ssim_point(m[0], m[1], m[2] + m[3], m[4]);
            o.ssim += s.s;
            maps[3 * at] = s.d_m, maps[3 * at + 1] = s.d_xx, maps[3 * at + 2] = s.d_xy;
        }
        for (int at = 0; at < w * h; at++) {
            double s[3] = {0};
            for (int j = -5; j <= 5; j++)
                for (int i = -5; i <= 5; i++) {
                    const int c = at % w + i, r = at / w + j;
                    for (int k = 0; k < 3 && c >= 0 && c < w && r >= 0 && r < h; k++)
                        s[k] += window(i, j) * maps[3 * (r * w + c) + k];
                }
            const double a = (double) x[at], ds = s[0] + 2 * a * s[1] + y[at] * s[2];
            if (!used || used[at])
                o.gradient[ch * n + (size_t) at] =
                    ((1 - lambda) * ((a > y[at]) - (a < y[at])) - lambda * ds) / (3 * (double) n);
        }
    }
    o.l1 /= 3 * (double) n, o.mse /= 3 * (double) n, o.ssim /= 3 * (double) n;
    free(maps);
    free(y);
    return o;
}

static void check_size(const struct cpu_kernels *k, int w, int h, int rows, bool masked,
                       float lambda, bool same)
{
    const size_t n = (size_t) w * (size_t) h;
    float *rgb = malloc(3 * n * sizeof(float)), *gradient = malloc(3 * n * sizeof(float));
    float *scratch = malloc(CPU_LOSS_SCRATCH((size_t) w) * sizeof(float));
    double *sums = malloc(9 * (size_t) h * sizeof(double));
    uint8_t *target = malloc(3 * n), *used = malloc(n);
    assert_true(rgb && gradient && scratch && sums && target && used);
    for (size_t i = 0; i < CPU_LOSS_SCRATCH((size_t) w); i++)
        scratch[i] = NAN; /* must not be read unwritten */
    for (size_t i = 0; i < n; i++) {
        used[i] = draw(3, i, 0, 1) < 0.7f ? 255 : 0;
        for (size_t ch = 0; ch < 3; ch++) {
            target[3 * i + ch] = (uint8_t) draw(1, 3 * i + ch, 0, 255.9f);
            rgb[ch * n + i] = same ? (float) target[3 * i + ch] * (1.0f / 255.0f)
                                   : draw(2, 3 * i + ch, -0.2f, 1.3f);
        }
    }
    const struct sg_photometric p = {.lambda_dssim = lambda};
    const struct sg_target_pixels t = {.rgb = target, .mask = masked ? used : NULL};
    const struct cpu_loss_args a = {.width = w,
                                    .height = h,
                                    .rgb = rgb,
                                    .target = &t,
                                    .params = &p,
                                    .gradient = gradient,
                                    .sums = sums};
    for (int ch = 0; ch < 3; ch++)
        for (int y = 0; y < h; y += rows)
            k->loss(&a, ch, y, y + rows < h ? y + rows : h, scratch);
    float *whole = malloc(3 * n * sizeof(float));
    double *whole_sums = malloc(9 * (size_t) h * sizeof(double));
    assert_true(whole && whole_sums);
    struct cpu_loss_args all = a;
    all.gradient = whole, all.sums = whole_sums;
    for (int ch = 0; ch < 3; ch++)
        k->loss(&all, ch, 0, h, scratch);
    assert_memory_equal(gradient, whole,
                        3 * n * sizeof(float)); /* however the rows are dealt out */
    assert_memory_equal(sums, whole_sums, 9 * (size_t) h * sizeof(double));
    double l1 = 0, mse = 0, ssim = 0;
    for (int i = 0; i < 3 * h; i++)
        l1 += sums[3 * i], mse += sums[3 * i + 1], ssim += sums[3 * i + 2];
    l1 /= 3 * (double) n, mse /= 3 * (double) n, ssim /= 3 * (double) n;
    struct exact_loss e = exact(rgb, target, t.mask, w, h, (double) lambda);
    const double unit = 1 / (3 * (double) n);
    assert_float_equal(l1, e.l1, 1e-6);
    assert_float_equal(mse, e.mse, 1e-6);
    assert_float_equal(ssim, e.ssim, 2e-5);
    if (same)
        assert_true(fabs(ssim - 1) < 1e-5 && l1 == 0 && mse == 0);
    for (size_t i = 0; i < 3 * n; i++) {
        const double expected = same ? 0 : e.gradient[i], found = (double) gradient[i];
        /* In single precision the moments of equal images cancel to 1e-7 / C2. */
        if (!(fabs(found - expected) <=
              unit * (double) lambda * (same ? 2e-3 : 1e-3) + 1e-6 * fabs(expected)))
            fail_msg("%s, %d x %d%s: image gradient %zu: found %.9g, expected %.9g", k->name, w, h,
                     masked ? ", masked" : "", i, found, expected);
        if (masked && !used[i % n])
            assert_true(gradient[i] == 0);
    }
    void *owned[] = {rgb, gradient, scratch, whole, whole_sums, sums, target, used, e.gradient};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        free(owned[i]);
}

static void compare_loss(const struct cpu_kernels *k)
{
    static const int sizes[][2] = {{1, 1},   {3, 40},  {40, 2},  {16, 16},
                                   {17, 33}, {31, 15}, {64, 12}, {530, 99}};
    for (int s = 0; s < 8; s++)
        for (int masked = 0; masked < 2; masked++) {
            check_size(k, sizes[s][0], sizes[s][1], 23, masked, 0.2f, false);
            check_size(k, sizes[s][0], sizes[s][1], sizes[s][1], masked, 1, false);
            check_size(k, sizes[s][0], sizes[s][1], 5, masked, 0.2f, true);
        }
}

static double bench(const struct cpu_kernels *k)
{
    enum { W = 320, H = 64, PIXELS = W * H };
    float *rgb = random_floats(3 * PIXELS, 2, 0, 1), *gradient = must(3 * PIXELS, sizeof(float)),
          *scratch = must(CPU_LOSS_SCRATCH(W), sizeof(float));
    double *sums = must(9 * H, sizeof(double));
    uint8_t *target = must(3 * PIXELS, 1);
    for (size_t i = 0; i < 3 * PIXELS; i++)
        target[i] = (uint8_t) draw(1, i, 0, 255.9f);
    const struct sg_photometric p = {.lambda_dssim = 0.2f};
    const struct sg_target_pixels t = {.rgb = target};
    const struct cpu_loss_args a = {.width = W,
                                    .height = H,
                                    .rgb = rgb,
                                    .target = &t,
                                    .params = &p,
                                    .gradient = gradient,
                                    .sums = sums};
    struct timing timing = {0};
    while (timing_again(&timing))
        if (k)
            for (int ch = 0; ch < 3; ch++)
                k->loss(&a, ch, 0, H, scratch);
        else
            free(exact(rgb, target, NULL, W, H, 0.2).gradient);
    free(rgb), free(gradient), free(scratch), free(sums), free(target);
    return timing_result(&timing, PIXELS);
}

const struct kernel_check check_loss = {"loss", "pixel", false, compare_loss, bench};
