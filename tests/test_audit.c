/* SPDX-License-Identifier: Apache-2.0 */
/* The audit on images whose features are known. */
#include "models.h"

#define W 160
#define H 112

static uint8_t image[3 * W * H];

static uint8_t clamp(double v)
{
    return (uint8_t) (v < 0 ? 0 : v > 255 ? 255 : v + 0.5);
}

/* Smooth shading with a few edges, and `noise` grey levels on top: in rows only, or in every pixel. */
static void paint(double noise, bool rows, uint64_t seed)
{
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int ch = 0; ch < 3; ch++) {
                const double base = 90 + 40 * sin(x * 0.05 + ch) + 30 * cos(y * 0.04) + (x / 40 + y / 30) % 2 * 30;
                const uint64_t at = rows ? (uint64_t) y : (uint64_t) ((y * W + x) * 3 + ch);
                const double sign = draw(seed, at, -1, 1) > 0 ? 1 : -1;
                image[3 * (y * W + x) + ch] = clamp(base + noise * (rows ? y % 2 ? 1 : -1 : sign));
            }
}

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
    assert_true(f.tv_down == 0 && f.osc_down == 0 && f.osc_share == 0 && f.osc_quiet == 0 && f.noisy == 0);
    /* Rows that alternate by 20 levels: every inner pixel is an extreme, all variation is in them, none across. */
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
    /* Pairs of rows do so at half the size, fours at a quarter. */
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
    /* Any size. */
    for (int w = 1; w < 4; w++)
        for (int h = 1; h < 4; h++)
            assert_int_equal(sg_audit_measure(ctx, image, NULL, w, h, &f, map), SG_OK);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Noise is told at any size: blocks that the border cuts off do not pass for quiet parts. */
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

