/* SPDX-License-Identifier: Apache-2.0 */
#include "host_model.h"

#include <math.h>
#include <string.h>

#include "core/rng.h"
#include "math/constants.h"
#include "morton.h"

int sg_optimiser_create(sg_ctx *ctx, size_t count, int sh_degree, struct sg_optimiser *o)
{
    const size_t capacity = (count + SG_LANES - 1) / SG_LANES * SG_LANES,
                 planes = (size_t) sg_param_count(sh_degree);
    *o = (struct sg_optimiser){.capacity = capacity};
    o->m = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, planes * sizeof(float));
    o->v = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, planes * sizeof(float));
    o->grad_sum = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, sizeof(float));
    o->grad_count = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, sizeof(float));
    if (o->m && o->v && o->grad_sum && o->grad_count)
        return SG_OK;
    sg_optimiser_clear(o);
    return SG_ERR_BUDGET;
}

void sg_optimiser_clear(struct sg_optimiser *o)
{
    sg_free(o->m);
    sg_free(o->v);
    sg_free(o->grad_sum);
    sg_free(o->grad_count);
    *o = (struct sg_optimiser){0};
}

static size_t block_bytes(const struct sg_host_model *h)
{
    return (size_t) h->planes * SG_LANES * sizeof(float);
}

static size_t blocks(size_t count)
{
    return (count + SG_LANES - 1) / SG_LANES;
}

int sg_host_upload(sg_ctx *ctx, struct sg_host_model *h, const struct sg_model *m,
                   const struct sg_optimiser *o)
{
    struct sg_host_model n = {.count = m->count,
                              .capacity = blocks(m->count) * SG_LANES,
                              .sh_degree = m->sh_degree,
                              .planes = sg_param_count(m->sh_degree)};
    n.params = sg_alloc(ctx, SG_MEM_MODEL, n.capacity, (size_t) n.planes * sizeof(float));
    if (!n.params || (o && sg_optimiser_create(ctx, m->count, m->sh_degree, &n.opt))) {
        sg_free(n.params);
        return SG_ERR_BUDGET;
    }
    const size_t bytes = blocks(m->count) * block_bytes(&n);
    memcpy(n.params, m->params, bytes);
    if (o) {
        memcpy(n.opt.m, o->m, bytes);
        memcpy(n.opt.v, o->v, bytes);
        memcpy(n.opt.grad_sum, o->grad_sum, m->count * sizeof(float));
        memcpy(n.opt.grad_count, o->grad_count, m->count * sizeof(float));
    }
    sg_host_clear(h);
    *h = n;
    return SG_OK;
}

void sg_host_adopt(struct sg_host_model *h, struct sg_model *m, struct sg_optimiser *o)
{
    sg_host_clear(h);
    *h = (struct sg_host_model){.count = m->count,
                                .capacity = m->capacity,
                                .sh_degree = m->sh_degree,
                                .planes = sg_param_count(m->sh_degree),
                                .params = m->params,
                                .opt = *o};
    m->params = NULL;
    *o = (struct sg_optimiser){0};
}

int sg_host_alloc_optimiser(sg_ctx *ctx, struct sg_host_model *h)
{
    return h->opt.m ? SG_OK : sg_optimiser_create(ctx, h->count, h->sh_degree, &h->opt);
}

static void copy_out(float *to, const float *from, size_t bytes)
{
    if (to && from)
        memcpy(to, from, bytes);
    else if (to)
        memset(to, 0, bytes);
}

int sg_host_download(const struct sg_host_model *h, struct sg_model *m, struct sg_optimiser *o)
{
    const size_t bytes = blocks(h->count) * block_bytes(h), each = h->count * sizeof(float);
    if (m)
        memcpy(m->params, h->params, bytes);
    if (o) {
        copy_out(o->m, h->opt.m, bytes);
        copy_out(o->v, h->opt.v, bytes);
        copy_out(o->grad_sum, h->opt.grad_sum, each);
        copy_out(o->grad_count, h->opt.grad_count, each);
    }
    return SG_OK;
}

struct statistics_job {
    const struct sg_host_model *h;
    struct sg_statistics out;
};

#define STATISTICS_CHUNK 4096

