/* SPDX-License-Identifier: Apache-2.0 */
/* PSNR, SSIM and evaluation against values worked out another way. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "params.h"

static sg_ctx *context(int threads)
{
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads}), SG_OK);
    return ctx;
}

/* A smooth pattern with noise; the same seed gives the same picture. */
static uint8_t *picture(int width, int height, unsigned seed)
{
    uint8_t *p = malloc((size_t) width * (size_t) height * 3);
    for (int i = 0; i < width * height * 3; i++) {
        seed = seed * 1664525u + 1013904223u;
        p[i] = (uint8_t) (100 + 60 * sin(i / 3 % width * 0.3) + (seed >> 26));
    }
    return p;
}

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

static void psnr_has_known_values(void **state)
{
    (void) state;
    uint8_t a[4 * 5 * 3], b[4 * 5 * 3];
    memset(a, 100, sizeof(a));
    memset(b, 116, sizeof(b));
    assert_true(fabs(sg_psnr_u8(a, b, 4, 5) - 20 * log10(255.0 / 16)) < 1e-12);
    assert_true(isinf(sg_psnr_u8(a, a, 4, 5)) && sg_psnr_u8(a, a, 4, 5) > 0);
    /* One joint error, not a mean of three: all of it in one channel. */
    memcpy(b, a, sizeof(b));
    for (size_t i = 0; i < sizeof(b); i += 3)
        b[i] = 130;
    assert_true(fabs(sg_psnr_u8(a, b, 4, 5) - 10 * log10(255.0 * 255 / 300)) < 1e-12);
    memset(a, 0, sizeof(a));
    memset(b, 255, sizeof(b));
    assert_true(fabs(sg_psnr_u8(a, b, 4, 5)) < 1e-12);
}

static void ssim_agrees_with_its_definition(void **state)
{
    (void) state;
    static const int sizes[][2] = {{1, 1}, {3, 17}, {11, 11}, {40, 4}, {33, 37}};
    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++) {
        const int w = sizes[s][0], h = sizes[s][1];
        uint8_t *a = picture(w, h, 1), *b = picture(w, h, 2);
        const double expected = direct_ssim(a, b, w, h);
        double first = 0;
        for (int threads = 1; threads <= 7; threads += 3) {
            sg_ctx *ctx = context(threads);
            double got = 0, same = 0;
            assert_int_equal(sg_ssim_u8(ctx, a, b, w, h, &got), SG_OK);
            assert_int_equal(sg_ssim_u8(ctx, a, a, w, h, &same), SG_OK);
            assert_true(fabs(got - expected) < 1e-6);
            assert_true(fabs(same - 1) < 1e-9);
            if (threads == 1)
                first = got;
            assert_memory_equal(&got, &first, sizeof(got)); /* whatever the threads */
            assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
            sg_ctx_destroy(&ctx);
        }
        free(a);
        free(b);
    }
}

static void quantisation_clamps_and_rounds(void **state)
{
    (void) state;
    /* 4 x 1 pixels in planes. */
    const float planes[12] = {
        -1,           0.5f / 255 - 1e-6f, 0.5f / 255 + 1e-6f, 1,         2,    NAN,
        254.4f / 255, 254.6f / 255,       INFINITY,           -INFINITY, 0.5f, 0.25f};
    const uint8_t expected[12] = {0, 255, 255, 0, 0, 0, 1, 254, 128, 255, 255, 64};
    uint8_t got[12];
    sg_quantise(planes, 4, 1, got);
    assert_memory_equal(got, expected, sizeof(got));
}

/* A model nobody sees renders the background, whose distance to a flat photo is known. */
static void evaluation_measures_a_flat_view(void **state)
{
    (void) state;
    sg_ctx *ctx = context(2);
    struct sg_model *m;
    sg_renderer *r;
    uint8_t *photos = malloc(2 * 24 * 20 * 3);
    struct sg_view views[2];
    memset(views, 0, sizeof(views));
    for (int i = 0; i < 2; i++) {
        views[i].camera = (struct sg_camera){.width = 24,
                                             .height = 20,
                                             .fx = 20,
                                             .fy = 20,
                                             .cx = 12,
                                             .cy = 10,
                                             .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
        views[i].rgb = photos + i * 24 * 20 * 3;
        memset(views[i].rgb, i ? 255 : 239, 24 * 20 * 3);
    }
    assert_int_equal(sg_model_create(ctx, 1, 0, &m), SG_OK);
    *sg_model_at(m, 0, SG_P_XYZ + 2) = -5; /* behind the cameras */
    *sg_model_at(m, 0, SG_P_ROT) = 1;
    assert_int_equal(
        sg_renderer_create(ctx, "ref", NULL, m, sg_render_params(.background = {1, 1, 1}), &r),
        SG_OK);

    struct sg_eval e;
    assert_int_equal(sg_evaluate(ctx, r, views, 2, 1, &e), SG_OK);
    const double off = 20 * log10(255.0 / 16);
    assert_int_equal(e.views, 2);
    assert_true(fabs(e.per_view[0].psnr - off) < 1e-9);
    assert_true(e.per_view[1].psnr == 100); /* equal images count as 100 dB */
    assert_true(fabs(e.psnr - (off + 100) / 2) < 1e-9);
    assert_true(fabs(e.per_view[1].ssim - 1) < 1e-9 && e.per_view[0].ssim < 1);
    assert_true(fabs(e.ssim - (e.per_view[0].ssim + e.per_view[1].ssim) / 2) < 1e-12);
    assert_true(e.fps > 0 && e.fps_mean > 0);
    sg_eval_clear(&e);

    /* What a mask leaves out does not count, however wrong; PSNR is that of the rest. */
    uint8_t mask[24 * 20];
    for (int i = 0; i < 24 * 20; i++)
        mask[i] = i < 100 ? 0 : 255;
    memset(views[0].rgb, 0, 300);
    views[0].mask = mask;
    assert_int_equal(sg_evaluate(ctx, r, views, 1, 0, &e), SG_OK);
    assert_true(fabs(e.psnr - off) < 1e-9);
    sg_eval_clear(&e);
    memset(mask, 0, sizeof(mask));
    assert_int_equal(sg_evaluate(ctx, r, views, 1, 0, &e), SG_ERR_INPUT);
    assert_int_equal(sg_evaluate(ctx, r, views, 2, 0, &e), SG_OK);
    assert_true(isnan(e.per_view[0].psnr) && isnan(e.per_view[0].ssim));
    assert_true(e.psnr == e.per_view[1].psnr &&
                e.ssim == e.per_view[1].ssim); /* of those that are left */
    sg_eval_clear(&e);
    views[0].mask = NULL;

    assert_int_equal(sg_evaluate(ctx, r, views, 1, 0, &e), SG_OK);
    assert_true(e.fps == 0 && e.fps_mean == 0); /* not timed */
    sg_eval_clear(&e);
    assert_int_equal(sg_evaluate(ctx, r, views, 0, 0, &e), SG_ERR_INPUT);
    assert_null(e.per_view);

    sg_renderer_destroy(&r);
    sg_model_destroy(&m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
    free(photos);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(psnr_has_known_values),
        cmocka_unit_test(ssim_agrees_with_its_definition),
        cmocka_unit_test(quantisation_clamps_and_rounds),
        cmocka_unit_test(evaluation_measures_a_flat_view),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
