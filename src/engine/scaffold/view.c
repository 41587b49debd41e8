/* SPDX-License-Identifier: Apache-2.0 */
/* Anchors to the Gaussians of a view. */
#include "math/real_f32.h"

#include <string.h>

#include "math/projection.h"
#include "math/tile_rect.h"
#include "state.h"

struct sees_job {
    const struct scaffold_engine *b;
    struct pinhole view;
    int grid_x, grid_y;
};

#define CHUNK 1024

/* An anchor is seen if it would be drawn as a Gaussian with its offsets' unit as scales. */
static void sees_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct sees_job *j = arg;
    const struct sg_host_model *h = &j->b->anchors;
    const size_t end = (chunk + 1) * CHUNK < h->count ? (chunk + 1) * CHUNK : h->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        const float *p = h->at[SG_C_PARAMETERS] + sg_param_index(h->planes, i, 0);
        float position[3], scale[3];
        struct splat s;
        struct projection projection;
        for (int k = 0; k < 3; k++) {
            position[k] = p[(SG_P_XYZ + k) * SG_LANES];
            scale[k] = p[(SG_P_SCALE + k) * SG_LANES];
        }
        project(&j->view, position, scale, (const float[]){1, 0, 0, 0}, &s, &projection);
        const struct tile_rect r = tile_rect_make(s.x, s.y, s.sigma, j->grid_x, j->grid_y);
        j->b->sees[i] = s.visible && r.radius > 0 && r.x0 < r.x1 && r.y0 < r.y1;
    }
}

static int find_seen(struct scaffold_engine *b, const struct sg_camera *camera)
{
    sg_ctx *ctx = b->base.ctx;
    const size_t n = b->anchors.count;
    struct sees_job job = {b, view_make(camera), (camera->width + SG_TILE - 1) / SG_TILE,
                           (camera->height + SG_TILE - 1) / SG_TILE};
    if (sg_grow(ctx, SG_MEM_SPLATS, &b->sees, &b->cap_sees, n, 0, 1))
        return SG_ERR_BUDGET;
    sg_parallel_for(ctx, (n + CHUNK - 1) / CHUNK, sees_chunk, &job);
    size_t count = 0;
    for (size_t i = 0; i < n; i++)
        count += b->sees[i];
    if (sg_grow(ctx, SG_MEM_SPLATS, &b->seen, &b->cap_seen, count, 0, sizeof(*b->seen)))
        return SG_ERR_BUDGET;
    b->seen_count = 0;
    for (size_t i = 0; i < n; i++)
        if (b->sees[i])
            b->seen[b->seen_count++] = (struct seen){.anchor = (uint32_t) i};
    memcpy(b->args.centre, job.view.centre, sizeof(b->args.centre));
    b->args.parts = b->networks->parts;
    return SG_OK;
}

/* An appearance is the same for all anchors of a view: what the colours' network makes of it is
 * added to the biases. */
static int set_appearance(struct scaffold_engine *b, int photo)
{
    const struct sg_networks *n = b->networks;
    b->args.weights = &n->value;
    if (!(n->parts & SG_PART_APPEARANCE))
        return SG_OK;
    if (!b->own_weights &&
        !(b->own_weights = sg_alloc_raw(b->base.ctx, SG_MEM_SPLATS, 1, sizeof(*b->own_weights))))
        return SG_ERR_BUDGET;
    const bool one = photo >= 0 && (size_t) photo < n->photos;
    b->photo = one ? (size_t) photo : SIZE_MAX;
    for (int k = 0; k < SG_APPEARANCE; k++) {
        float sum = 0;
        for (size_t i = 0; i < n->photos && !one && photo != SG_APPEARANCE_ZERO; i++)
            sum += n->appearance[i].value[k];
        b->appearance[k] = one ? n->appearance[photo].value[k] : sum / (float) n->photos;
    }
    *b->own_weights = n->value;
    float *bias = b->own_weights->input[SG_NETWORK_INPUTS] + SG_N_COLOUR * SG_NETWORK_HIDDEN;
    for (int k = 0; k < SG_APPEARANCE; k++)
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            bias[h] += n->value.appearance[k][h] * b->appearance[k];
    b->args.weights = b->own_weights;
    return SG_OK;
}

void sg_scaffold_gather(const struct scaffold_engine *b, size_t count, size_t block,
                        struct sg_anchor_block *out)
{
    const struct sg_host_model *h = &b->anchors;
    uint32_t anchor[SG_LANES];
    for (size_t lane = 0; lane < SG_LANES; lane++) {
        const size_t at = block * SG_LANES + lane, last = count - 1;
        anchor[lane] = b->seen[at < last ? at : last].anchor;
    }
    b->pick(h->at[SG_C_PARAMETERS], h->planes, SG_P_XYZ, 3, anchor, out->position);
    b->pick(h->at[SG_C_PARAMETERS], h->planes, SG_P_SCALE, 3, anchor, out->reach);
    b->pick(h->at[SG_C_ANCHOR], SG_A_PLANES, 0, SG_A_PLANES, anchor, out->anchor);
    for (size_t lane = count - block * SG_LANES; lane < SG_LANES; lane++)
        for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++)
            out->anchor[SG_A_OFFSET + 3 * g][lane] = SG_OFFSET_HIDDEN;
}

