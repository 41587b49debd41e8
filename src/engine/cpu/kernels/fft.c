/* SPDX-License-Identifier: Apache-2.0 */
/* Mixed radix transforms by decimation in time, depth first: the transforms of a part that fits
 * into the nearest cache are finished before the next part is begun. Lanes are transforms, so
 * nothing is ever shuffled here. This file is compiled without fused multiplications and additions:
 * every instruction set gives the same bytes.
 *
 * Backward transforms are forward ones whose real and imaginary parts are exchanged: `re` is the
 * place of the real parts in a point, 0 or 16. */
#include "spectral/fft.h"

#include "kernels.h"

#define POINT SG_FFT_POINT

#undef SG_FN
#define SG_FN SIMD /* no call passes vectors through memory */
#include "math/fft_points.h"

SIMD struct fft_value load(const float *p, int re)
{
    return (struct fft_value){r_load(p + re), r_load(p + (re ^ SG_FFT_LANES))};
}

SIMD void store(float *p, int re, struct fft_value v)
{
    r_store(p + re, v.re);
    r_store(p + (re ^ SG_FFT_LANES), v.im);
}

/* ---- transforms of a few points, in place ---- */

/* By definition, with the conjugate symmetry of the roots of unity: for 7, 11 and 13 the loops are
 * unrolled. */
SIMD void prime(int p, struct fft_value *x, const float *roots)
{
    struct fft_value sum[SG_FFT_PRIME_MAX / 2], difference[SG_FFT_PRIME_MAX / 2];
    const struct fft_value first = x[0];
    const int half = p / 2;
    struct fft_value total = first;
#pragma GCC unroll 8
    for (int j = 0; j < half; j++) {
        sum[j] = fft_add(x[1 + j], x[p - 1 - j]);
        difference[j] = fft_subtract(x[1 + j], x[p - 1 - j]);
        total = fft_add(total, sum[j]);
    }
    x[0] = total;
#pragma GCC unroll 8
    for (int k = 1; k <= half; k++) {
        struct fft_value c = first, s = {r_set(0), r_set(0)};
        int at = 0;
#pragma GCC unroll 8
        for (int j = 0; j < half; j++) {
            at = at + k < p ? at + k : at + k - p;
            c.re += sum[j].re * roots[2 * at];
            c.im += sum[j].im * roots[2 * at];
            s.re += difference[j].im * roots[2 * at + 1];
            s.im += difference[j].re * roots[2 * at + 1];
        }
        x[k] = (struct fft_value){c.re - s.re, c.im + s.im};
        x[p - k] = (struct fft_value){c.re + s.re, c.im - s.im};
    }
}

/* radix is constant where this is inlined, but for large primes. */
SIMD void transform_few(int radix, struct fft_value *x, const float *roots)
{
    switch (radix) {
    case 1:
        break;
    case 2:
        fft_two(x);
        break;
    case 3:
        fft_three(x);
        break;
    case 4:
        fft_four(x);
        break;
    case 5:
        fft_five(x);
        break;
    case 8:
        fft_eight(x);
        break;
    default:
        prime(radix, x, roots);
    }
}

/* ---- a stage ---- */

/* `count` transforms of `radix` points, which are `step` floats apart; the next transform begins
 * `next` floats on. */
SIMD void begin(int radix, int count, const float *in, size_t step, size_t next, float *out, int re,
                const float *roots)
{
    for (int i = 0; i < count; i++, in += next, out += radix * POINT)
        for (int part = 0; part < SG_FFT_LANES; part += LANES) {
            struct fft_value x[SG_FFT_PRIME_MAX];
#pragma GCC unroll 16
            for (int j = 0; j < radix; j++)
                x[j] = load(in + (size_t) j * step + part, re);
            transform_few(radix, x, roots);
#pragma GCC unroll 16
            for (int j = 0; j < radix; j++)
                store(out + j * POINT + part, re, x[j]);
        }
}

