/* SPDX-License-Identifier: Apache-2.0 */
#include "cluster.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "codec.h"
#include "core/compare.h"

/* ---- numbers ---- */

#define TABLE_ROUNDS 300

/* The first of sorted values from `from` to `to` that is not below v; else `to`. */
static size_t lower_bound(const float *values, size_t from, size_t to, double v)
{
    while (from < to) {
        const size_t middle = from + (to - from) / 2;
        if ((double) values[middle] < v)
            from = middle + 1;
        else
            to = middle;
    }
    return from;
}

/* Cuts sorted values into at most SG_TABLE_SIZE runs: again and again the run with the largest
 * product of length and squared width, at its mean. Returns how many; run r begins at start[r]. */
static size_t cut(const float *values, size_t n, const double *sums,
                  size_t start[SG_TABLE_SIZE + 1])
{
    size_t runs = 1;
    start[0] = 0, start[1] = n;
    while (runs < SG_TABLE_SIZE) {
        size_t widest = 0;
        double most = 0;
        for (size_t r = 0; r < runs; r++) {
            const double width = (double) values[start[r + 1] - 1] - (double) values[start[r]],
                         cost = width * width * (double) (start[r + 1] - start[r]);
            if (cost > most)
                most = cost, widest = r;
        }
        if (most <= 0)
            break;
        const size_t from = start[widest], to = start[widest + 1];
        size_t at = lower_bound(values, from, to, (sums[to] - sums[from]) / (double) (to - from));
        /* Rounding may put the mean at an end: a piece must not be empty. */
        at = at <= from ? from + 1 : at >= to ? to - 1 : at;
        memmove(start + widest + 2, start + widest + 1, (runs - widest) * sizeof(*start));
        start[widest + 1] = at;
        runs++;
    }
    return runs;
}

int sg_make_table(sg_ctx *ctx, float *values, size_t n, float table[SG_TABLE_SIZE])
{
    size_t start[SG_TABLE_SIZE + 1];
    void *room; /* of qsort */
    double mean[SG_TABLE_SIZE], *sums = sg_alloc_raw(ctx, SG_MEM_MISC, n + 1, sizeof(*sums));
    if (!sums)
        return SG_ERR_BUDGET;
    const int code = sg_reserve(ctx, SG_MEM_MISC, n * sizeof(*values), &room);
    if (code) {
        sg_free(sums);
        return code;
    }
    qsort(values, n, sizeof(*values), sg_float_ascending);
    sg_free(room);
    /* Outwards from 0, so that no large value cancels small ones in a difference. */
    const size_t middle = lower_bound(values, 0, n, 0);
    sums[middle] = 0;
    for (size_t i = middle; i < n; i++)
        sums[i + 1] = sums[i] + (double) values[i];
    for (size_t i = middle; i-- > 0;)
        sums[i] = sums[i + 1] - (double) values[i];
    const size_t runs = cut(values, n, sums, start);
    for (int round = 0; round < TABLE_ROUNDS; round++) {
        bool moved = false;
        for (size_t r = 0; r < runs; r++)
            if (start[r + 1] > start[r])
                mean[r] =
                    (sums[start[r + 1]] - sums[start[r]]) / (double) (start[r + 1] - start[r]);
        for (size_t r = 1; r < runs; r++) {
            const size_t at = lower_bound(values, 0, n, (mean[r - 1] + mean[r]) / 2);
            moved = moved || at != start[r];
            start[r] = at;
        }
        if (!moved)
            break;
    }
    sg_free(sums);
    for (size_t r = 0; r < SG_TABLE_SIZE; r++)
        table[r] = (float) (r < SG_TABLE_SIZE - runs ? mean[0] : mean[r - (SG_TABLE_SIZE - runs)]);
    return SG_OK;
}

uint8_t sg_nearest_number(const float table[SG_TABLE_SIZE], float value)
{
    const size_t at = lower_bound(table, 0, SG_TABLE_SIZE, (double) value);
    const bool below = at == SG_TABLE_SIZE || (at && value - table[at - 1] < table[at] - value);
    return (uint8_t) (below ? at - 1 : at);
}

/* ---- vectors ---- */

/* The search is in two levels, since each of n vectors would otherwise be compared with a palette
 * of 65 536. A coarse palette divides the vectors into groups; each group has a palette of its own.
 * Then each vector takes the best of the palettes of its NEAR nearest groups, for some rounds. */
