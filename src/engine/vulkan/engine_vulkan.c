/* SPDX-License-Identifier: Apache-2.0 */
/* The Vulkan engine: records the kernels of each stage, a few iterations ahead of the device. Every
 * sum is taken in a fixed order, so that one device and driver always give the same bytes. */
#include <string.h>

#include "engine.h"
#include "math/real_f32.h"

#include "math/projection.h"

static void destroy(struct sg_engine *base)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    struct gpu_buffer *owned[] = {
        &e->view,      &e->splats,    &e->image,          &e->alpha,       &e->depth,
        &e->units,     &e->reached,   &e->checkpoints,    &e->gradient,    &e->slots,
        &e->band_sums, &e->given,     &e->target,         &e->maps,        &e->sums,
        &e->exposed,   &e->exposures, &e->given_exposure, &e->flow.arrived};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        sg_gpu_release(g, owned[i]);
    for (int c = 0; c < SG_COLUMNS; c++)
        sg_gpu_release(g, &e->at[c]);
    for (size_t i = 0; i < e->cap_photos; i++)
        sg_gpu_release(g, &e->photos[i]);
    for (int i = 0; i < GPU_FLIGHTS; i++) {
        sg_gpu_release(g, &e->passing[i].seen);
        sg_gpu_release(g, &e->passing[i].photo);
    }
    sg_free(e->photos);
    sg_vulkan_anchors_clear(e);
    sg_vulkan_spectrum_clear(e);
    sg_gpu_lists_clear(g, &e->lists);
    sg_log(base->ctx, SG_LOG_DEBUG,
           "vulkan: at most %llu bytes on the device, %llu dispatches in %llu submissions",
           (unsigned long long) sg_vram_peak(base->ctx, SG_MEM_TAGS),
           (unsigned long long) g->dispatches, (unsigned long long) g->submissions);
    sg_gpu_close(&e->gpu);
    sg_free(e);
}

static const char *variant(const struct sg_engine *base)
{
    return ((const struct vulkan_engine *) base)->gpu->chosen.info.name;
}

static size_t count(const struct sg_engine *base)
{
    return ((const struct vulkan_engine *) base)->count;
}

/* ---- a view ---- */

int sg_vulkan_project(struct vulkan_engine *e, const struct sg_camera *camera, int sh_degree,
                      const struct sg_render_params *params)
{
    struct gpu *g = e->gpu;
    const struct pinhole view = view_make_mip(camera, params->mip_kernel);
    _Static_assert(sizeof(view) == VK_VIEW * sizeof(float), "as view_load reads it");
    const uint64_t values = 3 * (uint64_t) camera->width * (uint64_t) camera->height;
    e->camera = *camera;
    e->params = *params;
    e->degree = sh_degree;
    e->width = (uint32_t) camera->width, e->height = (uint32_t) camera->height;
    e->terms = (struct vulkan_terms){.width = e->width, .height = e->height};
    int code;
    if ((code = sg_gpu_reserve(g, SG_MEM_MISC, &e->view, 4 * (VK_VIEW + VK_STEP))) ||
        (code =
             sg_gpu_reserve(g, SG_MEM_SPLATS, &e->splats, (4 * VK_SPLAT) * (uint64_t) e->count)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->image, 4 * values)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->gradient, 4 * values)) ||
        (code = sg_gpu_lists_begin(g, &e->lists, e->count, camera->width, camera->height,
                                   params->reference_tiles)) ||
        (code = sg_gpu_update(g, &e->view, 0, &view, sizeof(view))))
        return code;
    const int shown = e->at[SG_C_SHAPED].buffer ? SG_C_SHAPED : SG_C_PARAMETERS;
    return GPU_RUN(g, project, sh_degree, FOR_EACH(e->count), .params = e->at[shown].address,
                   .view = e->view.address, .splats = e->splats.address,
                   .rects = e->lists.rects.address, .keys = e->lists.keys.address,
                   .flags = e->lists.flags.address, .results = e->lists.results.address,
                   .count = (uint32_t) e->count, .planes = (uint32_t) e->planes,
                   .grid_x = e->lists.grid_x, .grid_y = e->lists.grid_y);
}