/* `radix` transforms of `rest` points, one after the other in data, become one. */
SIMD void join(int radix, int rest, float *data, int re, const float *twiddles, const float *roots)
{
    const size_t step = (size_t) rest * POINT;
    for (int k = 0; k < rest; k++, data += POINT, twiddles += 2 * (radix - 1))
        for (int part = 0; part < SG_FFT_LANES; part += LANES) {
            struct fft_value x[SG_FFT_PRIME_MAX];
            x[0] = load(data + part, re);
#pragma GCC unroll 16
            for (int j = 1; j < radix; j++)
                x[j] = fft_multiply(load(data + (size_t) j * step + part, re), twiddles[2 * j - 2],
                                    twiddles[2 * j - 1]);
            transform_few(radix, x, roots);
#pragma GCC unroll 16
            for (int j = 0; j < radix; j++)
                store(data + (size_t) j * step + part, re, x[j]);
        }
}

#define EACH_RADIX(DO) DO(1) DO(2) DO(3) DO(4) DO(5) DO(7) DO(8) DO(11) DO(13)

static __attribute__((noinline)) void begin_any(const struct sg_fft_stage *s, int count,
                                                const float *in, size_t step, size_t next,
                                                float *out, int re)
{
    switch (s->radix) {
#define BEGIN(r)                                                                                   \
    case r:                                                                                        \
        begin(r, count, in, step, next, out, re, s->roots);                                        \
        break;
        EACH_RADIX(BEGIN)
    default:
        begin(s->radix, count, in, step, next, out, re, s->roots);
    }
}

static __attribute__((noinline)) void join_any(const struct sg_fft_stage *s, float *data, int re)
{
    switch (s->radix) {
#define JOIN(r)                                                                                    \
    case r:                                                                                        \
        join(r, s->rest, data, re, s->twiddles, s->roots);                                         \
        break;
        EACH_RADIX(JOIN)
    default:
        join(s->radix, s->rest, data, re, s->twiddles, s->roots);
    }
}

static void transform(const struct sg_fft_stage *s, const float *in, size_t step, float *out,
                      int re)
{
    if (s->rest == 1) {
        begin_any(s, 1, in, step, 0, out, re);
        return;
    }
    if (s[1].rest == 1)
        begin_any(s + 1, s->radix, in, step * (size_t) s->radix, step, out, re);
    else
        for (int j = 0; j < s->radix; j++)
            transform(s + 1, in + (size_t) j * step, step * (size_t) s->radix,
                      out + (size_t) j * (size_t) s->rest * POINT, re);
    join_any(s, out, re);
}

/* ---- any length ---- */

/* to = from times the factors of each point; the rest of to is 0. */
static void scale(const float *from, int from_re, const float *factors, int n, float *to, int to_re,
                  int end)
{
    for (int k = 0; k < end; k++, from += POINT, to += POINT)
        for (int part = 0; part < SG_FFT_LANES; part += LANES) {
            const struct fft_value zero = {r_set(0), r_set(0)};
            store(to + part, to_re,
                  k < n
                      ? fft_multiply(load(from + part, from_re), factors[2 * k], factors[2 * k + 1])
                      : zero);
        }
}

void KERNEL(fft_columns)(const struct sg_fft *fft, const float *in, float *out, bool backward,
                         float *scratch)
{
    const int re = backward ? SG_FFT_LANES : 0;
    if (!fft->longer) {
        transform(fft->stage, in, POINT, out, re);
        return;
    }
    const int longer = fft->longer->n;
    float *a = scratch, *b = scratch + (size_t) longer * POINT;
    scale(in, re, fft->chirp, fft->n, a, 0, longer);
    transform(fft->longer->stage, a, POINT, b, 0);
    scale(b, 0, fft->filter, longer, b, 0, longer);
    transform(fft->longer->stage, b, POINT, a, SG_FFT_LANES);
    scale(a, 0, fft->chirp, fft->n, out, re, fft->n);
}

/* ---- rows ---- */

#define BLOCK SG_FFT_LANES

#if LANES == 16
#define R_LOW(a, b)                                                                                \
    __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)
#define R_HIGH(a, b)                                                                               \
    __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31)
#elif LANES == 8
#define R_LOW(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11)
#define R_HIGH(a, b) __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15)
#else
#define R_LOW(a, b) __builtin_shufflevector(a, b, 0, 4, 1, 5)
#define R_HIGH(a, b) __builtin_shufflevector(a, b, 2, 6, 3, 7)
#endif

