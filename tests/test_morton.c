/* SPDX-License-Identifier: Apache-2.0 */
/* The order along a space-filling curve, and edits large enough to use it. */
#include "model/morton.h"

#include "engine/host/host_model.h"
#include "models.h"

enum { N = 20000 };

static float distance(const struct sg_model *m, size_t a, size_t b)
{
    float d = 0;
    for (int k = 0; k < 3; k++)
        d += fabsf(*sg_model_at(m, a, k) - *sg_model_at(m, b, k));
    return d;
}

/* A permutation in which neighbours are near. Strays and NaNs are kept and do not disturb it. */
static void test_order(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, N, 0, 3);
    for (size_t i = 0; i < 50; i++) {
        *sg_model_at(m, 7 * i, 0) = 1e30f;
        *sg_model_at(m, 7 * i + 1, 1) = NAN;
        *sg_model_at(m, 7 * i + 2, 2) = -INFINITY;
    }
    uint32_t *source = malloc(N * sizeof(*source)), *order = malloc(N * sizeof(*order));
    uint8_t *seen = calloc(N, 1);
    for (uint32_t i = 0; i < N; i++)
        source[i] = i;
    const struct sg_places places = {m->params, N, NULL, sg_param_count(0), 0};
    assert_int_equal(sg_morton_order(ctx, &places, source, N, order), SG_OK);
    double before = 0, after = 0;
    for (size_t i = 0; i < N; i++) {
        assert_true(order[i] < N && !seen[order[i]]++);
        if (i && isfinite(distance(m, i, i - 1)) && distance(m, i, i - 1) < 10)
            before += (double) distance(m, i, i - 1);
        if (i && isfinite(distance(m, order[i], order[i - 1])) &&
            distance(m, order[i], order[i - 1]) < 10)
            after += (double) distance(m, order[i], order[i - 1]);
    }
    assert_true(after < 0.1 * before);
    free(source);
    free(order);
    free(seen);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* More items than one thread sorts at a time, at few places: equal ones keep their order, and the
 * number of threads changes nothing. */
