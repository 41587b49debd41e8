/* SPDX-License-Identifier: Apache-2.0 */
/* The model and the state of its optimiser on the device, and what changes Gaussians in place. */
#include <math.h>
#include <string.h>

#include "core/rng.h"
#include "engine.h"
#include "model/mip.h"

static uint64_t bytes_of(const struct vulkan_engine *e, int column, size_t count)
{
    return (uint64_t) sg_blocks(count) * SG_LANES * sizeof(float) *
           (uint64_t) sg_column_array_planes(column, e->base.sh_degree);
}

uint64_t sg_vulkan_column_bytes(const struct vulkan_engine *e, int column)
{
    return bytes_of(e, column, e->count);
}

void sg_vulkan_drop_columns(struct vulkan_engine *e, unsigned bits)
{
    for (int c = 0; c < SG_COLUMNS; c++)
        if (c != SG_C_PARAMETERS && (sg_columns[c].bits & bits))
            sg_gpu_release(e->gpu, &e->at[c]);
}

int sg_vulkan_alloc(struct vulkan_engine *e, int column)
{
    if (e->at[column].buffer)
        return SG_OK;
    const uint64_t bytes = sg_vulkan_column_bytes(e, column);
    const int code = sg_gpu_reserve(e->gpu, sg_column_tag(column), &e->at[column], bytes);
    return code ? code : sg_gpu_fill(e->gpu, &e->at[column], 0, bytes, 0);
}

int sg_vulkan_alloc_saved(struct vulkan_engine *e)
{
    int code = SG_OK;
    for (int c = 0; c < SG_COLUMNS && !code; c++)
        if (sg_column_has_array(c) && sg_column_of(c, SG_COLUMN_SAVED))
            code = sg_vulkan_alloc(e, c);
    return code;
}

/* Replaces a column by `count` Gaussians' values. Where memory runs out it is as it was. */
static int replace(struct vulkan_engine *e, int column, const float *from, size_t count)
{
    struct gpu_buffer made = {0};
    const uint64_t bytes = bytes_of(e, column, count);
    int code = sg_gpu_reserve(e->gpu, sg_column_tag(column), &made, bytes);
    if (!code)
        code = sg_gpu_write(e->gpu, &made, 0, from, bytes);
    if (code) {
        sg_gpu_release(e->gpu, &made);
        return code;
    }
    sg_gpu_release(e->gpu, &e->at[column]);
    e->at[column] = made;
    return SG_OK;
}

uint64_t sg_vulkan_most(int planes)
{
    return VK_MOST_INDEX / (uint64_t) (planes > VK_SPLAT ? planes : VK_SPLAT) - SG_LANES;
}

int sg_vulkan_check_size(sg_ctx *ctx, size_t count, int planes)
{
    const uint64_t most = sg_vulkan_most(planes);
    return count <= most ? SG_OK
                         : sg_fail(ctx, SG_ERR_BUDGET,
                                   "vulkan: found %zu Gaussians of %d values, at most %llu are "
                                   "supported",
                                   count, planes, (unsigned long long) most);
}

int sg_vulkan_upload(struct sg_engine *base, const struct sg_model *m,
                     const struct sg_columns *columns)
{
    struct vulkan_engine *e = vulkan_of(base);
    const int planes = sg_param_count(m->sh_degree), before = base->sh_degree;
    int code = sg_vulkan_check_size(base->ctx, m->count, planes);
    if (code)
        return code;
    base->sh_degree = m->sh_degree; /* of which the columns now are */
    code = replace(e, SG_C_PARAMETERS, m->params, m->count);
    if (code) {
        base->sh_degree = before;
        return code;
    }
    sg_vulkan_drop_columns(e, ~0u);
    e->count = m->count;
    e->planes = planes;
    for (int c = 0; c < SG_COLUMNS && columns && !code; c++)
        if (c != SG_C_PARAMETERS && columns->at[c])
            code = replace(e, c, columns->at[c], m->count);
    return code;
}

int sg_vulkan_download(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    struct vulkan_engine *e = vulkan_of(base);
    int code = SG_OK;
    for (int c = 0; c < SG_COLUMNS && !code; c++) {
        const uint64_t bytes = sg_vulkan_column_bytes(e, c);
        float *to = c == SG_C_PARAMETERS ? m ? m->params : NULL : columns ? columns->at[c] : NULL;
        if (to && e->at[c].buffer)
            code = sg_gpu_read(e->gpu, &e->at[c], 0, to, bytes);
        else if (to)
            memset(to, 0, bytes);
    }
    return code;
}

/* ---- through the host ---- */

