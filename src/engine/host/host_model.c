/* SPDX-License-Identifier: Apache-2.0 */
#include "host_model.h"

#include <math.h>
#include <string.h>

#include "core/rng.h"
#include "math/real_f32.h"
#include "model/morton.h"

#include "math/explore.h"
#include "math/mip.h"

/* Of a column's array. */
static size_t block_bytes(const struct sg_host_model *h, int column)
{
    return (size_t) sg_column_array_planes(column, h->sh_degree) * SG_LANES * sizeof(float);
}

int sg_host_alloc(sg_ctx *ctx, struct sg_host_model *h, int column)
{
    if (!h->at[column])
        h->at[column] =
            sg_alloc(ctx, sg_column_tag(column), h->capacity / SG_LANES, block_bytes(h, column));
    return h->at[column] ? SG_OK : SG_ERR_BUDGET;
}

int sg_host_alloc_saved(sg_ctx *ctx, struct sg_host_model *h)
{
    for (int c = 0; c < SG_COLUMNS; c++)
        if (sg_column_has_array(c) && sg_column_of(c, SG_COLUMN_SAVED) && sg_host_alloc(ctx, h, c))
            return SG_ERR_BUDGET;
    return SG_OK;
}

int sg_host_upload(sg_ctx *ctx, struct sg_host_model *h, const struct sg_model *m,
                   const struct sg_columns *columns)
{
    struct sg_host_model n = {.count = m->count,
                              .capacity = sg_blocks(m->count) * SG_LANES,
                              .sh_degree = m->sh_degree,
                              .planes = sg_param_count(m->sh_degree)};
    for (int c = 0; c < SG_COLUMNS; c++) {
        const float *from = c == SG_C_PARAMETERS ? m->params : columns ? columns->at[c] : NULL;
        if (!from)
            continue;
        if (sg_host_alloc(ctx, &n, c)) {
            sg_host_clear(&n);
            return SG_ERR_BUDGET;
        }
        memcpy(n.at[c], from, sg_blocks(n.count) * block_bytes(&n, c));
    }
    sg_host_clear(h);
    *h = n;
    return SG_OK;
}

int sg_host_grow(sg_ctx *ctx, struct sg_host_model *h, size_t blocks, size_t keep)
{
    size_t capacity = h->capacity / SG_LANES;
    if (blocks <= capacity)
        return SG_OK;
    for (int c = 0; c < SG_COLUMNS; c++)
        if (c != SG_C_PARAMETERS) {
            sg_free(h->at[c]);
            h->at[c] = NULL;
        }
    const int code = sg_grow(ctx, SG_MEM_MODEL, &h->at[SG_C_PARAMETERS], &capacity, blocks, keep,
                             block_bytes(h, SG_C_PARAMETERS));
    h->capacity = capacity * SG_LANES;
    if (!capacity)
        h->count = 0;
    return code;
}

void sg_host_adopt(struct sg_host_model *h, struct sg_model *m, struct sg_columns *columns)
{
    sg_host_clear(h);
    *h = (struct sg_host_model){.count = m->count,
                                .capacity = m->capacity,
                                .sh_degree = m->sh_degree,
                                .planes = sg_param_count(m->sh_degree)};
    memcpy(h->at, columns->at, sizeof(h->at));
    h->at[SG_C_PARAMETERS] = m->params;
    m->params = NULL;
    *columns = (struct sg_columns){0};
}