static void test_equal_places(void **state)
{
    (void) state;
    enum { ITEMS = 150000, PLACES = 97 };
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, PLACES, 0, 3);
    uint32_t *source = malloc(ITEMS * sizeof(*source)), *order = malloc(ITEMS * sizeof(*order)),
             *first = malloc(ITEMS * sizeof(*first));
    uint8_t *seen = calloc(ITEMS, 1);
    for (uint32_t i = 0; i < ITEMS; i++)
        source[i] = (uint32_t) ((uint64_t) i * i % PLACES);
    const struct sg_places places = {m->params, PLACES, NULL, sg_param_count(0), 0};
    for (int threads = 1; threads <= 4; threads += 3) {
        sg_ctx *own;
        assert_int_equal(sg_ctx_create(&own, &(struct sg_ctx_params){.threads = threads}), SG_OK);
        assert_int_equal(sg_morton_order(own, &places, source, ITEMS, threads == 1 ? first : order),
                         SG_OK);
        assert_int_equal(sg_mem_current(own, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&own);
    }
    assert_memory_equal(first, order, ITEMS * sizeof(*order));
    for (size_t i = 0; i < ITEMS; i++) {
        assert_true(order[i] < ITEMS && !seen[order[i]]++);
        assert_true(!i || source[order[i]] != source[order[i - 1]] || order[i] > order[i - 1]);
    }
    free(source);
    free(order);
    free(first);
    free(seen);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static int by_bits(const void *a, const void *b)
{
    return memcmp(a, b, 3 * sizeof(float));
}

/* In any order, an edit has the same Gaussians: survivors keep moments and, if asked for,
 * statistics; copies and inserted rows have none. */
static void edited(bool statistics)
{
    sg_ctx *ctx = make_context(3);
    struct sg_model *m = make_model(ctx, N, 1, 9), *rows = make_model(ctx, N / 10, 1, 10);
    struct sg_columns o;
    assert_int_equal(sg_columns_create(ctx, N, 1, SG_COLUMN_SAVED, &o), SG_OK);
    const int planes = sg_param_count(1);
    for (size_t i = 0; i < N; i++)
        for (int p = 0; p < planes; p++)
            o.at[SG_C_MOMENT1][sg_param_index(planes, i, p)] = *sg_model_at(m, i, p) + 1;
    for (size_t i = 0; i < N; i++)
        o.at[SG_C_GRAD_SUM][i] = *sg_model_at(m, i, 0) + 2,
        o.at[SG_C_GRAD_COUNT][i] = (float) (i + 1);
    struct sg_host_model h = {0};
    assert_int_equal(sg_host_upload(ctx, &h, m, &o), SG_OK);
    uint8_t *keep = calloc(N, 1), *kind = calloc(N, 1);
    uint32_t *source = malloc(N * sizeof(*source));
    struct sg_edit e = {
        .keep = keep, .source = source, .kind = kind, .rows = rows, .statistics = statistics};
    for (uint32_t i = 0; i < N; i++) {
        keep[i] = i % 3 != 0;
        e.kept += keep[i];
        if (i % 5 == 0)
            source[e.appended++] = i;
        if (i % 10 == 7)
            kind[e.appended] = SG_EDIT_INSERT, source[e.appended++] = i / 10;
    }
    float(*expected)[5] = malloc((e.kept + e.appended) * sizeof(*expected)),
    (*found)[5] = malloc((e.kept + e.appended) * sizeof(*found));
    size_t n = 0;
    for (uint32_t i = 0; i < N; i++) {
        const float x = *sg_model_at(m, i, 0), c = *sg_model_at(m, i, planes - 1);
        if (keep[i])
            memcpy(expected[n++],
                   (float[]){x, c, x + 1, statistics ? x + 2 : 0, statistics ? (float) (i + 1) : 0},
                   sizeof(*expected));
        if (i % 5 == 0)
            memcpy(expected[n++], (float[]){x, c, 0, 0, 0}, sizeof(*expected));
        if (i % 10 == 7)
            memcpy(expected[n++],
                   (float[]){*sg_model_at(rows, i / 10, 0), *sg_model_at(rows, i / 10, planes - 1),
                             0, 0, 0},
                   sizeof(*expected));
    }
    assert_int_equal(sg_host_edit(ctx, &h, &e), SG_OK);
    assert_int_equal(h.count, n);
    for (size_t i = 0; i < n; i++) {
        found[i][0] = h.at[SG_C_PARAMETERS][sg_param_index(planes, i, 0)];
        found[i][1] = h.at[SG_C_PARAMETERS][sg_param_index(planes, i, planes - 1)];
        found[i][2] = h.at[SG_C_MOMENT1][sg_param_index(planes, i, 0)];
        found[i][3] = h.at[SG_C_GRAD_SUM][i], found[i][4] = h.at[SG_C_GRAD_COUNT][i];
    }
    qsort(expected, n, sizeof(*expected), by_bits);
    qsort(found, n, sizeof(*found), by_bits);
    assert_memory_equal(expected, found, n * sizeof(*found));
    free(keep);
    free(kind);
    free(source);
    free(expected);
    free(found);
    sg_host_clear(&h);
    sg_columns_clear(&o);
    sg_model_destroy(&rows);
    sg_model_destroy(&m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

static void test_edit(void **state)
{
    (void) state;
    edited(false);
    edited(true);
}

/* An edit holds one array twice, and where memory runs out the model is as it was, or edited and
 * without moments. */
static void test_edit_memory(void **state)
{
    (void) state;
    enum { COUNT = N / 8 };
    sg_ctx *plenty = make_context(1);
    struct sg_model *m = make_model(plenty, COUNT, 1, 9);
    struct sg_columns o;
    assert_int_equal(sg_columns_create(plenty, COUNT, 1, SG_COLUMN_SAVED, &o), SG_OK);
    const size_t more = COUNT / 2;
    uint8_t *keep = malloc(COUNT), *kind = calloc(more, 1);
    uint32_t *source = calloc(more, sizeof(*source));
    memset(keep, 1, COUNT);
    const struct sg_edit e = {
        .keep = keep, .kept = COUNT, .appended = more, .source = source, .kind = kind};
    const uint64_t array = COUNT * (uint64_t) sg_param_count(1) * sizeof(float),
                   rest = COUNT * UINT64_C(32);
    int as_was = 0, edited = 0, done = 0;
    /* Up to 3 arrays of old and new size, one more of the new size, and small ones. */
    for (uint64_t limit = 3 * array + rest; limit <= 6 * array + 2 * rest; limit += rest / 8) {
        sg_ctx *ctx;
        struct sg_host_model h = {0};
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = limit}), SG_OK);
        assert_int_equal(sg_host_upload(ctx, &h, m, &o), SG_OK);
        const int code = sg_host_edit(ctx, &h, &e);
        assert_true(code == SG_OK || code == SG_ERR_BUDGET);
        assert_int_equal(h.count, code && h.at[SG_C_MOMENT1] ? COUNT : COUNT + more);
        as_was += code && h.at[SG_C_MOMENT1];
        edited += code && !h.at[SG_C_MOMENT1];
        done += !code && h.at[SG_C_MOMENT1];
        assert_int_equal(sg_host_alloc_saved(ctx, &h), SG_OK);
        assert_non_null(h.at[SG_C_GRAD_COUNT]);
        sg_host_clear(&h);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    assert_true(as_was > 0 && edited > 0 && done > 0);
    free(keep);
    free(kind);
    free(source);
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    sg_ctx_destroy(&plenty);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order), cmocka_unit_test(test_equal_places),
        cmocka_unit_test(test_edit), cmocka_unit_test(test_edit_memory)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