/* Bytes of an instance: keys and values twice, its two lists and slot; its shares of a unit with
 * its checkpoints, rounded up, and of the counters of digits. */
#define INSTANCE_BYTES                                                                             \
    (4 * (2 + 2 + 2 + 2 + VK_SLOT_ABSOLUTE) + (16 * 256 + 4 * VK_UNIT + VK_CHUNK - 1) / VK_CHUNK + \
     4 * VK_DIGITS / VK_SORT)

_Static_assert(VK_CHUNK % VK_BATCH == 0, "a unit has whole batches");

int sg_vulkan_bin(struct vulkan_engine *e)
{
    struct gpu_lists *l = &e->lists;
    l->known |= e->flow.again;
    const int code = sg_gpu_lists_make(e->gpu, l, &e->splats, e->params.max_instances,
                                       INSTANCE_BYTES, &e->terms.longest);
    e->terms.bands = (uint32_t) l->band_count;
    return code || l->band_count > 1 ? code : sg_gpu_lists_band(e->gpu, l, 0);
}

/* Room for what goes with the instances of a band. */
static int reserve_instances(struct vulkan_engine *e, struct gpu_buffer *b, uint64_t bytes)
{
    const int code = sg_gpu_reserve(e->gpu, SG_MEM_INSTANCES, b, bytes);
    e->lists.starved |= code < 0;
    return code;
}

/* Draws the present band. results: where its pairs are counted. */
static int raster_band(struct vulkan_engine *e, bool auxiliary, VkDeviceAddress results)
{
    struct gpu *g = e->gpu;
    const struct gpu_lists *l = &e->lists;
    const struct gpu_band *band = &l->bands[l->band];
    const uint32_t tiles = band->end - band->first;
    int code;
    if ((code = reserve_instances(e, &e->units, 4 * VK_UNIT * sg_gpu_lists_units(l))) ||
        (code = reserve_instances(e, &e->reached, 4 * (uint64_t) tiles)) ||
        (code = reserve_instances(e, &e->checkpoints, 16 * 256 * sg_gpu_lists_units(l))))
        return code;
    return GPU_RUN_WORK(
        g, raster, 0, &l->work, VK_WORK_TILES, .splats = e->splats.address,
        .instances = l->instances.address, .tile_start = l->tile_start.address,
        .chunk_start = l->chunk_start.address, .units = e->units.address,
        .reached = e->reached.address, .checkpoints = e->checkpoints.address,
        .image = e->image.address, .alpha = sg_gpu_at(g, &e->alpha),
        .depth = sg_gpu_at(g, &e->depth), .results = results, .first_tile = band->first,
        .tiles = tiles, .grid_x = l->grid_x, .width = e->width, .height = e->height,
        .auxiliary = auxiliary, .background_r = e->params.background[0],
        .background_g = e->params.background[1], .background_b = e->params.background[2]);
}

int sg_vulkan_raster(struct vulkan_engine *e, bool auxiliary)
{
    const uint64_t bytes = 4 * (uint64_t) e->width * e->height;
    int code = SG_OK;
    if (auxiliary && ((code = sg_gpu_reserve(e->gpu, SG_MEM_FRAME, &e->alpha, bytes)) ||
                      (code = sg_gpu_reserve(e->gpu, SG_MEM_FRAME, &e->depth, bytes))))
        return code;
    for (int band = 0; band < e->lists.band_count && !code; band++)
        if (!(code = sg_gpu_lists_band(e->gpu, &e->lists, band)))
            code = raster_band(e, auxiliary, e->lists.results.address);
    return code;
}

static int read_image(struct sg_engine *base, float *rgb, float *alpha, float *depth)
{
    struct vulkan_engine *e = vulkan_of(base);
    const uint64_t bytes = 4 * (uint64_t) e->width * e->height;
    int code = sg_gpu_read(e->gpu, &e->image, 0, rgb, 3 * bytes);
    if (alpha && !code)
        code = sg_gpu_read(e->gpu, &e->alpha, 0, alpha, bytes);
    if (depth && !code)
        code = sg_gpu_read(e->gpu, &e->depth, 0, depth, bytes);
    return code;
}

