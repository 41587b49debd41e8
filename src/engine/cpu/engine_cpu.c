/* SPDX-License-Identifier: Apache-2.0 */
/* The CPU engine: drives the kernels over the thread pool. However work is cut into pieces, every
 * sum is taken in a fixed order, so that any number of threads gives the same bytes. */
#include <stdatomic.h>
#include <string.h>

#include "bin.h"
#include "dispatch.h"
#include "engine/host/exposure.h"
#include "engine/host/host_model.h"
#include "engine/host/image_losses.h"
#include "engine/host/low_pass.h"
#include "engine/ops.h"

#define BLOCKS_PER_PIECE 64 /* of SG_LANES Gaussians */

struct cpu_engine {
    struct sg_engine base;
    const struct cpu_kernels *kernels;
    struct sg_host_model model;
    struct sg_camera camera;
    struct sg_render_params params;
    int degree;
    struct cpu_splat *splats;
    struct bins bins;
    float *slots;     /* per instance of the band: splat gradients */
    float *band_sums; /* per Gaussian over the bands; unused with one band */
    float *rgb, *alpha, *depth, *gradient, *loss_scratch;
    double *sums;
    size_t cap_splats, cap_slots, cap_band_sums;
    size_t pixels;     /* the frame buffers' size */
    size_t aux_pixels; /* alpha and depth */
    size_t loss_scratch_floats;
    size_t sums_rows;
    struct sg_image_losses image_losses;
    struct sg_host_low_pass low_pass;
    struct sg_host_exposure exposed;
    int most_bands; /* of a view so far; only for the log */
};

static void destroy(struct sg_engine *base)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    sg_host_clear(&b->model);
    sg_bins_clear(&b->bins);
    sg_image_losses_clear(&b->image_losses);
    sg_host_low_pass_clear(&b->low_pass);
    sg_host_exposure_clear(&b->exposed);
    void *owned[] = {b->splats, b->slots,    b->band_sums,    b->rgb, b->alpha,
                     b->depth,  b->gradient, b->loss_scratch, b->sums};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        sg_free(owned[i]);
    sg_free(b);
}

static const char *variant(const struct sg_engine *base)
{
    return ((const struct cpu_engine *) base)->kernels->name;
}

static int upload(struct sg_engine *base, const struct sg_model *m,
                  const struct sg_columns *columns)
{
    return sg_host_upload(base->ctx, &((struct cpu_engine *) base)->model, m, columns);
}

static int adopt(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    sg_host_adopt(&((struct cpu_engine *) base)->model, m, columns);
    return SG_OK;
}

static int download(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    return sg_host_download(&((struct cpu_engine *) base)->model, m, columns);
}

static struct sg_host_model *host_model(struct sg_engine *base)
{
    return &((struct cpu_engine *) base)->model;
}

static size_t count(const struct sg_engine *base)
{
    return ((const struct cpu_engine *) base)->model.count;
}

static size_t pieces(size_t n)
{
    const size_t blocks = (n + SG_LANES - 1) / SG_LANES;
    return (blocks + BLOCKS_PER_PIECE - 1) / BLOCKS_PER_PIECE;
}

static size_t piece_end(size_t n, size_t piece)
{
    const size_t blocks = (n + SG_LANES - 1) / SG_LANES, end = (piece + 1) * BLOCKS_PER_PIECE;
    return end < blocks ? end : blocks;
}

struct project_job {
    void (*kernel)(const struct cpu_project_args *, size_t, size_t);
    struct cpu_project_args args;
};

static void project_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct project_job *j = arg;
    j->kernel(&j->args, piece * BLOCKS_PER_PIECE, piece_end(j->args.count, piece));
}

/* Replaces *buffer by one of n items; contents undefined. */
static int refit(sg_ctx *ctx, float **buffer, size_t n)
{
    sg_free(*buffer);
    *buffer = sg_alloc_raw(ctx, SG_MEM_FRAME, n, sizeof(float));
    return *buffer ? SG_OK : SG_ERR_BUDGET;
}

