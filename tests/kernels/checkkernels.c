/* SPDX-License-Identifier: Apache-2.0 */
/* Checks every kernel on every instruction set that this machine runs against its oracle, or times
 * both.
 *
 *     checkkernels [--bench] [--list] [PATTERN]
 *
 * PATTERN is a shell pattern of kernels ("raster*") or of kernels and variants ("fft_rows/avx2").
 */
#include "check.h"

#include <fnmatch.h>

#include "spectral/fft.h"

/* A kernel of CPU_KERNELS or SG_FFT_KERNELS, or a loss of SG_IMAGE_LOSSES, that has no check does
 * not link. */
#define K(kernel, result, arguments) extern const struct kernel_check check_##kernel;
CPU_KERNELS(K)
#undef K
#define K(kernel, result, arguments) extern const struct kernel_check check_fft_##kernel;
SG_FFT_KERNELS(K)
#undef K
#define L(kind, name, type) extern const struct kernel_check check_##name;
SG_IMAGE_LOSSES(L)
#undef L
extern const struct kernel_check check_ssim;

static const struct kernel_check *const checks[] = {
#define K(kernel, result, arguments) &check_##kernel,
    CPU_KERNELS(K)
#undef K
#define K(kernel, result, arguments) &check_fft_##kernel,
            SG_FFT_KERNELS(K)
#undef K
#define L(kind, name, type) &check_##name,
                SG_IMAGE_LOSSES(L)
#undef L
        & check_ssim,
};
#define CHECKS (sizeof(checks) / sizeof(checks[0]))

/* A kernel in one variant. */
struct selected {
    const struct kernel_check *check;
    const struct cpu_kernels *kernels;
    char name[64];
};

static void run(void **state)
{
    const struct selected *s = *state;
    s->check->check(s->kernels);
}

/* The variants of a kernel on this machine that match, at most SG_ENGINE_VARIANTS. */
static size_t select_variants(const struct kernel_check *check, const char *pattern,
                              struct selected *out)
{
    const struct cpu_kernels *variants[SG_ENGINE_VARIANTS];
    const int all = sg_cpu_variants(variants), n = check->portable ? 1 : all;
    size_t count = 0;
    for (int v = 0; v < n; v++) {
        struct selected *s = &out[count];
        s->check = check, s->kernels = variants[v];
        snprintf(s->name, sizeof(s->name), "%s/%s", check->name,
                 check->portable ? "c" : variants[v]->name);
        if (!fnmatch(pattern, check->name, 0) || !fnmatch(pattern, s->name, 0))
            count++;
    }
    return count;
}

static void bench(const struct selected *s, size_t n)
{
    const double oracle = s->check->bench(NULL);
    printf("%-40s %10.2f ns/%s\n", s->check->name, oracle, s->check->unit);
    for (size_t i = 0; i < n; i++) {
        const double time = s->check->bench(s[i].kernels);
        printf("  %-38s %10.2f ns/%-12s %7.1fx\n", s[i].name, time, s->check->unit, oracle / time);
    }
    fflush(stdout);
}

int main(int argc, char **argv)
{
    static struct selected selected[CHECKS * SG_ENGINE_VARIANTS];
    static struct CMUnitTest tests[CHECKS * SG_ENGINE_VARIANTS];
    const char *pattern = "*";
    bool time = false, list = false;
    for (int i = 1; i < argc; i++)
        if (!strcmp(argv[i], "--bench"))
            time = true;
        else if (!strcmp(argv[i], "--list"))
            list = true;
        else if (argv[i][0] != '-' && !strcmp(pattern, "*"))
            pattern = argv[i];
        else {
            fprintf(stderr, "usage: checkkernels [--bench] [--list] [PATTERN]\n");
            return 1;
        }
    size_t n = 0;
    for (size_t c = 0; c < CHECKS; c++) {
        const size_t own = select_variants(checks[c], pattern, selected + n);
        if (time && own && !list)
            bench(selected + n, own);
        for (size_t i = n; i < n + own; i++) {
            if (list)
                printf("%s\n", selected[i].name);
            tests[i] = (struct CMUnitTest){
                .name = selected[i].name, .test_func = run, .initial_state = &selected[i]};
        }
        n += own;
    }
    if (!n) {
        fprintf(stderr, "checkkernels: no kernel matches \"%s\"; --list shows them\n", pattern);
        return 1;
    }
    return time || list ? 0 : _cmocka_run_group_tests("kernels", tests, n, NULL, NULL);
}