static int write_image_gradient(struct sg_engine *base, const float *gradient)
{
    struct vulkan_engine *e = vulkan_of(base);
    return sg_gpu_write(e->gpu, &e->gradient, 0, gradient, 12 * (uint64_t) e->width * e->height);
}

/* Adds the slots of the present band, of `width` floats, to sums by Gaussian. */
static int add_slots(struct vulkan_engine *e, const struct gpu_buffer *sums, uint32_t width)
{
    return GPU_RUN_WORK(e->gpu, slots_add, 0, &e->lists.work, VK_WORK_MODEL,
                        .slots = e->slots.address, .slot_start = e->lists.slot_start.address,
                        .sums = sums->address, .count = (uint32_t) e->count, .width = width);
}

/* Room for sums of `width` floats by Gaussian, zeroed. */
static int begin_sums(struct vulkan_engine *e, uint32_t width)
{
    const uint64_t bytes = 4 * (uint64_t) width * e->count;
    const int code = sg_gpu_reserve(e->gpu, SG_MEM_SPLATS, &e->band_sums, bytes);
    return code ? code : sg_gpu_fill(e->gpu, &e->band_sums, 0, bytes, 0);
}

int sg_vulkan_raster_backward(struct vulkan_engine *e)
{
    struct gpu *g = e->gpu;
    struct gpu_lists *l = &e->lists;
    const bool banded = l->band_count > 1, absolute = e->base.statistic != SG_GRADIENT_NORM;
    const uint32_t width = absolute ? VK_SLOT_ABSOLUTE : VK_SLOT;
    int code = banded ? begin_sums(e, width) : SG_OK;
    for (int band = 0; band < l->band_count && !code; band++) {
        const struct gpu_band *b = &l->bands[band];
        code = sg_gpu_lists_band(g, l, band);
        if (!code)
            code = reserve_instances(e, &e->slots, 4 * width * l->capacity);
        if (!code && banded) /* its states are not at hand any more: draw it again, uncounted */
            code = raster_band(e, false, g->none.address);
        if (!code)
            code = GPU_RUN_WORK(
                g, raster_backward, absolute, &l->work, VK_WORK_UNITS, .splats = e->splats.address,
                .instances = l->instances.address, .tile_start = l->tile_start.address,
                .chunk_start = l->chunk_start.address, .units = e->units.address,
                .reached = e->reached.address, .checkpoints = e->checkpoints.address,
                .image = e->image.address, .gradient = e->gradient.address,
                .slots = e->slots.address, .first_tile = b->first, .tiles = b->end - b->first,
                .grid_x = l->grid_x, .width = e->width, .height = e->height);
        if (!code && banded)
            code = add_slots(e, &e->band_sums, width);
    }
    return code;
}

/* ---- learning ---- */

