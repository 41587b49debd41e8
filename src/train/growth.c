/* SPDX-License-Identifier: Apache-2.0 */
#include "growth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/rng.h"
#include "model/anchors.h"

/* Cells of a grid, each once, with the new anchor that it has got: a hash table with open
 * addresses. */
#define OLD UINT32_MAX /* it has an anchor from before */
struct cell {
    int64_t at[3];
    uint32_t anchor;
    bool used;
};
struct cells {
    struct cell *slot;
    size_t slots; /* a power of two */
};

static int create_cells(sg_ctx *ctx, size_t most, struct cells *c)
{
    c->slots = 16;
    while (c->slots < 2 * most)
        c->slots *= 2;
    c->slot = sg_alloc(ctx, SG_MEM_OPTIMISER, c->slots, sizeof(*c->slot));
    return c->slot ? SG_OK : SG_ERR_BUDGET;
}

/* The slot of a cell, which is not used if the cell is not there. */
static struct cell *find_cell(const struct cells *c, const int64_t at[3])
{
    uint64_t hash = 0;
    for (int k = 0; k < 3; k++)
        hash = sg_rng_mix(hash ^ (uint64_t) at[k]);
    for (size_t i = (size_t) hash;; i++) {
        struct cell *s = &c->slot[i & (c->slots - 1)];
        if (!s->used || !memcmp(s->at, at, sizeof(s->at)))
            return s;
    }
}

static void put_cell(struct cell *s, const int64_t at[3], uint32_t anchor)
{
    memcpy(s->at, at, sizeof(s->at));
    s->used = true;
    s->anchor = anchor;
}

struct new_anchor {
    int64_t cell[3];
    float size, gradient; /* gradient: the largest of those that made it */
    int level;
    float feature[SG_ANCHOR_FEATURES];
};

struct growing {
    sg_ctx *ctx;
    const struct sg_anchor_view *old;
    const struct sg_growth_params *p;
    struct new_anchor *new;
    size_t count, capacity;
};

static bool cell_of(const float position[3], float size, int64_t cell[3])
{
    return sg_anchor_cell(position[0], size, &cell[0]) &&
           sg_anchor_cell(position[1], size, &cell[1]) &&
           sg_anchor_cell(position[2], size, &cell[2]);
}

static void centre_of(const struct new_anchor *a, float out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = (float) a->cell[k] * a->size;
}

/* Cells of this size that have an anchor: an old one, or one of an earlier grid. */
static int fill_cells(const struct growing *g, float size, size_t candidates, struct cells *out)
{
    const int planes = sg_param_count(0);
    const size_t n = g->old->count;
    if (create_cells(g->ctx, n + g->count + candidates, out))
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n + g->count; i++) {
        float at[3];
        int64_t cell[3];
        for (int k = 0; k < 3 && i < n; k++)
            at[k] = g->old->params[sg_param_index(planes, i, SG_P_XYZ + k)];
        if (i >= n)
            centre_of(&g->new[i - n], at);
        if (cell_of(at, size, cell))
            put_cell(find_cell(out, cell), cell, OLD);
    }
    return SG_OK;
}

static float mean_gradient(const struct sg_anchor_view *a, size_t i, int k)
{
    const float *s = a->statistics + sg_param_index(SG_A_STATISTICS, i, 0);
    return s[(SG_A_GRADIENT + k) * SG_LANES] / s[(SG_A_DRAWN + k) * SG_LANES];
}

/* Whether Gaussian k of an anchor grows on this grid. */
static bool grows(const struct growing *g, size_t i, int k, int level)
{
    const struct sg_growth_params *p = g->p;
    const float drawn = g->old->statistics[sg_param_index(SG_A_STATISTICS, i, SG_A_DRAWN + k)];
    const uint64_t number =
        ((uint64_t) i * SG_ANCHOR_GAUSSIANS + (uint64_t) k) * (uint64_t) p->grids;
    float gradient = p->gradient;
    for (int finer = 0; finer < level; finer++)
        gradient *= (float) (p->finer / 2);
    return drawn > p->drawn && mean_gradient(g->old, i, k) >= gradient &&
           sg_rng_uniform(p->seed, SG_RNG_ANCHORS, p->stream, number + (uint64_t) level) >
               powf(p->drop, (float) (level + 1));
}

static void position_of(const struct sg_anchor_view *a, size_t i, int k, float out[3])
{
    const float *p = a->params + sg_param_index(sg_param_count(0), i, 0),
                *anchor = a->anchor + sg_param_index(SG_A_PLANES, i, 0);
    for (int axis = 0; axis < 3; axis++)
        out[axis] =
            p[(SG_P_XYZ + axis) * SG_LANES] + anchor[(SG_A_OFFSET + 3 * k + axis) * SG_LANES] *
                                                  expf(p[(SG_P_SCALE + axis) * SG_LANES]);
}

