/* SPDX-License-Identifier: Apache-2.0 */
/* `real` as a vector of LANES floats, so that src/math and the kernels are written once for every
 * instruction set. Arithmetic is the compiler's vector extension; what it cannot say well is
 * here. */
#ifndef SG_SIMD_H
#define SG_SIMD_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "math/dialect.h"

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#if defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX2__)
#define LANES 8
#else
#define LANES 4
#endif

typedef float scalar;
typedef float real __attribute__((vector_size(4 * LANES)));
typedef int32_t ireal __attribute__((vector_size(4 * LANES)));

#define SIMD static inline __attribute__((always_inline))

SIMD real r_set(float a)
{
    return a - (real){0};
}
SIMD ireal i_set(int32_t a)
{
    return a - (ireal){0};
}
SIMD real r_load(const float *p)
{
    real v;
    memcpy(&v, p, sizeof(v));
    return v;
}
SIMD void r_store(float *p, real v)
{
    memcpy(p, &v, sizeof(v));
}
#if defined(__AVX512F__)
SIMD real r_load_part(const float *p, int count)
{
    return (real) _mm512_maskz_loadu_ps((__mmask16) ((1u << count) - 1), p);
}
SIMD void r_store_part(float *p, int count, real v)
{
    _mm512_mask_storeu_ps(p, (__mmask16) ((1u << count) - 1), (__m512) v);
}
#else
/* The first `count` < LANES lanes; the others are zero. */
SIMD real r_load_part(const float *p, int count)
{
    real v = {0};
    memcpy(&v, p, (size_t) count * sizeof(float));
    return v;
}
SIMD void r_store_part(float *p, int count, real v)
{
    memcpy(p, &v, (size_t) count * sizeof(float));
}
#endif
/* near[k] = the lanes from p + k - 5 on, k = 0..10. p is aligned to a vector where that helps. */
SIMD void r_load_around(const float *p, real near[11])
{
#if LANES == 16 /* shifts of three aligned loads: a load across two cache lines costs two */
    const __m512i a = _mm512_load_si512(p - 16), b = _mm512_load_si512(p),
                  c = _mm512_load_si512(p + 16);
    near[5] = (real) b;
#define AROUND(k)                                                                                  \
    near[5 - (k)] = (real) _mm512_alignr_epi32(b, a, 16 - (k)),                                    \
             near[5 + (k)] = (real) _mm512_alignr_epi32(c, b, k)
    AROUND(1), AROUND(2), AROUND(3), AROUND(4), AROUND(5);
#undef AROUND
#else
    for (int k = 0; k < 11; k++)
        near[k] = r_load(p + k - 5);
#endif
}
SIMD real r_lane(void) /* 0, 1, 2, ... */
{
    real v;
    for (int i = 0; i < LANES; i++)
        v[i] = (float) i;
    return v;
}
/* a b + c, rounded once where the instruction exists. For sums of two products, which the compiler
 * is free to fuse either way, and does so differently from one unrolled copy to the next. */
SIMD real r_fma(real a, real b, real c)
{
#if defined(__AVX512F__)
    return (real) _mm512_fmadd_ps((__m512) a, (__m512) b, (__m512) c);
#elif defined(__FMA__)
    return (real) _mm256_fmadd_ps((__m256) a, (__m256) b, (__m256) c);
#elif defined(__aarch64__)
    return (real) vfmaq_f32((float32x4_t) c, (float32x4_t) a, (float32x4_t) b);
#else
    return a * b + c;
#endif
}
SIMD real r_from_int(ireal a)
{
    return __builtin_convertvector(a, real);
}
SIMD ireal r_to_int(real a)
{
    return __builtin_convertvector(a, ireal);
} /* truncates; callers clamp first */