static int learn(struct vulkan_engine *e, const struct sg_update *u, uint32_t what)
{
    struct gpu *g = e->gpu;
    const bool banded = e->lists.band_count > 1;
    const enum sg_gradient_statistic statistic = e->base.statistic;
    float step[VK_STEP];
    _Static_assert(2 * SG_GROUPS + 2 == VK_STEP, "rates, roots, two weights");
    int code;
    what |= (banded ? VK_LEARN_BANDED : 0) |
            (statistic != SG_GRADIENT_NORM ? VK_LEARN_ABSOLUTE : 0) |
            (statistic == SG_GRADIENT_MIP ? VK_LEARN_BESIDE : 0);
    if ((what & VK_LEARN_ADAM && (code = sg_vulkan_alloc_saved(e))) ||
        (what & VK_LEARN_STATISTICS && ((code = sg_vulkan_alloc(e, SG_C_GRAD_SUM)) ||
                                        (code = sg_vulkan_alloc(e, SG_C_GRAD_COUNT)))) ||
        (what & VK_LEARN_ACCUMULATE && (code = sg_vulkan_alloc(e, SG_C_ACCUMULATED))) ||
        (what & VK_LEARN_BESIDE && (code = sg_vulkan_alloc(e, SG_C_GRAD_ABSOLUTE))))
        return code;
    memcpy(step, u->rate, sizeof(u->rate));
    memcpy(step + SG_GROUPS, u->root, sizeof(u->root));
    step[2 * SG_GROUPS] = u->mean_opacity, step[2 * SG_GROUPS + 1] = u->mean_scale;
    const int shown = e->at[SG_C_SHAPED].buffer ? SG_C_SHAPED : SG_C_PARAMETERS;
    code = sg_gpu_update(g, &e->view, sizeof(struct pinhole), step, sizeof(step));
    return code ? code
                : GPU_RUN_WORK(
                      g, learn, e->degree, &e->lists.work, VK_WORK_MODEL,
                      .shaped = e->at[shown].address, .params = e->at[SG_C_PARAMETERS].address,
                      .m = sg_gpu_at(g, &e->at[SG_C_MOMENT1]),
                      .v = sg_gpu_at(g, &e->at[SG_C_MOMENT2]),
                      .grad_sum = sg_gpu_at(g, &e->at[SG_C_GRAD_SUM]),
                      .grad_count = sg_gpu_at(g, &e->at[SG_C_GRAD_COUNT]),
                      .grad_absolute = sg_gpu_at(g, &e->at[SG_C_GRAD_ABSOLUTE]),
                      .gradients = sg_gpu_at(g, &e->at[SG_C_GRADIENT]),
                      .accumulated = sg_gpu_at(g, &e->at[SG_C_ACCUMULATED]),
                      .splats = e->splats.address, .rects = e->lists.rects.address,
                      .slots = sg_gpu_at(g, banded ? &e->band_sums : &e->slots),
                      .slot_start = sg_gpu_at(g, &e->lists.slot_start), .view = e->view.address,
                      .count = (uint32_t) e->count, .planes = (uint32_t) e->planes, .what = what);
}

int sg_vulkan_project_backward(struct vulkan_engine *e, bool statistics)
{
    int code = sg_vulkan_alloc(e, SG_C_GRADIENT);
    if (!code)
        code = sg_gpu_fill(e->gpu, &e->at[SG_C_GRADIENT], 0,
                           sg_vulkan_column_bytes(e, SG_C_GRADIENT), 0);
    return code ? code
                : learn(e, &(struct sg_update){0},
                        VK_LEARN_PULL | VK_LEARN_STORE | (statistics ? VK_LEARN_STATISTICS : 0));
}

static uint32_t bits_of(const struct sg_update *u)
{
    return (u->adam ? VK_LEARN_ADAM : 0) | (u->accumulate ? VK_LEARN_ACCUMULATE : 0);
}

int sg_vulkan_optimise(struct vulkan_engine *e, const struct sg_update *u)
{
    return bits_of(u) ? learn(e, u, bits_of(u)) : SG_OK;
}

int sg_vulkan_backward_optimise(struct vulkan_engine *e, const struct sg_update *u)
{
    const uint32_t what = bits_of(u) | (u->statistics ? VK_LEARN_STATISTICS : 0);
    return what ? learn(e, u, VK_LEARN_PULL | what) : SG_OK;
}

static int read_gradients(struct sg_engine *base, struct sg_model *out)
{
    struct vulkan_engine *e = vulkan_of(base);
    return sg_gpu_read(e->gpu, &e->at[SG_C_GRADIENT], 0, out->params,
                       sg_vulkan_column_bytes(e, SG_C_GRADIENT));
}

void sg_vulkan_read_results(const struct vulkan_terms *t, const uint32_t r[VK_RESULTS],
                            struct sg_step *step)
{
    step->stats.visible = r[VK_RESULT_VISIBLE];
    step->stats.instances = r[VK_RESULT_INSTANCES] | (uint64_t) r[VK_RESULT_INSTANCES + 1] << 32;
    step->stats.pairs = r[VK_RESULT_PAIRS] | (uint64_t) r[VK_RESULT_PAIRS + 1] << 32;
    step->stats.bands = t->bands;
    step->stats.max_tile = t->bands > 1 ? t->longest : r[VK_RESULT_LONGEST];
    sg_vulkan_read_losses(t, r, step);
}

static int read_step(struct sg_engine *base)
{
    struct vulkan_engine *e = vulkan_of(base);
    uint32_t r[VK_RESULTS];
    if (!e->lists.results.buffer)
        return SG_OK; /* no view yet */
    const int code = sg_gpu_read(e->gpu, &e->lists.results, 0, r, sizeof(r));
    if (!code)
        sg_vulkan_read_results(&e->terms, r, &base->step);
    return code;
}