static void statistics_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct statistics_job *j = arg;
    const struct sg_host_model *h = j->h;
    const size_t end =
        (chunk + 1) * STATISTICS_CHUNK < h->count ? (chunk + 1) * STATISTICS_CHUNK : h->count;
    for (size_t i = chunk * STATISTICS_CHUNK; i < end; i++) {
        const float *p = h->params + sg_param_index(h->planes, i, SG_P_SCALE);
        const float s[3] = {p[0], p[SG_LANES], p[2 * SG_LANES]};
        if (j->out.gradient)
            j->out.gradient[i] = h->opt.m && h->opt.grad_count[i] > 0
                                     ? h->opt.grad_sum[i] / h->opt.grad_count[i]
                                     : 0;
        if (j->out.opacity)
            j->out.opacity[i] =
                1 / (1 + expf(-h->params[sg_param_index(h->planes, i, SG_P_OPACITY)]));
        if (j->out.largest)
            j->out.largest[i] = expf(fmaxf(fmaxf(s[0], s[1]), s[2]));
        if (j->out.log_smallest)
            j->out.log_smallest[i] = fminf(fminf(s[0], s[1]), s[2]);
    }
}

void sg_host_statistics(sg_ctx *ctx, const struct sg_host_model *h, const struct sg_statistics *out)
{
    struct statistics_job job = {h, *out};
    sg_parallel_for(ctx, (h->count + STATISTICS_CHUNK - 1) / STATISTICS_CHUNK, statistics_chunk,
                    &job);
}

/* A child is drawn from its parent as from a distribution, and shrunk (Kerbl et al. 2023,
 * section 5.2). */
static void make_child(float *params, size_t i, int planes, const struct sg_edit *e, size_t entry)
{
    float *p = params + sg_param_index(planes, i, 0);
#define AT(plane) p[(plane) *SG_LANES]
    float n[3], q[4], len = 0;
    for (int k = 0; k < 3; k++)
        n[k] = expf(AT(SG_P_SCALE + k)) *
               sg_rng_normal(e->seed, SG_RNG_SPLIT, e->stream, 3 * entry + (size_t) k);
    for (int k = 0; k < 4; k++)
        len += AT(SG_P_ROT + k) * AT(SG_P_ROT + k);
    len = fmaxf(sqrtf(len), 1e-12f);
    for (int k = 0; k < 4; k++)
        q[k] = AT(SG_P_ROT + k) / len;
    const float r = q[0], x = q[1], y = q[2], z = q[3];
    AT(SG_P_XYZ) +=
        (1 - 2 * (y * y + z * z)) * n[0] + 2 * (x * y - r * z) * n[1] + 2 * (x * z + r * y) * n[2];
    AT(SG_P_XYZ + 1) +=
        2 * (x * y + r * z) * n[0] + (1 - 2 * (x * x + z * z)) * n[1] + 2 * (y * z - r * x) * n[2];
    AT(SG_P_XYZ + 2) +=
        2 * (x * z - r * y) * n[0] + 2 * (y * z + r * x) * n[1] + (1 - 2 * (x * x + y * y)) * n[2];
    for (int k = 0; k < 3; k++)
        AT(SG_P_SCALE + k) -= logf(SG_SPLIT_SHRINK);
#undef AT
}

/* Rows of one array after an edit. */
struct edit_job {
    const struct sg_edit *edit;
    const float *from;
    float *to;
    /* of every item, those kept and then those appended: its index before */
    const uint32_t *source;
    const uint32_t *order; /* of every row: its item */
    size_t count, copied;  /* items; of which copied from before, the rest are zero */
    int planes;
    bool parameters;
};

#define EDIT_BLOCKS 64 /* a piece of work */

static void edit_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct edit_job *j = arg;
    const size_t first = piece * EDIT_BLOCKS * SG_LANES, stop = first + EDIT_BLOCKS * SG_LANES;
    for (size_t i = first; i < stop && i < j->count; i++) {
        const size_t item = j->order[i];
        float *to = j->to + sg_param_index(j->planes, i, 0);
        const float *from =
            item < j->copied ? j->from + sg_param_index(j->planes, j->source[item], 0) : NULL;
        for (int p = 0; p < j->planes; p++)
            to[p * SG_LANES] = from ? from[p * SG_LANES] : 0;
        const size_t entry = item - j->edit->kept;
        if (j->parameters && item >= j->edit->kept && j->edit->kind[entry] == SG_EDIT_CHILD)
            make_child(j->to, i, j->planes, j->edit, entry);
    }
}

