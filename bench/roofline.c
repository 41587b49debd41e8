/* SPDX-License-Identifier: Apache-2.0 */
#include "roofline.h"

#include <math.h>
#include <stdlib.h>

#include "core/clock.h"

#define STREAM_FLOATS ((size_t) 1 << 25) /* 128 MiB: beyond every cache */
#define PIECES 256

static void stream_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    float *p = (float *) arg + piece * (STREAM_FLOATS / PIECES);
    for (size_t i = 0; i < STREAM_FLOATS / PIECES; i++)
        p[i] = p[i] * 0.999f + 1.0f;
}

static double bandwidth(sg_ctx *ctx)
{
    float *p = calloc(STREAM_FLOATS, sizeof(float));
    double best = 0;
    for (int i = 0; i < 8; i++) {
        const double start = sg_seconds();
        sg_parallel_for(ctx, PIECES, stream_piece, p);
        best = fmax(best, 2 * sizeof(float) * (double) STREAM_FLOATS / (sg_seconds() - start));
    }
    free(p);
    return best;
}

/* Twelve independent chains of the widest multiply-add that the machine has. */
#define CHAINS 12
#define MULTIPLY_ADD(name, type, ...)                                                              \
    __attribute__((__VA_ARGS__)) static double name(long rounds)                                   \
    {                                                                                              \
        type x[CHAINS];                                                                            \
        for (int k = 0; k < CHAINS; k++)                                                           \
            x[k] = (type){0} + (float) k; /* all different, or they would be computed once */      \
        const type a = (type){0} + 0.999f, b = (type){0} + 1.0f;                                   \
        for (long i = 0; i < rounds; i++)                                                          \
            for (int k = 0; k < CHAINS; k++)                                                       \
                x[k] = x[k] * a + b;                                                               \
        float sum = 0;                                                                             \
        for (int k = 0; k < CHAINS; k++)                                                           \
            sum += x[k][0];                                                                        \
        return (double) sum;                                                                       \
    }
typedef float f4 __attribute__((vector_size(16)));
MULTIPLY_ADD(multiply_add_4, f4, noinline)
#if defined(__x86_64__)
typedef float f16 __attribute__((vector_size(64)));
typedef float f8 __attribute__((vector_size(32)));
MULTIPLY_ADD(multiply_add_16, f16, noinline, target("avx512f"))
MULTIPLY_ADD(multiply_add_8, f8, noinline, target("avx2,fma"))
#endif

static double flops(void)
{
    const long rounds = 5000000;
    double (*work)(long) = multiply_add_4, best = 0;
    int lanes = 4;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f"))
        work = multiply_add_16, lanes = 16;
    else if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        work = multiply_add_8, lanes = 8;
#endif
    for (int i = 0; i < 5; i++) {
        const double start = sg_seconds();
        volatile double sink = work(rounds);
        (void) sink;
        best = fmax(best, 2.0 * lanes * CHAINS * (double) rounds / (sg_seconds() - start));
    }
    return best;
}

/* One tile under many wide, faint splats: no pixel stops early and no lane idles. */
static void pairs(const struct cpu_kernels *kernels, struct roofline *out)
{
    enum { N = 1280, ROUNDS = 60 };
    struct cpu_splat *splats = aligned_alloc(64, (N + 1) * sizeof(*splats));
    struct cpu_instance *instances = calloc(N + CPU_PREFETCH, sizeof(*instances));
    float *slots = calloc(N, CPU_SLOT_FLOATS * sizeof(float)), rgb[768], gradient[768];
    const float opacity = 0.0055f;
    for (uint32_t i = 0; i < N; i++) {
        splats[i] = (struct cpu_splat){.x = 8,
                                       .y = 8,
                                       .reach = 4900,
                                       .taper = 1,
                                       .ymax = 70,
                                       .across = 0.01f,
                                       .down = 0.01f,
                                       .peak = log2f(opacity),
                                       .r = 0.5f,
                                       .g = 0.4f,
                                       .b = 0.3f,
                                       .z = 1};
        instances[i] = (struct cpu_instance){i, i};
    }
    for (int i = 0; i < 768; i++)
        gradient[i] = 0.1f;
    const uint32_t start[2] = {0, N};
    uint16_t *block_mask = calloc(N, sizeof(*block_mask));
    uint32_t tile_end;
    const struct cpu_raster_args a = {.width = 16,
                                      .height = 16,
                                      .grid_x = 1,
                                      .splats = splats,
                                      .instances = instances,
                                      .tile_start = start,
                                      .block_mask = block_mask,
                                      .tile_end = &tile_end,
                                      .rgb = rgb,
                                      .gradient = gradient,
                                      .slots = slots};
    for (int i = 0; i < 7; i++) {
        uint64_t n = 0;
        double t = sg_seconds();
        for (int k = 0; k < ROUNDS; k++)
            n += kernels->raster(&a, 0);
        out->forward = fmax(out->forward, (double) n / (sg_seconds() - t));
        n = 0;
        t = sg_seconds();
        for (int k = 0; k < ROUNDS; k++)
            n += kernels->raster_backward(&a, 0);
        out->backward = fmax(out->backward, (double) n / (sg_seconds() - t));
    }
    free(splats);
    free(instances);
    free(slots);
    free(block_mask);
}

struct roofline roofline_measure(sg_ctx *ctx, const struct cpu_kernels *kernels)
{
    struct roofline r = {.bandwidth = bandwidth(ctx), .flops = flops()};
    pairs(kernels, &r);
    return r;
}
