/* SPDX-License-Identifier: Apache-2.0 */
#include "morton.h"
#include "core/compare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splatguard/model.h"

#define SAMPLES 1024
#define AXIS_BITS 10
#define CELLS (1 << AXIS_BITS)

#define PIECE 32768 /* items that a thread sorts at a time */

struct item {
    uint32_t key, index;
};

/* A stable radix sort, a digit an axis wide at a time. Each piece of the items has counters of its
 * own, so that pieces are sorted side by side. */
struct job {
    const struct sg_places *places;
    const uint32_t *source;
    size_t n;
    float low[3], per_unit[3];
    struct item *from, *to;
    uint32_t (*counts)[CELLS]; /* of each piece: how often a digit occurs, then its first place */
    int shift;
};

static float position(const struct sg_places *p, size_t place, int axis)
{
    return place < p->count
               ? p->params[sg_param_index(p->planes, place, SG_P_XYZ + axis)]
               : p->rows[sg_param_index(p->row_planes, place - p->count, SG_P_XYZ + axis)];
}

/* The lattice leaves out a fiftieth at each end, so that strays do not push all others into one
 * cell. It spans the Gaussians before the edit, or the items if there were none. */
static void lattice(const struct sg_places *places, const uint32_t *source, size_t n_items,
                    int axis, float *low, float *per_unit)
{
    float sample[SAMPLES];
    size_t n = 0;
    for (size_t k = 0; k < SAMPLES; k++) {
        const float v = position(
            places, places->count ? k * places->count / SAMPLES : source[k * n_items / SAMPLES],
            axis);
        if (isfinite(v))
            sample[n++] = v;
    }
    *low = *per_unit = 0;
    if (!n)
        return;
    qsort(sample, n, sizeof(*sample), sg_float_ascending);
    *low = sample[n / 50];
    const float span = sample[n - 1 - n / 50] - *low;
    *per_unit = span > 0 && isfinite(span) ? CELLS / span : 0;
}

static uint32_t spread(uint32_t v) /* two zeros before each bit of ten */
{
    v = (v | v << 16) & 0x030000ff;
    v = (v | v << 8) & 0x0300f00f;
    v = (v | v << 4) & 0x030c30c3;
    return (v | v << 2) & 0x09249249;
}

static size_t piece_end(const struct job *j, size_t piece)
{
    return (piece + 1) * PIECE < j->n ? (piece + 1) * PIECE : j->n;
}

static void make_keys(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    for (size_t i = piece * PIECE; i < piece_end(j, piece); i++) {
        uint32_t key = 0;
        for (int axis = 0; axis < 3; axis++) {
            const float at = position(j->places, j->source ? j->source[i] : i, axis),
                        v = (at - j->low[axis]) * j->per_unit[axis];
            key |= spread((uint32_t) (v > 0 ? v < CELLS - 1 ? v : CELLS - 1 : 0))
                   << axis; /* NaN: 0 */
        }
        j->from[i] = (struct item){key, (uint32_t) i};
    }
}

static uint32_t digit(const struct job *j, size_t i)
{
    return j->from[i].key >> j->shift & (CELLS - 1);
}

static void count_digits(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    memset(j->counts[piece], 0, sizeof(j->counts[piece]));
    for (size_t i = piece * PIECE; i < piece_end(j, piece); i++)
        j->counts[piece][digit(j, i)]++;
}

static void scatter(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    for (size_t i = piece * PIECE; i < piece_end(j, piece); i++)
        j->to[j->counts[piece][digit(j, i)]++] = j->from[i];
}

static void sort_digit(sg_ctx *ctx, struct job *j, size_t pieces)
{
    uint32_t sum = 0;
    sg_parallel_for(ctx, pieces, count_digits, j);
    for (int d = 0; d < CELLS; d++)
        for (size_t p = 0; p < pieces; p++) {
            const uint32_t here = j->counts[p][d];
            j->counts[p][d] = sum;
            sum += here;
        }
    sg_parallel_for(ctx, pieces, scatter, j);
    struct item *swap = j->from;
    j->from = j->to, j->to = swap;
}

int sg_morton_order(sg_ctx *ctx, const struct sg_places *places, const uint32_t *source, size_t n,
                    uint32_t *order)
{
    if (n == 0)
        return SG_OK;
    const size_t pieces = (n + PIECE - 1) / PIECE;
    struct job j = {.places = places,
                    .source = source,
                    .n = n,
                    .from = sg_alloc_raw(ctx, SG_MEM_MODEL, n, sizeof(*j.from)),
                    .to = sg_alloc_raw(ctx, SG_MEM_MODEL, n, sizeof(*j.to)),
                    .counts = sg_alloc_raw(ctx, SG_MEM_MODEL, pieces, sizeof(*j.counts))};
    const int code = j.from && j.to && j.counts ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        for (int axis = 0; axis < 3; axis++)
            lattice(places, source, n, axis, &j.low[axis], &j.per_unit[axis]);
        sg_parallel_for(ctx, pieces, make_keys, &j);
        for (j.shift = 0; j.shift < 3 * AXIS_BITS; j.shift += AXIS_BITS)
            sort_digit(ctx, &j, pieces);
        for (size_t i = 0; i < n; i++)
            order[i] = j.from[i].index;
    }
    sg_free(j.from);
    sg_free(j.to);
    sg_free(j.counts);
    return code;
}