static struct sg_host_model host_model(const struct vulkan_engine *e, int planes)
{
    return (struct sg_host_model){.count = e->count,
                                  .capacity = sg_blocks(e->count) * SG_LANES,
                                  .sh_degree = e->base.sh_degree,
                                  .planes = planes};
}

/* Copies of columns, which are made where there are none. */
static int mirror(struct vulkan_engine *e, struct sg_host_model *h, const int *columns, int n)
{
    int code = SG_OK;
    for (int k = 0; k < n && !code; k++)
        if (!(code = sg_vulkan_alloc(e, columns[k])) &&
            !(code = sg_host_alloc(e->base.ctx, h, columns[k])))
            code = sg_gpu_read(e->gpu, &e->at[columns[k]], 0, h->at[columns[k]],
                               sg_vulkan_column_bytes(e, columns[k]));
    return code;
}

static int write_back(struct vulkan_engine *e, const struct sg_host_model *h, int column)
{
    return sg_gpu_write(e->gpu, &e->at[column], 0, h->at[column],
                        sg_vulkan_column_bytes(e, column));
}

int sg_vulkan_read_planes(struct vulkan_engine *e, int planes, struct sg_host_model *h)
{
    struct gpu_buffer some = {0};
    *h = host_model(e, planes);
    const uint64_t bytes = 4 * (uint64_t) h->capacity * (uint64_t) planes;
    int code = sg_gpu_reserve(e->gpu, SG_MEM_SPLATS, &some, bytes);
    h->at[SG_C_PARAMETERS] =
        sg_alloc(e->base.ctx, SG_MEM_MODEL, h->capacity, (size_t) planes * sizeof(float));
    if (!h->at[SG_C_PARAMETERS])
        code = SG_ERR_BUDGET;
    if (!code)
        code =
            GPU_RUN(e->gpu, planes, 0, FOR_EACH(e->count), .from = e->at[SG_C_PARAMETERS].address,
                    .to = some.address, .count = (uint32_t) e->count,
                    .planes = (uint32_t) e->planes, .width = (uint32_t) planes);
    if (!code)
        code = sg_gpu_read(e->gpu, &some, 0, h->at[SG_C_PARAMETERS], bytes);
    sg_gpu_release(e->gpu, &some);
    return code;
}

int sg_vulkan_filter(struct sg_engine *base, const struct sg_camera *const *cameras, size_t n,
                     const struct sg_mip_filter *filter)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    const uint64_t count = e->count, bytes = 4 * n * SG_MIP_CAMERA;
    struct gpu_buffer seen_from = {0}, depths = {0};
    double(*exact)[SG_MIP_CAMERA] = sg_alloc_raw(base->ctx, SG_MEM_MISC, n, sizeof(*exact));
    float *numbers = sg_alloc_raw(base->ctx, SG_MEM_MISC, n, SG_MIP_CAMERA * sizeof(*numbers)),
          focal = 0;
    int code = n && !(exact && numbers) ? SG_ERR_BUDGET : sg_vulkan_alloc(e, SG_C_FILTER);
    if (!code) {
        focal = sg_host_filter_cameras(cameras, n, exact);
        for (size_t k = 0; k < n * SG_MIP_CAMERA; k++)
            numbers[k] = (float) exact[k / SG_MIP_CAMERA][k % SG_MIP_CAMERA];
        code = sg_gpu_reserve(g, SG_MEM_MISC, &seen_from, bytes);
    }
    if (!code)
        code = sg_gpu_reserve(g, SG_MEM_SPLATS, &depths, 4 * (count + 1));
    if (!code)
        code = sg_gpu_write(g, &seen_from, 0, numbers, bytes);
    if (!code)
        code = sg_gpu_fill(g, &depths, 4 * count, 4, 0);
    if (!code)
        code = GPU_RUN(g, mip_depth, 0, FOR_EACH(count), .params = e->at[SG_C_PARAMETERS].address,
                       .cameras = seen_from.address, .depths = depths.address,
                       .most = depths.address + 4 * count, .count = (uint32_t) count,
                       .planes = (uint32_t) e->planes, .views = (uint32_t) n,
                       .margin = (float) filter->margin);
    if (!code)
        code = GPU_RUN(g, mip_filter, 0, FOR_EACH(count), .depths = depths.address,
                       .filters = e->at[SG_C_FILTER].address, .count = (uint32_t) count,
                       .focal = focal, .pixels = (float) sqrt(filter->variance));
    if (!code)
        code = sg_gpu_flush(g);
    sg_gpu_release(g, &seen_from);
    sg_gpu_release(g, &depths);
    sg_free(exact);
    sg_free(numbers);
    return code;
}