#define LANES 16       /* vectors that are compared at once */
#define SAMPLE 65536   /* vectors for the coarse palette */
#define GROUP_MAX 1024 /* of a group's palette, so that no group takes long */
#define GROUPS_MAX 256
#define COARSE_ROUNDS 8
#define FINE_ROUNDS 4
#define NEAR 4
#define NEAR_ROUNDS 2
#define LIMIT 1e9f
#define PIECE 1024 /* vectors that a thread takes at once */

/* Palettes lie in blocks of LANES vectors: minus half of their squared lengths, which is -infinity
 * where there is no vector, then component after component. The nearest vector to x is the one
 * with the largest sum of that and the product with x. */
static size_t block_floats(const struct sg_vectors *v)
{
    return LANES * (size_t) (v->width + 1);
}

static size_t blocks_of(size_t count)
{
    return (count + LANES - 1) / LANES;
}

/* Values beyond LIMIT are cut, so that all squares are finite. */
static void take(const struct sg_vectors *v, size_t i, float x[SG_SH_REST_MAX])
{
    for (int k = 0; k < v->width; k++) {
        const float value = *sg_model_at(v->model, i, v->first + k);
        x[k] = value < -LIMIT ? -LIMIT : value > LIMIT ? LIMIT : value;
    }
}

static void put(const struct sg_vectors *v, float *blocks, size_t at, const float *x)
{
    float *lane = blocks + at / LANES * block_floats(v) + at % LANES, square = 0;
    for (int k = 0; k < v->width; k++) {
        square += x[k] * x[k];
        lane[(size_t) (k + 1) * LANES] = x[k];
    }
    *lane = square / -2;
}

static void clear_lanes(const struct sg_vectors *v, float *blocks, size_t count)
{
    for (size_t at = count; at < blocks_of(count) * LANES; at++)
        blocks[at / LANES * block_floats(v) + at % LANES] = -INFINITY;
}

typedef float four __attribute__((vector_size(16)));

/* A block's scores for x. Sums are four vectors, which every processor holds in registers. */
static void score(const float *block, int width, const float *x, float s[LANES])
{
    four a[4], row[4];
    memcpy(a, block, sizeof(a));
    for (int k = 0; k < width; k++) {
        memcpy(row, block += LANES, sizeof(row));
        a[0] += x[k] * row[0];
        a[1] += x[k] * row[1];
        a[2] += x[k] * row[2];
        a[3] += x[k] * row[3];
    }
    memcpy(s, a, sizeof(a));
}

/* The vector of a palette that is nearest to x, if it beats *most, which is then its score. */
static size_t nearest(const struct sg_vectors *v, const float *blocks, size_t n_blocks,
                      const float *x, float *most, size_t otherwise)
{
    for (size_t b = 0; b < n_blocks; b++) {
        float s[LANES];
        score(blocks + b * block_floats(v), v->width, x, s);
        float highest = s[0];
        for (size_t l = 1; l < LANES; l++)
            highest = s[l] > highest ? s[l] : highest;
        for (size_t l = 0; l < LANES && highest > *most; l++)
            if (s[l] > *most)
                *most = s[l], otherwise = b * LANES + l;
    }
    return otherwise;
}

/* Moves palette vectors to the means of the vectors whose label they are; those without one stay.
 * sums: `count` rows of width + 1. */
static void move_to_means(const struct sg_vectors *v, const uint32_t *list, size_t n,
                          const uint32_t *labels, float *blocks, size_t count, double *sums)
{
    const size_t row = (size_t) v->width + 1;
    float x[SG_SH_REST_MAX];
    memset(sums, 0, count * row * sizeof(*sums));
    for (size_t j = 0; j < n; j++) {
        double *sum = sums + labels[j] * row;
        take(v, list ? list[j] : j, x);
        sum[v->width]++;
        for (int k = 0; k < v->width; k++)
            sum[k] += (double) x[k];
    }
    for (size_t p = 0; p < count; p++) {
        const double *sum = sums + p * row;
        if (sum[v->width] <= 0)
            continue;
        for (int k = 0; k < v->width; k++)
            x[k] = (float) (sum[k] / sum[v->width]);
        put(v, blocks, p, x);
    }
}

/* A palette for the Gaussians of a list, from every n / count-th on. labels: n; sums: as above. */
static void make_group(const struct sg_vectors *v, const uint32_t *list, size_t n, float *blocks,
                       size_t count, int rounds, uint32_t *labels, double *sums)
{
    float x[SG_SH_REST_MAX];
    for (size_t p = 0; p < count; p++) {
        take(v, list[p * n / count], x);
        put(v, blocks, p, x);
    }
    clear_lanes(v, blocks, count);
    for (int round = 0; round < rounds; round++) {
        for (size_t j = 0; j < n; j++) {
            float most = -INFINITY;
            take(v, list[j], x);
            labels[j] = (uint32_t) nearest(v, blocks, blocks_of(count), x, &most, 0);
        }
        move_to_means(v, list, n, labels, blocks, count, sums);
    }
}