#if LANES == 16
typedef __mmask16 mask;
#define r_lt(a, b) _mm512_cmp_ps_mask((__m512) (a), (__m512) (b), _CMP_LT_OQ)
#define r_le(a, b) _mm512_cmp_ps_mask((__m512) (a), (__m512) (b), _CMP_LE_OQ)
#define r_and(a, b) ((mask) ((a) & (b)))
#define m_any(a) ((a) != 0)
#define m_all ((mask) 0xffff)
#define m_bits(a) ((uint32_t) (a))
SIMD real r_sel(mask m, real a, real b)
{
    return (real) _mm512_mask_blend_ps(m, (__m512) b, (__m512) a);
}
SIMD real r_max(real a, real b)
{
    return (real) _mm512_max_ps((__m512) a, (__m512) b);
}
SIMD real r_min(real a, real b)
{
    return (real) _mm512_min_ps((__m512) a, (__m512) b);
}
SIMD real r_sqrt(real a)
{
    return (real) _mm512_sqrt_ps((__m512) a);
}
SIMD ireal i_sel(mask m, ireal a, ireal b)
{
    return (ireal) _mm512_mask_blend_epi32(m, (__m512i) b, (__m512i) a);
}
/* a + b c where m, else a */
SIMD real r_fma_if(mask m, real a, real b, real c)
{
    return (real) _mm512_mask3_fmadd_ps((__m512) b, (__m512) c, (__m512) a, m);
}
SIMD real r_keep(mask m, real a)
{
    return (real) _mm512_maskz_mov_ps(m, (__m512) a);
}
/* Square root within 1e-4: for bounds, not for values. */
SIMD real r_root(real a)
{
    return a * (real) _mm512_rsqrt14_ps(_mm512_max_ps((__m512) a, _mm512_set1_ps(1e-35f)));
}
/* Lane from[i] of a where m, else b. */
SIMD real r_move_if(mask m, real a, ireal from, real b)
{
    return (real) _mm512_mask_permutexvar_ps((__m512) b, m, (__m512i) from, (__m512) a);
}
/* The lesser where m, else 0. */
SIMD real r_min_keep(mask m, real a, real b)
{
    return (real) _mm512_maskz_min_ps(m, (__m512) a, (__m512) b);
}
/* 1/a within 2 ulp: estimate and one Newton step. */
SIMD real r_reciprocal(real a)
{
    const real x = (real) _mm512_rcp14_ps((__m512) a);
    return x * ((float) 2 - a * x);
}
#else
typedef ireal mask;
#define r_lt(a, b) ((mask) ((a) < (b)))
#define r_le(a, b) ((mask) ((a) <= (b)))
#define r_and(a, b) ((a) & (b))
#define m_all (i_set(-1))
SIMD ireal i_sel(mask m, ireal a, ireal b)
{
    return (m & a) | (~m & b);
}
SIMD real r_keep(mask m, real a)
{
    return (real) (m & (ireal) a);
}
SIMD real r_reciprocal(real a)
{
    return (float) 1 / a;
}
#if LANES == 8
#define m_bits(a) ((uint32_t) _mm256_movemask_ps((__m256) (a)))
SIMD real r_sel(mask m, real a, real b)
{
    return (real) _mm256_blendv_ps((__m256) b, (__m256) a, (__m256) m);
}
SIMD real r_max(real a, real b)
{
    return (real) _mm256_max_ps((__m256) a, (__m256) b);
}
SIMD real r_min(real a, real b)
{
    return (real) _mm256_min_ps((__m256) a, (__m256) b);
}
SIMD real r_sqrt(real a)
{
    return (real) _mm256_sqrt_ps((__m256) a);
}
#elif defined(__x86_64__)
#define m_bits(a) ((uint32_t) _mm_movemask_ps((__m128) (a)))
SIMD real r_sel(mask m, real a, real b)
{
    return (real) i_sel(m, (ireal) a, (ireal) b);
}
SIMD real r_max(real a, real b)
{
    return (real) _mm_max_ps((__m128) a, (__m128) b);
}
SIMD real r_min(real a, real b)
{
    return (real) _mm_min_ps((__m128) a, (__m128) b);
}
SIMD real r_sqrt(real a)
{
    return (real) _mm_sqrt_ps((__m128) a);
}
#elif defined(__aarch64__)
SIMD uint32_t m_bits(mask a)
{
    const uint32x4_t weight = {1, 2, 4, 8};
    return vaddvq_u32(vandq_u32((uint32x4_t) a, weight));
}
SIMD real r_sel(mask m, real a, real b)
{
    return (real) vbslq_f32((uint32x4_t) m, (float32x4_t) a, (float32x4_t) b);
}
/* As on x86: the second operand where either is NaN. */
SIMD real r_max(real a, real b)
{
    return r_sel(a > b, a, b);
}
SIMD real r_min(real a, real b)
{
    return r_sel(a < b, a, b);
}
SIMD real r_sqrt(real a)
{
    return (real) vsqrtq_f32((float32x4_t) a);
}
#else
SIMD uint32_t m_bits(mask a)
{
    uint32_t bits = 0;
    for (int i = 0; i < LANES; i++)
        bits |= (uint32_t) (a[i] & 1) << i;
    return bits;
}
SIMD real r_sel(mask m, real a, real b)
{
    return (real) i_sel(m, (ireal) a, (ireal) b);
}
SIMD real r_max(real a, real b)
{
    return r_sel(a > b, a, b);
}
SIMD real r_min(real a, real b)
{
    return r_sel(a < b, a, b);
}
SIMD real r_sqrt(real a)
{
    real out;
    for (int i = 0; i < LANES; i++)
        out[i] = __builtin_sqrtf(a[i]);
    return out;
}
#endif
#define m_any(a) (m_bits(a) != 0)
SIMD real r_root(real a)
{
    return r_sqrt(a);
}
SIMD real r_min_keep(mask m, real a, real b)
{
    return r_keep(m, r_min(a, b));
}
SIMD real r_fma_if(mask m, real a, real b, real c)
{
    return a + r_keep(m, b * c);
}
#endif

