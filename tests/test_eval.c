/* SPDX-License-Identifier: Apache-2.0 */
/* PSNR and evaluation against values worked out another way. tests/kernels/check_image.c has
 * SSIM. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "params.h"

#define EVAL_FPS (&(struct sg_eval_params){.fps = true})
#define EVAL_MATCHED (&(struct sg_eval_params){.match_colours = true})

static sg_ctx *context(int threads)
{
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads}), SG_OK);
    return ctx;
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

/* A model that is not in view renders the background, whose distance to a flat photo is known. */
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
    assert_int_equal(sg_evaluate(ctx, r, views, 2, EVAL_FPS, &e), SG_OK);
    const double off = 20 * log10(255.0 / 16);
    assert_int_equal(e.views, 2);
    assert_true(fabs(e.per_view[0].psnr - off) < 1e-9);
    assert_true(e.per_view[1].psnr == 100); /* equal images count as 100 dB */
    assert_true(fabs(e.psnr - (off + 100) / 2) < 1e-9);
    assert_true(fabs(e.per_view[1].ssim - 1) < 1e-9 && e.per_view[0].ssim < 1);
    assert_true(fabs(e.ssim - (e.per_view[0].ssim + e.per_view[1].ssim) / 2) < 1e-12);
    assert_true(e.fps > 0 && e.fps_mean > 0);
    sg_eval_clear(&e);

    /* Masked pixels do not count, however wrong they are; PSNR is that of the others. */
    uint8_t mask[24 * 20];
    for (int i = 0; i < 24 * 20; i++)
        mask[i] = i < 100 ? 0 : 255;
    memset(views[0].rgb, 0, 300);
    views[0].mask = mask;
    assert_int_equal(sg_evaluate(ctx, r, views, 1, NULL, &e), SG_OK);
    assert_true(fabs(e.psnr - off) < 1e-9);
    sg_eval_clear(&e);
    /* SSIM is that of the rectangle that is used: here the right half of the image. */
    double ssim;
    uint8_t white[12 * 20 * 3], half[12 * 20 * 3];
    memset(white, 255, sizeof(white));
    for (int i = 0; i < 24 * 20; i++) {
        mask[i] = i % 24 < 12 ? 0 : 255;
        for (int k = 0; k < 3 && i % 24 >= 12; k++)
            half[(i / 24 * 12 + i % 24 - 12) * 3 + k] = views[0].rgb[3 * i + k] =
                (uint8_t) (200 + (i * 7 + k) % 50);
    }
    assert_int_equal(sg_ssim_u8(ctx, white, half, 12, 20, &ssim), SG_OK);
    assert_int_equal(sg_evaluate(ctx, r, views, 1, NULL, &e), SG_OK);
    assert_true(fabs(e.ssim - ssim) < 1e-12);
    assert_true(fabs(e.psnr - sg_psnr_u8(white, half, 12, 20)) < 1e-9);
    sg_eval_clear(&e);
    memset(mask, 0, sizeof(mask));
    assert_int_equal(sg_evaluate(ctx, r, views, 1, NULL, &e), SG_ERR_INPUT);
    assert_int_equal(sg_evaluate(ctx, r, views, 2, NULL, &e), SG_OK);
    assert_true(isnan(e.per_view[0].psnr) && isnan(e.per_view[0].ssim));
    assert_true(e.psnr == e.per_view[1].psnr &&
                e.ssim == e.per_view[1].ssim); /* of those that are left */
    sg_eval_clear(&e);
    views[0].mask = NULL;

    assert_int_equal(sg_evaluate(ctx, r, views, 1, NULL, &e), SG_OK);
    assert_true(e.fps == 0 && e.fps_mean == 0); /* not timed */
    sg_eval_clear(&e);
    assert_int_equal(sg_evaluate(ctx, r, views, 0, NULL, &e), SG_ERR_INPUT);
    assert_null(e.per_view);

    sg_renderer_destroy(&r);
    sg_model_destroy(&m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
    free(photos);
}

/* A photo that shows the render with another contrast and brightness is the render, once colours
 * are matched, whatever is masked out. */
