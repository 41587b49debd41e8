/* SPDX-License-Identifier: Apache-2.0 */
/* The audit's verdicts on sets of photos whose noise is known. */
#include "photos.h"
#include "races.h"

#define MOST 101

/* Noise of each photo; -1: nothing in it, -2: a single pixel. */
static struct sg_audit *audit(sg_ctx *ctx, const double *noise, int n, bool rows)
{
    struct sg_view views[MOST];
    struct sg_audit *a;
    for (int i = 0; i < n; i++) {
        if (i == 0 || noise[i] > 0 || noise[i] != noise[i - 1]) /* else it is the same again */
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
    for (int i = 0; i < n; i++)
        assert_string_equal(a->images[i].name, "photo");
    assert_int_equal(a->verdicts[0] + a->verdicts[1] + a->verdicts[2], n);
    assert_int_equal(a->verdicts[SG_AUDIT_UNSEEN], 0);
    return a;
}

static double logit(double p)
{
    return log(p / (1 - p));
}

static bool says(const struct sg_audit *a, const char *words)
{
    for (size_t i = 0; i < a->count_reasons; i++)
        if (strstr(a->reasons[i], words))
            return true;
    return false;
}

/* The logits of known noise with the fitted weights, so that no change of the weights stays
 * unnoticed. After a new fit (bench/audit_fit.py) put the logits of the failures here, and the
 * report into bench/results/audit.md. */
static void test_scores(void **state)
{
    (void) state;
    skip_without_races();
    sg_ctx *ctx = make_context(1);
    static const double expected[2][9] = {
        /* of noise 0 to 8: in every pixel, in rows */
        {-10.26, -8.77, -6.76, -2.89, -1.51, -0.48, 0.11, 0.62, 0.89},
        {-10.26, -9.95, -1.81, 6.38, 13.32, 14.99, 16.32, 17.41, 18.33}};
    for (int rows = 0; rows < 2; rows++)
        for (int k = 0; k < 9; k++) {
            struct sg_audit *a = audit(ctx, (double[]){k}, 1, rows);
            const double score = a->images[0].score;
            assert_float_equal(logit(score), expected[rows][k], 0.01);
            const int verdict = score < 0.6   ? SG_AUDIT_CLEAN
                                : score < 0.9 ? SG_AUDIT_SUSPICIOUS
                                              : SG_AUDIT_POISONED;
            assert_int_equal(a->images[0].verdict, verdict);
            sg_audit_destroy(&a);
        }
    sg_ctx_destroy(&ctx);
}

/* A photo that is turned by 90 degrees has the same score, with rows and columns exchanged. */
static void test_turned(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    static uint8_t square[2][3 * H * H];
    for (int noise = 0; noise <= 8; noise += 4) {
        struct sg_audit *a[2];
        paint(noise, true, 1);
        for (int y = 0; y < H; y++)
            for (int x = 0; x < H; x++) {
                memcpy(square[0] + 3 * (y * H + x), image + 3 * (y * W + x), 3);
                memcpy(square[1] + 3 * (x * H + y), image + 3 * (y * W + x), 3);
            }
        for (int k = 0; k < 2; k++) {
            struct sg_view view = {
                .name = (char *) "photo", .camera = {.width = H, .height = H}, .rgb = square[k]};
            assert_int_equal(
                sg_audit_scene(ctx, &(struct sg_scene){.train = &view, .n_train = 1}, &a[k]),
                SG_OK);
        }
        const struct sg_audit_features *f = &a[0]->images[0].features,
                                       *g = &a[1]->images[0].features;
        assert_float_equal(a[0]->score, a[1]->score, 1e-9);
        assert_true(f->osc_down == g->osc_across && f->osc_across == g->osc_down &&
                    f->tv_down == g->tv_across);
        assert_int_equal(a[0]->count_reasons, a[1]->count_reasons);
        for (int k = 0; k < 2; k++) {
            assert_true(says(a[k], "rows oscillate by") == (noise > 0));
            sg_audit_destroy(&a[k]);
        }
    }
    sg_ctx_destroy(&ctx);
}

static void test_verdicts(void **state)
{
    (void) state;
    skip_without_races();
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
            if (levels[k] >= 8) /* noise in every pixel may also come from a camera in the dark */
                assert_true(rows ? a->verdict == SG_AUDIT_POISONED : a->verdict != SG_AUDIT_CLEAN);
            assert_true((a->verdict == SG_AUDIT_CLEAN) == (a->count_reasons == 0));
            sg_audit_destroy(&a);
        }
    }
    /* Two of twelve: each is found, and the set is not called clean. */
    double few[12] = {0};
    few[3] = few[8] = 16;
    struct sg_audit *a = audit(ctx, few, 12, true);
    for (int i = 0; i < 12; i++)
        assert_int_equal(a->images[i].verdict, few[i] > 0 ? SG_AUDIT_POISONED : SG_AUDIT_CLEAN);
    assert_int_equal(a->verdict, SG_AUDIT_SUSPICIOUS);
    assert_int_equal(a->count_reasons, 1);
    assert_string_equal(a->reasons[0], "2 of the 12 photos look poisoned");
    sg_audit_destroy(&a);
    /* Five of twelve decide. */
    for (int i = 0; i < 10; i += 2)
        few[i] = 16;
    a = audit(ctx, few, 12, true);
    assert_int_equal(a->verdict, SG_AUDIT_POISONED);
    sg_audit_destroy(&a);
    /* One of ten is enough that a set is not called clean, even where its score is not certain. */
    for (int n = 10; n <= 11; n++) {
        a = audit(ctx, (double[11]){20}, n, false);
        assert_true(a->images[0].verdict == SG_AUDIT_POISONED && a->images[0].score < 0.99);
        assert_int_equal(a->verdict, n == 10 ? SG_AUDIT_SUSPICIOUS : SG_AUDIT_CLEAN);
        sg_audit_destroy(&a);
    }
    /* Three of sixty decide where their scores are certain; then one of a hundred is not called
     * clean either. */
    double crowd[MOST] = {16, 16, 16};
    for (int n = 60; n <= 61; n++) {
        a = audit(ctx, crowd, n, true);
        assert_int_equal(a->verdict, n == 60 ? SG_AUDIT_POISONED : SG_AUDIT_SUSPICIOUS);
        sg_audit_destroy(&a);
    }
    crowd[1] = crowd[2] = 0;
    for (int n = 100; n <= 101; n++) {
        a = audit(ctx, crowd, n, true);
        assert_int_equal(a->verdict, n == 100 ? SG_AUDIT_SUSPICIOUS : SG_AUDIT_CLEAN);
        sg_audit_destroy(&a);
    }
    /* Photos with nothing in them do not vote; those with a single pixel hardly. */
    for (int i = 0; i < MOST; i++)
        crowd[i] = i < 7 ? 7 : -1;
    struct sg_audit *b = audit(ctx, crowd, MOST, true);
    a = audit(ctx, crowd, 7, true);
    assert_float_equal(a->score, b->score, 0);
    sg_audit_destroy(&b);
    for (int i = 7; i < MOST; i++)
        crowd[i] = -2;
    b = audit(ctx, crowd, MOST, true);
    assert_float_equal(a->score, b->score, 0.05);
    assert_int_equal(a->verdict, b->verdict);
    sg_audit_destroy(&a);
    sg_audit_destroy(&b);
    for (int i = 0; i < MOST; i++)
        crowd[i] = -1;
    a = audit(ctx, crowd, MOST, false);
    assert_true(a->verdict == SG_AUDIT_CLEAN && a->score == 0);
    sg_audit_destroy(&a);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Photos whose blocks are of one colour each do not vote, not even where they look poisoned. */
