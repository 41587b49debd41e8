/* SPDX-License-Identifier: Apache-2.0 */
#include "fft.h"

#include <math.h>

#include "engine/cpu/dispatch.h"

/* Appends e^(-2 pi i k / n), computed in double precision and rounded once. */
static float *put_root(float *to, uint64_t k, uint64_t n)
{
    const double angle = 6.283185307179586476925 * (double) (k % n) / (double) n;
    to[0] = (float) cos(angle), to[1] = (float) -sin(angle);
    return to + 2;
}

/* Radices from the last stage to the first: the last one reads with large steps and needs no
 * twiddles, so it is the largest. Returns their number, 0 if a prime factor is too large. */
static int factorise(int n, int radix[SG_FFT_STAGES])
{
    int count = 0;
    if (n == 1)
        radix[count++] = 1;
    for (int p = 3; p <= SG_FFT_PRIME_MAX && p <= n; p += 2)
        for (; n % p == 0; n /= p)
            radix[count++] = p;
    for (int r = 8; r >= 2; r /= 2) {
        for (; n % r == 0 && !(r == 8 && n == 16); n /= r)
            radix[count++] = r;
    }
    for (int i = 1; i < count; i++) /* falling order */
        for (int j = i; j > 0 && radix[j] > radix[j - 1]; j--) {
            const int kept = radix[j];
            radix[j] = radix[j - 1], radix[j - 1] = kept;
        }
    return n == 1 ? count : 0;
}

static bool quick(int n)
{
    for (int p = 2; p <= 7; p++)
        while (n % p == 0)
            n /= p;
    return n == 1;
}

static int make_stages(sg_ctx *ctx, struct sg_fft *fft, int radix[SG_FFT_STAGES])
{
    size_t floats = 0;
    for (int i = 0, rest = fft->n; i < fft->stages; i++) {
        struct sg_fft_stage *s = &fft->stage[i];
        s->radix = radix[fft->stages - 1 - i], s->rest = rest /= s->radix;
        floats += 2 * ((size_t) s->rest * (size_t) (s->radix - 1) + (size_t) s->radix);
    }
    fft->floats = floats;
    float *at = fft->tables = sg_alloc_raw(ctx, SG_MEM_FRAME, floats, sizeof(float));
    if (!at)
        return SG_ERR_BUDGET;
    for (struct sg_fft_stage *s = fft->stage; s < fft->stage + fft->stages; s++) {
        const uint64_t n = (uint64_t) s->radix * (uint64_t) s->rest;
        s->twiddles = at;
        for (uint64_t k = 0; k < (uint64_t) s->rest; k++)
            for (uint64_t j = 1; j < (uint64_t) s->radix; j++)
                at = put_root(at, k * j, n);
        s->roots = at;
        for (uint64_t j = 0; j < (uint64_t) s->radix; j++)
            at = put_root(at, j, (uint64_t) s->radix);
    }
    return SG_OK;
}

static int make_chirp(sg_ctx *ctx, struct sg_fft *fft)
{
    const uint64_t n = (uint64_t) fft->n;
    if (n > INT32_MAX / 4)
        return sg_fail(ctx, SG_ERR_BUDGET, "no Fourier transform of %d points", fft->n);
    uint64_t longer = 2 * n - 1;
    while (!quick((int) longer))
        longer++;
    if (sg_fft_create(ctx, (int) longer, &fft->longer))
        return SG_ERR_BUDGET;
    fft->floats = 2 * (n + longer);
    float *at = fft->tables = sg_alloc_raw(ctx, SG_MEM_FRAME, fft->floats, sizeof(float));
    double *conjugate = sg_alloc(ctx, SG_MEM_FRAME, 3 * longer, 2 * sizeof(double));
    if (!at || !conjugate) {
        sg_free(conjugate);
        return SG_ERR_BUDGET;
    }
    fft->chirp = at;
    for (uint64_t j = 0; j < n; j++) {
        const double angle =
            6.283185307179586476925 * (double) (j * j % (2 * n)) / (double) (2 * n);
        double *first = conjugate + 2 * j, *last = conjugate + 2 * ((longer - j) % longer);
        first[0] = last[0] = cos(angle), first[1] = last[1] = sin(angle);
        at = put_root(at, j * j, 2 * n);
    }
    fft->filter = at;
    double *transformed = conjugate + 2 * longer;
    sg_fft_exact((int) longer, conjugate, transformed, transformed + 2 * longer);
    for (uint64_t j = 0; j < 2 * longer; j++)
        at[j] = (float) (transformed[j] / (double) longer);
    sg_free(conjugate);
    return SG_OK;
}

int sg_fft_create(sg_ctx *ctx, int n, struct sg_fft **out)
{
    int radix[SG_FFT_STAGES];
    struct sg_fft *fft = *out = sg_alloc(ctx, SG_MEM_FRAME, 1, sizeof(*fft));
    if (!fft)
        return SG_ERR_BUDGET;
    fft->n = n, fft->stages = factorise(n, radix);
    const int code = fft->stages ? make_stages(ctx, fft, radix) : make_chirp(ctx, fft);
    if (code)
        sg_fft_destroy(out);
    return code;
}

void sg_fft_destroy(struct sg_fft **fft)
{
    if (!*fft)
        return;
    sg_fft_destroy(&(*fft)->longer);
    sg_free((*fft)->tables);
    sg_free(*fft);
    *fft = NULL;
}

/* The oracle needs room for 3 n complex numbers in double precision. */
size_t sg_fft_scratch(const struct sg_fft *fft)
{
    return fft->longer ? 2 * SG_FFT_POINT * (size_t) fft->longer->n : 12 * (size_t) fft->n;
}

size_t sg_fft_rows_scratch(const struct sg_fft *fft)
{
    return 2 * SG_FFT_POINT * (size_t) fft->n + (fft->longer ? sg_fft_scratch(fft) : 0);
}

const struct sg_fft_kernels *sg_fft_fastest(void)
{
    const struct cpu_kernels *variants[4];
    return &variants[sg_cpu_variants(variants) - 1]->fft;
}
