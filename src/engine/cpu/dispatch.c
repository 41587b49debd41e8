/* SPDX-License-Identifier: Apache-2.0 */
#include "dispatch.h"

#include <string.h>

int sg_cpu_variants(const struct cpu_kernels *out[4])
{
    int n = 0;
#if defined(__x86_64__)
    __builtin_cpu_init();
    out[n++] = &sg_cpu_kernels_baseline;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        out[n++] = &sg_cpu_kernels_avx2;
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        out[n++] = &sg_cpu_kernels_avx512;
#elif defined(__aarch64__)
    out[n++] = &sg_cpu_kernels_neon;
#else
    out[n++] = &sg_cpu_kernels_baseline;
#endif
    return n;
}

int sg_cpu_select(sg_ctx *ctx, const char *name, const struct cpu_kernels **out)
{
    const struct cpu_kernels *variants[4];
    const int n = sg_cpu_variants(variants);
    for (int i = n - 1; i >= 0; i--)
        if (!name || !strcmp(name, variants[i]->name)) {
            *out = variants[i];
            return SG_OK;
        }
    char list[64] = "";
    for (int i = 0; i < n; i++) {
        strcat(list, i ? ", " : "");
        strcat(list, variants[i]->name);
    }
    return sg_fail(ctx, SG_ERR_USAGE, "cpu: found \"%s\", this machine and build have: %s", name,
                   list);
}
