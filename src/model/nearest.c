/* SPDX-License-Identifier: Apache-2.0 */
/* Three nearest neighbours with a k-d tree kept as a permutation: exact, unless a search visits
 * PATIENCE leaves, which happens only with points that were placed to make it slow. So no input
 * makes it quadratic. */
#include "nearest.h"

#include <math.h>

#define LEAF 16
#define PIECE 1024
#define APART 8      /* at least as many items are between two medians */
#define PATIENCE 512 /* leaves; a search in photographed scenes meets ten */
#define HASTE 40     /* rounds of selection that a random order never needs */

struct tree {
    const float *xyz;
    uint32_t *index; /* a node is a range of it; its median splits it along its widest axis */
    uint8_t *axis;   /* of the node whose median is here */
    float (
        *box)[6]; /* of the node whose median is in these APART: lowest and highest coordinates */
    float *out;
    size_t n;
};

static bool before(const struct tree *t, uint32_t a, uint32_t b,
                   int axis) /* ties by index: no two are equal */
{
    const float x = t->xyz[3 * (size_t) a + (size_t) axis],
                y = t->xyz[3 * (size_t) b + (size_t) axis];
    return x < y || (x == y && a < b);
}

static void swap(uint32_t *a, uint32_t *b)
{
    const uint32_t kept = *a;
    *a = *b, *b = kept;
}

static void select_rank(const struct tree *t, size_t low, size_t high, size_t k, int axis);

/* Median of the medians of five (Blum et al. 1973): between 30 and 70 % of the range lie on each
 * side of it. */
static uint32_t fair_pivot(const struct tree *t, size_t low, size_t high, int axis)
{
    uint32_t *a = t->index;
    size_t groups = 0;
    for (size_t g = low; g + 5 <= high + 1; g += 5, groups++) {
        for (size_t i = g + 1; i < g + 5; i++)
            for (size_t j = i; j > g && before(t, a[j], a[j - 1], axis); j--)
                swap(&a[j], &a[j - 1]);
        swap(&a[low + groups], &a[g + 2]);
    }
    if (groups < 2)
        return a[low];
    select_rank(t, low, low + groups - 1, low + groups / 2, axis);
    return a[low + groups / 2];
}

/* Moves the element of rank k to index k, with smaller ones before it (Hoare 1961). A file made to
 * defeat the cheap pivot costs HASTE rounds; after them every round is linear in any case. */
static void select_rank(const struct tree *t, size_t low, size_t high, size_t k, int axis)
{
    uint32_t *a = t->index;
    for (int round = 0; low < high; round++) {
        const uint32_t pivot =
            round < HASTE ? a[low + (high - low) / 2] : fair_pivot(t, low, high, axis);
        size_t i = low, j = high;
        for (;;) {
            while (before(t, a[i], pivot, axis))
                i++;
            while (before(t, pivot, a[j], axis))
                j--;
            if (i >= j)
                break;
            swap(&a[i++], &a[j--]);
        }
        if (k <= j)
            high = j;
        else
            low = j + 1;
    }
}

static void build(struct tree *t, size_t low, size_t high) /* [low, high) */
{
    while (high - low > LEAF) {
        float lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY};
        for (size_t i = low; i < high; i++)
            for (int k = 0; k < 3; k++) {
                const float v = t->xyz[3 * (size_t) t->index[i] + (size_t) k];
                lo[k] = fminf(lo[k], v), hi[k] = fmaxf(hi[k], v);
            }
        int axis = 0;
        for (int k = 1; k < 3; k++)
            axis = hi[k] - lo[k] > hi[axis] - lo[axis] ? k : axis;
        const size_t middle = low + (high - low) / 2;
        select_rank(t, low, high - 1, middle, axis);
        t->axis[middle] = (uint8_t) axis;
        for (int k = 0; k < 3; k++)
            t->box[middle / APART][k] = lo[k], t->box[middle / APART][3 + k] = hi[k];
        build(t, low, middle);
        low = middle + 1;
    }
}

struct best {
    size_t self;
    float d[3]; /* ascending */
    int leaves; /* met */
};

static void offer(const struct tree *t, struct best *b, size_t other)
{
    if (other == b->self)
        return;
    float d = 0;
    for (int k = 0; k < 3; k++) {
        const float e = t->xyz[3 * b->self + (size_t) k] - t->xyz[3 * other + (size_t) k];
        d += e * e;
    }
    if (d >= b->d[2])
        return;
    int at = 2;
    for (; at > 0 && d < b->d[at - 1]; at--)
        b->d[at] = b->d[at - 1];
    b->d[at] = d;
}

/* No point of the box can be nearer: every step rounds as in `offer`, and rounding keeps the
 * order. */
static float box_distance(const struct tree *t, size_t self, const float box[6])
{
    float d = 0;
    for (int k = 0; k < 3; k++) {
        const float v = t->xyz[3 * self + (size_t) k],
                    e = fmaxf(fmaxf(box[k] - v, v - box[3 + k]), 0);
        d += e * e;
    }
    return d;
}

static void visit(const struct tree *t, struct best *b, size_t low, size_t high)
{
    while (high - low > LEAF) {
        const size_t middle = low + (high - low) / 2;
        if (b->leaves >= PATIENCE || box_distance(t, b->self, t->box[middle / APART]) >= b->d[2])
            return;
        const int axis = t->axis[middle];
        const float e = t->xyz[3 * b->self + (size_t) axis] -
                        t->xyz[3 * (size_t) t->index[middle] + (size_t) axis];
        offer(t, b, t->index[middle]);
        const bool left = e < 0;
        visit(t, b, left ? low : middle + 1, left ? middle : high);
        if (e * e >= b->d[2])
            return;
        if (left)
            low = middle + 1;
        else
            high = middle;
    }
    b->leaves++;
    for (size_t i = low; i < high; i++)
        offer(t, b, t->index[i]);
}

static void query_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct tree *t = arg;
    const size_t end = (piece + 1) * PIECE < t->n ? (piece + 1) * PIECE : t->n;
    for (size_t i = piece * PIECE; i < end; i++) {
        struct best b = {.self = t->index[i], .d = {INFINITY, INFINITY, INFINITY}};
        visit(t, &b, 0, t->n);
        t->out[b.self] = (b.d[0] + b.d[1] + b.d[2]) / 3;
    }
}

int sg_nearest3(sg_ctx *ctx, const float *xyz, size_t n, float *out)
{
    struct tree t = {.xyz = xyz, .out = out, .n = n};
    if ((uint64_t) n > UINT32_MAX) /* what an index holds */
        return sg_fail(ctx, SG_ERR_INPUT, "found %zu points, expected at most %llu", n,
                       (unsigned long long) UINT32_MAX);
    t.index = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*t.index));
    t.axis = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*t.axis));
    t.box = sg_alloc_raw(ctx, SG_MEM_MISC, n / APART + 1, sizeof(*t.box));
    int code = t.index && t.axis && t.box ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        for (size_t i = 0; i < n; i++)
            t.index[i] = (uint32_t) i;
        build(&t, 0, n);
        code = sg_parallel_stage(ctx, SG_STAGE_INIT, (n + PIECE - 1) / PIECE, query_piece, &t);
    }
    sg_free(t.index);
    sg_free(t.axis);
    sg_free(t.box);
    return code;
}