static void test_no_vote(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    static uint8_t mask[W * H];
    struct sg_view view = {
        .name = (char *) "photo", .camera = {.width = W, .height = H}, .rgb = image, .mask = mask};
    struct sg_audit *a;
    for (int i = 0; i < W * H; i++) { /* a dark block and one bright column, in turn */
        mask[i] = i % W % 32 <= 16 ? 255 : 0;
        memset(image + 3 * i, i % W % 32 < 16 ? 0 : 255, 3);
    }
    assert_int_equal(sg_audit_scene(ctx, &(struct sg_scene){.train = &view, .n_train = 1}, &a),
                     SG_OK);
    assert_true(a->images[0].verdict == SG_AUDIT_POISONED && a->images[0].features.content == 0);
    assert_true(a->verdict == SG_AUDIT_CLEAN && a->score == 0);
    sg_audit_destroy(&a);
    sg_ctx_destroy(&ctx);
}

/* Parts of a photo that an attacker spares do not hide the others, whether they are in one place or
 * scattered, smooth or not. */
static void test_spared(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    static uint8_t clean[sizeof(image)];
    struct sg_view view = {
        .name = (char *) "photo", .camera = {.width = W, .height = H}, .rgb = image};
    for (int scattered = 0; scattered < 2; scattered++)
        for (int smooth = 0; smooth < 2; smooth++) {
            for (int spared = 0; spared <= 10; spared++) { /* tenths */
                struct sg_audit *a;
                paint(0, false, 1);
                memcpy(clean, image, sizeof(clean));
                paint(16, true, 1);
                for (int i = 0; i < W * H; i++) {
                    const int x = i % W, y = i / W;
                    const int place = scattered ? (x / 16 * 7 + y / 16 * 3) % 10 : 10 * x / W;
                    if (place < spared && smooth)
                        memset(image + 3 * i, 100 + x % W / 16 + y / 16, 3);
                    else if (place < spared)
                        memcpy(image + 3 * i, clean + 3 * i, 3);
                }
                assert_int_equal(
                    sg_audit_scene(ctx, &(struct sg_scene){.train = &view, .n_train = 1}, &a),
                    SG_OK);
                assert_true(spared > 5 || a->verdict != SG_AUDIT_CLEAN);
                assert_true(spared > 2 || a->verdict == SG_AUDIT_POISONED);
                assert_true(spared < 10 || a->verdict == SG_AUDIT_CLEAN);
                sg_audit_destroy(&a);
            }
        }
    sg_ctx_destroy(&ctx);
}