static void matched_colours_undo_an_exposure(void **state)
{
    (void) state;
    enum { SIDE = 40 };
    sg_ctx *ctx = context(2);
    static float rgb[3 * SIDE * SIDE];
    static uint8_t photo[3 * SIDE * SIDE], other[3 * SIDE * SIDE], mask[SIDE * SIDE];
    struct sg_view view = {.camera = {.width = SIDE,
                                      .height = SIDE,
                                      .fx = SIDE,
                                      .fy = SIDE,
                                      .cx = SIDE / 2,
                                      .cy = SIDE / 2,
                                      .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                           .rgb = photo};
    struct sg_model *m;
    sg_renderer *r;
    struct sg_eval e;
    assert_int_equal(sg_model_create(ctx, 3, 0, &m), SG_OK);
    for (size_t i = 0; i < 3; i++) {
        *sg_model_at(m, i, SG_P_XYZ) = 0.3f * (float) i - 0.3f;
        *sg_model_at(m, i, SG_P_XYZ + 2) = 2;
        *sg_model_at(m, i, SG_P_ROT) = 1;
        *sg_model_at(m, i, SG_P_OPACITY) = 2;
        for (int k = 0; k < 3; k++) {
            *sg_model_at(m, i, SG_P_SCALE + k) = -1.5f;
            *sg_model_at(m, i, SG_P_SH + k) = (float) ((i + (size_t) k) % 3) - 0.5f;
        }
    }
    assert_int_equal(sg_renderer_create(ctx, "ref", NULL, m, NULL, &r), SG_OK);
    assert_int_equal(sg_render(r, &view.camera, rgb, NULL, NULL, NULL), SG_OK);
    for (int ch = 0; ch < 3; ch++)
        for (int i = 0; i < SIDE * SIDE; i++)
            photo[3 * i + ch] =
                (uint8_t) (255 * ((0.5 + 0.1 * ch) * fmin((double) rgb[ch * SIDE * SIDE + i], 1) +
                                  0.2) +
                           0.5);
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, NULL, &e), SG_OK);
    assert_true(e.psnr < 20 && e.corrected_psnr == 0); /* not asked for */
    sg_eval_clear(&e);
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, EVAL_MATCHED, &e), SG_OK);
    assert_true(e.psnr < 20 && e.corrected_psnr > 48 && e.corrected_ssim > 0.99);
    assert_true(e.per_view[0].corrected_psnr == e.corrected_psnr);
    sg_eval_clear(&e);

    /* a photo's own map does not need the photo: here two channels mix */
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double red = (double) rgb[i], green = (double) rgb[SIDE * SIDE + i],
                     blue = (double) rgb[2 * SIDE * SIDE + i];
        const double shown[3] = {0.5 * red + 0.25 * green + 0.1, 0.2 * red + 0.5 * green, blue};
        for (int ch = 0; ch < 3; ch++)
            other[3 * i + ch] = (uint8_t) (255 * fmin(shown[ch], 1) + 0.5);
    }
    view.rgb = other;
    const float exposures[24] = {
        [0] = 1, [12 + 0] = 0.5f, 0.2f, 0, 0.1f, 0.25f, 0.5f, 0, 0, 0, 0, 1, 0};
    size_t shown_photo = 1; /* whose map is the second */
    struct sg_eval_params exposed = {.exposures = exposures, .photos = &shown_photo};
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, &exposed, &e), SG_OK);
    assert_true(e.psnr < 30 && e.corrected_psnr > 60 && e.corrected_ssim > 0.999);
    sg_eval_clear(&e);
    assert_string_equal(sg_eval_corrected_by(&exposed), "exposure");
    exposed.match_colours = true;
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, &exposed, &e), SG_ERR_USAGE);
    assert_true(e.views == 0 && !e.per_view);
    exposed.match_colours = false, shown_photo = SIZE_MAX;
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, &exposed, &e), SG_ERR_USAGE);
    assert_true(e.views == 0 && !e.per_view);
    exposed.photos = NULL;
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, &exposed, &e), SG_ERR_USAGE);
    view.rgb = photo;

    /* what a mask leaves out is not matched to */
    for (int i = 0; i < SIDE * SIDE; i++)
        mask[i] = i < SIDE * SIDE / 2;
    memset(photo + sizeof(photo) / 2, 255, sizeof(photo) / 2);
    view.mask = mask;
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, EVAL_MATCHED, &e), SG_OK);
    assert_true(e.psnr < 20 && e.corrected_psnr > 48);
    sg_eval_clear(&e);
    view.mask = NULL;

    /* a flat photo says nothing: the render stays */
    memset(photo, 100, sizeof(photo));
    assert_int_equal(sg_evaluate(ctx, r, &view, 1, EVAL_MATCHED, &e), SG_OK);
    assert_true(e.psnr == e.corrected_psnr && e.ssim == e.corrected_ssim);
    sg_eval_clear(&e);
    sg_renderer_destroy(&r);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(psnr_has_known_values),
        cmocka_unit_test(quantisation_clamps_and_rounds),
        cmocka_unit_test(evaluation_measures_a_flat_view),
        cmocka_unit_test(matched_colours_undo_an_exposure),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