static int do_project(struct sg_engine *base, const struct sg_camera *camera, int sh_degree,
                      const struct sg_render_params *params)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    sg_ctx *ctx = base->ctx;
    b->camera = *camera;
    b->params = *params;
    b->degree = sh_degree;
    const size_t n = b->model.count, pixels = (size_t) camera->width * (size_t) camera->height;
    if (sg_grow(ctx, SG_MEM_SPLATS, &b->splats, &b->cap_splats, n, 0, sizeof(*b->splats)) ||
        sg_bins_begin(ctx, &b->bins, n, camera->width, camera->height, params->reference_tiles))
        return SG_ERR_BUDGET;
    if (pixels > b->pixels) {
        b->pixels = 0;
        if (refit(ctx, &b->rgb, 3 * pixels) || refit(ctx, &b->gradient, 3 * pixels))
            return SG_ERR_BUDGET;
        b->pixels = pixels;
    }
    struct project_job job = {params->mip_kernel > 0 ? b->kernels->project_mip
                                                     : b->kernels->project,
                              {.params = sg_host_effective(&b->model),
                               .count = n,
                               .planes = b->model.planes,
                               .degree = sh_degree,
                               .camera = &b->camera,
                               .mip_kernel = params->mip_kernel,
                               .grid_x = b->bins.grid_x,
                               .grid_y = b->bins.grid_y,
                               .reference_tiles = params->reference_tiles,
                               .splats = b->splats,
                               .extents = b->bins.extents}};
    sg_parallel_for(ctx, pieces(n), project_piece, &job);
    return SG_OK;
}

static int do_bin(struct sg_engine *base)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    const int code = sg_bins_make(base->ctx, &b->bins, b->splats, b->params.max_instances);
    if (code)
        return code;
    base->step.stats = (struct sg_render_stats){.visible = b->bins.visible,
                                                .instances = b->bins.total,
                                                .max_tile = b->bins.max_tile,
                                                .bands = (uint32_t) b->bins.band_count};
    if (b->bins.band_count > b->most_bands) {
        b->most_bands = b->bins.band_count;
        sg_log(base->ctx, SG_LOG_DEBUG,
               "engine: %d x %d pixels in %d bands: %llu instances, at most %llu at once",
               b->camera.width, b->camera.height, b->bins.band_count,
               (unsigned long long) b->bins.total, (unsigned long long) b->params.max_instances);
    }
    /* The lists of one band are held at once. Those of several are made while they are needed. */
    return b->bins.band_count == 1 ? sg_bins_band(base->ctx, &b->bins, 0) : SG_OK;
}

struct raster_job {
    uint64_t (*kernel)(const struct cpu_raster_args *, int);
    struct cpu_raster_args args;
    atomic_uint_least64_t pairs;
};

static void raster_tile(void *arg, size_t i, int thread)
{
    (void) thread;
    struct raster_job *j = arg;
    const uint64_t pairs = j->kernel(&j->args, j->args.first_tile + (int) i);
    atomic_fetch_add_explicit(&j->pairs, pairs, memory_order_relaxed);
}

static struct cpu_raster_args raster_args(const struct cpu_engine *b, int band)
{
    struct cpu_raster_args a = {.width = b->camera.width,
                                .height = b->camera.height,
                                .grid_x = b->bins.grid_x,
                                .splats = b->splats,
                                .instances = b->bins.instances,
                                .tile_start = b->bins.tile_start,
                                .first_tile = b->bins.bands[band].first,
                                .block_mask = b->bins.block_mask,
                                .tile_end = b->bins.tile_end,
                                .rgb = b->rgb,
                                .gradient = b->gradient,
                                .slots = b->slots};
    memcpy(a.background, b->params.background, sizeof(a.background));
    return a;
}

static size_t band_tiles(const struct cpu_engine *b, int band)
{
    return (size_t) (b->bins.bands[band].end - b->bins.bands[band].first);
}

