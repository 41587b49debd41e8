/* SPDX-License-Identifier: Apache-2.0 */
/* The transforms of each instruction set against the definition in double precision, against the
 * oracle, and against one another: they give the same bytes. */
#include "spectral/fft.h"

#include "engine/cpu/dispatch.h"
#include "models.h"
#include "spectral/anisotropy.h"

#define POINT SG_FFT_POINT
#define LANES SG_FFT_LANES
#define MOST 8192 /* points */

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

/* By definition: n numbers, real and imaginary parts side by side. */
static void naive(int n, const double *in, double *out)
{
    static double root[2 * MOST];
    for (int k = 0; k < n; k++)
        root[2 * k] = cos(2 * M_PI * k / n), root[2 * k + 1] = -sin(2 * M_PI * k / n);
    for (int k = 0; k < n; k++) {
        double re = 0, im = 0;
        for (int j = 0, at = 0; j < n; j++, at = at + k < n ? at + k : at + k - n) {
            re += in[2 * j] * root[2 * at] - in[2 * j + 1] * root[2 * at + 1];
            im += in[2 * j] * root[2 * at + 1] + in[2 * j + 1] * root[2 * at];
        }
        out[2 * k] = re, out[2 * k + 1] = im;
    }
}

/* Lane l holds signal a + l b, so that two transforms by definition tell what each lane must be. */
static void test_length(sg_ctx *ctx, int n)
{
    static double signal[2][2 * MOST], expected[2][2 * MOST];
    static float in[MOST * POINT], first[MOST * POINT], out[MOST * POINT], back[MOST * POINT];
    struct sg_fft *fft;
    assert_int_equal(sg_fft_create(ctx, n, &fft), SG_OK);
    float *scratch = floats(sg_fft_scratch(fft));
    for (int s = 0; s < 2; s++) {
        for (int i = 0; i < 2 * n; i++)
            signal[s][i] =
                (double) draw((uint64_t) n, (uint64_t) (i + 2 * n * s), -1, 1) / (s ? LANES : 1);
        naive(n, signal[s], expected[s]);
    }
    for (int i = 0; i < n * POINT; i++) {
        const int at = 2 * (i / POINT) + i % POINT / LANES;
        in[i] = (float) (signal[0][at] + i % LANES * signal[1][at]);
    }
    for (int v = 0; v < variant_count; v++) {
        const struct sg_fft_kernels *kernels = &variants[v]->fft;
        double power[3] = {0}, off = 0, off_back = 0;
        kernels->columns(fft, in, out, false, scratch);
        kernels->columns(fft, out, back, true, scratch);
        for (int i = 0; i < n * POINT; i++) {
            const int at = 2 * (i / POINT) + i % POINT / LANES;
            const double right = expected[0][at] + i % LANES * expected[1][at];
            power[0] += (double) in[i] * (double) in[i],
                power[1] += (double) out[i] * (double) out[i];
            off = fmax(off, fabs((double) out[i] - right)), power[2] += right * right;
            off_back = fmax(off_back, fabs((double) back[i] / n - (double) in[i]));
        }
        const double size = sqrt(power[2] / (n * POINT)); /* of a value */
        if (!(off < 4e-6 * size) || !(off_back < 4e-6) ||
            !(fabs(power[1] / power[0] / n - 1) < 1e-6))
            fail_msg("%s, length %d: off by %g of %g, forth and back by %g, power %g",
                     variants[v]->name, n, off, size, off_back, power[1] / power[0] / n);
        if (v == 0)
            memcpy(first, out, (size_t) n * POINT * sizeof(float));
        assert_memory_equal(out, first, (size_t) n * POINT * sizeof(float));
    }
    free(scratch);
    sg_fft_destroy(&fft);
}

