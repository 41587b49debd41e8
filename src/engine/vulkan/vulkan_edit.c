/* SPDX-License-Identifier: Apache-2.0 */
/* Edits of the model on the device. The host decides where rows come from and makes the children,
 * for which it reads the positions, scales and rotations; the rows themselves move on the device.
 * The bytes are those of an edit in host memory. */

#include "engine.h"

struct edit_job {
    const struct sg_moves *moves;
    struct gpu_buffer words, children;
};

/* Words of the rows, and the children. Each piece numbers its children from its first one on. */
struct move_job {
    const struct sg_host_model *h; /* planes up to the rotation */
    const struct sg_moves *moves;
    uint32_t *words, *first_child;
    float *children;
};

_Static_assert(SG_EDIT_KINDS <= 1 << VK_KIND_BITS, "a kind fits below a child's number");

#define PIECE 4096 /* rows */

static size_t piece_end(const struct move_job *j, size_t piece)
{
    return (piece + 1) * PIECE < j->moves->count ? (piece + 1) * PIECE : j->moves->count;
}

static void count_children(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct move_job *j = arg;
    uint32_t n = 0;
    for (size_t i = piece * PIECE; i < piece_end(j, piece); i++)
        n += sg_moves_kind(j->moves, j->moves->order[i]) == SG_EDIT_CHILD;
    j->first_child[piece] = n;
}

static void make_moves(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct move_job *j = arg;
    const struct sg_moves *m = j->moves;
    uint32_t child = j->first_child[piece];
    for (size_t i = piece * PIECE; i < piece_end(j, piece); i++) {
        const size_t item = m->order[i], source = m->source[item];
        const enum sg_edit_kind kind = sg_moves_kind(m, item);
        j->words[2 * i] = (uint32_t) (kind == SG_EDIT_INSERT ? source - j->h->count : source);
        j->words[2 * i + 1] = kind | child << VK_KIND_BITS;
        if (kind != SG_EDIT_CHILD)
            continue;
        const float *from = j->h->at[SG_C_PARAMETERS] + sg_param_index(SG_P_SH, source, 0);
        float *to = j->children + sg_param_index(SG_P_SH, child++, 0);
        for (int p = 0; p < SG_P_SH; p++)
            to[p * SG_LANES] = from[p * SG_LANES];
        sg_host_make_child(to, m->edit, item - m->edit->kept);
    }
}

static int put_moves(struct vulkan_engine *e, const struct sg_host_model *h, struct edit_job *job)
{
    sg_ctx *ctx = e->base.ctx;
    const struct sg_moves *m = job->moves;
    uint32_t children = 0;
    for (size_t i = 0; i < m->edit->appended; i++)
        children += m->edit->kind[i] == SG_EDIT_CHILD;
    const size_t blocks = sg_blocks(children), floats = (size_t) SG_P_SH * SG_LANES,
                 pieces = (m->count + PIECE - 1) / PIECE;
    struct move_job j = {
        .h = h,
        .moves = m,
        .words = sg_alloc_raw(ctx, SG_MEM_MODEL, m->count, 2 * sizeof(*j.words)),
        .first_child = sg_alloc_raw(ctx, SG_MEM_MODEL, pieces, sizeof(*j.first_child)),
        .children = sg_alloc(ctx, SG_MEM_MODEL, blocks, floats * sizeof(*j.children))};
    int code = (j.words && j.first_child) || !m->count ? SG_OK : SG_ERR_BUDGET;
    if (blocks && !j.children)
        code = SG_ERR_BUDGET;
    if (!code) {
        uint32_t sum = 0;
        sg_parallel_for(ctx, pieces, count_children, &j);
        for (size_t piece = 0; piece < pieces; piece++) {
            const uint32_t here = j.first_child[piece];
            j.first_child[piece] = sum;
            sum += here;
        }
        sg_parallel_for(ctx, pieces, make_moves, &j);
    }
    const uint64_t bytes = 8 * (uint64_t) m->count, child_bytes = 4 * (uint64_t) blocks * floats;
    if (!code)
        code = sg_gpu_reserve(e->gpu, SG_MEM_MODEL, &job->words, bytes);
    if (!code)
        code = sg_gpu_reserve(e->gpu, SG_MEM_MODEL, &job->children, child_bytes);
    if (!code)
        code = sg_gpu_write(e->gpu, &job->words, 0, j.words, bytes);
    if (!code)
        code = sg_gpu_write(e->gpu, &job->children, 0, j.children, child_bytes);
    sg_free(j.words);
    sg_free(j.first_child);
    sg_free(j.children);
    return code;
}

