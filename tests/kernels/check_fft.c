/* SPDX-License-Identifier: Apache-2.0 */
/* The transforms against the definition in double precision and against the oracle. All instruction
 * sets give the same bytes: those of the first one are compared with. */
#include "check.h"

#include "spectral/fft.h"

#define POINT SG_FFT_POINT
#define LANES SG_FFT_LANES
#define MOST 4096 /* points */

/* The slowest variant of this machine. */
static const struct sg_fft_kernels *first_kernels(void)
{
    const struct cpu_kernels *variants[SG_ENGINE_VARIANTS];
    sg_cpu_variants(variants);
    return &variants[0]->fft;
}

/* ---- columns ---- */

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

/* Lane l holds signal a + l b, so that two transforms by definition give the results of all
 * lanes. */
static void check_length(const struct cpu_kernels *k, sg_ctx *ctx, int n)
{
    static double signal[2][2 * MOST], expected[2][2 * MOST];
    static float in[MOST * POINT], out[MOST * POINT], back[MOST * POINT];
    const size_t bytes = (size_t) n * POINT * sizeof(float);
    struct sg_fft *fft;
    assert_int_equal(sg_fft_create(ctx, n, &fft), SG_OK);
    float *scratch = must(sg_fft_scratch(fft), sizeof(float));
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
    double power[3] = {0}, off = 0, off_back = 0;
    k->fft.columns(fft, in, out, false, scratch);
    k->fft.columns(fft, out, back, true, scratch);
    for (int i = 0; i < n * POINT; i++) {
        const int at = 2 * (i / POINT) + i % POINT / LANES;
        const double right = expected[0][at] + i % LANES * expected[1][at];
        power[0] += (double) in[i] * (double) in[i], power[1] += (double) out[i] * (double) out[i];
        off = fmax(off, fabs((double) out[i] - right)), power[2] += right * right;
        off_back = fmax(off_back, fabs((double) back[i] / n - (double) in[i]));
    }
    const double size = sqrt(power[2] / (n * POINT)); /* of a value */
    if (!(off < 4e-6 * size) || !(off_back < 4e-6) || !(fabs(power[1] / power[0] / n - 1) < 1e-6))
        fail_msg("%s, length %d: off by %g of %g, forth and back by %g, power %g", k->name, n, off,
                 size, off_back, power[1] / power[0] / n);
    first_kernels()->columns(fft, in, back, false, scratch);
    assert_memory_equal(out, back, bytes);
    free(scratch);
    sg_fft_destroy(&fft);
}

/* An impulse and a constant, whose transforms are exact. */
static void check_exact(const struct cpu_kernels *k, sg_ctx *ctx, int n)
{
    static float in[64 * POINT], out[64 * POINT];
    struct sg_fft *fft;
    assert_int_equal(sg_fft_create(ctx, n, &fft), SG_OK);
    memset(in, 0, sizeof(in));
    for (int l = 0; l < POINT; l++)
        in[l] = (float) (1 + l);
    k->fft.columns(fft, in, out, false, NULL);
    for (int i = 0; i < n * POINT; i++)
        assert_true(out[i] == (float) (1 + i % POINT));
    for (int i = 0; i < n * POINT; i++)
        in[i] = (float) (1 + i % POINT);
    k->fft.columns(fft, in, out, true, NULL);
    for (int l = 0; l < POINT; l++)
        assert_true(out[l] == (float) (n * (1 + l)));
    sg_fft_destroy(&fft);
}

