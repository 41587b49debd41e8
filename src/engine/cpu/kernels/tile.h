/* SPDX-License-Identifier: Apache-2.0 */
/* Common parts of the forward and the backward raster kernel. A tile is drawn as 16 blocks of 4x4
 * pixels. Each block has its own list of the splats that can touch it, so that its pixels stay in
 * registers while the list is processed. Lists are made for BATCH instances at a time, so that
 * scratch is bounded for every scene. */
#ifndef SG_KERNELS_TILE_H
#define SG_KERNELS_TILE_H

#include "kernels.h"

#include "math/pair.h"
#include "math/tiles.h"

#define BATCH 128
#define BLOCK 4            /* pixels a side */
#define BLOCKS 16          /* a tile */
#define PARTS (16 / LANES) /* vectors a block */
#define GROUP 4            /* pairs evaluated together, so that their latencies overlap */

struct batch {
    /* The last one is never drawn: it pads lists to whole groups. */
    _Alignas(64) struct cpu_splat splats[BATCH + 1];
    /* 16: a vector may be stored, and a group padded, at the end. */
    uint8_t list[BLOCKS][BATCH + 16];
    int length[BLOCKS];
};

typedef uint16_t halves __attribute__((vector_size(2 * LANES)));

/* Offsets of a part's pixels from the block's corner. */
SIMD real part_x(int part)
{
    real v;
    for (int i = 0; i < LANES; i++)
        v[i] = (float) ((part * LANES + i) % BLOCK);
    return v;
}

SIMD real part_y(int part)
{
    real v;
    for (int i = 0; i < LANES; i++)
        v[i] = (float) ((part * LANES + i) / BLOCK);
    return v;
}

/* Copies n instances' splats, then zeroes to whole vectors. The gathering loads miss the caches, so
 * they are prefetched. */
SIMD void batch_load(struct batch *b, const struct cpu_raster_args *a, size_t first, int n)
{
    for (int i = 0; i < n; i++) {
        __builtin_prefetch(&a->splats[a->instances[first + (size_t) i + CPU_PREFETCH].splat]);
        b->splats[i] = a->splats[a->instances[first + (size_t) i].splat];
    }
    for (int i = n; i % LANES; i++)
        b->splats[i] = (struct cpu_splat){0};
}

#define FIELDS 8

/* The first FIELDS floats of LANES splats, transposed. */
SIMD void splat_fields(const struct cpu_splat *s, real out[FIELDS])
{
#if LANES == 16
    __m512d rows[8], half[8];
    for (int i = 0; i < 8; i++) { /* row i % 4 + 8 (i / 4), and the one four below it */
        const float *row = (const float *) &s[i % 4 + i / 4 * 8];
        rows[i] = _mm512_castps_pd(
            _mm512_insertf32x8(_mm512_castps256_ps512(_mm256_load_ps(row)),
                               _mm256_load_ps(row + 4 * sizeof(*s) / sizeof(float)), 1));
    }
    for (int i = 0; i < 8; i += 4) {
        const __m512d a = (__m512d) _mm512_unpacklo_ps((__m512) rows[i], (__m512) rows[i + 1]);
        const __m512d b = (__m512d) _mm512_unpackhi_ps((__m512) rows[i], (__m512) rows[i + 1]);
        const __m512d c = (__m512d) _mm512_unpacklo_ps((__m512) rows[i + 2], (__m512) rows[i + 3]);
        const __m512d d = (__m512d) _mm512_unpackhi_ps((__m512) rows[i + 2], (__m512) rows[i + 3]);
        half[i] = _mm512_unpacklo_pd(a, c), half[i + 1] = _mm512_unpackhi_pd(a, c);
        half[i + 2] = _mm512_unpacklo_pd(b, d), half[i + 3] = _mm512_unpackhi_pd(b, d);
    }
    for (int i = 0; i < 4; i++) {
        out[i] = (real) _mm512_shuffle_f32x4((__m512) half[i], (__m512) half[i + 4], 0x88);
        out[i + 4] = (real) _mm512_shuffle_f32x4((__m512) half[i], (__m512) half[i + 4], 0xdd);
    }
#else
    float lanes[FIELDS][LANES];
    for (int lane = 0; lane < LANES; lane++)
        for (int i = 0; i < FIELDS; i++)
            lanes[i][lane] = ((const float *) &s[lane])[i];
    for (int i = 0; i < FIELDS; i++)
        out[i] = r_load(lanes[i]);
#endif
}