/* Adds a candidate to the cell that it lies in. */
static int add_candidate(struct growing *g, const struct cells *cells, const int64_t cell[3],
                         size_t i, int k, int level, float size)
{
    struct cell *s = find_cell(cells, cell);
    const float *feature = g->old->anchor + sg_param_index(SG_A_PLANES, i, SG_A_FEATURE);
    const float gradient = mean_gradient(g->old, i, k);
    if (s->used && s->anchor == OLD)
        return SG_OK;
    if (!s->used) {
        if (sg_grow(g->ctx, SG_MEM_OPTIMISER, &g->new, &g->capacity, g->count + 1, g->count,
                    sizeof(*g->new)))
            return SG_ERR_BUDGET;
        put_cell(s, cell, (uint32_t) g->count);
        struct new_anchor *a = &g->new[g->count++];
        *a = (struct new_anchor){.size = size, .gradient = gradient, .level = level};
        memcpy(a->cell, cell, sizeof(a->cell));
        for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
            a->feature[f] = feature[f * SG_LANES];
        return SG_OK;
    }
    struct new_anchor *a = &g->new[s->anchor];
    a->gradient = fmaxf(a->gradient, gradient);
    for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
        a->feature[f] = fmaxf(a->feature[f], feature[f * SG_LANES]);
    return SG_OK;
}

static int grow_level(struct growing *g, int level, float size)
{
    struct cells cells = {0};
    size_t candidates = 0;
    for (size_t i = 0; i < g->old->count; i++)
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            candidates += grows(g, i, k, level);
    if (!candidates)
        return SG_OK;
    int code = fill_cells(g, size, candidates, &cells);
    for (size_t i = 0; i < g->old->count && !code; i++)
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS && !code; k++) {
            float at[3];
            int64_t cell[3];
            if (!grows(g, i, k, level))
                continue;
            position_of(g->old, i, k, at);
            if (cell_of(at, size, cell))
                code = add_candidate(g, &cells, cell, i, k, level, size);
        }
    sg_free(cells.slot);
    return code;
}

static int compare_cells(const struct new_anchor *x, const struct new_anchor *y)
{
    if (x->level != y->level)
        return x->level < y->level ? -1 : 1;
    for (int k = 0; k < 3; k++)
        if (x->cell[k] != y->cell[k])
            return x->cell[k] < y->cell[k] ? -1 : 1;
    return 0;
}

static int in_order(const void *a, const void *b)
{
    return compare_cells(a, b);
}

static int steepest_first(const void *a, const void *b)
{
    const struct new_anchor *x = a, *y = b;
    if (x->gradient != y->gradient)
        return x->gradient > y->gradient ? -1 : 1;
    return compare_cells(x, y);
}

static int make_rows(sg_ctx *ctx, const struct new_anchor *new, size_t count, float log_size_max,
                     struct sg_model **rows)
{
    struct sg_model *m;
    int code = sg_model_create(ctx, count, 0, &m);
    if (!code && (code = sg_anchors_add(ctx, m, 0)))
        sg_model_destroy(&m);
    for (size_t i = 0; i < count && !code; i++) {
        float *feature = m->columns->at[SG_C_ANCHOR] + sg_param_index(SG_A_PLANES, i, SG_A_FEATURE);
        const float log_size = logf(new[i].size);
        float position[3];
        centre_of(&new[i], position);
        sg_anchor_set(m, i, position, log_size, fminf(log_size, log_size_max));
        for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
            feature[f * SG_LANES] = new[i].feature[f];
    }
    *rows = m;
    return code;
}

int sg_grow_anchors(sg_ctx *ctx, const struct sg_anchor_view *anchors,
                    const struct sg_growth_params *p, struct sg_model **rows, bool *bound)
{
    struct growing g = {.ctx = ctx, .old = anchors, .p = p};
    int code = SG_OK, factor = p->factor;
    *rows = NULL;
    for (int level = 0; level < p->grids && !code; level++, factor /= p->finer)
        /* As in the released code, a finer grid grows only where a coarser one has. */
        if (factor && (!level || g.count))
            code = grow_level(&g, level, p->voxel * (float) factor);
    *bound = g.count > p->limit;
    if (*bound && !code) {
        qsort(g.new, g.count, sizeof(*g.new), steepest_first);
        g.count = p->limit;
    }
    if (g.count && !code) {
        qsort(g.new, g.count, sizeof(*g.new), in_order);
        code = make_rows(ctx, g.new, g.count, p->log_size_max, rows);
    }
    sg_free(g.new);
    return code;
}