static bool read_arrived(struct sg_engine *base, uint64_t number, struct sg_step *out)
{
    return sg_flow_arrived(vulkan_of(base), number, out);
}

static int read_most(struct sg_engine *base, uint64_t *out)
{
    struct vulkan_engine *e = vulkan_of(base);
    uint32_t words[2] = {0, 0};
    const int code =
        e->lists.most.buffer ? sg_gpu_read(e->gpu, &e->lists.most, 0, words, sizeof(words)) : SG_OK;
    *out = words[0] | (uint64_t) words[1] << 32;
    return code;
}

/* ---- hits ---- */

_Static_assert(VK_HIT_WEIGHT == (int) SG_HIT_WEIGHT &&
                   VK_HIT_TRANSMITTANCE == (int) SG_HIT_TRANSMITTANCE,
               "as shaders/args.h says");

/* What the hits of the drawn view are, one float a Gaussian, to the device's sums. */
static int count_view(struct vulkan_engine *e, enum sg_hit kind)
{
    struct gpu *g = e->gpu;
    struct gpu_lists *l = &e->lists;
    int code = begin_sums(e, 1);
    for (int band = 0; band < l->band_count && !code; band++) {
        const struct gpu_band *b = &l->bands[band];
        code = sg_gpu_lists_band(g, l, band);
        if (!code)
            code = reserve_instances(e, &e->slots, 4 * l->capacity);
        if (!code)
            code = GPU_RUN_WORK(g, raster_count, 0, &l->work, VK_WORK_TILES,
                                .splats = e->splats.address, .instances = l->instances.address,
                                .tile_start = l->tile_start.address, .slots = e->slots.address,
                                .first_tile = b->first, .tiles = b->end - b->first,
                                .grid_x = l->grid_x, .width = e->width, .height = e->height,
                                .hit = (uint32_t) kind);
        if (!code)
            code = add_slots(e, &e->band_sums, 1);
    }
    return code;
}

static void clock_of(struct sg_engine *base, double *sum)
{
    sg_gpu_clock(vulkan_of(base)->gpu, sum);
}

static int count_hits(struct sg_engine *base, const struct sg_camera *view,
                      const struct sg_render_params *params, enum sg_hit kind, double *hits)
{
    struct vulkan_engine *e = vulkan_of(base);
    float *of_view = sg_alloc_raw(base->ctx, SG_MEM_SPLATS, e->count, sizeof(*of_view));
    int code = of_view || !e->count ? SG_OK : SG_ERR_BUDGET, tried = SG_OK;
    for (int times = 0; times < 2 && !code; times++) {
        if (!(tried = sg_vulkan_project(e, view, 0, params)) && !(tried = sg_vulkan_bin(e)) &&
            !(tried = count_view(e, kind)))
            tried = sg_gpu_read(e->gpu, &e->band_sums, 0, of_view, 4 * (uint64_t) e->count);
        if (tried != GPU_STOPPED)
            break;
        e->lists.known = true;
        code = sg_gpu_go_on(e->gpu);
    }
    code = code ? code : tried;
    for (size_t i = 0; i < e->count && !code; i++)
        hits[i] += kind != SG_HIT_VIEWS ? (double) of_view[i] : of_view[i] > 0;
    sg_free(of_view);
    return code;
}

/* ---- the stages, as callers run them ---- */

#define RUN(base, ...) sg_flow_run(vulkan_of(base), &(struct vulkan_call){__VA_ARGS__})

static int run_shape(struct sg_engine *base, const struct sg_shape *shape)
{
    return RUN(base, .stage = STAGE_SHAPE, .shape = shape);
}

static int run_project(struct sg_engine *base, const struct sg_camera *camera, int sh_degree,
                       const struct sg_render_params *params)
{
    return RUN(base, .stage = STAGE_PROJECT, .project = {*camera, sh_degree, *params});
}

static int run_bin(struct sg_engine *base)
{
    return RUN(base, .stage = STAGE_BIN);
}