#define CHUNK_BLOCKS 64 /* that are made at once, before their Gaussians move together */

struct generate_job {
    struct scaffold_engine *b;
    size_t first; /* block */
    float *params;
};

static void generate_block(void *arg, size_t k, int thread)
{
    (void) thread;
    const struct generate_job *j = arg;
    struct scaffold_engine *b = j->b;
    struct sg_anchor_block block;
    sg_scaffold_gather(b, b->seen_count, j->first + k, &block);
    b->neural(&b->args, &block, b->drawn[k]);
    for (size_t lane = 0; lane < SG_LANES; lane++) {
        const size_t at = (j->first + k) * SG_LANES + lane;
        if (at >= b->seen_count)
            break;
        struct seen *s = &b->seen[at];
        for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++) {
            if (b->drawn[k][g][SG_P_OPACITY][lane] > -INFINITY)
                s->exists |= (uint16_t) (1u << g);
        }
    }
}

static void place_block(void *arg, size_t k, int thread)
{
    (void) thread;
    const struct generate_job *j = arg;
    const struct scaffold_engine *b = j->b;
    for (size_t lane = 0; lane < SG_LANES; lane++) {
        const size_t at = (j->first + k) * SG_LANES + lane;
        if (at >= b->seen_count)
            break;
        const struct seen *s = &b->seen[at];
        size_t to = s->first;
        for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++) {
            if (!(s->exists >> g & 1))
                continue;
            for (int p = 0; p < SG_DRAWN_PLANES; p++)
                j->params[sg_param_index(SG_DRAWN_PLANES, to, p)] = b->drawn[k][g][p][lane];
            to++;
        }
    }
}

/* Anchors without a Gaussian have no gradient: they come last, where the way back leaves them out.
 * The others stay in their order. */
static void sort_seen(struct scaffold_engine *b)
{
    b->drawing_count = 0;
    for (size_t k = 0; k < b->seen_count; k++)
        if (b->seen[k].exists) {
            const struct seen without = b->seen[b->drawing_count];
            b->seen[b->drawing_count++] = b->seen[k];
            if (b->drawing_count <= k)
                b->seen[k] = without;
        }
}

/* The Gaussians of all seen anchors, in their order. */
static int generate(struct scaffold_engine *b, struct sg_host_model *drawn)
{
    sg_ctx *ctx = b->base.ctx;
    const size_t blocks = sg_blocks(b->seen_count);
    size_t n = 0;
    if (sg_host_grow(ctx, drawn, 1, 0) ||
        sg_grow(ctx, SG_MEM_SPLATS, &b->drawn, &b->cap_drawn,
                blocks < CHUNK_BLOCKS ? blocks : CHUNK_BLOCKS, 0, sizeof(*b->drawn)))
        return SG_ERR_BUDGET;
    for (size_t first = 0; first < blocks; first += CHUNK_BLOCKS) {
        const size_t end = first + CHUNK_BLOCKS < blocks ? first + CHUNK_BLOCKS : blocks,
                     before = n;
        struct generate_job job = {b, first, NULL};
        sg_parallel_for(ctx, end - first, generate_block, &job);
        for (size_t at = first * SG_LANES; at < end * SG_LANES && at < b->seen_count; at++) {
            b->seen[at].first = (uint32_t) n;
            n += (size_t) __builtin_popcount(b->seen[at].exists);
        }
        if (sg_host_grow(ctx, drawn, sg_blocks(n), sg_blocks(before)))
            return SG_ERR_BUDGET;
        job.params = drawn->at[SG_C_PARAMETERS];
        sg_parallel_for(ctx, end - first, place_block, &job);
    }
    b->drawn_count = n;
    sort_seen(b);
    return SG_OK;
}

/* Lanes past the last Gaussian are zero. A view without any gets one that is not drawn. */
static void finish_params(struct scaffold_engine *b, float *params)
{
    size_t n = b->drawn_count;
    if (!n) {
        memset(params, 0, SG_DRAWN_PLANES * SG_LANES * sizeof(float));
        for (int k = 0; k < 3; k++) /* behind the near plane */
            params[sg_param_index(SG_DRAWN_PLANES, 0, SG_P_XYZ + k)] = b->args.centre[k];
        params[sg_param_index(SG_DRAWN_PLANES, 0, SG_P_OPACITY)] = -100;
        n = 1;
    }
    for (size_t i = n; i < sg_blocks(n) * SG_LANES; i++)
        for (int p = 0; p < SG_DRAWN_PLANES; p++)
            params[sg_param_index(SG_DRAWN_PLANES, i, p)] = 0;
}

int sg_scaffold_view(struct scaffold_engine *b, const struct sg_camera *camera, int appearance)
{
    b->learns = false;
    if (b->device)
        return sg_scaffold_device_view(b, camera, appearance);
    struct sg_host_model *drawn = sg_scaffold_drawn_model(b);
    drawn->planes = SG_DRAWN_PLANES;
    int code = find_seen(b, camera);
    if (!code)
        code = set_appearance(b, appearance);
    if (!code)
        code = generate(b, drawn);
    if (code)
        return code;
    finish_params(b, drawn->at[SG_C_PARAMETERS]);
    drawn->count = sg_scaffold_drawn(b);
    return SG_OK;
}
