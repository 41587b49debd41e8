/* SPDX-License-Identifier: Apache-2.0 */
/* Gradients of a view's Gaussians to those of its anchors and of the networks, and the steps of
 * Adam. */
#include "math/real_f32.h"

#include <string.h>

#include "math/adam.h"
#include "state.h"

/* Gradients of the view's Gaussians, and their statistics of this view alone. */
static int pull_drawn(struct scaffold_engine *b, bool statistics)
{
    const struct sg_host_model *h = sg_scaffold_drawn_model(b);
    float *counted[] = {h->at[SG_C_GRAD_SUM], h->at[SG_C_GRAD_COUNT]};
    for (size_t k = 0; k < 2; k++)
        if (statistics && counted[k])
            memset(counted[k], 0, h->count * sizeof(float));
    return b->inner->ops->project_backward(b->inner, statistics);
}

#define PIECES 32 /* of the sums over anchors */

struct pull_job {
    struct scaffold_engine *b;
    const struct sg_host_model *drawn;
    size_t blocks, each; /* blocks in all, and of a piece */
    bool statistics;
};

static void count_anchor(const struct pull_job *j, const struct seen *s)
{
    float *stat =
        j->b->anchors.at[SG_C_ANCHOR_STATISTICS] + sg_param_index(SG_A_STATISTICS, s->anchor, 0);
    const float *params = j->drawn->at[SG_C_PARAMETERS];
    size_t from = s->first;
    float opacity = 0;
    for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++) {
        if (!(s->exists >> g & 1))
            continue;
        stat[(SG_A_GRADIENT + g) * SG_LANES] += j->drawn->at[SG_C_GRAD_SUM][from];
        stat[(SG_A_DRAWN + g) * SG_LANES] += j->drawn->at[SG_C_GRAD_COUNT][from];
        opacity += 1 / (1 + expf(-params[sg_param_index(SG_DRAWN_PLANES, from, SG_P_OPACITY)]));
        from++;
    }
    stat[SG_A_SEEN * SG_LANES] += 1;
    stat[SG_A_OPACITY * SG_LANES] += opacity;
}

static void pull_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct pull_job *j = arg;
    struct scaffold_engine *b = j->b;
    const size_t end = (piece + 1) * j->each;
    struct sg_weight_sums *sums = &b->weight_sums[piece];
    const float *pulled = j->drawn->at[SG_C_GRADIENT];
    memset(sums, 0, sizeof(*sums));
    for (size_t block = piece * j->each; block < end && block < j->blocks; block++) {
        struct sg_anchor_block anchors;
        sg_drawn_block gradient;
        memset(gradient, 0, sizeof(gradient));
        sg_scaffold_gather(b, b->drawing_count, block, &anchors);
        for (size_t lane = 0; lane < SG_LANES; lane++) {
            const size_t at = block * SG_LANES + lane;
            if (at >= b->drawing_count)
                break;
            const struct seen *s = &b->seen[at];
            size_t from = s->first;
            for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++) {
                if (!(s->exists >> g & 1))
                    continue;
                for (int p = 0; p < SG_DRAWN_PLANES; p++)
                    gradient[g][p][lane] = pulled[sg_param_index(SG_DRAWN_PLANES, from, p)];
                from++;
            }
            if (j->statistics)
                count_anchor(j, s);
        }
        b->neural_backward(&b->args, &anchors, gradient, &b->gradient[block], sums);
    }
}