/* LANES x LANES values: each round interleaves the first half of the vectors with the second. */
SIMD void transpose(real v[LANES])
{
#pragma GCC unroll 4
    for (int round = 1; round < LANES; round *= 2) {
        real w[LANES];
#pragma GCC unroll 8
        for (int i = 0; i < LANES / 2; i++) {
            w[2 * i] = R_LOW(v[i], v[i + LANES / 2]);
            w[2 * i + 1] = R_HIGH(v[i], v[i + LANES / 2]);
        }
#pragma GCC unroll 16
        for (int i = 0; i < LANES; i++)
            v[i] = w[i];
    }
}

/* A block of 16 x 16 values: to[j][i] = from[i][at + j]. */
SIMD void transpose_block(const float *const *from, size_t at, float *to, size_t step)
{
    for (int i = 0; i < BLOCK; i += LANES)
        for (int j = 0; j < BLOCK; j += LANES) {
            real v[LANES];
#pragma GCC unroll 16
            for (int k = 0; k < LANES; k++)
                v[k] = r_load(from[i + k] + at + j);
            transpose(v);
#pragma GCC unroll 16
            for (int k = 0; k < LANES; k++)
                r_store(to + (size_t) (j + k) * step + i, v[k]);
        }
}

struct block {
    _Alignas(64) float value[BLOCK][BLOCK];
};

SIMD void point_to(const struct block *b, const float *rows[BLOCK])
{
    for (int i = 0; i < BLOCK; i++)
        rows[i] = b->value[i];
}

/* Row i becomes lane i: rows 0 to 15 of the real parts, 16 to 31 of the imaginary parts. */
static void gather_rows(const struct sg_fft_rows *r, const float *const *row, float *to, int n)
{
    for (int first = 0; first < SG_FFT_ROWS; first += BLOCK, to += BLOCK) {
        const int count = r->count - first;
        for (int x = 0; x < r->width; x += BLOCK) {
            const int width = r->width - x;
            if (count >= BLOCK && width >= BLOCK) {
                transpose_block(row + first, (size_t) x, to + (size_t) x * POINT, POINT);
                continue;
            }
            struct block own = {0}, turned;
            const float *rows[BLOCK];
            point_to(&own, rows);
            for (int i = 0; i < BLOCK && i < count; i++)
                memcpy(own.value[i], row[first + i] + x,
                       (size_t) (width < BLOCK ? width : BLOCK) * sizeof(float));
            transpose_block(rows, 0, turned.value[0], BLOCK);
            for (int j = 0; j < BLOCK && j < width; j++)
                memcpy(to + (size_t) (x + j) * POINT, turned.value[j], sizeof(turned.value[j]));
        }
        for (int x = r->width; x < n; x++)
            memcpy(to + (size_t) x * POINT, to + (size_t) (r->width - 1) * POINT,
                   BLOCK * sizeof(float));
    }
}

/* The transforms of a pair of real rows from that of the complex row whose parts they were. */
SIMD void split_pair(const float *at, const float *twin, struct block split[4], int k)
{
    for (int part = 0; part < BLOCK; part += LANES) {
        const struct fft_value z = load(at + part, 0), t = load(twin + part, 0);
        r_store(split[0].value[k] + part, (z.re + t.re) * 0.5f);
        r_store(split[1].value[k] + part, (z.im - t.im) * 0.5f);
        r_store(split[2].value[k] + part, (z.im + t.im) * 0.5f);
        r_store(split[3].value[k] + part, (t.re - z.re) * 0.5f);
    }
}