struct group {
    size_t first, size;  /* in the list of all */
    size_t block, count; /* its palette */
    double error;        /* sum of squares with the coarse palette alone */
    int code;
};

struct search {
    sg_ctx *ctx;
    const struct sg_vectors *v;
    size_t n;
    struct group group[GROUPS_MAX];
    size_t groups;
    float *coarse, *blocks; /* palettes: coarse, and of all groups one behind another */
    uint32_t *list;         /* Gaussians, group by group */
    uint32_t *labels;       /* of a Gaussian: first its group, then its place in blocks */
    float *errors;
};

static void divide(void *arg, size_t piece, int thread)
{
    struct search *s = arg;
    (void) thread;
    for (size_t i = piece * PIECE; i < s->n && i < (piece + 1) * PIECE; i++) {
        float x[SG_SH_REST_MAX], most = -INFINITY, square = 0;
        take(s->v, i, x);
        for (int k = 0; k < s->v->width; k++)
            square += x[k] * x[k];
        s->labels[i] = (uint32_t) nearest(s->v, s->coarse, blocks_of(s->groups), x, &most, 0);
        s->errors[i] = fmaxf(square - 2 * most, 0);
    }
}

static void fill_group(void *arg, size_t i, int thread)
{
    struct search *s = arg;
    struct group *g = &s->group[i];
    (void) thread;
    uint32_t *labels = sg_alloc_raw(s->ctx, SG_MEM_MISC, g->size + 1, sizeof(*labels));
    double *sums =
        sg_alloc_raw(s->ctx, SG_MEM_MISC, g->count + 1, sizeof(*sums) * (size_t) (s->v->width + 1));
    g->code = labels && sums ? SG_OK : SG_ERR_BUDGET;
    if (!g->code && g->count)
        make_group(s->v, s->list + g->first, g->size, s->blocks + g->block * block_floats(s->v),
                   g->count, FINE_ROUNDS, labels, sums);
    sg_free(labels);
    sg_free(sums);
}

static void look_near(void *arg, size_t piece, int thread)
{
    struct search *s = arg;
    const size_t floats = block_floats(s->v);
    (void) thread;
    for (size_t i = piece * PIECE; i < s->n && i < (piece + 1) * PIECE; i++) {
        float x[SG_SH_REST_MAX], scores[GROUPS_MAX + LANES], most = -INFINITY;
        take(s->v, i, x);
        for (size_t b = 0; b < blocks_of(s->groups); b++)
            score(s->coarse + b * floats, s->v->width, x, scores + b * LANES);
        for (int near = 0; near < NEAR; near++) {
            size_t best = 0;
            for (size_t g = 1; g < s->groups; g++)
                if (scores[g] > scores[best])
                    best = g;
            const size_t block = s->group[best].block;
            const float before = most;
            const size_t at = nearest(s->v, s->blocks + block * floats,
                                      blocks_of(s->group[best].count), x, &most, 0);
            if (most > before)
                s->labels[i] = (uint32_t) (block * LANES + at);
            scores[best] = -INFINITY;
        }
    }
}

/* The coarse palette, from vectors at equal distances. */
static int make_coarse(struct search *s)
{
    const size_t n = s->n < SAMPLE ? s->n : SAMPLE;
    uint32_t *sample = sg_alloc_raw(s->ctx, SG_MEM_MISC, 2 * n, sizeof(*sample));
    double *sums =
        sg_alloc_raw(s->ctx, SG_MEM_MISC, s->groups, sizeof(*sums) * (size_t) (s->v->width + 1));
    const bool made = sample && sums;
    for (size_t j = 0; j < n && made; j++)
        sample[j] = (uint32_t) (j * s->n / n);
    if (made)
        make_group(s->v, sample, n, s->coarse, s->groups, COARSE_ROUNDS, sample + n, sums);
    sg_free(sample);
    sg_free(sums);
    return made ? SG_OK : SG_ERR_BUDGET;
}

/* Sizes and places of the groups and of their palettes. A palette of k vectors of many components
 * leaves an error that is nearly in proportion to the group's and changes little with k: shares
 * in proportion to the groups' errors make the sum least. Returns the number of blocks. */