static int ascending(const void *a, const void *b)
{
    const float x = *(const float *) a, y = *(const float *) b;
    return (x > y) - (x < y);
}

/* An attacker gains little by sparing a third of the photos: the middle three fifths decide, or the
 * median less 1. */
static void test_outliers(void **state)
{
    (void) state;
    skip_without_races();
    sg_ctx *ctx = make_context(1);
    double noise[12];
    for (int i = 0; i < 12; i++)
        noise[i] = 4 + (i % 3 - 1) * 1.5;
    struct sg_audit *a = audit(ctx, noise, 12, false);
    float logits[12];
    for (int i = 0; i < 12; i++)
        logits[i] = (float) logit(a->images[i].score);
    qsort(logits, 12, sizeof(*logits), ascending);
    assert_true(logits[11] > logits[0] + 3);
    double middle = 0.6 * (double) logits[2] + 0.6 * (double) logits[9];
    for (int i = 3; i < 9; i++)
        middle += (double) logits[i];
    assert_float_equal(logit(a->score), fmax(middle / 7.2, (double) logits[6] - 1), 1e-4);
    sg_audit_destroy(&a);
    /* Photos that are alike are judged as each is alone. */
    for (int i = 0; i < 12; i++)
        noise[i] = 2;
    a = audit(ctx, noise, 12, true);
    for (int i = 0; i < 12; i++)
        logits[i] = (float) logit(a->images[i].score);
    qsort(logits, 12, sizeof(*logits), ascending);
    assert_true(logits[0] - 1e-4F <= (float) logit(a->score) &&
                (float) logit(a->score) <= logits[11] + 1e-4F);
    sg_audit_destroy(&a);
    sg_ctx_destroy(&ctx);
}