void KERNEL(fft_rows)(const struct sg_fft *fft, const struct sg_fft_rows *r,
                      const float *const *row, float *scratch)
{
    const int n = fft->n;
    float *own = scratch, *f = own + (size_t) n * POINT, *panel = r->panels;
    gather_rows(r, row, own, n);
    KERNEL(fft_columns)(fft, own, f, false, f + (size_t) n * POINT);
    for (int first = 0; first < r->columns; first += BLOCK, panel += r->panel) {
        struct block split[4], turned;
        const int end = n - first < BLOCK ? n - first : BLOCK;
        for (int k = 0; k < end; k++)
            split_pair(f + (size_t) (first + k) * POINT, f + (size_t) ((n - first - k) % n) * POINT,
                       split, k);
        for (int m = 0; m < 4; m++) {
            const float *rows[BLOCK];
            point_to(&split[m], rows);
            memset(split[m].value[end], 0, (size_t) (BLOCK - end) * sizeof(split[m].value[0]));
            float *to = panel + m / 2 * BLOCK * POINT + m % 2 * SG_FFT_LANES;
            const int count = r->count - m / 2 * BLOCK;
            if (count >= BLOCK) {
                transpose_block(rows, 0, to, POINT);
                continue;
            }
            transpose_block(rows, 0, turned.value[0], BLOCK);
            for (int i = 0; i < count; i++)
                memcpy(to + i * POINT, turned.value[i], sizeof(turned.value[i]));
        }
    }
}

/* The complex row whose parts are the transforms back of a pair of half spectra. */
SIMD void join_pair(const struct block half[4], int k, float *at, float *twin, bool first)
{
    for (int part = 0; part < BLOCK; part += LANES) {
        const real re1 = r_load(half[0].value[k] + part), re2 = r_load(half[2].value[k] + part);
        const real im1 = first ? r_set(0) : r_load(half[1].value[k] + part);
        const real im2 = first ? r_set(0) : r_load(half[3].value[k] + part);
        store(twin + part, 0, (struct fft_value){re1 + im2, re2 - im1});
        store(at + part, 0, (struct fft_value){re1 - im2, re2 + im1});
    }
}

/* Row i of a part, from lane i. */
static void add_rows(const struct sg_fft_rows *r, const float *from, float *const *row, int count,
                     float scale)
{
    for (int x = 0; x < r->width; x += BLOCK) {
        const float *points[BLOCK];
        const int width = r->width - x < BLOCK ? r->width - x : BLOCK;
        struct block turned;
        for (int j = 0; j < BLOCK; j++)
            points[j] = from + (size_t) (x + (j < width ? j : 0)) * POINT;
        transpose_block(points, 0, turned.value[0], BLOCK);
        for (int i = 0; i < BLOCK && i < count; i++) {
            float *to = row[i] ? row[i] + x : NULL;
            if (to && width == BLOCK)
                for (int j = 0; j < BLOCK; j += LANES)
                    r_store(to + j, r_load(to + j) + r_load(turned.value[i] + j) * scale);
            else if (to)
                for (int j = 0; j < width; j++)
                    to[j] += turned.value[i][j] * scale;
        }
    }
}

void KERNEL(fft_rows_back)(const struct sg_fft *fft, const struct sg_fft_rows *r, float *const *row,
                           float scale, float *scratch)
{
    const int n = fft->n;
    float *f = scratch, *own = f + (size_t) n * POINT;
    const float *panel = r->panels;
    static const struct block zeros;
    for (int k = r->columns; k <= n - r->columns; k++)
        memset(f + (size_t) k * POINT, 0, POINT * sizeof(float));
    for (int first = 0; first < r->columns; first += BLOCK, panel += r->panel) {
        struct block half[4];
        for (int m = 0; m < 4; m++) {
            const float *rows[BLOCK];
            for (int i = 0; i < BLOCK; i++) {
                const int y = m / 2 * BLOCK + i;
                rows[i] = y < r->count ? panel + y * POINT + m % 2 * SG_FFT_LANES : zeros.value[0];
            }
            transpose_block(rows, 0, half[m].value[0], BLOCK);
        }
        for (int k = first; k < first + BLOCK && k < r->columns; k++)
            join_pair(half, k - first, f + (size_t) k * POINT, f + (size_t) ((n - k) % n) * POINT,
                      k == 0);
    }
    KERNEL(fft_columns)(fft, f, own, true, own + (size_t) n * POINT);
    for (int part = 0; part < POINT; part += LANES) {
        float *last = own + (size_t) (r->width - 1) * POINT + part;
        real sum = r_load(last);
        for (int x = r->width; x < n; x++)
            sum += r_load(own + (size_t) x * POINT + part);
        r_store(last, sum);
    }
    add_rows(r, own, row, r->count, scale);
    if (r->count > BLOCK)
        add_rows(r, own + SG_FFT_LANES, row + BLOCK, r->count - BLOCK, scale);
}
