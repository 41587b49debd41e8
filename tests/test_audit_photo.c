/* SPDX-License-Identifier: Apache-2.0 */
/* What the audit measures of one photo, on images whose features are known. */
#include "photos.h"

static struct sg_audit_features measure(sg_ctx *ctx, float *map)
{
    struct sg_audit_features f;
    assert_int_equal(sg_audit_measure(ctx, image, NULL, W, H, &f, map), SG_OK);
    return f;
}

static void test_features(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    memset(image, 77, sizeof(image));
    struct sg_audit_features f = measure(ctx, NULL);
    assert_true(f.tv_down == 0 && f.osc_down == 0 && f.osc_share == 0 && f.osc_quiet == 0 &&
                f.noisy == 0);
    /* Rows that alternate by 20 levels: every inner pixel is an extreme, and all variation is
     * vertical. */
    for (int y = 0; y < H; y++)
        memset(image + 3 * W * y, y % 2 ? 110 : 90, 3 * W);
    float map[(H + 15) / 16 * ((W + 15) / 16)];
    f = measure(ctx, map);
    assert_float_equal(f.tv_down, 20, 1e-9);
    assert_float_equal(f.osc_down, 20, 1e-9);
    assert_true(f.osc_across == 0 && f.tv_across == 0 && f.osc_chroma == 0);
    assert_float_equal(f.osc_share, 20.0 / 22, 1e-3);     /* two levels more below the line */
    assert_float_equal(map[(W + 15) / 16 + 1], 10, 1e-5); /* of both directions' mean */
    assert_true(f.noisy == 1);
    assert_true(f.half_quiet == 0 && f.half_osc == 0 && f.half_share == 0 && f.quarter_osc == 0);
    /* Pairs of rows alternate at half the size, groups of four at a quarter. */
    for (int pair = 2; pair <= 4; pair += 2) {
        for (int y = 0; y < H; y++)
            memset(image + 3 * W * y, y / pair % 2 ? 110 : 90, 3 * W);
        f = measure(ctx, NULL);
        assert_true(f.osc_down == 0 && f.osc_share == 0);
        assert_float_equal(f.half_osc, pair == 2 ? 10 : 0, 1); /* less at borders */
        assert_float_equal(f.half_quiet, f.half_osc, 1);
        assert_float_equal(f.half_share, pair == 2 ? 20.0 / 22 : 0, 1e-3);
        assert_float_equal(f.quarter_osc, pair == 4 ? 10 : 0, 2);
        assert_float_equal(f.quarter_share, pair == 4 ? 20.0 / 22 : 0, 1e-3);
    }
    /* A ramp has variation and no oscillation. */
    for (int i = 0; i < 3 * W * H; i++)
        image[i] = (uint8_t) (i / 3 / W * 2);
    f = measure(ctx, NULL);
    assert_float_equal(f.tv_down, 2, 0.01);
    assert_true(f.osc_down == 0 && f.osc_share == 0);
    /* White noise has a flat spectrum, without direction, in all colours. */
    for (int i = 0; i < 3 * W * H; i++)
        image[i] = clamp(128 + 40 * (double) draw(3, (uint64_t) i, -1, 1));
    f = measure(ctx, NULL);
    assert_float_equal(f.slope, 0, 0.1);
    assert_true(f.anisotropy < 0.01 && f.osc_share > 0.6 && f.noisy == 1 && f.osc_chroma > 5);
    /* Blurred, it falls with the frequency. */
    for (int i = 0; i + 3 * W + 3 < 3 * W * H; i++)
        image[i] =
            (uint8_t) ((image[i] + image[i + 3] + image[i + 3 * W] + image[i + 3 * W + 3]) / 4);
    assert_true(measure(ctx, NULL).slope < -1);
    /* Any size. */
    for (int w = 1; w < 4; w++)
        for (int h = 1; h < 4; h++)
            assert_int_equal(sg_audit_measure(ctx, image, NULL, w, h, &f, map), SG_OK);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Steps of less than two grey levels are no oscillation, and faint ones make no block noisy. */
static void test_faint(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    for (int level = 1; level <= 4; level++) {
        for (int y = 0; y < H; y++)
            memset(image + 3 * W * y, 100 + y % 2 * level, 3 * W);
        const struct sg_audit_features f = measure(ctx, NULL);
        assert_float_equal(f.osc_down, level < 2 ? 0 : level, 1e-9);
        assert_true(f.noisy == 0); /* of both directions' mean, 2 at most */
    }
    sg_ctx_destroy(&ctx);
}

/* Red and blue differ from green in the same way; green, which is in both differences, counts
 * twice. */
static void test_colours(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    for (int ch = 0; ch < 3; ch++) {
        memset(image, 100, sizeof(image));
        for (int i = 0; i < W * H; i++)
            image[3 * i + ch] = i / W % 2 ? 110 : 90;
        assert_float_equal(measure(ctx, NULL).osc_chroma, ch == 1 ? 10 : 5, 1e-9);
    }
    sg_ctx_destroy(&ctx);
}

/* Noise is found at any size: blocks that the border cuts off do not count as quiet parts. */
static void test_sizes(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_audit_features f;
    for (int side = 33; side < 82; side++) {
        for (int i = 0; i < 3 * side * side; i++)
            image[i] = (uint8_t) (draw(5, (uint64_t) i, -1, 1) > 0 ? 136 : 120);
        assert_int_equal(sg_audit_measure(ctx, image, NULL, side, side, &f, NULL), SG_OK);
        assert_true(f.osc_quiet > 2 && f.noisy > 0.85);
    }
    sg_ctx_destroy(&ctx);
}

/* The first statistics of texture, of luma at full size. */
enum {
    ENERGY = 1,
    ENERGY_DEVIATION = 3,
    NEXT = 4,
    SECOND = 7,
    EVENNESS = 8,
    DIRECTION = 14,
    EXTREMES = 16,
    BIN = 20,
    BRIGHTNESS = 29
};

static void test_texture(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    memset(image, 77, sizeof(image));
    assert_true(measure(ctx, NULL).tiles == 0);
    /* Rows that alternate by 20 levels: all steps are of one size, and each is the opposite of the
     * one before it. */
    for (int y = 0; y < H; y++)
        memset(image + 3 * W * y, y % 2 ? 110 : 90, 3 * W);
    struct sg_audit_features f = measure(ctx, NULL);
    assert_true(f.tiles == W / 32 * ((H + 31) / 32));
    assert_float_equal(f.texture[ENERGY], log(200) / 2, 0.02);
    assert_float_equal(f.texture[ENERGY_DEVIATION], 0, 0.05);
    assert_float_equal(f.texture[NEXT], -1, 0.01);
    assert_float_equal(f.texture[SECOND], 1, 0.1);
    assert_float_equal(f.texture[EVENNESS], 0.5, 0.02); /* those across are 0 */
    assert_float_equal(f.texture[DIRECTION], log(400 / 0.25), 0.1);
    assert_float_equal(f.texture[EXTREMES], 20.0 / 21, 0.02);
    assert_float_equal(f.texture[BIN], log(0.5), 0.02); /* of no curvature, and of 40 levels */
    assert_float_equal(f.texture[BIN + 7], log(0.5), 0.02);
    /* A ramp: every step follows one like it. */
    for (int i = 0; i < 3 * W * H; i++)
        image[i] = (uint8_t) (i / 3 / W * 2);
    f = measure(ctx, NULL);
    assert_float_equal(f.texture[NEXT], 2 / 2.25, 0.02);
    assert_true(f.texture[EXTREMES] == 0);
    /* Noise that is stronger where it is brighter. */
    for (int sign = -1; sign <= 1; sign++) {
        for (int i = 0; i < 3 * W * H; i++) {
            const double level = 60 + i / 3 % W, noise = 0.1 * (sign < 0   ? 280 - level
                                                                : sign > 0 ? level
                                                                           : 150);
            image[i] = clamp(level + noise * (double) draw(3, (uint64_t) i, -1, 1));
        }
        f = measure(ctx, NULL);
        assert_true(sign ? sign * f.texture[BRIGHTNESS] > 0.8 : fabs(f.texture[BRIGHTNESS]) < 0.5);
        assert_true(f.texture[ENERGY_DEVIATION] > (sign ? 0.2 : 0) &&
                    f.texture[ENERGY_DEVIATION] < (sign ? 1 : 0.1));
        assert_float_equal(f.texture[NEXT], -0.5, 0.05);
    }
    sg_ctx_destroy(&ctx);
}

/* The last statistics, of the ranges of the channels in cells. */
enum {
    RANGE = SG_AUDIT_TEXTURE - 16,
    CLOSED = RANGE + 6,
    OPEN = CLOSED + 4,
    CLOSED_SHARE = OPEN + 3
};

/* A bound shows as half of the range on grey, and as all of it on black and on white. */
static void test_range(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    for (int base = 0; base <= 255; base += 85)
        for (int bound = 8; bound <= 24; bound += 8) {
            for (int i = 0; i < 3 * W * H; i++)
                image[i] = clamp(base + bound * (draw(3, (uint64_t) i, -1, 1) > 0 ? 1 : -1));
            const struct sg_audit_features f = measure(ctx, NULL);
            const bool closed = base == 0 || base == 255;
            const double *all = f.texture + RANGE;
            for (int k = 0; k < 13; k++)
                assert_float_equal(all[k], log(bound + 0.5), 1e-12);
            assert_float_equal(f.texture[CLOSED_SHARE], closed, 1e-12);
            /* All pixels are at an end of their cell, half of them at that which is not closed. */
            assert_float_equal(f.texture[CLOSED_SHARE + 1], closed ? 0.2 : 1, 1e-12);
            assert_float_equal(f.texture[CLOSED_SHARE + 2], closed ? 0.5 : 0.1, 0.02);
        }
    /* Half of the photo is black: each half has its own cells. Without noise there are none. */
    for (int i = 0; i < 3 * W * H; i++)
        image[i] =
            clamp((i / 3 % W < W / 2 ? 0 : 128) +
                  (i / 3 % W < W / 2 ? 8 : 16) * (draw(3, (uint64_t) i, -1, 1) > 0 ? 1 : -1));
    struct sg_audit_features f = measure(ctx, NULL);
    assert_float_equal(f.texture[CLOSED_SHARE], 0.5, 1e-12);
    assert_float_equal(f.texture[CLOSED], log(8.5), 1e-12);
    assert_float_equal(f.texture[OPEN], log(16.5), 1e-12);
    memset(image, 0, sizeof(image));
    f = measure(ctx, NULL);
    assert_true(f.texture[RANGE] == 0 && f.texture[CLOSED_SHARE] == 0);
    sg_ctx_destroy(&ctx);
}

/* Masked pixels have no effect, whatever they contain. The others count, whatever the pattern of
 * the mask. */
static void test_masks(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    static uint8_t mask[W * H];
    struct sg_audit_features whole, f;
    const size_t top =
        63; /* the border is in the middle of what become one pixel at half the size */
    paint(16, false, 1);
    assert_int_equal(sg_audit_measure(ctx, image, NULL, W, (int) top, &whole, NULL), SG_OK);
    memset(mask, 255, top * W);
    for (size_t i = 3 * W * top; i < sizeof(image); i++)
        image[i] = (uint8_t) (i / 3 % W);
    assert_int_equal(sg_audit_measure(ctx, image, NULL, W, H, &f, NULL), SG_OK);
    assert_true(f.osc_quiet < 0.2 && whole.osc_quiet > 2);
    for (int fill = 0; fill < 2; fill++) {
        assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
        assert_true(f.osc_down == whole.osc_down && f.osc_across == whole.osc_across &&
                    f.tv_down == whole.tv_down);
        assert_float_equal(f.ragged, 1.0 / (double) top, 1e-12);
        assert_true(f.content == whole.content);
        assert_true(f.half_quiet == whole.half_quiet && f.half_osc == whole.half_osc &&
                    f.half_share == whole.half_share && f.quarter_osc == whole.quarter_osc &&
                    f.quarter_share == whole.quarter_share);
        assert_true(f.osc_quiet == whole.osc_quiet && f.noisy == whole.noisy &&
                    f.osc_share == whole.osc_share && f.osc_chroma == whole.osc_chroma);
        assert_true(f.tiles == whole.tiles);
        assert_memory_equal(f.texture, whole.texture, sizeof(f.texture));
        for (size_t i = 3 * W * top; i < sizeof(image); i++)
            image[i] = (uint8_t) draw(9, i, 0, 255);
    }
    /* Every other pixel left out, and smooth: no used pixel has a used neighbour. */
    paint(16, false, 1);
    for (size_t y = 0; y < H; y++)
        for (size_t x = 0; x < W; x++) {
            mask[y * W + x] = (x + y) % 2 ? 255 : 0;
            if (!mask[y * W + x])
                memset(image + 3 * (y * W + x), 128, 3);
        }
    assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
    assert_true(f.osc_quiet > 0.7 * whole.osc_quiet && f.noisy > 0.9 * whole.noisy);
    assert_true(f.ragged ==
                1); /* a mask like this could hide more than noise, and is reported on its own */
    struct sg_view view = {
        .name = (char *) "photo", .camera = {.width = W, .height = H}, .rgb = image, .mask = mask};
    struct sg_audit *a;
    memset(image, 128, sizeof(image));
    assert_int_equal(sg_audit_scene(ctx, &(struct sg_scene){.train = &view, .n_train = 1}, &a),
                     SG_OK);
    assert_true(a->verdict == SG_AUDIT_POISONED && a->images[0].verdict == SG_AUDIT_POISONED &&
                a->count_reasons == 1);
    sg_audit_destroy(&a);
    memset(mask, 0, sizeof(mask));
    assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
    assert_true(f.tv_down == 0 && f.osc_down == 0 && f.osc_quiet == 0 && f.osc_share == 0);
    sg_ctx_destroy(&ctx);
}

/* Borders of a mask count on all four sides; content counts where it is inside. */
static void test_outlines(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    static uint8_t mask[W * H];
    struct sg_audit_features f;
    paint(16, false, 1);
    for (int side = 0; side < 4; side++) {
        size_t used = 0;
        for (int i = 0; i < W * H; i++) {
            const int at = side < 2 ? i / W : i % W;
            mask[i] = (at < 50) == side % 2 ? 255 : 0;
            used += mask[i] > 0;
        }
        assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
        assert_float_equal(f.content, used, 0);
        assert_float_equal(f.ragged, (side < 2 ? W : H) / (double) used, 1e-12);
    }
    for (int i = 0; i < W * H; i++) { /* noise only where nobody sees it */
        mask[i] = i % W % 16 < 8 ? 255 : 0;
        if (mask[i])
            memset(image + 3 * i, 90, 3);
    }
    assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
    assert_true(f.content == 0);
    sg_ctx_destroy(&ctx);
}

/* Nothing leaks, whichever allocation is refused. */
static void test_memory(void **state)
{
    (void) state;
    sg_ctx *ctx;
    static uint8_t mask[W * H];
    struct sg_audit_features f;
    int before = SG_ERR_BUDGET;
    memset(mask, 255, sizeof(mask));
    for (uint64_t limit = 1000; limit < 400000; limit += limit < 40000 ? 300 : 5000) {
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = limit}), SG_OK);
        const int code = sg_audit_measure(ctx, image, mask, 1000, 2, &f, NULL);
        assert_true(code == SG_OK || (code == SG_ERR_BUDGET && before == SG_ERR_BUDGET));
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
        before = code;
    }
    assert_int_equal(before, SG_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_features), cmocka_unit_test(test_faint),
        cmocka_unit_test(test_colours),  cmocka_unit_test(test_sizes),
        cmocka_unit_test(test_texture),  cmocka_unit_test(test_range),
        cmocka_unit_test(test_masks),    cmocka_unit_test(test_outlines),
        cmocka_unit_test(test_memory)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
