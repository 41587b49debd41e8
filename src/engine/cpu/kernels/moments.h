/* SPDX-License-Identifier: Apache-2.0 */
/* Sums over a block's pixels for the backward pass, of each splat of a group: w and its moments
 * about the tile's centre up to the second, and the colour gradients. With AVX-512 a group is
 * transposed, so that its four splats share all shuffles. */
#ifndef SG_KERNELS_MOMENTS_H
#define SG_KERNELS_MOMENTS_H

#include "tile.h"

/* Floats of a splat's row: w, w y, w y^2, w x, w x y, w x^2, r, g, b; then those of
 * CPU_SLOT_ABSOLUTE and room up to a cache line. */
#define SUMS 16

/* Pixels of a part as the moments see them: offsets from the tile's centre, and dL/dimage. */
struct window {
#if LANES == 16
    real x[4], xx[4], y; /* a column; all its rows */
    real g[3][4];        /* of a column, in every element of the lane that is its row */
#else
    real x, y;
    real g[3];
#endif
};

SIMD float centred(int pixel)
{
    return (float) pixel - 0.5f * (SG_TILE - 1);
}

#if LANES == 16

/* rows 0 and 2 of a, then of b; HIGH: rows 1 and 3 */
#define LOW(a, b) (real) _mm512_shuffle_f32x4((__m512) (a), (__m512) (b), 0x88)
#define HIGH(a, b) (real) _mm512_shuffle_f32x4((__m512) (a), (__m512) (b), 0xdd)

SIMD void window_make(struct window *o, const real g[3], int block, int part)
{
    (void) part;
    o->y = part_y(0) + centred(block / BLOCK * BLOCK);
    for (int column = 0; column < 4; column++) {
        o->x[column] = r_set(centred(block % BLOCK * BLOCK + column));
        o->xx[column] = o->x[column] * o->x[column];
    }
    for (int ch = 0; ch < 3; ch++) {
        o->g[ch][0] = (real) _mm512_permute_ps((__m512) g[ch], 0x00);
        o->g[ch][1] = (real) _mm512_permute_ps((__m512) g[ch], 0x55);
        o->g[ch][2] = (real) _mm512_permute_ps((__m512) g[ch], 0xaa);
        o->g[ch][3] = (real) _mm512_permute_ps((__m512) g[ch], 0xff);
    }
}

/* From four splats' 4x4 pixels to columns: element = splat, lane = row. */
SIMD void columns(const real *v, real *out)
{
    const __m512d a = (__m512d) _mm512_unpacklo_ps((__m512) v[0], (__m512) v[1]);
    const __m512d b = (__m512d) _mm512_unpackhi_ps((__m512) v[0], (__m512) v[1]);
    const __m512d c = (__m512d) _mm512_unpacklo_ps((__m512) v[2], (__m512) v[3]);
    const __m512d d = (__m512d) _mm512_unpackhi_ps((__m512) v[2], (__m512) v[3]);
    out[0] = (real) _mm512_unpacklo_pd(a, c);
    out[1] = (real) _mm512_unpackhi_pd(a, c);
    out[2] = (real) _mm512_unpacklo_pd(b, d);
    out[3] = (real) _mm512_unpackhi_pd(b, d);
}

SIMD real dot4(const real *a, const real *b)
{
    return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
}

/* Lane k of the result: sum over the lanes of argument k. */
SIMD real sum_rows(real a, real b, real c, real d)
{
    const real ab = LOW(a, b) + HIGH(a, b), cd = LOW(c, d) + HIGH(c, d);
    return LOW(ab, cd) + HIGH(ab, cd);
}

/* Adds four splats' sums to their rows. */
SIMD void window_add(const struct window *o, const real *w, const real *weight, float (*sums)[SUMS],
                     const uint8_t *list)
{
    real column[4];
    columns(w, column);
    const real s0 = (column[0] + column[1]) + (column[2] + column[3]), s1 = dot4(column, o->x);
    const real y1 = o->y * s0, s2 = dot4(column, o->xx);
    const real first = sum_rows(s0, y1, o->y * y1, s1);
    columns(weight, column);
    const real second = sum_rows(o->y * s1, s2, dot4(column, o->g[0]), dot4(column, o->g[1]));
    real blue = dot4(column, o->g[2]);
    blue += (real) _mm512_shuffle_f32x4((__m512) blue, (__m512) blue, 0xee);
    float last[4];
    _mm_storeu_ps(last, _mm_add_ps(_mm512_castps512_ps128((__m512) blue),
                                   _mm512_extractf32x4_ps((__m512) blue, 1)));
    /* Element 4 k + u of first and second to 8 consecutive floats of splat u. */
    const __m512i even =
        _mm512_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28, 1, 5, 9, 13, 17, 21, 25, 29);
    const __m512i odd = _mm512_add_epi32(even, _mm512_set1_epi32(2));
    const __m512 p01 = _mm512_permutex2var_ps((__m512) first, even, (__m512) second);
    const __m512 p23 = _mm512_permutex2var_ps((__m512) first, odd, (__m512) second);
    const __m256 rows[4] = {_mm512_castps512_ps256(p01), _mm512_extractf32x8_ps(p01, 1),
                            _mm512_castps512_ps256(p23), _mm512_extractf32x8_ps(p23, 1)};
    for (int u = 0; u < GROUP; u++) {
        float *row = sums[list[u]];
        _mm256_store_ps(row, _mm256_add_ps(_mm256_load_ps(row), rows[u]));
        row[8] += last[u];
    }
}

#else

/* acc[0..8] += the lane sums of v[0..8]; acc is 64-byte aligned. */
SIMD void r_add_sums9(float *acc, const real *v)
{
#if LANES == 8
    __m256 q[2];
    for (int i = 0; i < 2; i++) {
        const __m256 ab = _mm256_hadd_ps((__m256) v[4 * i], (__m256) v[4 * i + 1]);
        const __m256 cd = _mm256_hadd_ps((__m256) v[4 * i + 2], (__m256) v[4 * i + 3]);
        q[i] = _mm256_hadd_ps(ab, cd);
    }
    const __m256 s = _mm256_add_ps(_mm256_permute2f128_ps(q[0], q[1], 0x20),
                                   _mm256_permute2f128_ps(q[0], q[1], 0x31));
    _mm256_store_ps(acc, _mm256_add_ps(_mm256_load_ps(acc), s));
    acc[8] += r_sum(v[8]);
#else
    for (int i = 0; i < 9; i++)
        acc[i] += r_sum(v[i]);
#endif
}

SIMD void window_make(struct window *o, const real g[3], int block, int part)
{
    o->x = part_x(part) + centred(block % BLOCK * BLOCK);
    o->y = part_y(part) + centred(block / BLOCK * BLOCK);
    for (int ch = 0; ch < 3; ch++)
        o->g[ch] = g[ch];
}

SIMD void window_add(const struct window *o, const real *w, const real *weight, float (*sums)[SUMS],
                     const uint8_t *list)
{
    for (int u = 0; u < GROUP; u++) {
        const real wx = w[u] * o->x, wy = w[u] * o->y;
        const real v[9] = {w[u],
                           wy,
                           wy * o->y,
                           wx,
                           wx * o->y,
                           wx * o->x,
                           weight[u] * o->g[0],
                           weight[u] * o->g[1],
                           weight[u] * o->g[2]};
        r_add_sums9(sums[list[u]], v);
    }
}

#endif

#endif