static void add_weights(struct scaffold_engine *b, size_t pieces)
{
    struct sg_weights *to = b->weight_gradient;
    memset(to, 0, sizeof(*to));
    for (size_t piece = 0; piece < pieces; piece++) {
        const struct sg_weight_sums *s = &b->weight_sums[piece];
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
            for (int h = 0; h < SG_HIDDEN; h++)
                to->input[i][h] += s->input[i][h];
        for (int o = 0; o < SG_OUTPUTS; o++) {
            for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
                to->output[o][h] += s->output[o][h];
            for (int lane = 0; lane < SG_LANES; lane++)
                to->bias[o] += s->bias[o][lane];
        }
        for (int h = 0; h < SG_HIDDEN; h++)
            to->distance[h] += s->distance[h];
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
            for (int i = 0; i <= SG_BANK_INPUTS; i++)
                to->bank_input[i][h] += s->bank_input[i][h];
            for (int j = 0; j < SG_BANK_OUTPUTS; j++)
                to->bank_output[j][h] += s->bank_output[j][h];
        }
        for (int j = 0; j < SG_BANK_OUTPUTS; j++)
            for (int lane = 0; lane < SG_LANES; lane++)
                to->bank_bias[j] += s->bank_bias[j][lane];
    }
}

/* From the gradients of the colours' biases. */
static void pull_appearance(struct scaffold_engine *b)
{
    const struct sg_weights *w = &b->networks->value;
    struct sg_weights *to = b->weight_gradient;
    const float *bias = to->input[SG_NETWORK_INPUTS] + SG_N_COLOUR * SG_NETWORK_HIDDEN;
    for (int k = 0; k < SG_APPEARANCE; k++) {
        b->appearance_gradient[k] = 0;
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
            to->appearance[k][h] = b->appearance[k] * bias[h];
            b->appearance_gradient[k] += w->appearance[k][h] * bias[h];
        }
    }
}

int sg_scaffold_pull(struct scaffold_engine *b, bool statistics)
{
    sg_ctx *ctx = b->base.ctx;
    const size_t blocks = sg_blocks(b->drawing_count), each = (blocks + PIECES - 1) / PIECES;
    const size_t pieces = each ? (blocks + each - 1) / each : 0;
    int code = pull_drawn(b, statistics && b->drawn_count);
    if (code)
        return code;
    if ((statistics && sg_host_alloc(ctx, &b->anchors, SG_C_ANCHOR_STATISTICS)) ||
        sg_grow(ctx, SG_MEM_SPLATS, &b->gradient, &b->cap_gradient, blocks, 0,
                sizeof(*b->gradient)) ||
        sg_grow(ctx, SG_MEM_SPLATS, &b->weight_sums, &b->cap_weight_sums, pieces, 0,
                sizeof(*b->weight_sums)))
        return SG_ERR_BUDGET;
    b->args.volume = b->drawn_count ? b->base.volume / (float) b->drawn_count : 0;
    struct pull_job job = {b, sg_scaffold_drawn_model(b), blocks, each, statistics};
    sg_parallel_for(ctx, pieces, pull_piece, &job);
    for (size_t k = b->drawing_count; statistics && k < b->seen_count; k++)
        b->anchors.at[SG_C_ANCHOR_STATISTICS]
                     [sg_param_index(SG_A_STATISTICS, b->seen[k].anchor, SG_A_SEEN)] += 1;
    add_weights(b, pieces);
    if (b->args.parts & SG_PART_APPEARANCE)
        pull_appearance(b);
    return SG_OK;
}

/* ---- the optimiser ---- */

struct learn_job {
    struct scaffold_engine *b;
    const struct sg_update *u;
};

/* One plane of a block. */
static void step_plane(float *p, float *m, float *v, const float *g, float rate, float root)
{
    for (int lane = 0; lane < SG_LANES; lane++) {
        const struct adam_state s =
            adam_step((struct adam_state){p[lane], m[lane], v[lane]}, g[lane], rate, root);
        p[lane] = s.p, m[lane] = s.m, v[lane] = s.v;
    }
}

#define LEARN_BLOCKS 16
#define GRADIENT_PLANES (3 + SG_A_PLANES)
_Static_assert(sizeof(struct sg_anchor_gradient) == GRADIENT_PLANES * SG_LANES * sizeof(float),
               "a column");

