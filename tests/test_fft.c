/* SPDX-License-Identifier: Apache-2.0 */
/* What is made of the transforms: a loss with the same bytes on every instruction set; and memory
 * that runs out. tests/kernels/check_fft.c has the transforms themselves. */
#include "spectral/fft.h"

#include "engine/cpu/dispatch.h"
#include "models.h"
#include "spectral/anisotropy.h"

static const struct cpu_kernels *variants[4];
static int variant_count;

static int find_variants(void **state)
{
    (void) state;
    variant_count = sg_cpu_variants(variants);
    return 0;
}

static float *floats(size_t n)
{
    float *p = aligned_alloc(64, (n * sizeof(float) + 63) / 64 * 64);
    assert_non_null(p);
    return p;
}

/* A loss and its gradient: the same bytes for any number of threads and any instruction set, near
 * the oracle's. */
static void test_threads(void **state)
{
    (void) state;
    static const int sizes[][2] = {{70, 101}, {64, 33}, {267, 40}};
    for (int k = 0; k < 3; k++) {
        const int w = sizes[k][0], h = sizes[k][1];
        const size_t n = 3 * (size_t) w * (size_t) h;
        float *x = floats(n), *g = floats(n), *first = floats(n);
        double loss = 0, off = 0, largest = 0;
        for (size_t i = 0; i < n; i++)
            x[i] = draw(11, i, 0, 1);
        for (int v = -1; v < 3 * variant_count;
             v++) { /* the oracle, then each variant with some threads */
            sg_ctx *ctx = make_context(v < 0 ? 2 : (int[]){1, 2, 5}[v % 3]);
            struct sg_anisotropy *a;
            const struct sg_fft_kernels *kernels = v < 0 ? &sg_fft_oracle : &variants[v / 3]->fft;
            assert_int_equal(sg_anisotropy_create(ctx, w, h, NULL, kernels, &a), SG_OK);
            memset(g, 0, n * sizeof(float));
            const double found = sg_anisotropy_loss(a, x, 1, g);
            if (v == 0)
                for (size_t i = 0; i < n; i++) {
                    off = fmax(off, fabs((double) g[i] - (double) first[i]));
                    largest = fmax(largest, fabs((double) first[i]));
                }
            assert_true(v < 0 || fabs(found - loss) < 1e-6 * loss);
            assert_true(off <= 1e-5 * largest);
            assert_true(v < 1 || found == loss);
            if (v < 1)
                loss = found, memcpy(first, g, n * sizeof(float));
            assert_memory_equal(g, first, n * sizeof(float));
            sg_anisotropy_destroy(&a);
            sg_ctx_destroy(&ctx);
        }
        free(x), free(g), free(first);
    }
}

/* Whatever memory is refused, nothing is kept. */
static void test_memory(void **state)
{
    (void) state;
    static const int lengths[] = {600, 1559};
    for (int k = 0; k < 2; k++) {
        int code = SG_ERR_BUDGET;
        for (uint64_t limit = 100; limit < 1000000; limit = limit * 9 / 8) {
            sg_ctx *ctx;
            struct sg_fft *fft;
            const int before = code;
            assert_int_equal(
                sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = limit}),
                SG_OK);
            code = sg_fft_create(ctx, lengths[k], &fft);
            assert_true(code == SG_OK || (code == SG_ERR_BUDGET && before == code && !fft));
            sg_fft_destroy(&fft);
            assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
            sg_ctx_destroy(&ctx);
        }
        assert_int_equal(code, SG_OK);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_threads),
                                       cmocka_unit_test(test_memory)};
    return cmocka_run_group_tests(tests, find_variants, NULL);
}
