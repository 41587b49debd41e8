/* SPDX-License-Identifier: Apache-2.0 */
#include "dispatch.h"

#include <string.h>

#if defined(__x86_64__)
static bool has_avx2(void)
{
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}

static bool has_avx512(void)
{
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
}
#endif

/* Slowest first. */
static const struct {
    const struct cpu_kernels *kernels;
    const char *description, *needs;
    bool (*runs)(void); /* NULL: on every machine of the architecture */
} variants[] = {
#if defined(__x86_64__)
    {&sg_cpu_kernels_baseline, "x86-64, 128-bit vectors", NULL, NULL},
    {&sg_cpu_kernels_avx2, "x86-64, 256-bit vectors", "AVX2 and FMA", has_avx2},
    {&sg_cpu_kernels_avx512, "x86-64, 512-bit vectors", "AVX-512 F, BW, DQ and VL", has_avx512},
#elif defined(__aarch64__)
    {&sg_cpu_kernels_neon, "AArch64, 128-bit vectors", NULL, NULL},
#else
    {&sg_cpu_kernels_baseline, "vectors as the compiler makes them", NULL, NULL},
#endif
};
#define VARIANTS (sizeof(variants) / sizeof(variants[0]))

static bool runs(size_t i)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
#endif
    return !variants[i].runs || variants[i].runs();
}

int sg_cpu_variants(const struct cpu_kernels *out[SG_ENGINE_VARIANTS])
{
    int n = 0;
    for (size_t i = 0; i < VARIANTS; i++)
        if (runs(i))
            out[n++] = variants[i].kernels;
    return n;
}

bool sg_cpu_describe(size_t index, struct sg_engine_info *out)
{
    if (index >= VARIANTS || !out)
        return index < VARIANTS;
    const struct cpu_kernels *running[SG_ENGINE_VARIANTS];
    const int n = sg_cpu_variants(running);
    out->variant = variants[index].kernels->name;
    out->description = variants[index].description;
    out->available = runs(index);
    out->chosen = variants[index].kernels == running[n - 1];
    out->missing = out->available ? NULL : variants[index].needs;
    return true;
}

int sg_cpu_select(sg_ctx *ctx, const char *name, const struct cpu_kernels **out)
{
    const struct cpu_kernels *running[SG_ENGINE_VARIANTS];
    const int n = sg_cpu_variants(running);
    for (int i = n - 1; i >= 0; i--)
        if (!name || !strcmp(name, running[i]->name)) {
            *out = running[i];
            return SG_OK;
        }
    char list[64] = "";
    for (int i = 0; i < n; i++) {
        strcat(list, i ? ", " : "");
        strcat(list, running[i]->name);
    }
    return sg_fail(ctx, SG_ERR_USAGE, "cpu: found \"%s\", this machine and build have: %s", name,
                   list);
}