/* Which blocks each splat can touch, a bit a block. x0, y0: the tile's first pixel. */
SIMD void batch_find(const struct batch *b, int n, int x0, int y0, uint16_t *block_mask)
{
    for (int i = 0; i < n; i += LANES) {
        real in[FIELDS];
        splat_fields(&b->splats[i], in);
        const real x = in[0] - (float) x0, y = in[1];
        const struct ellipse e = {in[2], in[3], in[4], in[5], in[6]};
        ireal bits = {0};
        for (int row = 0; row < 4; row++) {
            const real top = (float) (y0 + row * BLOCK) - y;
            const struct row_span span = ellipse_row_span(e, top, top + (float) (BLOCK - 1));
            const struct cell_range cells = row_span_cells(span, x, BLOCK, r_set(0), r_set(4));
            const ireal c0 = r_to_int(cells.first), c1 = r_to_int(cells.end);
            const ireal columns = (i_set(1) << c1) - (i_set(1) << c0); /* bits c0 .. c1 - 1 */
            bits |= i_sel(r_and(span.hit, r_le(span.x0, span.x1)), (columns & 15) << (4 * row),
                          i_set(0));
        }
        const halves found = __builtin_convertvector(bits, halves);
        memcpy(block_mask + i, &found, sizeof(uint16_t) * (size_t) (n - i < LANES ? n - i : LANES));
    }
}

/* The blocks' lists from the bits, padded to whole groups with a splat that is under every
 * cut-off. */
SIMD void batch_list(struct batch *b, const uint16_t *block_mask, int n)
{
    for (int block = 0; block < BLOCKS; block++)
        b->length[block] = 0;
#if LANES == 16
    __m512i index = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    for (int i = 0; i < n; i += 16) {
        const __mmask16 valid = (__mmask16) (n - i < 16 ? (1 << (n - i)) - 1 : 0xffff);
        const __m512i bits = _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(valid, block_mask + i));
        for (int block = 0; block < BLOCKS; block++) {
            const __mmask16 m = _mm512_test_epi32_mask(bits, _mm512_set1_epi32(1 << block));
            const __m128i packed = _mm512_cvtepi32_epi8(_mm512_maskz_compress_epi32(m, index));
            _mm_storeu_si128((__m128i *) &b->list[block][b->length[block]], packed);
            b->length[block] += __builtin_popcount(m);
        }
        index = _mm512_add_epi32(index, _mm512_set1_epi32(16));
    }
#else
    for (int i = 0; i < n; i++)
        for (uint32_t left = block_mask[i]; left; left &= left - 1) {
            const int block = __builtin_ctz(left);
            b->list[block][b->length[block]++] = (uint8_t) i;
        }
#endif
    b->splats[BATCH] = (struct cpu_splat){.peak = -100};
    for (int block = 0; block < BLOCKS; block++)
        memset(&b->list[block][b->length[block]], BATCH, GROUP - 1);
}

/* GROUP splats of a list against the pixels of a part, a step of all before the next step of any.
 * raw is the opacity before its bound; where a skip test of Kerbl et al. applies, a pixel is not
 * drawn and its alpha is 0. */
struct pairs {
    const struct cpu_splat *splat[GROUP];
    mask drawn[GROUP];
    real raw[GROUP], alpha[GROUP];
};

SIMD void pairs_eval(struct pairs *p, const struct batch *b, const uint8_t *list, real px, real py)
{
    real dx[GROUP], dy[GROUP], power[GROUP], shifted[GROUP], x[GROUP], below[GROUP];
#define EACH for (int u = 0; u < GROUP; u++)
    EACH p->splat[u] = &b->splats[list[u]];
    EACH dx[u] = px - p->splat[u]->x;
    EACH dy[u] = py - p->splat[u]->y;
    EACH x[u] = pair_along(dx[u], dy[u], p->splat[u]->across, p->splat[u]->shear);
    EACH below[u] = pair_below(dy[u], p->splat[u]->down, p->splat[u]->peak);
    EACH power[u] = pair_power(x[u], below[u]);
    EACH shifted[u] = r_exp2_split(power[u], &x[u]);
    /* Far from a small ellipse this wraps around; such a pixel is not drawn. */
    EACH p->raw[u] = r_exp2_join(x[u], shifted[u]);
    EACH p->drawn[u] = pair_drawn(power[u]);
    EACH p->alpha[u] = pair_alpha(p->drawn[u], p->raw[u]);
#undef EACH
}

/* Pixels of the image among a part's. */
SIMD mask part_inside(const struct cpu_raster_args *a, real px, real py)
{
    return r_and(r_lt(px, r_set((float) a->width)), r_lt(py, r_set((float) a->height)));
}

#endif