static float *edited(sg_ctx *ctx, enum sg_mem_tag tag, const struct sg_host_model *h,
                     const float *array, size_t capacity, const struct sg_edit *e,
                     const uint32_t *source, const uint32_t *order)
{
    const bool parameters = tag == SG_MEM_MODEL; /* moments of appended rows are zero */
    struct edit_job job = {.edit = e,
                           .from = array,
                           .source = source,
                           .order = order,
                           .count = e->kept + e->appended,
                           .copied = e->kept + (parameters ? e->appended : 0),
                           .planes = h->planes,
                           .parameters = parameters};
    job.to = sg_alloc_raw(ctx, tag, capacity, (size_t) h->planes * sizeof(float));
    if (!job.to)
        return NULL;
    if (capacity > job.count) /* lanes past the end */
        memset(job.to + (capacity / SG_LANES - 1) * (size_t) h->planes * SG_LANES, 0,
               block_bytes(h));
    sg_parallel_for(ctx, (job.count + EDIT_BLOCKS * SG_LANES - 1) / (EDIT_BLOCKS * SG_LANES),
                    edit_piece, &job);
    return job.to;
}

#define ORDER_FROM 4096 /* Gaussians: fewer stay in the caches, however they lie */

/* Where everything goes: source and order of struct edit_job, to be freed by the caller. */
static int edit_order(sg_ctx *ctx, const struct sg_host_model *h, const struct sg_edit *e,
                      uint32_t **source, uint32_t **order)
{
    const size_t n = e->kept + e->appended;
    *source = sg_alloc_raw(ctx, SG_MEM_MODEL, n, sizeof(**source));
    *order = sg_alloc_raw(ctx, SG_MEM_MODEL, n, sizeof(**order));
    if (!*source || !*order)
        return SG_ERR_BUDGET;
    size_t to = 0;
    for (size_t i = 0; i < h->count; i++)
        if (e->keep[i])
            (*source)[to++] = (uint32_t) i;
    if (e->appended)
        memcpy(*source + to, e->source, e->appended * sizeof(**source));
    for (size_t i = 0; i < n; i++)
        (*order)[i] = (uint32_t) i;
    return n < ORDER_FROM
               ? SG_OK
               : sg_morton_order(ctx, h->params, h->planes, h->count, *source, n, *order);
}

/* Replaces one array by what the edit makes of it, so that only one exists twice at any time. */
static bool replace(sg_ctx *ctx, enum sg_mem_tag tag, const struct sg_host_model *h, float **array,
                    size_t capacity, const struct sg_edit *e, const uint32_t *source,
                    const uint32_t *order)
{
    float *made = edited(ctx, tag, h, *array, capacity, e, source, order);
    if (!made)
        return false;
    sg_free(*array);
    *array = made;
    return true;
}

static void drop(float **array)
{
    sg_free(*array);
    *array = NULL;
}

int sg_host_edit(sg_ctx *ctx, struct sg_host_model *h, const struct sg_edit *e)
{
    const size_t count = e->kept + e->appended, capacity = blocks(count) * SG_LANES;
    const bool learns = h->opt.m;
    struct sg_optimiser fresh = {.capacity = capacity}; /* the statistics */
    uint32_t *source = NULL, *order = NULL;
    drop(&h->accumulated), drop(&h->gradients), drop(&h->shaped);
    int code = edit_order(ctx, h, e, &source, &order);
    if (!code && learns) {
        fresh.grad_sum = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, sizeof(float));
        fresh.grad_count = sg_alloc(ctx, SG_MEM_OPTIMISER, capacity, sizeof(float));
        code = fresh.grad_sum && fresh.grad_count ? SG_OK : SG_ERR_BUDGET;
    }
    for (size_t i = 0; !code && learns && e->statistics && i < count; i++)
        if (order[i] < e->kept) {
            fresh.grad_sum[i] = h->opt.grad_sum[source[order[i]]];
            fresh.grad_count[i] = h->opt.grad_count[source[order[i]]];
        }
    if (!code && !replace(ctx, SG_MEM_MODEL, h, &h->params, capacity, e, source, order))
        code = SG_ERR_BUDGET;
    if (code) { /* the model is as it was */
        sg_optimiser_clear(&fresh);
        goto done;
    }
    if (learns && (!replace(ctx, SG_MEM_OPTIMISER, h, &h->opt.m, capacity, e, source, order) ||
                   !replace(ctx, SG_MEM_OPTIMISER, h, &h->opt.v, capacity, e, source, order))) {
        code = SG_ERR_BUDGET; /* the model is edited and has no moments */
        sg_optimiser_clear(&fresh);
        sg_optimiser_clear(&h->opt);
    } else {
        sg_free(h->opt.grad_sum);
        sg_free(h->opt.grad_count);
        fresh.m = h->opt.m, fresh.v = h->opt.v;
        h->opt = fresh;
    }
    h->count = count, h->capacity = capacity;