/* Clean photos have no amplitude; that of others grows with their noise. The set's is the median of
 * the others. */
static void test_amplitude(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(2);
    double before = 0;
    for (int noise = 0; noise <= 24; noise += noise ? 8 : 16) {
        struct sg_audit *a = audit(ctx, (double[]){noise, noise, noise, 0}, 4, false);
        for (int i = 0; i < 4; i++) {
            const struct sg_audit_image *m = &a->images[i];
            assert_true((m->verdict == SG_AUDIT_CLEAN) == (m->tau == 0) &&
                        (m->tau > 0) == (m->tau_error > 0));
            assert_true(m->tau_error <= m->tau);
        }
        assert_true(a->images[3].tau == 0 && (noise == 0 || a->images[0].tau > before));
        assert_true((a->verdict == SG_AUDIT_CLEAN) == (noise == 0));
        double least = INFINITY, most = 0;
        for (int i = 0; i < 3; i++)
            least = fmin(least, a->images[i].tau), most = fmax(most, a->images[i].tau);
        assert_true(least <= a->tau && a->tau <= most && (a->tau > 0) == (a->tau_error > 0));
        before = a->images[0].tau;
        sg_audit_destroy(&a);
    }
    assert_string_equal(sg_audit_verdict_name(SG_AUDIT_UNSEEN), "unseen");
    assert_string_equal(sg_audit_verdict_name(SG_AUDIT_VERDICTS), "unknown");
    /* A clean set has none, also where a photo of it does. */
    struct sg_audit *a = audit(ctx, (double[]){8, 0, 0, 0, 0, 0}, 6, false);
    assert_int_equal(a->images[0].verdict, SG_AUDIT_SUSPICIOUS);
    assert_true(a->images[0].tau > 0);
    assert_true(a->verdict == SG_AUDIT_CLEAN && a->tau == 0 && a->tau_error == 0);
    sg_audit_destroy(&a);
    sg_ctx_destroy(&ctx);
}

/* The reasons name every feature that shows the noise, one sentence each. */
static void test_reasons(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_audit *a = audit(ctx, (double[]){20, 20, 20}, 3, false);
    static const char *const words[] = {"quiet parts of the photos",
                                        "stick out from both neighbours carry", "colours oscillate",
                                        "photos in less than 70 %"};
    assert_int_equal(a->count_reasons, 4);
    for (int i = 0; i < 4; i++)
        assert_true(says(a, words[i]));
    sg_audit_destroy(&a);
    sg_ctx_destroy(&ctx);
}

/* Memory for one photo is enough for any number of threads, with the same scores. Less is an error.
 */