static int run_raster(struct sg_engine *base, bool auxiliary)
{
    return RUN(base, .stage = STAGE_RASTER, .flag = auxiliary);
}

static int run_loss(struct sg_engine *base, const struct sg_target_pixels *t,
                    const struct sg_loss *l)
{
    struct vulkan_call call = {.stage = STAGE_LOSS, .loss = {.target = *t, .loss = *l}};
    struct vulkan_engine *e = vulkan_of(base);
    if (t->exposure) /* the caller's, which may move on */
        memcpy(call.loss.exposure, t->exposure, sizeof(call.loss.exposure));
    if (t->photo && t->photo == e->passed)
        call.loss.target.photo = VK_PASSING + e->turn;
    return sg_flow_run(e, &call);
}

static int run_ascend_view(struct sg_engine *base, const struct sg_view_ascent *a)
{
    return RUN(base, .stage = STAGE_ASCEND_VIEW, .ascent = *a);
}

static int run_learn_exposures(struct sg_engine *base, size_t number,
                               const struct sg_exposure_update *u)
{
    return RUN(base, .stage = STAGE_LEARN_EXPOSURES, .exposures = {number, *u});
}

static int run_count_radii(struct sg_engine *base)
{
    return RUN(base, .stage = STAGE_COUNT_RADII);
}

static int run_raster_backward(struct sg_engine *base)
{
    return RUN(base, .stage = STAGE_RASTER_BACKWARD);
}

static int run_project_backward(struct sg_engine *base, bool statistics)
{
    return RUN(base, .stage = STAGE_PROJECT_BACKWARD, .flag = statistics);
}

static int run_shape_backward(struct sg_engine *base, const struct sg_shape *shape)
{
    return RUN(base, .stage = STAGE_SHAPE_BACKWARD, .shape = shape);
}

static int run_optimise(struct sg_engine *base, const struct sg_update *u)
{
    return RUN(base, .stage = STAGE_OPTIMISE, .update = *u);
}

static int run_backward_optimise(struct sg_engine *base, const struct sg_update *u)
{
    return RUN(base, .stage = STAGE_BACKWARD_OPTIMISE, .update = *u);
}

static int run_explore(struct sg_engine *base, const struct sg_exploration *x)
{
    return RUN(base, .stage = STAGE_EXPLORE, .explore = *x);
}

static const struct sg_engine_ops ops = {
    .name = "vulkan",
    .absolute = true,
    .exposure = true,
    .mip_kernel = true,
    .destroy = destroy,
    .variant = variant,
    .upload = sg_vulkan_upload,
    .download = sg_vulkan_download,
    .count = count,
    .read_statistics = sg_vulkan_read_statistics,
    .edit = sg_vulkan_edit,
    .floor_scale = sg_vulkan_floor_scale,
    .reset_opacity = sg_vulkan_reset_opacity,
    .relocate = sg_vulkan_relocate,
    .explore = run_explore,
    .count_radii = run_count_radii,
    .filter = sg_vulkan_filter,
    .photo_add = sg_vulkan_photo_add,
    .photo_drop = sg_vulkan_photo_drop,
    .photo_pass = sg_vulkan_photo_pass,
    .set_exposures = sg_vulkan_set_exposures,
    .read_exposures = sg_vulkan_read_exposures,
    .learn_exposures = run_learn_exposures,
    .shape = run_shape,
    .shape_backward = run_shape_backward,
    .project = run_project,
    .bin = run_bin,
    .raster = run_raster,
    .read_image = read_image,
    .loss = run_loss,
    .ascend_view = run_ascend_view,
    .write_image_gradient = write_image_gradient,
    .raster_backward = run_raster_backward,
    .project_backward = run_project_backward,
    .optimise = run_optimise,
    .project_backward_optimise = run_backward_optimise,
    .read_gradients = read_gradients,
    .finish = sg_flow_finish,
    .read_step = read_step,
    .read_arrived = read_arrived,
    .read_most = read_most,
    .count_hits = count_hits,
    .ascend = sg_vulkan_ascend,
    .ascends_spectrum = true,
    .anchors = &sg_vulkan_anchors,
};