done:
    sg_free(order);
    sg_free(source);
    return code;
}

void sg_host_floor_scale(struct sg_host_model *h, float smallest)
{
    const float least = logf(smallest);
    for (size_t i = 0; i < h->count; i++)
        for (int k = 0; k < 3; k++) {
            float *scale = &h->params[sg_param_index(h->planes, i, SG_P_SCALE + k)];
            *scale = fmaxf(*scale, least);
        }
}

void sg_host_reset_opacity(struct sg_host_model *h, float limit)
{
    const float logit = logf(limit / (1 - limit));
    for (size_t i = 0; i < h->count; i++) {
        const size_t at = sg_param_index(h->planes, i, SG_P_OPACITY);
        h->params[at] = fminf(h->params[at], logit);
        if (h->opt.m)
            h->opt.m[at] = h->opt.v[at] = 0;
    }
}

static int room(sg_ctx *ctx, enum sg_mem_tag tag, const struct sg_host_model *h, float **array)
{
    if (!*array)
        *array = sg_alloc(ctx, tag, h->capacity, (size_t) h->planes * sizeof(float));
    return *array ? SG_OK : SG_ERR_BUDGET;
}

int sg_host_alloc_gradients(sg_ctx *ctx, struct sg_host_model *h)
{
    return room(ctx, SG_MEM_OPTIMISER, h, &h->gradients);
}

int sg_host_alloc_accumulated(sg_ctx *ctx, struct sg_host_model *h)
{
    return room(ctx, SG_MEM_OPTIMISER, h, &h->accumulated);
}

struct shape_job {
    const struct sg_host_model *h;
    const struct sg_shape *shape;
    bool back;
};

static void shape_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct shape_job *j = arg;
    const size_t end = (piece + 1) * EDIT_BLOCKS, most = blocks(j->h->count),
                 block = block_bytes(j->h) / sizeof(float);
    for (size_t b = piece * EDIT_BLOCKS; b < end && b < most; b++) {
        const float *params = j->h->params + b * block;
        if (j->back)
            j->shape->backward(j->shape->arg, params, j->h->planes, j->h->gradients + b * block);
        else
            j->shape->forward(j->shape->arg, params, j->h->planes, j->h->shaped + b * block);
    }
}

int sg_host_shape(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape)
{
    if (room(ctx, SG_MEM_MODEL, h, &h->shaped))
        return SG_ERR_BUDGET;
    sg_parallel_for(ctx, (blocks(h->count) + EDIT_BLOCKS - 1) / EDIT_BLOCKS, shape_piece,
                    &(struct shape_job){h, shape, false});
    return SG_OK;
}

int sg_host_shape_backward(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape)
{
    sg_parallel_for(ctx, (blocks(h->count) + EDIT_BLOCKS - 1) / EDIT_BLOCKS, shape_piece,
                    &(struct shape_job){h, shape, true});
    return SG_OK;
}

void sg_host_clear(struct sg_host_model *h)
{
    sg_free(h->params);
    sg_free(h->gradients);
    sg_free(h->accumulated);
    sg_free(h->shaped);
    sg_optimiser_clear(&h->opt);
    *h = (struct sg_host_model){0};
}
