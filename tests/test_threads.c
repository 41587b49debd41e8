/* SPDX-License-Identifier: Apache-2.0 */
/* The pool and what is promised to be safe on it. Run it under ThreadSanitizer too. */
#include <sched.h>
#include <stdatomic.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/context.h"
#include "models.h"

struct tally {
    size_t n;
    int threads;
    atomic_int *hits; /* per index */
    /* per index, written without atomics: the pool must order it before its return */
    size_t *plain;
    size_t *per_thread; /* scratch of each thread, unsynchronised by design */
    atomic_bool bad;
};

static void tally_one(void *arg, size_t i, int thread)
{
    struct tally *t = arg;
    if (i >= t->n || thread < 0 || thread >= t->threads) {
        t->bad = true;
        return;
    }
    atomic_fetch_add(&t->hits[i], 1);
    t->plain[i] = 3 * i + 1;
    t->per_thread[thread]++;
}

static void test_each_index_once(void **state)
{
    (void) state;
    static const int threads[] = {1, 2, 7, 16};
    static const size_t sizes[] = {0, 1, 2, 3, 16, 1000, 100000};
    for (int k = 0; k < 4; k++) {
        sg_ctx *ctx = make_context(threads[k]);
        assert_int_equal(sg_ctx_threads(ctx), threads[k]);
        for (int s = 0; s < 7; s++) {
            const size_t n = sizes[s];
            struct tally t = {.n = n, .threads = threads[k]};
            t.hits = calloc(n + 1, sizeof(*t.hits));
            t.plain = calloc(n + 1, sizeof(*t.plain));
            t.per_thread = calloc((size_t) threads[k], sizeof(*t.per_thread));
            assert_true(t.hits && t.plain && t.per_thread);
            sg_parallel_for(ctx, n, tally_one, &t);
            assert_false(t.bad);
            size_t sum = 0;
            for (size_t i = 0; i < n; i++) {
                assert_int_equal(t.hits[i], 1);
                assert_int_equal(t.plain[i], 3 * i + 1);
            }
            for (int i = 0; i < threads[k]; i++)
                sum += t.per_thread[i];
            assert_int_equal(sum, n);
            free(t.hits);
            free(t.plain);
            free(t.per_thread);
        }
        sg_ctx_destroy(&ctx);
    }
}

static void add_one(void *arg, size_t i, int thread)
{
    (void) thread;
    ((size_t *) arg)[i]++;
}

/* Many short jobs one after the other: a late worker must not take work of the next job twice or
 * lose it. */
static void test_jobs_in_a_row(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(5);
    size_t counts[9] = {0}, expected[9] = {0};
    for (size_t round = 0; round < 20000; round++) {
        const size_t n = round % 10;
        sg_parallel_for(ctx, n, add_one, counts);
        for (size_t i = 0; i < n; i++)
            expected[i]++;
    }
    assert_memory_equal(counts, expected, sizeof(counts));
    sg_ctx_destroy(&ctx);
}

#define GREEDY 8
/* below what the allocator maps anew, so that the race is as tight as it can be */
#define GREEDY_BYTES 1000

struct greedy {
    sg_ctx *ctx;
    atomic_int arrived, granted;
    void *held[GREEDY];
};

static void greedy_one(void *arg, size_t i, int thread)
{
    (void) thread;
    struct greedy *g = arg;
    atomic_fetch_add(&g->arrived, 1);
    while (g->arrived < GREEDY) /* every thread of the pool holds one item */
        sched_yield();
    g->held[i] = sg_alloc_raw(g->ctx, SG_MEM_MISC, GREEDY_BYTES, 1);
    if (g->held[i])
        atomic_fetch_add(&g->granted, 1);
}

/* The limit holds however many threads ask at the same moment, and every failure leaves one whole
 * message. */
static void test_ledger_limit_under_contention(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    sg_free(sg_alloc_raw(ctx, SG_MEM_MISC, GREEDY_BYTES, 1));
    const uint64_t limit = sg_mem_peak(ctx, SG_MEM_TAGS) + 10; /* room for one */
    sg_ctx_destroy(&ctx);
    assert_int_equal(
        sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = GREEDY, .max_memory = limit}),
        SG_OK);
    for (int round = 0; round < 3000; round++) {
        struct greedy g = {.ctx = ctx};
        sg_clear_error(ctx);
        sg_parallel_for(ctx, GREEDY, greedy_one, &g);
        assert_int_equal(g.granted, 1);
        assert_non_null(strstr(sg_last_error(ctx), "misc refused"));
        for (int i = 0; i < GREEDY; i++)
            sg_free(g.held[i]);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_MISC), 0);
    }
    assert_true(sg_mem_peak(ctx, SG_MEM_TAGS) <= limit);
    sg_ctx_destroy(&ctx);
}

/* Contexts are independent: each of these runs its own pool while the others do. */
static void nested_context(void *arg, size_t i, int thread)
{
    (void) thread;
    size_t *out = arg, counts[4] = {0};
    sg_ctx *ctx;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 2}))
        return;
    for (int k = 0; k < 50; k++)
        sg_parallel_for(ctx, 4, add_one, counts);
    sg_ctx_destroy(&ctx);
    out[i] = counts[0] + counts[1] + counts[2] + counts[3];
}

static void test_independent_contexts(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(4);
    size_t sums[12] = {0};
    sg_parallel_for(ctx, 12, nested_context, sums);
    for (int i = 0; i < 12; i++)
        assert_int_equal(sums[i], 200);
    sg_ctx_destroy(&ctx);
}

/* A forked process has the context but not its threads. */
static void test_forked_process(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(4);
    size_t counts[8] = {0};
    sg_parallel_for(ctx, 8, add_one, counts);
    const pid_t child = fork();
    if (child == 0) {
        alarm(60); /* it would wait for ever */
        sg_parallel_for(ctx, 8, add_one, counts);
        sg_ctx_destroy(&ctx);
        for (int i = 0; i < 8; i++)
            if (counts[i] != 2)
                _exit(1);
        _exit(0);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    sg_parallel_for(ctx, 8, add_one, counts);
    for (int i = 0; i < 8; i++)
        assert_int_equal(counts[i], 2);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_index_once),
        cmocka_unit_test(test_jobs_in_a_row),
        cmocka_unit_test(test_ledger_limit_under_contention),
        cmocka_unit_test(test_independent_contexts),
        cmocka_unit_test(test_forked_process),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