static int raster(struct sg_engine *base, bool auxiliary)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    sg_ctx *ctx = base->ctx;
    uint64_t pairs = 0;
    const size_t pixels = (size_t) b->camera.width * (size_t) b->camera.height;
    if (auxiliary && pixels > b->aux_pixels) {
        b->aux_pixels = 0;
        if (refit(ctx, &b->alpha, pixels) || refit(ctx, &b->depth, pixels))
            return SG_ERR_BUDGET;
        b->aux_pixels = pixels;
    }
    for (int band = 0; band < b->bins.band_count; band++) {
        if (sg_bins_band(ctx, &b->bins, band))
            return SG_ERR_BUDGET;
        struct raster_job job = {.kernel = b->kernels->raster, .args = raster_args(b, band)};
        if (auxiliary)
            job.args.alpha = b->alpha, job.args.depth = b->depth;
        sg_parallel_for(ctx, band_tiles(b, band), raster_tile, &job);
        pairs += job.pairs;
    }
    base->step.stats.pairs = pairs;
    return SG_OK;
}

static int read_image(struct sg_engine *base, float *rgb, float *alpha, float *depth)
{
    const struct cpu_engine *b = (const struct cpu_engine *) base;
    const size_t pixels = (size_t) b->camera.width * (size_t) b->camera.height;
    memcpy(rgb, b->rgb, 3 * pixels * sizeof(float));
    if (alpha)
        memcpy(alpha, b->alpha, pixels * sizeof(float));
    if (depth)
        memcpy(depth, b->depth, pixels * sizeof(float));
    return SG_OK;
}

static int write_image_gradient(struct sg_engine *base, const float *gradient)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    memcpy(b->gradient, gradient,
           3 * (size_t) b->camera.width * (size_t) b->camera.height * sizeof(float));
    return SG_OK;
}

struct loss_job {
    const struct cpu_kernels *kernels;
    struct cpu_loss_args args;
    int rows; /* of a piece */
    float *scratch;
};

static void loss_rows(void *arg, size_t piece, int thread)
{
    const struct loss_job *j = arg;
    const int first = (int) (piece / 3) * j->rows, end = first + j->rows;
    j->kernels->loss(&j->args, (int) (piece % 3), first,
                     end < j->args.height ? end : j->args.height,
                     j->scratch + (size_t) thread * CPU_LOSS_SCRATCH((size_t) j->args.width));
}

static int photometric(struct sg_engine *base, const struct sg_target_pixels *target,
                       const struct sg_photometric *p)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    const int height = b->camera.height, threads = sg_ctx_threads(base->ctx);
    const size_t scratch = (size_t) threads * CPU_LOSS_SCRATCH((size_t) b->camera.width);
    if (scratch > b->loss_scratch_floats) {
        b->loss_scratch_floats = 0;
        if (refit(base->ctx, &b->loss_scratch, scratch))
            return SG_ERR_BUDGET;
        b->loss_scratch_floats = scratch;
    }
    if (sg_grow(base->ctx, SG_MEM_FRAME, &b->sums, &b->sums_rows, (size_t) height, 0,
                9 * sizeof(double)) ||
        (target->exposure &&
         sg_host_expose(base->ctx, &b->exposed, target->exposure, b->rgb, b->camera.width, height)))
        return SG_ERR_BUDGET;
    /* Each piece computes ten rows of its neighbours again, so few pieces are better. But the
     * threads should end at the same time. */
    const int rows = height / (2 * threads) + 1;
    struct loss_job job = {.kernels = b->kernels,
                           .args = {.width = b->camera.width,
                                    .height = height,
                                    .rgb = target->exposure ? b->exposed.image : b->rgb,
                                    .target = target,
                                    .params = p,
                                    .gradient = b->gradient,
                                    .sums = b->sums},
                           .rows = rows < CPU_LOSS_STEP ? CPU_LOSS_STEP : rows,
                           .scratch = b->loss_scratch};
    sg_parallel_for(base->ctx, 3 * (((size_t) height + (size_t) job.rows - 1) / (size_t) job.rows),
                    loss_rows, &job);
    double low_pass = 0;
    if (p->low_pass > 0 && sg_host_low_pass(base->ctx, &b->low_pass, job.args.rgb, target, p,
                                            b->camera.width, height, b->gradient, &low_pass))
        return SG_ERR_BUDGET;
    if (target->exposure)
        sg_host_expose_backward(base->ctx, &b->exposed, target->exposure, b->rgb, b->camera.width,
                                height, b->gradient, base->step.exposure);
    double sums[3] = {0};
    for (int row = 0; row < 3 * b->camera.height; row++)
        for (int k = 0; k < 3; k++)
            sums[k] += b->sums[3 * row + k];
    const double values = 3.0 * (double) b->camera.width * (double) b->camera.height;
    base->step.photometric = sg_photometric_value_of(sums[0] / values, sums[1] / values,
                                                     sums[2] / values, p->lambda_dssim);
    base->step.photometric.total += (double) p->low_pass * low_pass;
    base->step.loss[SG_LOSS_PHOTOMETRIC] = base->step.photometric.total;
    return SG_OK;
}