static size_t share(struct search *s, size_t most)
{
    double error = 0;
    size_t first = 0, block = 0;
    for (size_t i = 0; i < s->n; i++) {
        s->group[s->labels[i]].size++;
        s->group[s->labels[i]].error += (double) s->errors[i];
    }
    for (size_t g = 0; g < s->groups; g++)
        error += s->group[g].error;
    for (size_t g = 0; g < s->groups; g++) {
        struct group *here = &s->group[g];
        const double part = error > 0 ? (double) (most - s->groups) * here->error / error : 0;
        size_t count = 1 + (size_t) part;
        count = count < GROUP_MAX ? count : GROUP_MAX;
        here->count = count < here->size ? count : here->size;
        here->first = first, here->block = block;
        first += here->size, block += blocks_of(here->count);
        here->size = 0;
    }
    for (size_t i = 0; i < s->n; i++) {
        struct group *here = &s->group[s->labels[i]];
        s->list[here->first + here->size++] = (uint32_t) i;
    }
    return block;
}

/* Leaves out the vectors that no Gaussian has. sums: as move_to_means leaves them. */
static int compact(struct search *s, size_t n_blocks, const double *sums, float **palette,
                   size_t *count)
{
    const size_t width = (size_t) s->v->width;
    uint32_t *place = sg_alloc_raw(s->ctx, SG_MEM_MISC, n_blocks * LANES, sizeof(*place));
    *palette = sg_alloc_raw(s->ctx, SG_MEM_MISC, n_blocks * LANES, width * sizeof(**palette));
    *count = 0;
    const bool made = place && *palette;
    for (size_t p = 0; p < n_blocks * LANES && made; p++) {
        const float *lane = s->blocks + p / LANES * block_floats(s->v) + p % LANES;
        if (sums[p * (width + 1) + width] <= 0)
            continue;
        for (size_t k = 0; k < width; k++)
            (*palette)[*count * width + k] = lane[(k + 1) * LANES];
        place[p] = (uint32_t) (*count)++;
    }
    for (size_t i = 0; i < s->n && made; i++)
        s->labels[i] = place[s->labels[i]];
    sg_free(place);
    return made ? SG_OK : SG_ERR_BUDGET;
}

static int make_fine(struct search *s, size_t most, float **palette, size_t *count)
{
    const size_t n_blocks = share(s, most), pieces = (s->n + PIECE - 1) / PIECE;
    double *sums = NULL;
    int code = SG_OK;
    s->blocks = sg_alloc(s->ctx, SG_MEM_MISC, n_blocks, block_floats(s->v) * sizeof(float));
    if (!s->blocks)
        return SG_ERR_BUDGET;
    code = sg_parallel_stage(s->ctx, SG_STAGE_WRITE, s->groups, fill_group, s);
    for (size_t g = 0; g < s->groups && !code; g++)
        code = s->group[g].code;
    if (!code && !(sums = sg_alloc_raw(s->ctx, SG_MEM_MISC, n_blocks * LANES,
                                       sizeof(*sums) * (size_t) (s->v->width + 1))))
        code = SG_ERR_BUDGET;
    for (int round = 0; round < NEAR_ROUNDS && !code; round++) {
        code = sg_parallel_stage(s->ctx, SG_STAGE_WRITE, pieces, look_near, s);
        if (!code)
            move_to_means(s->v, NULL, s->n, s->labels, s->blocks, n_blocks * LANES, sums);
    }
    if (!code)
        code = compact(s, n_blocks, sums, palette, count);
    sg_free(sums);
    return code;
}

int sg_make_palette(sg_ctx *ctx, const struct sg_vectors *vectors, size_t most, float **palette,
                    size_t *count, uint32_t *labels)
{
    const size_t n = vectors->model->count;
    size_t groups = (size_t) ceil(sqrt((double) most));
    groups = groups < GROUPS_MAX ? groups : GROUPS_MAX;
    groups = groups < n ? groups : n;
    struct search s = {.ctx = ctx, .v = vectors, .n = n, .groups = groups, .labels = labels};
    *palette = NULL;
    s.coarse = sg_alloc(ctx, SG_MEM_MISC, blocks_of(groups), block_floats(vectors) * sizeof(float));
    s.list = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*s.list));
    s.errors = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*s.errors));
    int code = s.coarse && s.list && s.errors ? make_coarse(&s) : SG_ERR_BUDGET;
    if (!code)
        code = sg_parallel_stage(ctx, SG_STAGE_WRITE, (n + PIECE - 1) / PIECE, divide, &s);
    if (!code)
        code = make_fine(&s, most, palette, count);
    sg_free(s.coarse);
    sg_free(s.blocks);
    sg_free(s.list);
    sg_free(s.errors);
    if (code) {
        sg_free(*palette);
        *palette = NULL;
    }
    return code;
}