int sg_vulkan_count_radii(struct vulkan_engine *e)
{
    const int shown = e->at[SG_C_SHAPED].buffer ? SG_C_SHAPED : SG_C_PARAMETERS;
    const int code = sg_vulkan_alloc(e, SG_C_RADIUS);
    return code ? code
                : GPU_RUN(e->gpu, radii, 0, FOR_EACH(e->count), .params = e->at[shown].address,
                          .view = e->view.address, .radii = e->at[SG_C_RADIUS].address,
                          .stop = e->gpu->stop.address, .count = (uint32_t) e->count,
                          .planes = (uint32_t) e->planes, .grid_x = e->lists.grid_x,
                          .grid_y = e->lists.grid_y);
}

/* ---- densification as Markov chain Monte Carlo ---- */

/* The entries, to the device. */
static int put_entries(struct vulkan_engine *e, const struct sg_relocation *r,
                       struct gpu_buffer *to)
{
    uint32_t *words =
        sg_alloc_raw(e->base.ctx, SG_MEM_OPTIMISER, r->count, VK_ENTRY * sizeof(*words));
    const uint64_t bytes = 4 * VK_ENTRY * (uint64_t) r->count;
    int code = words ? sg_gpu_reserve(e->gpu, SG_MEM_OPTIMISER, to, bytes) : SG_ERR_BUDGET;
    for (size_t k = 0; k < r->count && !code; k++) {
        uint32_t *w = words + VK_ENTRY * k;
        w[0] = r->to[k], w[1] = r->from[k], w[4] = r->fresh[k];
        memcpy(w + 2, &r->opacity[k], sizeof(*w));
        memcpy(w + 3, &r->scale[k], sizeof(*w));
    }
    if (!code)
        code = sg_gpu_write(e->gpu, to, 0, words, bytes);
    sg_free(words);
    return code;
}

static int run_entries(struct vulkan_engine *e, const struct gpu_buffer *entries, size_t first,
                       size_t end)
{
    const bool moments = e->at[SG_C_MOMENT1].buffer && e->at[SG_C_MOMENT2].buffer;
    return GPU_RUN(
        e->gpu, relocate, 0, FOR_EACH(end - first), .params = e->at[SG_C_PARAMETERS].address,
        .m = sg_gpu_at(e->gpu, &e->at[SG_C_MOMENT1]), .v = sg_gpu_at(e->gpu, &e->at[SG_C_MOMENT2]),
        .entries = entries->address, .first = (uint32_t) first, .end = (uint32_t) end,
        .planes = (uint32_t) e->planes, .moments = moments);
}

/* Entries count one after the other. Those that do not meet run at once. */
int sg_vulkan_relocate(struct sg_engine *base, const struct sg_relocation *r)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu_buffer entries = {0};
    /* Of each Gaussian, 1 + the newest entry that reads it, and that writes it. */
    uint32_t *read = sg_alloc(base->ctx, SG_MEM_OPTIMISER, e->count, 2 * sizeof(*read)),
             *written = read ? read + e->count : NULL;
    size_t first = 0;
    int code = !r->count ? SG_OK : read ? put_entries(e, r, &entries) : SG_ERR_BUDGET;
    for (size_t k = 0; k < r->count && !code; k++) {
        const uint32_t to = r->to[k], from = r->from[k];
        if (written[from] > first || written[to] > first || read[to] > first) {
            code = run_entries(e, &entries, first, k);
            first = k;
        }
        read[from] = written[to] = (uint32_t) k + 1;
    }
    if (!code)
        code = run_entries(e, &entries, first, r->count);
    if (!code)
        code = sg_gpu_flush(e->gpu);
    sg_gpu_release(e->gpu, &entries);
    sg_free(read);
    return code;
}

int sg_vulkan_explore(struct vulkan_engine *e, const struct sg_exploration *x)
{
    const uint64_t key = sg_rng_key(x->seed, SG_RNG_EXPLORE, x->stream);
    const struct args_explore args = {.params = e->at[SG_C_PARAMETERS].address,
                                      .count = (uint32_t) e->count,
                                      .planes = (uint32_t) e->planes,
                                      .key_low = (uint32_t) key,
                                      .key_high = (uint32_t) (key >> 32),
                                      .amount = x->amount,
                                      .gate = x->gate,
                                      .dead = x->dead};
    /* After an edit the work is that of an earlier model, and the device has not stopped. */
    return e->lists.work.buffer && e->lists.count == e->count
               ? sg_gpu_dispatch_work(e->gpu, GPU_explore, 0, &args, sizeof(args), &e->lists.work,
                                      VK_WORK_MODEL)
               : sg_gpu_dispatch(e->gpu, GPU_explore, 0, &args, sizeof(args), FOR_EACH(e->count));
}

/* ---- the shape ---- */

