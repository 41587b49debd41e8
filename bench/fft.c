/* SPDX-License-Identifier: Apache-2.0 */
/* The anisotropy loss and its gradient, by our transforms and by FFTW's in turn. Prints CSV:
 * medians in milliseconds, the median of the ratios of neighbouring calls, ours over FFTW's, and
 * the same of the processor time of all threads, which other work on the machine changes least.
 *
 *     bench_fft [--cpu VARIANT] [ROUNDS] */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "core/clock.h"
#include "engine/cpu/dispatch.h"
#include "fftw.h"
#include "measure.h"
#include "spectral/fft.h"

static double processor_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Edges, texture, noise. */
static void paint(float *x, int w, int h)
{
    uint32_t seed = 1;
    for (int i = 0; i < 3 * w * h; i++) {
        const int at = i % (w * h), px = at % w, py = at / w;
        seed = seed * 1664525u + 1013904223u;
        x[i] = 0.5f + 0.2f * (float) ((px / 37 + py / 23) % 2) +
               0.1f * (float) (seed >> 8) / (float) (1 << 24);
    }
}

/* Largest difference of the gradients, as a part of the largest gradient. */
static double apart(const float *a, const float *b, size_t n)
{
    double most = 0, largest = 0;
    for (size_t i = 0; i < n; i++) {
        most = fmax(most, fabs((double) a[i] - (double) b[i]));
        largest = fmax(largest, fabs((double) b[i]));
    }
    return most / largest;
}

static void compare(const struct cpu_kernels *kernels, int w, int h, bool exact, int threads,
                    int rounds)
{
    sg_ctx *ctx;
    struct sg_anisotropy *ours;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads}))
        bench_fail(NULL, "context");
    struct sg_anisotropy_params params = sg_anisotropy_params_default();
    params.exact_size = exact;
    if (sg_anisotropy_create(ctx, w, h, &params, &kernels->fft, &ours))
        bench_fail(ctx, "transform");
    struct fftw_anisotropy *theirs = fftw_anisotropy_create(ctx, w, h, exact);
    const size_t n = 3 * (size_t) w * (size_t) h;
    float *x = malloc(n * sizeof(float)),
          *g[2] = {malloc(n * sizeof(float)), malloc(n * sizeof(float))};
    double *times[4], loss[2] = {0}, off = 0;
    for (int k = 0; k < 4; k++)
        times[k] = malloc((size_t) rounds * sizeof(double));
    paint(x, w, h);
    for (int i = -2; i < rounds; i++) { /* two to warm up */
        double spent[2], worked[2];
        for (int turn = 0; turn < 2; turn++) {
            const int k = turn ^ (i & 1); /* each comes first every other time */
            memset(g[k], 0, n * sizeof(float));
            const double start = sg_seconds(), start_work = processor_seconds();
            loss[k] =
                k ? fftw_anisotropy_loss(theirs, x, g[1]) : sg_anisotropy_loss(ours, x, 1, g[0]);
            spent[k] = sg_seconds() - start, worked[k] = processor_seconds() - start_work;
        }
        if (i >= 0)
            times[0][i] = spent[0], times[1][i] = spent[1], times[2][i] = spent[0] / spent[1],
            times[3][i] = worked[0] / worked[1];
    }
    off = apart(g[0], g[1], n);
    if (!(fabs(loss[0] - loss[1]) < 1e-5 * loss[1] && off < 1e-4))
        bench_fail(NULL, "the results differ");
    printf("%s,%dx%d,%dx%d,%d,%.2f,%.2f,%.2f,%.2f,%.1e\n", kernels->name, w, h,
           sg_anisotropy_width(w, exact), sg_anisotropy_height(h, exact), threads,
           1e3 * median(times[0], rounds), 1e3 * median(times[1], rounds), median(times[2], rounds),
           median(times[3], rounds), off);
    fflush(stdout);
    for (int k = 0; k < 4; k++)
        free(times[k]);
    free(x), free(g[0]), free(g[1]);
    fftw_anisotropy_destroy(theirs);
    sg_anisotropy_destroy(&ours);
    sg_ctx_destroy(&ctx);
}

int main(int argc, char **argv)
{
    const struct cpu_kernels *kernels;
    const char *cpu = NULL;
    int rounds = 31;
    for (int i = 1; i < argc; i++)
        if (!strcmp(argv[i], "--cpu") && i + 1 < argc)
            cpu = argv[++i];
        else
            rounds = atoi(argv[i]);
    sg_ctx *ctx;
    if (rounds < 1)
        bench_fail(NULL, "usage: bench_fft [--cpu VARIANT] [ROUNDS]");
    if (sg_ctx_create(&ctx, NULL) || sg_cpu_select(ctx, cpu, &kernels))
        bench_fail(ctx, "kernels");
    printf("kernels,image,transformed,threads,ms,fftw_ms,ratio,processor_time_ratio,gradient_"
           "difference\n");
    static const struct {
        int w, h;
        bool exact;
    } sizes[] = {{800, 800, false},   {800, 533, false},  {1600, 1066, false}, {400, 400, false},
                 {1559, 1039, false}, {1559, 1039, true}, {800, 533, true},    {779, 519, true}};
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
        for (int threads = 1; threads <= 2; threads++)
            compare(kernels, sizes[i].w, sizes[i].h, sizes[i].exact, threads, rounds);
    sg_ctx_destroy(&ctx);
    return 0;
}