/* What a mask leaves out is not seen, whatever is in it; what it leaves in is, whatever its pattern. */
static void test_masks(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    static uint8_t mask[W * H];
    struct sg_audit_features whole, f;
    const size_t top = 64;
    paint(16, false, 1);
    assert_int_equal(sg_audit_measure(ctx, image, NULL, W, (int) top, &whole, NULL), SG_OK);
    memset(mask, 255, top * W);
    for (size_t i = 3 * W * top; i < sizeof(image); i++)
        image[i] = (uint8_t) (i / 3 % W);
    assert_int_equal(sg_audit_measure(ctx, image, NULL, W, H, &f, NULL), SG_OK);
    assert_true(f.osc_quiet < 0.2 && whole.osc_quiet > 2);
    for (int fill = 0; fill < 2; fill++) {
        assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
        assert_true(f.osc_down == whole.osc_down && f.osc_across == whole.osc_across && f.tv_down == whole.tv_down);
        assert_true(f.ragged > 0 && f.ragged < 0.05);
        assert_true(f.half_quiet == whole.half_quiet && f.half_osc == whole.half_osc &&
                    f.half_share == whole.half_share && f.quarter_osc == whole.quarter_osc &&
                    f.quarter_share == whole.quarter_share);
        assert_true(f.osc_quiet == whole.osc_quiet && f.noisy == whole.noisy && f.osc_share == whole.osc_share &&
                    f.osc_chroma == whole.osc_chroma);
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
    assert_true(f.ragged == 1); /* which could hide more than this noise, and is told by itself */
    struct sg_view view = {.name = (char *) "photo", .camera = {.width = W, .height = H}, .rgb = image, .mask = mask};
    struct sg_audit *a;
    memset(image, 128, sizeof(image));
    assert_int_equal(sg_audit_scene(ctx, &(struct sg_scene){.train = &view, .n_train = 1}, &a), SG_OK);
    assert_true(a->verdict == SG_AUDIT_POISONED && a->images[0].verdict == SG_AUDIT_POISONED && a->count_reasons == 1);
    sg_audit_destroy(ctx, &a);
    memset(mask, 0, sizeof(mask));
    assert_int_equal(sg_audit_measure(ctx, image, mask, W, H, &f, NULL), SG_OK);
    assert_true(f.tv_down == 0 && f.osc_down == 0 && f.osc_quiet == 0 && f.osc_share == 0);
    sg_ctx_destroy(&ctx);
}

#define MOST 80

/* Noise of each photo; -1: nothing in it, -2: a single pixel. */
static struct sg_audit *audit(sg_ctx *ctx, const double *noise, int n, bool rows)
{
    struct sg_view views[MOST];
    struct sg_audit *a;
    for (int i = 0; i < n; i++) {
        paint(noise[i], rows, (uint64_t) i);
        if (noise[i] < 0)
            memset(image, 90, sizeof(image));
        if (noise[i] < -1)
            memset(image + 3 * (W * H / 2 + W / 2), 91, 3);
        views[i] = (struct sg_view){.name = (char *) "photo", .camera = {.width = W, .height = H}};
        views[i].rgb = malloc(sizeof(image));
        memcpy(views[i].rgb, image, sizeof(image));
    }
    const struct sg_scene scene = {.train = views, .n_train = (size_t) n};
    assert_int_equal(sg_audit_scene(ctx, &scene, &a), SG_OK);
    for (int i = 0; i < n; i++)
        free(views[i].rgb);
    assert_int_equal(a->count, n);
    assert_int_equal(a->verdicts[0] + a->verdicts[1] + a->verdicts[2], n);
    return a;
}

static void test_verdicts(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    static const double levels[] = {0, 1, 4, 8, 16};
    for (int rows = 0; rows < 2; rows++) {
        double before = -1;
        for (int k = 0; k < 5; k++) {
            struct sg_audit *a = audit(ctx, (double[]){levels[k], levels[k], levels[k]}, 3, rows);
            assert_true(a->score >= before - 0.05); /* the more noise the worse */
            before = a->score;
            if (levels[k] <= !rows) /* rows that alternate are odd even where they are faint */
                assert_true(a->verdict == SG_AUDIT_CLEAN && a->count_reasons == 0);
            if (levels[k] >= 8) /* 4 is what cameras do in the dark, and makes models smaller */
                assert_true(a->verdict == SG_AUDIT_POISONED);
            assert_true((a->verdict == SG_AUDIT_CLEAN) == (a->count_reasons == 0));
            sg_audit_destroy(ctx, &a);
        }
    }
    /* Two of twelve: each is found, and the set is not called clean. */
    double few[12] = {0};
    few[3] = few[8] = 16;
    struct sg_audit *a = audit(ctx, few, 12, false);
    for (int i = 0; i < 12; i++)
        assert_int_equal(a->images[i].verdict, few[i] > 0 ? SG_AUDIT_POISONED : SG_AUDIT_CLEAN);
    assert_int_equal(a->verdict, SG_AUDIT_SUSPICIOUS);
    assert_int_equal(a->count_reasons, 1);
    assert_string_equal(a->reasons[0], "2 of the 12 photos look poisoned");
    sg_audit_destroy(ctx, &a);
    /* Five of twelve decide. */
    for (int i = 0; i < 10; i += 2)
        few[i] = 16;
    a = audit(ctx, few, 12, false);
    assert_int_equal(a->verdict, SG_AUDIT_POISONED);
    sg_audit_destroy(ctx, &a);
    /* Three in sixty are enough where there is no doubt of them, and one in sixty not to be called clean. */
    double crowd[MOST] = {16, 16, 16};
    a = audit(ctx, crowd, 60, false);
    assert_int_equal(a->verdict, SG_AUDIT_POISONED);
    sg_audit_destroy(ctx, &a);
    crowd[1] = crowd[2] = 0;
    a = audit(ctx, crowd, 60, false);
    assert_int_equal(a->verdict, SG_AUDIT_SUSPICIOUS);
    sg_audit_destroy(ctx, &a);
    /* Photos with nothing in them do not vote, a single pixel in them hardly. */
    for (int i = 0; i < MOST; i++)
        crowd[i] = i < 8 ? 7 : -1;
    struct sg_audit *b = audit(ctx, crowd, MOST, false);
    a = audit(ctx, crowd, 8, false);
    assert_float_equal(a->score, b->score, 0);
    sg_audit_destroy(ctx, &b);
    for (int i = 8; i < MOST; i++)
        crowd[i] = -2;
    b = audit(ctx, crowd, MOST, false);
    assert_float_equal(a->score, b->score, 0.05);
    assert_int_equal(a->verdict, b->verdict);
    sg_audit_destroy(ctx, &a);
    sg_audit_destroy(ctx, &b);
    for (int i = 0; i < MOST; i++)
        crowd[i] = -1;
    a = audit(ctx, crowd, MOST, false);
    assert_true(a->verdict == SG_AUDIT_CLEAN && a->score == 0);
    sg_audit_destroy(ctx, &a);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Parts of a photo that an attacker spares, side by side or here and there, smooth or not, do not hide the others. */
static void test_spared(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    static uint8_t clean[sizeof(image)];
    struct sg_view view = {.name = (char *) "photo", .camera = {.width = W, .height = H}, .rgb = image};
    for (int scattered = 0; scattered < 2; scattered++)
        for (int smooth = 0; smooth < 2; smooth++) {
            double before = 1;
            for (int spared = 0; spared <= 10; spared++) { /* tenths */
                struct sg_audit *a;
                paint(0, false, 1);
                memcpy(clean, image, sizeof(clean));
                paint(16, false, 1);
                for (int i = 0; i < W * H; i++) {
                    const int x = i % W, y = i / W;
                    const int place = scattered ? (x / 16 * 7 + y / 16 * 3) % 10 : 10 * x / W;
                    if (place < spared && smooth)
                        memset(image + 3 * i, 100 + x % W / 16 + y / 16, 3);
                    else if (place < spared)
                        memcpy(image + 3 * i, clean + 3 * i, 3);
                }
                assert_int_equal(sg_audit_scene(ctx, &(struct sg_scene){.train = &view, .n_train = 1}, &a), SG_OK);
                assert_true(a->score <= before + 1e-3 || spared > 8); /* where what is left is a border */
                assert_true(spared > 5 || a->verdict == SG_AUDIT_POISONED);
                assert_true(spared < 10 || a->verdict == SG_AUDIT_CLEAN);
                before = a->score;
                sg_audit_destroy(ctx, &a);
            }
        }
    sg_ctx_destroy(&ctx);
}

/* Photos that oscillate alike are more suspicious than those that differ, but that alone decides little. */
static void test_consistency(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    double alike[12], different[12];
    for (int i = 0; i < 12; i++)
        alike[i] = 7, different[i] = 7 + (i % 3 - 1) * 3;
    struct sg_audit *a = audit(ctx, alike, 12, false), *b = audit(ctx, different, 12, false);
    struct sg_audit *few = audit(ctx, alike, 3, false);
    const double x = log(a->score / (1 - a->score)), y = log(b->score / (1 - b->score)),
                 z = log(few->score / (1 - few->score));
    double lowest = 1, highest = 0;
    for (int i = 0; i < 12; i++)
        lowest = fmin(lowest, b->images[i].score), highest = fmax(highest, b->images[i].score);
    assert_true(x > z + 0.5 && x < z + 1.5); /* of few photos nothing is said */
    /* Nothing is won by making a third of them differ: half of the photos decide, or the worst quarter less 1. */
    assert_true(y > log(lowest / (1 - lowest)) + 0.1 && fabs(y - log(highest / (1 - highest)) + 1) < 0.2);
    bool said = false;
    for (size_t i = 0; i < a->count_reasons; i++)
        said |= !!strstr(a->reasons[i], "oscillate alike");
    assert_true(said);
    sg_audit_destroy(ctx, &a);
    sg_audit_destroy(ctx, &b);
    sg_audit_destroy(ctx, &few);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_features), cmocka_unit_test(test_sizes),
                                       cmocka_unit_test(test_masks),    cmocka_unit_test(test_verdicts),
                                       cmocka_unit_test(test_spared),   cmocka_unit_test(test_consistency)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
