/* SPDX-License-Identifier: Apache-2.0 */
/* The audit's verdicts on sets of photos whose noise is known. */
#include "photos.h"

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
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_verdicts), cmocka_unit_test(test_spared),
                                       cmocka_unit_test(test_consistency)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