int sg_host_download(const struct sg_host_model *h, struct sg_model *m, struct sg_columns *columns)
{
    for (int c = 0; c < SG_COLUMNS; c++) {
        const size_t bytes = sg_blocks(h->count) * block_bytes(h, c);
        float *to = c == SG_C_PARAMETERS ? m ? m->params : NULL : columns ? columns->at[c] : NULL;
        if (to && h->at[c])
            memcpy(to, h->at[c], bytes);
        else if (to)
            memset(to, 0, bytes);
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
    const float *params = h->at[SG_C_PARAMETERS], *sum = h->at[SG_C_GRAD_SUM],
                *views = h->at[SG_C_GRAD_COUNT], *absolute = h->at[SG_C_GRAD_ABSOLUTE];
    const size_t end =
        (chunk + 1) * STATISTICS_CHUNK < h->count ? (chunk + 1) * STATISTICS_CHUNK : h->count;
    for (size_t i = chunk * STATISTICS_CHUNK; i < end; i++) {
        const float *p = params + sg_param_index(h->planes, i, SG_P_SCALE);
        const float s[3] = {p[0], p[SG_LANES], p[2 * SG_LANES]};
        if (j->out.gradient)
            j->out.gradient[i] = sum && views && views[i] > 0 ? sum[i] / views[i] : 0;
        if (j->out.radius)
            j->out.radius[i] = h->at[SG_C_RADIUS] ? h->at[SG_C_RADIUS][i] : 0;
        if (j->out.absolute)
            j->out.absolute[i] = absolute && views && views[i] > 0 ? absolute[i] / views[i] : 0;
        if (j->out.opacity)
            j->out.opacity[i] = 1 / (1 + expf(-params[sg_param_index(h->planes, i, SG_P_OPACITY)]));
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

#define AT(plane) p[(plane) *SG_LANES]
/* A child is drawn from its parent as from a distribution, and shrunk (Kerbl et al. 2023,
 * section 5.2). */
static void draw_position(float *p, const struct sg_edit *e, size_t entry)
{
    const float rot[4] = {AT(SG_P_ROT), AT(SG_P_ROT + 1), AT(SG_P_ROT + 2), AT(SG_P_ROT + 3)};
    float n[3], R[9];
    for (int k = 0; k < 3; k++)
        n[k] = expf(AT(SG_P_SCALE + k)) *
               sg_rng_normal(e->seed, SG_RNG_SPLIT, e->stream, 3 * entry + (size_t) k);
    rotation_of(rot, R);
    for (int k = 0; k < 3; k++)
        AT(SG_P_XYZ + k) += R[3 * k] * n[0] + R[3 * k + 1] * n[1] + R[3 * k + 2] * n[2];
}

static void shrink(float *p, int first, int planes)
{
    for (int k = first; k < first + planes; k++)
        AT(k) -= logf(SG_SPLIT_SHRINK);
}
#undef AT

/* In the order of the table: positions are drawn before scales shrink. */
void sg_host_make_child(float *p, const struct sg_edit *edit, size_t entry)
{
    for (int c = 0; sg_column_is_parameter(c); c++)
        if (sg_columns[c].fate[SG_EDIT_CHILD] == SG_FATE_DRAW)
            draw_position(p, edit, entry);
        else if (sg_columns[c].fate[SG_EDIT_CHILD] == SG_FATE_SHRINK)
            shrink(p, sg_columns[c].first, sg_columns[c].planes);
}

enum sg_edit_kind sg_moves_kind(const struct sg_moves *moves, size_t item)
{
    const size_t kept = moves->edit->kept;
    return item < kept ? SG_EDIT_KEEP : (enum sg_edit_kind) moves->edit->kind[item - kept];
}

/* A column as it lies in an array. */
struct part {
    int first, end; /* planes */
    const enum sg_fate *fate;
};

/* Rows of one array after an edit. */
struct edit_job {
    const struct sg_moves *moves;
    size_t before;            /* Gaussians */
    const float *from, *rows; /* rows: of the edit, or NULL */
    float *to;
    bool parameters;
    int planes, n_parts;
    struct part parts[SG_COLUMNS];
};

static void copy_planes(const struct part *part, const float *from, float *to)
{
    for (int p = part->first; p < part->end; p++)
        to[p * SG_LANES] = from ? from[p * SG_LANES] : 0;
}

static void edit_row(const struct edit_job *j, size_t i)
{
    const struct sg_moves *m = j->moves;
    const size_t item = m->order[i], source = m->source[item];
    const enum sg_edit_kind kind = sg_moves_kind(m, item);
    const float *from = NULL;
    if (kind != SG_EDIT_INSERT)
        from = j->from + sg_param_index(j->planes, source, 0);
    else if (j->rows)
        from = j->rows + sg_param_index(j->planes, source - j->before, 0);
    float *to = j->to + sg_param_index(j->planes, i, 0);
    for (int k = 0; k < j->n_parts; k++) {
        const enum sg_fate fate = j->parts[k].fate[kind];
        copy_planes(&j->parts[k], sg_edit_zeroes(m->edit, fate) ? NULL : from, to);
    }
    if (kind == SG_EDIT_CHILD && j->parameters)
        sg_host_make_child(to, m->edit, item - m->edit->kept);
}

#define EDIT_BLOCKS 64 /* a piece of work */

static void edit_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct edit_job *j = arg;
    const size_t first = piece * EDIT_BLOCKS * SG_LANES, stop = first + EDIT_BLOCKS * SG_LANES;
    for (size_t i = first; i < stop && i < j->moves->count; i++)
        edit_row(j, i);
}

const float *sg_host_rows_of(const struct sg_model *rows, int column)
{
    if (!rows || column == SG_C_PARAMETERS)
        return rows ? rows->params : NULL;
    return rows->columns ? rows->columns->at[column] : NULL;
}

/* What the edit makes of an array. */
static int make_array(sg_ctx *ctx, const struct sg_host_model *h, int column,
                      const struct sg_moves *moves, float **out)
{
    const size_t most = sg_blocks(moves->count), block = block_bytes(h, column);
    struct edit_job job = {.moves = moves,
                           .before = h->count,
                           .parameters = column == SG_C_PARAMETERS,
                           .from = h->at[column],
                           .rows = sg_host_rows_of(moves->edit->rows, column),
                           .to = sg_alloc_raw(ctx, sg_column_tag(column), most, block),
                           .planes = sg_column_array_planes(column, h->sh_degree)};
    for (int c = column; c == column || (column == SG_C_PARAMETERS && sg_column_is_parameter(c));
         c++) {
        const int first = sg_columns[c].first, planes = sg_column_planes(c, h->sh_degree);
        job.parts[job.n_parts++] = (struct part){first, first + planes, sg_columns[c].fate};
    }
    *out = job.to;
    if (!job.to)
        return SG_ERR_BUDGET;
    if (most * SG_LANES > moves->count) /* lanes past the end */
        memset((char *) job.to + (most - 1) * block, 0, block);
    sg_parallel_for(ctx, (most + EDIT_BLOCKS - 1) / EDIT_BLOCKS, edit_piece, &job);
    return SG_OK;
}

static void replace(struct sg_host_model *h, int column, float *array)
{
    sg_free(h->at[column]);
    h->at[column] = array;
}

/* The arrays that the model needs: all of them are edited, or none. */
static int edit_needed(sg_ctx *ctx, struct sg_host_model *h, const struct sg_moves *moves)
{
    float *made[SG_COLUMNS] = {NULL};
    int code = SG_OK;
    for (int c = 0; c < SG_COLUMNS && !code; c++)
        if (sg_column_is_needed(c) && h->at[c])
            code = make_array(ctx, h, c, moves, &made[c]);
    for (int c = 0; c < SG_COLUMNS; c++)
        if (code)
            sg_free(made[c]);
        else if (made[c])
            replace(h, c, made[c]);
    return code;
}

/* The other ones, of which only one exists twice at any time. */
static int edit_others(sg_ctx *ctx, struct sg_host_model *h, const struct sg_moves *moves)
{
    for (int c = 0; c < SG_COLUMNS; c++) {
        float *made;
        if (sg_column_is_needed(c) || !h->at[c])
            continue;
        if (make_array(ctx, h, c, moves, &made))
            return SG_ERR_BUDGET;
        replace(h, c, made);
    }
    return SG_OK;
}

#define ORDER_FROM 4096 /* Gaussians; fewer fit the caches in any order */

int sg_host_plan_edit(sg_ctx *ctx, const struct sg_host_model *h, const struct sg_edit *e,
                      struct sg_moves *out)
{
    const size_t count = e->kept + e->appended;
    struct sg_moves *m = out;
    *m = (struct sg_moves){.edit = e, .count = count};
    m->source = sg_alloc_raw(ctx, SG_MEM_MODEL, count, sizeof(*m->source));
    m->order = sg_alloc_raw(ctx, SG_MEM_MODEL, count, sizeof(*m->order));
    if (!m->source || !m->order)
        return SG_ERR_BUDGET;
    size_t to = 0;
    for (size_t i = 0; i < h->count; i++)
        if (e->keep[i])
            m->source[to++] = (uint32_t) i;
    for (size_t i = 0; i < e->appended; i++)
        m->source[to++] = e->source[i] + (e->kind[i] == SG_EDIT_INSERT ? (uint32_t) h->count : 0);
    for (size_t i = 0; i < count && count < ORDER_FROM; i++)
        m->order[i] = (uint32_t) i;
    const struct sg_places places = {.params = h->at[SG_C_PARAMETERS],
                                     .count = h->count,
                                     .rows = e->rows ? e->rows->params : NULL,
                                     .planes = h->planes,
                                     .row_planes =
                                         e->rows ? sg_param_count(e->rows->sh_degree) : 0};
    return count < ORDER_FROM ? SG_OK : sg_morton_order(ctx, &places, m->source, count, m->order);
}

void sg_moves_clear(struct sg_moves *moves)
{
    sg_free(moves->order);
    sg_free(moves->source);
}

static void drop(struct sg_host_model *h, unsigned bits)
{
    for (int c = 0; c < SG_COLUMNS; c++)
        if (!sg_column_is_needed(c) && (sg_columns[c].bits & bits))
            replace(h, c, NULL);
}

int sg_host_edit(sg_ctx *ctx, struct sg_host_model *h, const struct sg_edit *e)
{
    struct sg_moves moves;
    drop(h, SG_COLUMN_LOST);
    int code = sg_host_plan_edit(ctx, h, e, &moves);
    if (!code)
        code = edit_needed(ctx, h, &moves);
    const bool edited = !code;
    if (!code)
        code = edit_others(ctx, h, &moves);
    if (edited && code)
        drop(h, ~0u);
    if (edited)
        h->count = moves.count, h->capacity = sg_blocks(moves.count) * SG_LANES;
    sg_moves_clear(&moves);
    return code;
}

void sg_host_floor_scale(struct sg_host_model *h, float smallest)
{
    const float least = logf(smallest);
    for (size_t i = 0; i < h->count; i++)
        for (int k = 0; k < 3; k++) {
            float *scale = &h->at[SG_C_PARAMETERS][sg_param_index(h->planes, i, SG_P_SCALE + k)];
            *scale = fmaxf(*scale, least);
        }
}

static const float *column_of(const struct sg_host_model *h, const struct sg_shape *shape,
                              size_t block)
{
    return shape->column < SG_COLUMNS ? h->at[shape->column] + block * SG_LANES : NULL;
}

void sg_host_reset_opacity(struct sg_host_model *h, float limit, const struct sg_shape *shape)
{
    const float logit = logf(limit / (1 - limit));
    float *params = h->at[SG_C_PARAMETERS], *m = h->at[SG_C_MOMENT1], *v = h->at[SG_C_MOMENT2];
    float shaped[SG_PARAMS_MAX * SG_LANES];
    for (size_t i = 0; i < h->count; i++) {
        const size_t at = sg_param_index(h->planes, i, SG_P_OPACITY), lane = i % SG_LANES;
        if (shape && !lane)
            shape->forward(shape->arg, params + sg_param_index(h->planes, i, 0),
                           column_of(h, shape, i / SG_LANES), h->planes, shaped);
        if (m && v)
            m[at] = v[at] = 0;
        params[at] = shape ? mip_limited(params[at], shaped[SG_P_OPACITY * SG_LANES + lane], limit)
                           : fminf(params[at], logit);
    }
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
    const size_t end = (piece + 1) * EDIT_BLOCKS, most = sg_blocks(j->h->count),
                 block = block_bytes(j->h, SG_C_PARAMETERS) / sizeof(float);
    float *const *at = j->h->at;
    for (size_t b = piece * EDIT_BLOCKS; b < end && b < most; b++) {
        const float *params = at[SG_C_PARAMETERS] + b * block;
        if (j->back)
            j->shape->backward(j->shape->arg, params, column_of(j->h, j->shape, b), j->h->planes,
                               at[SG_C_GRADIENT] + b * block);
        else
            j->shape->forward(j->shape->arg, params, column_of(j->h, j->shape, b), j->h->planes,
                              at[SG_C_SHAPED] + b * block);
    }
}

int sg_host_shape(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape)
{
    if (sg_host_alloc(ctx, h, SG_C_SHAPED) ||
        (shape->column < SG_COLUMNS && sg_host_alloc(ctx, h, shape->column)))
        return SG_ERR_BUDGET;
    sg_parallel_for(ctx, (sg_blocks(h->count) + EDIT_BLOCKS - 1) / EDIT_BLOCKS, shape_piece,
                    &(struct shape_job){h, shape, false});
    return SG_OK;
}

int sg_host_shape_backward(sg_ctx *ctx, struct sg_host_model *h, const struct sg_shape *shape)
{
    sg_parallel_for(ctx, (sg_blocks(h->count) + EDIT_BLOCKS - 1) / EDIT_BLOCKS, shape_piece,
                    &(struct shape_job){h, shape, true});
    return SG_OK;
}

void sg_host_clear(struct sg_host_model *h)
{
    for (int c = 0; c < SG_COLUMNS; c++)
        sg_free(h->at[c]);
    *h = (struct sg_host_model){0};
}

uint64_t sg_host_footprint(const struct sg_work *work, bool gradient)
{
    const unsigned bits = SG_COLUMN_SAVED | (work->mip ? SG_COLUMN_MIP : 0) |
                          (work->anchors ? SG_COLUMN_ANCHORS : 0) |
                          (work->radii ? SG_COLUMN_RADII : 0) | (work->grace ? SG_COLUMN_GRACE : 0);
    uint64_t sum = 0, largest = 0;
    for (int c = 0; c < SG_COLUMNS; c++) {
        const uint64_t bytes =
            (uint64_t) sg_column_array_planes(c, work->sh_degree) * sizeof(float);
        if (!sg_column_has_array(c) ||
            !(sg_column_of(c, bits) || (c == SG_C_ACCUMULATED && work->accumulate) ||
              (c == SG_C_GRADIENT && (gradient || work->mip)) || (c == SG_C_SHAPED && work->mip)))
            continue;
        sum += bytes;
        largest = bytes > largest ? bytes : largest;
    }
    /* An edit or a checkpoint holds one array twice. An edit also has the source and the order of
     * rows. What else the model needs it holds twice where what was read to plan it has been. */
    return sum + largest + 2 * sizeof(uint32_t);
}