/* What the planes of a column take, by kind of row. */
static uint32_t fates_of(int column, const struct sg_edit *edit, bool rows)
{
    uint32_t fates = 0;
    for (int kind = 0; kind < SG_EDIT_KINDS; kind++) {
        const enum sg_fate fate = sg_columns[column].fate[kind];
        const bool zero = sg_edit_zeroes(edit, fate) || (kind == SG_EDIT_INSERT && !rows);
        const bool made = fate == SG_FATE_DRAW || fate == SG_FATE_SHRINK;
        const uint32_t takes = zero                     ? VK_FATE_ZERO
                               : kind == SG_EDIT_INSERT ? VK_FATE_ROW
                               : made                   ? VK_FATE_CHILD
                                                        : VK_FATE_COPY;
        fates |= takes << VK_FATE_BITS * kind;
    }
    return fates;
}

/* What the edit makes of an array; after an error nothing. */
static int make_array(struct vulkan_engine *e, int column, const struct edit_job *j,
                      struct gpu_buffer *out)
{
    struct gpu *g = e->gpu;
    const struct sg_edit *edit = j->moves->edit;
    const int degree = e->base.sh_degree, planes = sg_column_array_planes(column, degree);
    const uint64_t block = 4 * SG_LANES * (uint64_t) planes,
                   bytes = sg_blocks(j->moves->count) * block;
    const float *rows = sg_host_rows_of(edit->rows, column);
    struct gpu_buffer given = {0};
    *out = (struct gpu_buffer){0};
    int code = sg_gpu_reserve(g, sg_column_tag(column), out, bytes);
    if (rows && !code) {
        const uint64_t size = sg_blocks(edit->rows->count) * block;
        if (!(code = sg_gpu_reserve(g, SG_MEM_MODEL, &given, size)))
            code = sg_gpu_write(g, &given, 0, rows, size);
    }
    if (bytes && !code) /* lanes past the end */
        code = sg_gpu_fill(g, out, bytes - block, block, 0);
    for (int c = column;
         !code && (c == column || (column == SG_C_PARAMETERS && sg_column_is_parameter(c))); c++) {
        const int first = sg_columns[c].first;
        code = GPU_RUN(g, edit, 0, FOR_EACH(j->moves->count), .from = e->at[column].address,
                       .rows = sg_gpu_at(g, &given), .children = sg_gpu_at(g, &j->children),
                       .moves = j->words.address, .to = out->address,
                       .count = (uint32_t) j->moves->count, .planes = (uint32_t) planes,
                       .first = (uint32_t) first,
                       .end = (uint32_t) (first + sg_column_planes(c, degree)),
                       .fates = fates_of(c, edit, rows != NULL));
    }
    if (!code)
        code = sg_gpu_flush(g);
    sg_gpu_release(g, &given);
    if (code)
        sg_gpu_release(g, out);
    return code;
}

static void replace(struct vulkan_engine *e, int column, struct gpu_buffer array)
{
    sg_gpu_release(e->gpu, &e->at[column]);
    e->at[column] = array;
}

/* The arrays that the model needs: all of them are edited, or none. */
static int edit_needed(struct vulkan_engine *e, const struct edit_job *j)
{
    struct gpu_buffer made[SG_COLUMNS] = {{0}};
    int code = SG_OK;
    for (int c = 0; c < SG_COLUMNS && !code; c++)
        if (sg_column_is_needed(c) && e->at[c].buffer)
            code = make_array(e, c, j, &made[c]);
    for (int c = 0; c < SG_COLUMNS; c++)
        if (code)
            sg_gpu_release(e->gpu, &made[c]);
        else if (made[c].buffer)
            replace(e, c, made[c]);
    return code;
}

/* The other ones, of which only one exists twice at any time. */
static int edit_others(struct vulkan_engine *e, const struct edit_job *j)
{
    for (int c = 0; c < SG_COLUMNS; c++) {
        struct gpu_buffer made;
        if (sg_column_is_needed(c) || !e->at[c].buffer)
            continue;
        const int code = make_array(e, c, j, &made);
        if (code)
            return code;
        replace(e, c, made);
    }
    return SG_OK;
}

int sg_vulkan_edit(struct sg_engine *base, const struct sg_edit *edit)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct sg_host_model h = {0};
    struct sg_moves moves = {0};
    struct edit_job job = {.moves = &moves};
    sg_vulkan_drop_columns(e, SG_COLUMN_LOST);
    int code = sg_vulkan_check_size(base->ctx, edit->kept + edit->appended, e->planes);
    if (!code)
        code = sg_vulkan_read_planes(e, SG_P_SH, &h);
    if (!code)
        code = sg_host_plan_edit(base->ctx, &h, edit, &moves);
    if (!code)
        code = put_moves(e, &h, &job);
    sg_host_clear(&h);
    if (!code)
        code = edit_needed(e, &job);
    const bool edited = !code;
    if (!code)
        code = edit_others(e, &job);
    for (int c = 0; c < SG_COLUMNS && edited && code; c++)
        if (!sg_column_is_needed(c))
            sg_gpu_release(e->gpu, &e->at[c]);
    if (edited)
        e->count = moves.count;
    sg_gpu_release(e->gpu, &job.words);
    sg_gpu_release(e->gpu, &job.children);
    sg_moves_clear(&moves);
    return code;
}