static void test_every_length(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    for (int n = 1; n <= 600; n++)
        test_length(ctx, n);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Powers of each radix, several large primes, what photos have. */
static void test_large(void **state)
{
    (void) state;
    static const int lengths[] = {1024, 2048, 2187, 3125, 2401, 1331, 2197,
                                  961,  1078, 1559, 1600, 1067, 2018, 4096};
    sg_ctx *ctx = make_context(1);
    for (size_t i = 0; i < sizeof(lengths) / sizeof(lengths[0]); i++)
        test_length(ctx, lengths[i]);
    sg_ctx_destroy(&ctx);
}

/* What can be told exactly: an impulse, a constant. */
static void test_exact(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    static float in[64 * POINT], out[64 * POINT];
    for (int n = 1; n <= 64; n++)
        for (int v = 0; v < variant_count; v++) {
            struct sg_fft *fft;
            assert_int_equal(sg_fft_create(ctx, n, &fft), SG_OK);
            memset(in, 0, sizeof(in));
            for (int l = 0; l < POINT; l++)
                in[l] = (float) (1 + l);
            variants[v]->fft.columns(fft, in, out, false, NULL);
            for (int i = 0; i < n * POINT; i++)
                assert_true(out[i] == (float) (1 + i % POINT));
            for (int i = 0; i < n * POINT; i++)
                in[i] = (float) (1 + i % POINT);
            variants[v]->fft.columns(fft, in, out, true, NULL);
            for (int l = 0; l < POINT; l++)
                assert_true(out[l] == (float) (n * (1 + l)));
            sg_fft_destroy(&fft);
        }
    sg_ctx_destroy(&ctx);
}

/* The oracle, which is compared with below, against the definition. */
static void test_oracle(void **state)
{
    (void) state;
    static double in[2 * 211], expected[2 * 211], out[2 * 211], room[2 * 211];
    for (int n = 1; n <= 211; n += n < 64 ? 1 : 21) {
        double off = 0;
        for (int i = 0; i < 2 * n; i++)
            in[i] = (double) draw(3, (uint64_t) i, -1, 1);
        naive(n, in, expected);
        sg_fft_exact(n, in, out, room);
        for (int i = 0; i < 2 * n; i++)
            off = fmax(off, fabs(out[i] - expected[i]));
        assert_true(off < 1e-11);
    }
}

struct rows_case {
    int n, width, columns, count;
};

/* Rows and their way back, by one set of kernels, from the same values. */
static void transform_rows(sg_ctx *ctx, const struct rows_case *c,
                           const struct sg_fft_kernels *kernels, float *panels, size_t panel,
                           float *image, size_t stride)
{
    struct sg_fft *fft;
    const float *from[SG_FFT_ROWS];
    float *to[SG_FFT_ROWS], *values = floats(SG_FFT_ROWS * stride);
    assert_int_equal(sg_fft_create(ctx, c->n, &fft), SG_OK);
    float *scratch = floats(sg_fft_rows_scratch(fft));
    for (size_t i = 0; i < SG_FFT_ROWS * stride; i++)
        values[i] = draw((uint64_t) c->n, i, -1, 1), image[i] = draw(5, i, -1, 1);
    for (size_t i = 0; i < 3 * panel; i++)
        panels[i] = 7;
    for (int i = 0; i < SG_FFT_ROWS; i++) {
        from[i] =
            i < c->count ? values + (size_t) i * stride + i % 5 : NULL; /* aligned in no way */
        to[i] = i < c->count && i % 6 != 4 ? image + (size_t) i * stride : NULL;
    }
    const struct sg_fft_rows r = {.count = c->count,
                                  .width = c->width,
                                  .columns = c->columns,
                                  .panels = panels + 2 * POINT,
                                  .panel = panel};
    kernels->rows(fft, &r, from, scratch);
    kernels->rows_back(fft, &r, to, 0.25f, scratch);
    free(scratch), free(values);
    sg_fft_destroy(&fft);
}

/* Every remainder of a block of rows, of columns and of the width; also that nothing else is
 * written. */
static void test_rows(void **state)
{
    (void) state;
    static const struct rows_case cases[] = {
        {1, 1, 1, 1},     {2, 2, 1, 2},       {3, 1, 2, 32},     {16, 16, 8, 16},   {17, 17, 9, 17},
        {33, 30, 17, 15}, {64, 64, 32, 32},   {75, 69, 38, 31},  {80, 80, 17, 20},  {90, 33, 33, 9},
        {48, 48, 1, 32},  {103, 103, 48, 32}, {103, 100, 49, 3}, {101, 101, 51, 18}};
    enum { STRIDE = 128, PANEL = 40 * POINT };
    sg_ctx *ctx = make_context(1);
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const struct rows_case *c = &cases[k];
        const size_t used = SG_FFT_PANELS(c->columns) * PANEL, room = 4 * PANEL,
                     pixels = SG_FFT_ROWS * STRIDE;
        float *right = floats(room), *right_image = floats(pixels), *panels = floats(room),
              *image = floats(pixels);
        float *first = floats(room), *first_image = floats(pixels);
        transform_rows(ctx, c, &sg_fft_oracle, right, PANEL, right_image, STRIDE);
        for (int v = 0; v < variant_count; v++) {
            transform_rows(ctx, c, &variants[v]->fft, panels, PANEL, image, STRIDE);
            for (size_t i = 0; i < 3 * PANEL; i++) {
                const int row = (int) (i % PANEL / POINT) - 2;
                const bool own = i < used && row >= 0 && row < c->count;
                if (own ? fabsf(panels[i] - right[i]) > 2e-5f : panels[i] != 7)
                    fail_msg("%s, length %d: coefficient %zu: %g, expected %g", variants[v]->name,
                             c->n, i, (double) panels[i], (double) right[i]);
            }
            for (size_t i = 0; i < pixels; i++) {
                const int row = (int) (i / STRIDE);
                const bool own = row < c->count && row % 6 != 4 && (int) (i % STRIDE) < c->width;
                if (own ? fabsf(image[i] - right_image[i]) > 2e-5f * (float) c->n
                        : image[i] != draw(5, i, -1, 1))
                    fail_msg("%s, length %d: pixel %zu: %g, expected %g", variants[v]->name, c->n,
                             i, (double) image[i], (double) right_image[i]);
            }
            if (v == 0) {
                memcpy(first, panels, 3 * PANEL * sizeof(float));
                memcpy(first_image, image, pixels * sizeof(float));
            }
            assert_memory_equal(panels, first, 3 * PANEL * sizeof(float));
            assert_memory_equal(image, first_image, pixels * sizeof(float));
        }
        free(right), free(right_image), free(panels), free(image), free(first), free(first_image);
    }
    sg_ctx_destroy(&ctx);
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
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_exact), cmocka_unit_test(test_oracle),
        cmocka_unit_test(test_rows),  cmocka_unit_test(test_every_length),
        cmocka_unit_test(test_large), cmocka_unit_test(test_threads),
        cmocka_unit_test(test_memory)};
    return cmocka_run_group_tests(tests, find_variants, NULL);
}