static int loss(struct sg_engine *base, const struct sg_target_pixels *target,
                const struct sg_loss *l)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    if (l->kind == SG_LOSS_PHOTOMETRIC)
        return photometric(base, target, &l->photometric);
    return sg_image_loss(base->ctx, &b->image_losses, l, b->rgb, b->camera.width, b->camera.height,
                         target->mask, b->gradient, &base->step.loss[l->kind]);
}

static bool absolute(const struct cpu_engine *b)
{
    return b->base.statistic != SG_GRADIENT_NORM;
}

static void band_sum_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct cpu_engine *b = arg;
    const size_t n = b->model.count, stop = piece_end(n, piece) * SG_LANES,
                 used = absolute(b) ? CPU_SLOT_ABSOLUTE : CPU_SLOT_USED;
    for (size_t i = piece * BLOCKS_PER_PIECE * SG_LANES; i < stop && i < n; i++)
        for (size_t k = b->bins.slot_start[i]; k < b->bins.slot_start[i + 1]; k++)
            for (size_t j = 0; j < used; j++)
                b->band_sums[i * CPU_SLOT_FLOATS + j] += b->slots[k * CPU_SLOT_FLOATS + j];
}

static int raster_backward(struct sg_engine *base)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    sg_ctx *ctx = base->ctx;
    const bool banded = b->bins.band_count > 1;
    if (banded) {
        if (sg_grow(ctx, SG_MEM_SPLATS, &b->band_sums, &b->cap_band_sums, b->model.count, 0,
                    CPU_SLOT_FLOATS * sizeof(float)))
            return SG_ERR_BUDGET;
        memset(b->band_sums, 0, b->model.count * CPU_SLOT_FLOATS * sizeof(float));
    }
    for (int band = 0; band < b->bins.band_count; band++) {
        if (sg_bins_band(ctx, &b->bins, band))
            return SG_ERR_BUDGET;
        const size_t instances = b->bins.tile_start[band_tiles(b, band)];
        if (sg_grow(ctx, SG_MEM_INSTANCES, &b->slots, &b->cap_slots, instances, 0,
                    CPU_SLOT_FLOATS * sizeof(float)))
            return SG_ERR_BUDGET;
        struct raster_job job = {.kernel = b->kernels->raster, .args = raster_args(b, band)};
        if (banded) /* a later band has overwritten the block masks: draw this band again */
            sg_parallel_for(ctx, band_tiles(b, band), raster_tile, &job);
        job.kernel =
            absolute(b) ? b->kernels->raster_backward_absolute : b->kernels->raster_backward;
        sg_parallel_for(ctx, band_tiles(b, band), raster_tile, &job);
        if (banded)
            sg_parallel_for(ctx, pieces(b->model.count), band_sum_piece, b);
    }
    return SG_OK;
}

struct learn_job {
    void (*kernel)(const struct cpu_learn_args *, size_t, size_t);
    struct cpu_learn_args args;
};

static void learn_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct learn_job *j = arg;
    j->kernel(&j->args, piece * BLOCKS_PER_PIECE, piece_end(j->args.count, piece));
}

static struct cpu_learn_args learn_args(const struct cpu_engine *b)
{
    const struct sg_host_model *h = &b->model;
    const bool banded = b->bins.band_count > 1;
    return (struct cpu_learn_args){.camera = &b->camera,
                                   .mip_kernel = b->params.mip_kernel,
                                   .shaped = sg_host_effective(h),
                                   .params = h->at[SG_C_PARAMETERS],
                                   .m = h->at[SG_C_MOMENT1],
                                   .v = h->at[SG_C_MOMENT2],
                                   .grad_sum = h->at[SG_C_GRAD_SUM],
                                   .grad_count = h->at[SG_C_GRAD_COUNT],
                                   .count = h->count,
                                   .planes = h->planes,
                                   .degree = b->degree,
                                   .splats = b->splats,
                                   .extents = b->bins.extents,
                                   .absolute = absolute(b),
                                   .grad_absolute = h->at[SG_C_GRAD_ABSOLUTE],
                                   .slots = banded ? b->band_sums : b->slots,
                                   .slot_start = banded ? NULL : b->bins.slot_start,
                                   .gradients = h->at[SG_C_GRADIENT]};
}

