/* SPDX-License-Identifier: Apache-2.0 */
/* What the forward and the backward raster kernel share: a tile is drawn as 16 blocks of 4x4 pixels, each with its own list
 * of the splats that can touch it, so that a block's pixels stay in registers while its list runs by.
 * Lists are made for BATCH instances at a time: scratch is bounded whatever the scene. */
#ifndef SG_KERNELS_TILE_H
#define SG_KERNELS_TILE_H

#include "kernels.h"

#include "math/tiles.h"

#define BATCH 128
#define BLOCK 4                  /* pixels a side */
#define BLOCKS 16                /* a tile */
#define PARTS (16 / LANES)       /* vectors a block */
#define GROUP 4                  /* pairs evaluated together, so that their latencies overlap */

struct batch {
    _Alignas(64) struct cpu_splat splats[BATCH + 1]; /* the last one is never drawn: it pads lists to whole groups */
    _Alignas(64) float x[BATCH], y[BATCH], k[BATCH], slope[BATCH], var[BATCH], ic[BATCH];
    uint8_t list[BLOCKS][BATCH + 16]; /* 16: a vector may be stored, and a group padded, at the end */
    int length[BLOCKS];
};

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

/* Appends the indices first + lane of set bits to the lists of the blocks. */
SIMD void batch_append(struct batch *b, int first, ireal bits)
{
#if LANES == 16
    const __m512i index =
        _mm512_add_epi32(_mm512_set1_epi32(first), _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15));
    for (int block = 0; block < BLOCKS; block++) {
        const __mmask16 m = _mm512_test_epi32_mask((__m512i) bits, _mm512_set1_epi32(1 << block));
        const __m128i packed = _mm512_cvtepi32_epi8(_mm512_maskz_compress_epi32(m, index));
        _mm_storeu_si128((__m128i *) &b->list[block][b->length[block]], packed);
        b->length[block] += __builtin_popcount(m);
    }
#else
    for (int lane = 0; lane < LANES; lane++)
        for (uint32_t left = (uint32_t) bits[lane]; left; left &= left - 1) {
            const int block = __builtin_ctz(left);
            b->list[block][b->length[block]++] = (uint8_t) (first + lane);
        }
#endif
}

/* Loads n instances and sorts them into the blocks' lists. x0, y0: the tile's first pixel. */
__attribute__((noinline)) static void batch_load(struct batch *b, const struct cpu_raster_args *a, size_t first, int n, int x0, int y0)
{
    for (int i = 0; i < n; i++) {
        __builtin_prefetch(&a->splats[a->instances[first + (size_t) i + CPU_PREFETCH].splat]);
        const struct cpu_splat *s = &a->splats[a->instances[first + (size_t) i].splat];
        b->splats[i] = *s;
        b->x[i] = s->x, b->y[i] = s->y, b->k[i] = s->k;
        b->slope[i] = s->slope, b->var[i] = s->var, b->ic[i] = s->ic;
    }
    for (int i = n; i % LANES; i++) { /* never hit */
        b->x[i] = b->y[i] = 1e9f;
        b->k[i] = b->slope[i] = 0;
        b->var[i] = b->ic[i] = 1;
    }
    for (int block = 0; block < BLOCKS; block++)
        b->length[block] = 0;
    b->splats[BATCH] = (struct cpu_splat){.peak = -100}; /* under every cut-off */
    for (int i = 0; i < n; i += LANES) {
        const real x = r_load(&b->x[i]) - (float) x0, y = r_load(&b->y[i]);
        const struct ellipse e = {r_load(&b->k[i]), r_load(&b->slope[i]), r_load(&b->var[i]), r_load(&b->ic[i])};
        const struct ellipse_rows rows = ellipse_rows(&e);
        ireal bits = {0};
        for (int row = 0; row < 4; row++) {
            real left, right;
            const real top = (float) (y0 + row * BLOCK) - y;
            const mask hit = ellipse_row_span(&e, &rows, top, top + (float) (BLOCK - 1), &left, &right);
            /* Blocks whose pixel centres 4c .. 4c + 3 meet [x + left, x + right]; the clamps keep the conversion sane. */
            const ireal c0 = r_to_int(r_max(r_min((x + left + 1) * 0.25f, r_set(4)), r_set(0)));
            const ireal c1 = r_to_int(r_max(r_min((x + right + 4) * 0.25f, r_set(4)), r_set(0)));
            const ireal span = (i_set(1) << c1) - (i_set(1) << c0); /* bits c0 .. c1 - 1 */
            bits |= i_sel(r_and(hit, r_le(left, right)), (span & 15) << (4 * row), i_set(0));
        }
        batch_append(b, i, bits);
    }
    for (int block = 0; block < BLOCKS; block++)
        memset(&b->list[block][b->length[block]], BATCH, GROUP - 1);
}

/* GROUP splats of a list against the pixels of a part, a step of all before the next step of any. raw is the opacity before
 * the 0.99 clamp; where a skip test of Kerbl et al. applies both are 0, which blends nothing and has no gradient. */
struct pairs {
    const struct cpu_splat *splat[GROUP];
    real dx[GROUP], dy[GROUP], raw[GROUP], alpha[GROUP];
};

SIMD void pairs_eval(struct pairs *p, const struct batch *b, const uint8_t *list, real px, real py)
{
    real power[GROUP], shifted[GROUP], x[GROUP], e[GROUP];
#define EACH for (int u = 0; u < GROUP; u++)
    EACH p->splat[u] = &b->splats[list[u]];
    EACH p->dx[u] = p->splat[u]->x - px;
    EACH p->dy[u] = p->splat[u]->y - py;
    EACH x[u] = p->splat[u]->B * p->dy[u];
    EACH e[u] = p->splat[u]->C * p->dy[u];
    EACH x[u] = p->splat[u]->A * p->dx[u] + x[u];
    EACH e[u] = e[u] * p->dy[u] + p->splat[u]->peak;
    EACH power[u] = p->dx[u] * x[u] + e[u];
    EACH shifted[u] = r_exp2_split(power[u], &x[u]);
    EACH e[u] = r_exp2_join(x[u], shifted[u]); /* lists hold splats whose ellipse is near: no underflow */
    EACH p->raw[u] =
        r_keep(r_and(r_le(power[u], r_set(p->splat[u]->peak)), r_le(r_set(SG_LOG2_ALPHA_MIN), power[u])), e[u]);
    EACH p->alpha[u] = r_min(p->raw[u], r_set(SG_ALPHA_MAX));
#undef EACH
}

/* Pixels of the image among a part's. */
SIMD mask part_inside(const struct cpu_raster_args *a, real px, real py)
{
    return r_and(r_lt(px, r_set((float) a->width)), r_lt(py, r_set((float) a->height)));
}

#endif