SIMD real r_abs(real a)
{
    return r_max(a, -a);
}

/* 2^y for -126 <= y < 127: minimax polynomial of degree 4, relative error 2.6e-6. The integer part
 * moves by additions and shifts, which run beside the multiplications; the dedicated AVX-512
 * instructions do not. */
SIMD real r_exp2_split(real y, real *fraction)
{
    const real shifted = y + 0x1.8p23f; /* the nearest integer is in the low bits */
    *fraction = y - (shifted - 0x1.8p23f);
    return shifted;
}

SIMD real r_exp2_join(real x, real shifted)
{
    real p = x * 9.570101908081146e-3f + 5.5917860319303916e-2f;
    p = p * x + 2.4024744827944053e-1f;
    p = p * x + 6.931218147367708e-1f;
    p = p * x + 9.999992614457144e-1f;
    return (real) ((ireal) p + ((ireal) shifted << 23));
}

SIMD real r_exp2(real y)
{
    real x;
    const real shifted = r_exp2_split(y, &x);
    return r_exp2_join(x, shifted);
}

/* e^x for |x| < 87, relative error 3e-6; beyond, as at 87. */
SIMD real r_exp(real x)
{
    /* The product is split so that large x keep their relative accuracy. */
    const real y = r_max(r_min(x * 1.44269502f, r_set(126)), r_set(-126));
    const real low = r_max(r_min(x, r_set(88)), r_set(-88)) * 1.925963033e-8f;
    return r_exp2(y) * ((float) 1 + low * 0.693147181f);
}

/* Natural logarithm of a positive normal number, absolute error 1e-5. */
SIMD real r_log(real x)
{
    const ireal bits = (ireal) x;
    const real e = r_from_int((bits >> 23) - 127);
    const real m = (real) ((bits & 0x7fffff) | 0x3f800000) - (float) 1;
    real p = m * -3.443596493494142e-2f + 1.4603304864526429e-1f;
    p = p * m - 3.030363642244506e-1f;
    p = p * m + 4.691741355628358e-1f;
    p = p * m - 7.204261771838789e-1f;
    p = p * m + 1.4426829202470193f;
    return (e + p * m) * 0.693147181f;
}

SIMD float r_sum(real v)
{
#if LANES == 16
    return _mm512_reduce_add_ps((__m512) v);
#else
    float s = 0;
    for (int i = 0; i < LANES; i++)
        s += v[i];
    return s;
#endif
}

#endif