static int alloc_absolute(struct cpu_engine *b)
{
    return b->base.statistic == SG_GRADIENT_MIP
               ? sg_host_alloc(b->base.ctx, &b->model, SG_C_GRAD_ABSOLUTE)
               : SG_OK;
}

static void (*pull_kernel(const struct cpu_engine *b))(const struct cpu_learn_args *, size_t,
                                                       size_t)
{
    return b->params.mip_kernel > 0 ? b->kernels->project_backward_optimise_mip
                                    : b->kernels->project_backward_optimise;
}

static int project_backward(struct sg_engine *base, bool statistics)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    const bool zeros = !b->model.at[SG_C_GRADIENT];
    if ((statistics && (sg_host_alloc(base->ctx, &b->model, SG_C_GRAD_SUM) ||
                        sg_host_alloc(base->ctx, &b->model, SG_C_GRAD_COUNT))) ||
        alloc_absolute(b) || sg_host_alloc(base->ctx, &b->model, SG_C_GRADIENT))
        return SG_ERR_BUDGET;
    const struct sg_host_model *h = &b->model;
    const struct sg_update update = {.statistics = statistics};
    struct learn_job job = {pull_kernel(b), learn_args(b)};
    job.args.update = &update;
    if (!zeros)
        memset(h->at[SG_C_GRADIENT], 0, h->capacity * (size_t) h->planes * sizeof(float));
    sg_parallel_for(base->ctx, pieces(h->count), learn_piece, &job);
    return SG_OK;
}

static int learn(struct cpu_engine *b, const struct sg_update *u, bool stored,
                 void (*kernel)(const struct cpu_learn_args *, size_t, size_t))
{
    struct sg_host_model *h = &b->model;
    if (sg_host_alloc_saved(b->base.ctx, h) || alloc_absolute(b) ||
        (u->accumulate && sg_host_alloc(b->base.ctx, h, SG_C_ACCUMULATED)))
        return SG_ERR_BUDGET;
    struct learn_job job = {kernel, learn_args(b)};
    job.args.update = u;
    job.args.accumulated = u->accumulate ? h->at[SG_C_ACCUMULATED] : NULL;
    job.args.gradients = stored ? h->at[SG_C_GRADIENT] : NULL;
    if (u->adam || u->statistics || u->accumulate)
        sg_parallel_for(b->base.ctx, pieces(h->count), learn_piece, &job);
    return SG_OK;
}

static int optimise(struct sg_engine *base, const struct sg_update *u)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    return learn(b, u, true, b->kernels->optimise);
}

static int project_backward_optimise(struct sg_engine *base, const struct sg_update *u)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    return learn(b, u, false, pull_kernel(b));
}

static int shape(struct sg_engine *base, const struct sg_shape *how)
{
    return sg_host_shape(base->ctx, &((struct cpu_engine *) base)->model, how);
}

static int shape_backward(struct sg_engine *base, const struct sg_shape *how)
{
    return sg_host_shape_backward(base->ctx, &((struct cpu_engine *) base)->model, how);
}

struct hit_job {
    const struct cpu_engine *b;
    uint8_t *seen; /* NULL, or per Gaussian: blended somewhere in this view */
    double *hits;
};

/* Adds up a band's slots, as the update does with gradients. */
static void hit_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct hit_job *j = arg;
    const struct bins *bins = &j->b->bins;
    const size_t n = j->b->model.count, stop = piece_end(n, piece) * SG_LANES;
    for (size_t i = piece * BLOCKS_PER_PIECE * SG_LANES; i < stop && i < n; i++)
        for (size_t k = bins->slot_start[i]; k < bins->slot_start[i + 1]; k++) {
            if (!j->seen)
                j->hits[i] += (double) j->b->slots[k];
            else if (j->b->slots[k] > 0 && !j->seen[i])
                j->seen[i] = 1, j->hits[i] += 1;
        }
}