static void test_memory(void **state)
{
    (void) state;
    static uint8_t mask[W * H];
    struct sg_view views[8];
    struct sg_scene scene = {.path = (char *) "scene", .train = views, .n_train = 8};
    struct sg_audit *whole, *a;
    sg_ctx *ctx = make_context(1), *small;
    memset(mask, 255, sizeof(mask));
    paint(16, false, 1);
    for (int i = 0; i < 8; i++)
        views[i] =
            (struct sg_view){.camera = {.width = W, .height = H}, .rgb = image, .mask = mask};
    assert_int_equal(sg_audit_scene(ctx, &scene, &whole), SG_OK);
    int refused = 0, fits = 0;
    for (uint64_t limit = 1000; limit < 1000000; limit = limit * 5 / 4) {
        int codes[2];
        for (int k = 0; k < 2; k++) {
            const struct sg_ctx_params p = {.threads = k ? 4 : 1, .max_memory = limit};
            assert_int_equal(sg_ctx_create(&small, &p), SG_OK);
            codes[k] = sg_audit_scene(small, &scene, &a);
            if (codes[k])
                assert_true(!a && sg_last_error(small)[0]);
            for (size_t i = 0; a && i < a->count; i++)
                assert_true(a->images[i].score == whole->images[i].score &&
                            a->score == whole->score);
            sg_audit_destroy(&a);
            assert_int_equal(sg_mem_current(small, SG_MEM_TAGS), 0);
            sg_ctx_destroy(&small);
        }
        assert_true(codes[0] == codes[1] && (codes[0] == SG_OK || codes[0] == SG_ERR_BUDGET));
        refused += codes[0] != SG_OK, fits += codes[0] == SG_OK;
    }
    assert_true(refused && fits);
    sg_audit_destroy(&whole);
    sg_ctx_destroy(&ctx);
}

/* One photo needs more memory than there is, and the others do not: the error names it. */
static void test_true_cause(void **state)
{
    (void) state;
    struct sg_view views[8];
    for (int i = 0; i < 8; i++)
        views[i] = (struct sg_view){.camera = {.width = i == 2 ? W : 16, .height = i == 2 ? H : 16},
                                    .rgb = image};
    const struct sg_scene scene = {.path = (char *) "folder", .train = views, .n_train = 8};
    for (int threads = 1; threads <= 4; threads += 3) {
        sg_ctx *ctx;
        struct sg_audit *a;
        assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads,
                                                                     .max_memory = 32 << 10}),
                         SG_OK);
        assert_int_equal(sg_audit_scene(ctx, &scene, &a), SG_ERR_BUDGET);
        assert_null(a);
        assert_non_null(strstr(sg_last_error(ctx), "limit 32768"));
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
}

/* A fully masked photo has no verdict, and a set of such photos has none. */
static void test_unseen(void **state)
{
    (void) state;
    static uint8_t nothing[W * H];
    sg_ctx *ctx = make_context(1);
    struct sg_view views[3];
    struct sg_scene scene = {.path = (char *) "scene", .train = views, .n_train = 3};
    struct sg_audit *a;
    paint(16, true, 1);
    for (int i = 0; i < 3; i++)
        views[i] = (struct sg_view){
            .camera = {.width = W, .height = H}, .rgb = image, .mask = i ? nothing : NULL};
    assert_int_equal(sg_audit_scene(ctx, &scene, &a), SG_OK);
    assert_int_equal(a->verdict, SG_AUDIT_POISONED);
    assert_int_equal(a->verdicts[SG_AUDIT_UNSEEN], 2);
    assert_int_equal(a->verdicts[SG_AUDIT_CLEAN], 0);
    assert_true(a->images[1].verdict == SG_AUDIT_UNSEEN && a->images[1].score == 0);
    assert_string_equal(sg_audit_verdict_name(SG_AUDIT_UNSEEN), "unseen");
    sg_audit_destroy(&a);
    views[0].mask = nothing;
    for (int k = 0; k < 2; k++) { /* a set without photos has no verdict either */
        scene.n_train = k ? 0 : 3;
        assert_int_equal(sg_audit_scene(ctx, &scene, &a), SG_ERR_INPUT);
        assert_null(a);
        assert_non_null(
            strstr(sg_last_error(ctx), "scene: audit: found no training view with a used pixel"));
    }
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scores),    cmocka_unit_test(test_turned),
        cmocka_unit_test(test_verdicts),  cmocka_unit_test(test_no_vote),
        cmocka_unit_test(test_spared),    cmocka_unit_test(test_outliers),
        cmocka_unit_test(test_amplitude), cmocka_unit_test(test_reasons),
        cmocka_unit_test(test_memory),    cmocka_unit_test(test_unseen),
        cmocka_unit_test(test_true_cause)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