static int create(sg_ctx *ctx, const char *selector, struct sg_engine **out)
{
    struct vulkan_engine *e = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*e));
    if (!e)
        return SG_ERR_BUDGET;
    const int code = sg_gpu_open(ctx, selector, &e->gpu);
    if (code) {
        sg_free(e);
        return code;
    }
    e->base = (struct sg_engine){
        .ops = &ops, .ctx = ctx, .clock = e->gpu->flights[0].timestamps ? clock_of : NULL};
    if (!e->base.clock)
        sg_log(ctx, SG_LOG_INFO, "vulkan: %s has no timestamps: times of stages are the host's",
               e->gpu->chosen.info.name);
    e->lists.band = -1;
    sg_log(ctx, SG_LOG_DEBUG, "vulkan: %s, driver %s, %u invocations a block of pixels",
           e->gpu->chosen.info.name, e->gpu->chosen.info.driver, e->gpu->lanes);
    *out = &e->base;
    return SG_OK;
}

static int check(sg_ctx *ctx, const char *selector)
{
    struct vk_functions vk;
    struct vk_device_choice devices[VK_DEVICES];
    const struct vk_device_choice *chosen;
    const char *missing = sg_vk_open(&vk);
    if (missing)
        return sg_fail(ctx, SG_ERR_USAGE, "vulkan: this machine lacks %s", missing);
    return sg_vk_choose_device(ctx, devices, sg_vk_devices(&vk, devices), selector, &chosen);
}

/* Of the host. The model is there once, while a run is resumed; a checkpoint copies one array, and
 * an edit less than a model has, after that. */
static struct sg_footprint footprint(const struct sg_work *w)
{
    const uint64_t pixels = (uint64_t) w->width * (uint64_t) w->height;
    const unsigned held = SG_COLUMN_SAVED | (w->mip ? SG_COLUMN_MIP : 0);
    uint64_t gaussian = 0;
    for (int c = 0; c < SG_COLUMNS; c++)
        if (sg_column_has_array(c) && sg_column_of(c, held))
            gaussian += 4 * (uint64_t) sg_column_array_planes(c, w->sh_degree);
    return (struct sg_footprint){.gaussian = gaussian,
                                 .view = pixels * (5 * 3 * sizeof(float) + 4)};
}

/* A Gaussian's columns, what a view keeps of it, its sums over bands, and what edits read or make;
 * instances; images, their gradients and targets, the maps of SSIM, alpha and depth, spectra. */
static struct sg_footprint on_device(const struct sg_work *work)
{
    const struct sg_work drawn = sg_work_drawn(work), *w = &drawn;
    const uint64_t pixels = (uint64_t) w->width * (uint64_t) w->height,
                   tiles =
                       gpu_groups((uint64_t) w->width, 16) * gpu_groups((uint64_t) w->height, 16);
    const uint64_t parameters =
        4 * (uint64_t) sg_column_array_planes(SG_C_PARAMETERS, w->sh_degree);
    const uint64_t exposure = w->exposure ? 4 * SG_EXPOSURE_FLOATS : 0;
    const struct sg_footprint f = {
        .gaussian = sg_host_footprint(w, false) + 4 * (27 + VK_SLOT_ABSOLUTE + SG_P_SH) + 1,
        .instance = INSTANCE_BYTES,
        .largest = parameters > (4 * VK_SPLAT) ? parameters : (4 * VK_SPLAT),
        .most = sg_vulkan_most(sg_param_count(w->sh_degree)),
        .map = pixels * VK_MAPS_BYTES,
        .view = pixels * 4 * (9 * 3 + 2) + tiles * (16 * 256 + 64 + 4 * VK_UNIT) +
                (w->anisotropy ? sg_vulkan_spectrum_bytes((uint64_t) w->width, (uint64_t) w->height)
                               : 0),
        .photo = 4 * pixels + exposure,
        .passing = GPU_FLIGHTS * 2 * 4 * pixels + exposure};
    return work->anchors ? sg_vulkan_anchors_footprint(work, f) : f;
}

const struct sg_engine_kind sg_engine_vulkan = {
    .name = "vulkan",
    .devices = true,
    .create = create,
    .check = check,
    .footprint = footprint,
    .on_device = on_device,
    .may_run = sg_vulkan_may_have_gpu,
    .describe = sg_vulkan_describe,
};