static int count_bands(struct cpu_engine *b, enum sg_hit kind, struct hit_job *job)
{
    sg_ctx *ctx = b->base.ctx;
    for (int band = 0; band < b->bins.band_count; band++) {
        if (sg_bins_band(ctx, &b->bins, band))
            return SG_ERR_BUDGET;
        const size_t instances = b->bins.tile_start[band_tiles(b, band)];
        if (sg_grow(ctx, SG_MEM_INSTANCES, &b->slots, &b->cap_slots,
                    (instances + CPU_SLOT_FLOATS - 1) / CPU_SLOT_FLOATS, 0,
                    CPU_SLOT_FLOATS * sizeof(float)))
            return SG_ERR_BUDGET;
        struct raster_job raster = {.kernel = b->kernels->raster_count,
                                    .args = raster_args(b, band)};
        raster.args.hit = kind;
        sg_parallel_for(ctx, band_tiles(b, band), raster_tile, &raster);
        sg_parallel_for(ctx, pieces(b->model.count), hit_piece, job);
    }
    return SG_OK;
}

static int count_hits(struct sg_engine *base, const struct sg_camera *view,
                      const struct sg_render_params *params, enum sg_hit kind, double *hits)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    struct hit_job job = {.b = b, .hits = hits};
    if (kind == SG_HIT_VIEWS && !(job.seen = sg_alloc(base->ctx, SG_MEM_SPLATS, b->model.count, 1)))
        return SG_ERR_BUDGET;
    int code = do_project(base, view, 0, params);
    if (!code && !(code = do_bin(base)))
        code = count_bands(b, kind, &job);
    sg_free(job.seen);
    return code;
}

static int read_gradients(struct sg_engine *base, struct sg_model *out)
{
    const struct sg_host_model *h = &((struct cpu_engine *) base)->model;
    memcpy(out->params, h->at[SG_C_GRADIENT], out->capacity * (size_t) h->planes * sizeof(float));
    return SG_OK;
}

static int read_statistics(struct sg_engine *base, const struct sg_statistics *out)
{
    sg_host_statistics(base->ctx, &((struct cpu_engine *) base)->model, out);
    return SG_OK;
}

static int edit(struct sg_engine *base, const struct sg_edit *e)
{
    return sg_host_edit(base->ctx, &((struct cpu_engine *) base)->model, e);
}

static int floor_scale(struct sg_engine *base, float smallest)
{
    sg_host_floor_scale(&((struct cpu_engine *) base)->model, smallest);
    return SG_OK;
}

static int reset_opacity(struct sg_engine *base, float limit)
{
    sg_host_reset_opacity(&((struct cpu_engine *) base)->model, limit, base->shape);
    return SG_OK;
}

static int count_radii(struct sg_engine *base)
{
    struct cpu_engine *b = (struct cpu_engine *) base;
    return sg_host_count_radii(base->ctx, &b->model, &b->camera, b->params.mip_kernel);
}

static int relocate(struct sg_engine *base, const struct sg_relocation *r)
{
    sg_host_relocate(&((struct cpu_engine *) base)->model, r);
    return SG_OK;
}

static int filter(struct sg_engine *base, const struct sg_camera *const *cameras, size_t n,
                  const struct sg_mip_filter *how)
{
    return sg_host_filter(base->ctx, &((struct cpu_engine *) base)->model, cameras, n, how);
}

static int explore(struct sg_engine *base, const struct sg_exploration *x)
{
    sg_host_explore(base->ctx, &((struct cpu_engine *) base)->model, x);
    return SG_OK;
}

struct ascend_job {
    const struct cpu_kernels *kernels;
    const struct sg_ascend *args;
};

#define ASCEND_ROWS 16 /* a piece of work */

static void ascend_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct ascend_job *j = arg;
    const size_t first = piece * ASCEND_ROWS, all = 3 * (size_t) j->args->height;
    for (size_t r = first; r < first + ASCEND_ROWS && r < all; r++)
        j->kernels->ascend(j->args, r);
}