/* Every short length, then powers of each radix, large primes, and sides that photos have. */
static void compare_columns(const struct cpu_kernels *k)
{
    static const int lengths[] = {1024, 2048, 2187, 3125, 2401, 1331, 2197,
                                  961,  1078, 1559, 1600, 1067, 2018, 4096};
    sg_ctx *ctx = make_context(1);
    for (int n = 1; n <= 64; n++)
        check_exact(k, ctx, n);
    for (int n = 1; n <= 600; n++)
        check_length(k, ctx, n);
    for (size_t i = 0; i < sizeof(lengths) / sizeof(lengths[0]); i++)
        check_length(k, ctx, lengths[i]);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* ---- rows ---- */

/* The oracle of the rows, against the definition. */
static void check_oracle(void)
{
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

#define STRIDE 128
#define PANEL ((size_t) 40 * POINT)
#define PANELS (4 * PANEL)
#define PIXELS ((size_t) SG_FFT_ROWS * STRIDE)

/* Every remainder of a block of rows, of columns and of the width. */
static const struct rows_case {
    int n, width, columns, count;
} cases[] = {{1, 1, 1, 1},      {2, 2, 1, 2},      {3, 1, 2, 32},    {16, 16, 8, 16},
             {17, 17, 9, 17},   {33, 30, 17, 15},  {64, 64, 32, 32}, {75, 69, 38, 31},
             {80, 80, 17, 20},  {90, 33, 33, 9},   {48, 48, 1, 32},  {103, 103, 48, 32},
             {103, 100, 49, 3}, {101, 101, 51, 18}};
#define CASES (sizeof(cases) / sizeof(cases[0]))

struct rows_work {
    struct sg_fft *fft;
    float *values, *panels, *image, *scratch;
    struct sg_fft_rows rows;
    const float *from[SG_FFT_ROWS];
    float *to[SG_FFT_ROWS];
};

/* values: the rows, at odd addresses. image: what rows_back adds to, but for some rows. */
static struct rows_work make_rows(sg_ctx *ctx, const struct rows_case *c)
{
    struct rows_work w = {.values = random_floats(PIXELS, (uint64_t) c->n, -1, 1),
                          .panels = random_floats(PANELS, 6, -1, 1),
                          .image = random_floats(PIXELS, 5, -1, 1)};
    assert_int_equal(sg_fft_create(ctx, c->n, &w.fft), SG_OK);
    w.scratch = must(sg_fft_rows_scratch(w.fft), sizeof(float));
    w.rows = (struct sg_fft_rows){.count = c->count,
                                  .width = c->width,
                                  .columns = c->columns,
                                  .panels = w.panels + 2 * POINT,
                                  .panel = PANEL};
    for (int i = 0; i < c->count; i++) {
        w.from[i] = w.values + (size_t) i * STRIDE + i % 5;
        w.to[i] = i % 6 != 4 ? w.image + (size_t) i * STRIDE : NULL;
    }
    return w;
}

static void clear_rows(struct rows_work *w)
{
    free(w->values), free(w->panels), free(w->image), free(w->scratch);
    sg_fft_destroy(&w->fft);
}

static void compare_rows(const struct cpu_kernels *k)
{
    sg_ctx *ctx = make_context(1);
    check_oracle();
    for (size_t c = 0; c < CASES; c++) {
        struct rows_work found = make_rows(ctx, &cases[c]), right = make_rows(ctx, &cases[c]),
                         first = make_rows(ctx, &cases[c]);
        k->fft.rows(found.fft, &found.rows, found.from, found.scratch);
        sg_fft_oracle.rows(right.fft, &right.rows, right.from, right.scratch);
        first_kernels()->rows(first.fft, &first.rows, first.from, first.scratch);
        for (size_t i = 0; i < PANELS; i++) /* what is not a coefficient is as it was */
            if (fabsf(found.panels[i] - right.panels[i]) > 2e-5f)
                fail_msg("%s, length %d: coefficient %zu: %g, expected %g", k->name, cases[c].n, i,
                         (double) found.panels[i], (double) right.panels[i]);
        assert_memory_equal(found.panels, first.panels, PANELS * sizeof(float));
        clear_rows(&found), clear_rows(&right), clear_rows(&first);
    }
    sg_ctx_destroy(&ctx);
}

static void compare_rows_back(const struct cpu_kernels *k)
{
    sg_ctx *ctx = make_context(1);
    for (size_t c = 0; c < CASES; c++) {
        struct rows_work found = make_rows(ctx, &cases[c]), right = make_rows(ctx, &cases[c]),
                         first = make_rows(ctx, &cases[c]);
        const float tolerance = 2e-5f * (float) cases[c].n;
        k->fft.rows_back(found.fft, &found.rows, found.to, 0.25f, found.scratch);
        sg_fft_oracle.rows_back(right.fft, &right.rows, right.to, 0.25f, right.scratch);
        first_kernels()->rows_back(first.fft, &first.rows, first.to, 0.25f, first.scratch);
        for (size_t i = 0; i < PIXELS; i++) {
            const int row = (int) (i / STRIDE), column = (int) (i % STRIDE);
            const bool own = row < cases[c].count && row % 6 != 4 && column < cases[c].width;
            if (own ? fabsf(found.image[i] - right.image[i]) > tolerance
                    : found.image[i] != draw(5, i, -1, 1))
                fail_msg("%s, length %d: row %d, column %d: %g, expected %g", k->name, cases[c].n,
                         row, column, (double) found.image[i], (double) right.image[i]);
        }
        assert_memory_equal(found.image, first.image, PIXELS * sizeof(float));
        clear_rows(&found), clear_rows(&right), clear_rows(&first);
    }
    sg_ctx_destroy(&ctx);
}

/* ---- times ---- */

#define BENCH 120 /* points */

static double bench_columns(const struct cpu_kernels *k)
{
    sg_ctx *ctx = make_context(1);
    const struct sg_fft_kernels *fft_kernels = k ? &k->fft : &sg_fft_oracle;
    struct sg_fft *fft;
    struct timing t = {0};
    assert_int_equal(sg_fft_create(ctx, BENCH, &fft), SG_OK);
    float *in = random_floats((size_t) BENCH * POINT, 1, -1, 1),
          *out = must((size_t) BENCH * POINT, sizeof(float)),
          *scratch = must(sg_fft_scratch(fft), sizeof(float));
    while (timing_again(&t))
        fft_kernels->columns(fft, in, out, false, scratch);
    free(in), free(out), free(scratch);
    sg_fft_destroy(&fft);
    sg_ctx_destroy(&ctx);
    return timing_result(&t, BENCH * LANES);
}

static double bench_rows_of(const struct cpu_kernels *k, bool back)
{
    const struct rows_case c = {BENCH, BENCH, BENCH / 2, SG_FFT_ROWS};
    const struct sg_fft_kernels *fft_kernels = k ? &k->fft : &sg_fft_oracle;
    sg_ctx *ctx = make_context(1);
    struct rows_work w = make_rows(ctx, &c);
    struct timing t = {0};
    while (timing_again(&t))
        if (back)
            fft_kernels->rows_back(w.fft, &w.rows, w.to, 1e-3f, w.scratch);
        else
            fft_kernels->rows(w.fft, &w.rows, w.from, w.scratch);
    clear_rows(&w);
    sg_ctx_destroy(&ctx);
    return timing_result(&t, BENCH * SG_FFT_ROWS);
}

static double bench_rows(const struct cpu_kernels *k)
{
    return bench_rows_of(k, false);
}

static double bench_rows_back(const struct cpu_kernels *k)
{
    return bench_rows_of(k, true);
}

const struct kernel_check check_fft_columns = {"fft_columns", "point", false, compare_columns,
                                               bench_columns};
const struct kernel_check check_fft_rows = {"fft_rows", "point", false, compare_rows, bench_rows};
const struct kernel_check check_fft_rows_back = {"fft_rows_back", "point", false, compare_rows_back,
                                                 bench_rows_back};