static void learn_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct learn_job *j = arg;
    const struct sg_update *u = j->u;
    struct sg_host_model *h = &j->b->anchors;
    const size_t most = sg_blocks(h->count), end = (piece + 1) * LEARN_BLOCKS;
    for (size_t block = piece * LEARN_BLOCKS; block < end && block < most; block++) {
        struct sg_anchor_gradient g;
        const size_t params = sg_param_index(h->planes, block * SG_LANES, SG_P_SCALE),
                     anchor = sg_param_index(SG_A_PLANES, block * SG_LANES, 0);
        /* Anchors that drew nothing have no gradient. */
        j->b->pick((const float *) j->b->gradient, GRADIENT_PLANES, 0, GRADIENT_PLANES,
                   j->b->place + block * SG_LANES, (float(*)[SG_LANES]) & g);
        for (size_t k = 0; k < 3; k++)
            step_plane(h->at[SG_C_PARAMETERS] + params + k * SG_LANES,
                       h->at[SG_C_MOMENT1] + params + k * SG_LANES,
                       h->at[SG_C_MOMENT2] + params + k * SG_LANES, g.reach[k], u->rate[SG_G_SCALE],
                       u->root[SG_G_SCALE]);
        for (size_t k = 0; k < SG_A_PLANES; k++) {
            const enum sg_group group = k < SG_A_FEATURE ? SG_G_OFFSET
                                        : k < SG_A_SIZE  ? SG_G_FEATURE
                                                         : SG_G_SCALE;
            step_plane(h->at[SG_C_ANCHOR] + anchor + k * SG_LANES,
                       h->at[SG_C_ANCHOR_MOMENT1] + anchor + k * SG_LANES,
                       h->at[SG_C_ANCHOR_MOMENT2] + anchor + k * SG_LANES, g.anchor[k],
                       u->rate[group], u->root[group]);
        }
    }
}

int sg_scaffold_optimise(struct scaffold_engine *b, const struct sg_update *u)
{
    struct sg_host_model *h = &b->anchors;
    sg_ctx *ctx = b->base.ctx;
    const size_t blocks = sg_blocks(h->count);
    if (sg_host_alloc(ctx, h, SG_C_MOMENT1) || sg_host_alloc(ctx, h, SG_C_MOMENT2) ||
        sg_host_alloc(ctx, h, SG_C_ANCHOR_MOMENT1) || sg_host_alloc(ctx, h, SG_C_ANCHOR_MOMENT2) ||
        sg_grow(ctx, SG_MEM_SPLATS, &b->place, &b->cap_place, blocks, 0,
                SG_LANES * sizeof(*b->place)))
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < blocks * SG_LANES; i++)
        b->place[i] = SG_NOWHERE;
    for (size_t k = 0; k < b->drawing_count; k++)
        b->place[b->seen[k].anchor] = (uint32_t) k;
    struct learn_job job = {b, u};
    sg_parallel_for(ctx, (blocks + LEARN_BLOCKS - 1) / LEARN_BLOCKS, learn_piece, &job);
    return SG_OK;
}

void sg_scaffold_learn(struct scaffold_engine *b, const struct sg_network_update *u)
{
    float *p = (float *) &b->networks->value, *m = (float *) &b->networks->moment1,
          *v = (float *) &b->networks->moment2;
    const float *g = (const float *) b->weight_gradient;
    for (size_t i = 0; i < SG_WEIGHTS; i++) {
        const struct adam_state s = adam_step((struct adam_state){p[i], m[i], v[i]}, g[i],
                                              u->rate[sg_weight_network(i)], u->root);
        p[i] = s.p, m[i] = s.m, v[i] = s.v;
    }
    /* Of all photos: those of others move on by their momentum, as in the released code. */
    for (size_t photo = 0; photo < b->networks->photos; photo++) {
        struct sg_appearance *a = &b->networks->appearance[photo];
        for (int k = 0; k < SG_APPEARANCE; k++) {
            const struct adam_state s =
                adam_step((struct adam_state){a->value[k], a->moment1[k], a->moment2[k]},
                          photo == b->photo ? b->appearance_gradient[k] : 0,
                          u->rate[SG_N_APPEARANCE], u->root);
            a->value[k] = s.p, a->moment1[k] = s.m, a->moment2[k] = s.v;
        }
    }
}