/* A stage in host memory: on copies of the parameters, of what the shape reads, and of the column
 * that it changes. */
static int shape_on_host(struct vulkan_engine *e, const struct sg_shape *shape, int column,
                         int (*stage)(sg_ctx *, struct sg_host_model *, const struct sg_shape *))
{
    const int columns[] = {SG_C_PARAMETERS, column, shape->column};
    struct sg_host_model h = host_model(e, e->planes);
    int code = mirror(e, &h, columns, shape->column < SG_COLUMNS ? 3 : 2);
    if (!code)
        code = stage(e->base.ctx, &h, shape);
    if (!code)
        code = write_back(e, &h, column);
    sg_host_clear(&h);
    return code;
}

/* The stages of the only shape that has a kernel. */
static bool is_mip(const struct sg_shape *shape)
{
    return shape->forward == sg_mip_forward && shape->backward == sg_mip_backward &&
           shape->column == SG_C_FILTER;
}

static int run_mip(struct vulkan_engine *e, int column, bool back)
{
    const int code = sg_vulkan_alloc(e, SG_C_FILTER);
    return code ? code
                : GPU_RUN(e->gpu, mip_shape, 0, FOR_EACH(e->count),
                          .params = e->at[SG_C_PARAMETERS].address,
                          .filters = e->at[SG_C_FILTER].address, .to = e->at[column].address,
                          .count = (uint32_t) e->count, .planes = (uint32_t) e->planes,
                          .back = back);
}

int sg_vulkan_shape(struct sg_engine *base, const struct sg_shape *shape)
{
    struct vulkan_engine *e = vulkan_of(base);
    if (!is_mip(shape))
        return shape_on_host(e, shape, SG_C_SHAPED, sg_host_shape);
    const uint64_t bytes = sg_vulkan_column_bytes(e, SG_C_PARAMETERS);
    int code = sg_vulkan_alloc(e, SG_C_SHAPED);
    if (!code)
        code = sg_gpu_copy(e->gpu, &e->at[SG_C_PARAMETERS], 0, &e->at[SG_C_SHAPED], 0, bytes);
    return code ? code : run_mip(e, SG_C_SHAPED, false);
}

int sg_vulkan_shape_backward(struct sg_engine *base, const struct sg_shape *shape)
{
    struct vulkan_engine *e = vulkan_of(base);
    return is_mip(shape) ? run_mip(e, SG_C_GRADIENT, true)
                         : shape_on_host(e, shape, SG_C_GRADIENT, sg_host_shape_backward);
}

/* ---- small ones ---- */

int sg_vulkan_read_statistics(struct sg_engine *base, const struct sg_statistics *out)
{
    struct vulkan_engine *e = vulkan_of(base);
    const int statistics[] = {SG_C_GRAD_SUM, SG_C_GRAD_COUNT, SG_C_GRAD_ABSOLUTE, SG_C_RADIUS};
    struct sg_host_model h;
    int code = sg_vulkan_read_planes(e, SG_P_ROT, &h);
    for (int k = 0; k < 4 && !code; k++)
        if (e->at[statistics[k]].buffer)
            code = mirror(e, &h, &statistics[k], 1);
    if (!code)
        sg_host_statistics(base->ctx, &h, out);
    sg_host_clear(&h);
    return code;
}

/* Submitted at once: what is refused later must not lose it unnoticed. */
static int move(struct vulkan_engine *e, uint32_t what, float limit)
{
    const bool moments = e->at[SG_C_MOMENT1].buffer && e->at[SG_C_MOMENT2].buffer;
    const int code =
        GPU_RUN(e->gpu, move, 0, FOR_EACH(e->count), .params = e->at[SG_C_PARAMETERS].address,
                .shaped = sg_gpu_at(e->gpu, &e->at[SG_C_SHAPED]),
                .m = sg_gpu_at(e->gpu, &e->at[SG_C_MOMENT1]),
                .v = sg_gpu_at(e->gpu, &e->at[SG_C_MOMENT2]), .count = (uint32_t) e->count,
                .planes = (uint32_t) e->planes, .what = what, .moments = moments, .limit = limit);
    return code ? code : sg_gpu_flush(e->gpu);
}

int sg_vulkan_floor_scale(struct sg_engine *base, float smallest)
{
    return move(vulkan_of(base), 0, logf(smallest));
}

int sg_vulkan_reset_opacity(struct sg_engine *base, float limit)
{
    struct vulkan_engine *e = vulkan_of(base);
    if (!base->shape)
        return move(e, 1, logf(limit / (1 - limit)));
    const int code = sg_vulkan_shape(base, base->shape);
    return code ? code : move(e, 2, limit);
}