static int ascend(struct sg_engine *base, const struct sg_ascend *a)
{
    struct ascend_job job = {((struct cpu_engine *) base)->kernels, a};
    sg_parallel_for(base->ctx, (3 * (size_t) a->height + ASCEND_ROWS - 1) / ASCEND_ROWS,
                    ascend_piece, &job);
    return SG_OK;
}

static const struct sg_engine_ops ops = {
    .name = "cpu",
    .absolute = true,
    .exposure = true,
    .mip_kernel = true,
    .destroy = destroy,
    .variant = variant,
    .upload = upload,
    .adopt = adopt,
    .download = download,
    .host_model = host_model,
    .count = count,
    .read_statistics = read_statistics,
    .edit = edit,
    .floor_scale = floor_scale,
    .reset_opacity = reset_opacity,
    .count_radii = count_radii,
    .relocate = relocate,
    .explore = explore,
    .filter = filter,
    .project = do_project,
    .bin = do_bin,
    .raster = raster,
    .read_image = read_image,
    .loss = loss,
    .write_image_gradient = write_image_gradient,
    .raster_backward = raster_backward,
    .shape = shape,
    .shape_backward = shape_backward,
    .project_backward = project_backward,
    .optimise = optimise,
    .project_backward_optimise = project_backward_optimise,
    .read_gradients = read_gradients,
    .count_hits = count_hits,
    .ascend = ascend,
};

static int create(sg_ctx *ctx, const char *variant_name, struct sg_engine **out)
{
    const struct cpu_kernels *kernels;
    const int code = sg_cpu_select(ctx, variant_name, &kernels);
    if (code)
        return code;
    struct cpu_engine *b = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*b));
    if (!b)
        return SG_ERR_BUDGET;
    b->base = (struct sg_engine){.ops = &ops, .ctx = ctx};
    b->kernels = kernels;
    b->image_losses.fft = &kernels->fft;
    b->bins.band = -1;
    *out = &b->base;
    return SG_OK;
}

static int check(sg_ctx *ctx, const char *variant_name)
{
    const struct cpu_kernels *kernels;
    return sg_cpu_select(ctx, variant_name, &kernels);
}

static int variants(const char *out[SG_ENGINE_VARIANTS])
{
    const struct cpu_kernels *kernels[SG_ENGINE_VARIANTS];
    const int n = sg_cpu_variants(kernels);
    for (int i = 0; i < n; i++)
        out[i] = kernels[i]->name;
    return n;
}

/* sg_grow may hold half as much again as it needs. */
#define GROWN(bytes) ((bytes) + (bytes) / 2)
#define SLOT_BYTES (CPU_SLOT_FLOATS * sizeof(float))

static struct sg_footprint footprint(const struct sg_work *w)
{
    const uint64_t width = (uint64_t) w->width, pixels = width * (uint64_t) w->height;
    const uint64_t projection = sizeof(struct cpu_splat) + sizeof(struct cpu_extent) +
                                sizeof(uint32_t) + 2 * sizeof(struct bin_entry) +
                                SLOT_BYTES; /* slot: of the bands' sums */
    const uint64_t instance = sizeof(struct cpu_instance) + sizeof(uint16_t) + SLOT_BYTES;
    const uint64_t pixel = 5 * 3 * sizeof(float) +
                           2 * sizeof(float) /* image, gradient, spectra; alpha, depth */
                           + (w->exposure ? GROWN(3 * sizeof(float)) : 0) +
                           (w->low_pass ? GROWN(SG_HOST_LOW_PASS_PIXEL) : 0);
    /* Rows of the loss and of the transforms; slack. */
    const uint64_t column =
        sizeof(float) * (CPU_LOSS_SCRATCH_ROWS + (w->anisotropy ? 2 * SG_FFT_POINT : 0)) + 128;
    return (struct sg_footprint){.gaussian = sg_host_footprint(w, false) + GROWN(projection),
                                 .instance = GROWN(instance),
                                 .view = pixels * pixel + (uint64_t) w->threads * width * column};
}

const struct sg_engine_kind sg_engine_cpu = {
    .name = "cpu",
    .create = create,
    .check = check,
    .variants = variants,
    .footprint = footprint,
    .describe = sg_cpu_describe,
};
