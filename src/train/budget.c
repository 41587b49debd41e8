/* SPDX-License-Identifier: Apache-2.0 */
#include "budget.h"

#include "core/vram.h"
#include "engine/engine.h"
#include "engine/registry.h"
#include "scene/photo.h"
#include "schedule.h"
#include "splatguard/model.h"

/* Bytes that training needs beside the engine: of a Gaussian while it is scored (statistics,
 * scores, order); of a pixel of renders and photos that are measured; of tables that do not grow
 * with the input. */
#define PLAN_BYTES (3 * 4 + 1 + 2 * (1 + 4) + 3 * 8 + 2 * 4 + 8)
#define PIXEL_BYTES (3 * 12 + 8)
#define FIXED_BYTES (8 << 20)
#define LISTED 2   /* instances a Gaussian to hold at once */
#define LEAST 1000 /* the fewest Gaussians of a model */

/* Bytes of the buffers for the most demanding view. */
static uint64_t largest_view(const struct sg_engine_kind *engine, struct sg_work work,
                             const struct sg_view *views, size_t n, uint64_t most)
{
    for (size_t i = 0; i < n; i++) {
        work.width = views[i].camera.width, work.height = views[i].camera.height;
        const uint64_t bytes = sg_engine_footprint(engine, &work).view +
                               (uint64_t) work.width * (uint64_t) work.height * PIXEL_BYTES;
        most = bytes > most ? bytes : most;
    }
    return most;
}

static uint64_t lesser(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* The least that photos take while they are used: all of them, or one at a time. */
static uint64_t least_photos(const struct sg_photo_bytes *p)
{
    return p->dropped || p->total > p->most ? p->read : lesser(p->total, p->read);
}

/* Divides `room` bytes between photos and Gaussians. These need at least `least` and at most
 * `wanted`. Returns what the photos take, including one that is being read. */
static uint64_t divide(const struct sg_photo_bytes *p, uint64_t room, uint64_t least,
                       uint64_t wanted, struct sg_budget *out)
{
    const uint64_t rest = room - lesser(wanted, room);
    uint64_t share = lesser(room / 2, room - least);
    share = share > rest ? share : rest;
    share = share > p->read ? share : p->read; /* as soon as one photo does not stay */
    const uint64_t all = p->total + (p->dropped ? p->read : 0);
    out->photos_stay = all <= share && p->total <= p->most;
    if (out->photos_stay) {
        out->photos = p->total;
        return all;
    }
    const uint64_t kept = lesser(share - p->read, p->most);
    out->read_ahead = p->largest && p->largest <= kept;
    out->photos = kept - (out->read_ahead ? p->largest : 0);
    return kept + p->read;
}

static struct sg_work work_of(sg_ctx *ctx, const struct sg_train_params *p, int sh_degree,
                              bool accumulate)
{
    return (struct sg_work){.sh_degree = sh_degree,
                            .accumulate = accumulate,
                            .anisotropy = p->defense.on,
                            .exposure = p->exposure,
                            .mip = p->model == SG_MODEL_MIP,
                            .anchors = p->model == SG_MODEL_SCAFFOLD,
                            .radii = sg_counts_radii(p),
                            .grace = sg_spares_anchors(p),
                            .low_pass =
                                (p->tolerance > 0 || p->tolerances) && p->tolerance_low_pass > 0,
                            .threads = sg_ctx_threads(ctx),
                            .width = 1,
                            .height = 1};
}

/* Smoothed photos (see tolerance_smooth) take the place of those that can be read again, one after
 * the other, and are held beside the others. */
static uint64_t smoothed_bytes(const struct sg_scene *scene, const struct sg_train_params *p)
{
    uint64_t largest = 0, beside = 0;
    for (size_t i = 0; i < scene->n_train && p->tolerances && p->tolerance_smooth < 1; i++) {
        const struct sg_camera *c = &scene->train[i].camera;
        const uint64_t n = sg_mem_cost(3 * (size_t) c->width * (size_t) c->height);
        if (scene->train[i].lazy)
            largest = n > largest ? n : largest;
        else if (p->tolerances[i] > 0)
            beside += n;
    }
    return largest + beside;
}

/* Memory has room for so many Gaussians. */
static void lower(sg_ctx *ctx, struct sg_budget *limits, uint64_t gaussians)
{
    if (limits->overshoots && gaussians / 2 < limits->gaussians) {
        sg_log(
            ctx, SG_LOG_WARN,
            "memory has room for %llu Gaussians, expected twice --max-gaussians, %llu, which the "
            "universal threshold can reach: growth stops as with --at-limit stop",
            (unsigned long long) gaussians, 2 * (unsigned long long) limits->gaussians);
        limits->overshoots = false;
    }
    if (!limits->gaussians || gaussians < limits->gaussians)
        limits->by_memory = true, limits->gaussians = gaussians;
}

int sg_budget_plan(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_train_params *p,
                   int sh_degree, uint64_t leaving, bool accumulate, struct sg_budget *out)
{
    const struct sg_photo_bytes photos = sg_lazy_photos_bytes(scene->lazy);
    /* The universal threshold stops growth only once it is met, where memory has room for that. */
    *out = (struct sg_budget){.gaussians = p->max_gaussians,
                              .overshoots = sg_counts_radii(p),
                              .instances = p->max_instances,
                              .photos = photos.most,
                              .photos_stay = photos.total <= photos.most};
    const uint64_t limit = sg_mem_limit(ctx), held = sg_mem_current(ctx, SG_MEM_TAGS) - photos.held;
    if (!limit)
        return SG_OK;
    const struct sg_engine_kind *engine = sg_engine_find(ctx, p->engine, p->cpu);
    if (!engine)
        return SG_ERR_USAGE;
    const struct sg_work work = work_of(ctx, p, sh_degree, accumulate);
    const struct sg_footprint need = sg_engine_footprint(engine, &work);
    const uint64_t view = largest_view(engine, work, scene->test, scene->n_test,
                                       largest_view(engine, work, scene->train, scene->n_train, 0));
    const uint64_t each = need.gaussian + PLAN_BYTES + LISTED * need.instance +
                          (work.mip ? 2 * sizeof(float) : 0); /* a second statistic, sorted */
    const uint64_t fixed = (held > leaving ? held - leaving : 0) + view + FIXED_BYTES +
                           smoothed_bytes(scene, p),
                   least = LEAST * each, expected = fixed + least_photos(&photos) + least;
    if (limit < expected)
        return sg_fail(
            ctx, SG_ERR_BUDGET,
            "%s: memory: found a limit of %llu bytes, expected at least %llu: photos and tables "
            "are %llu, the buffers of the largest view %llu, and %d Gaussians %llu",
            scene->path, (unsigned long long) limit, (unsigned long long) expected,
            (unsigned long long) (expected - least - view), (unsigned long long) view, LEAST,
            (unsigned long long) least);
    const uint64_t most = p->max_gaussians * (out->overshoots ? 2 : 1), room = limit - fixed,
                   wanted = most && most < room / each ? most * each : room;
    const uint64_t free = room - divide(&photos, room, least, wanted, out);
    const uint64_t fit = free / each;
    lower(ctx, out, fit);
    const uint64_t left = free - sg_budget_most(out) * (each - LISTED * need.instance);
    const uint64_t lists = need.instance ? left / need.instance : p->max_instances;
    out->instances = lists < p->max_instances ? lists : p->max_instances;
    sg_log(
        ctx, SG_LOG_DEBUG,
        "memory: limit %llu bytes, %llu for photos, tables and the largest view, %llu a Gaussian: "
        "at most %llu Gaussians and %llu instances at once",
        (unsigned long long) limit, (unsigned long long) (limit - free), (unsigned long long) each,
        (unsigned long long) out->gaussians, (unsigned long long) out->instances);
    if (!out->photos_stay)
        sg_log(ctx, SG_LOG_WARN,
               "%s: memory: %llu of the %llu bytes of the photos stay in memory; the other photos "
               "are read again whenever they are used%s",
               scene->path, (unsigned long long) out->photos, (unsigned long long) photos.total,
               out->read_ahead ? ", each during the iteration before" : "");
    return SG_OK;
}

/* Of a device, beside those of photos: the buffers of an engine, and of others that share it. */
#define OTHER_ALLOCATIONS 1024

/* What views need on a device, in bytes. */
struct device_views {
    uint64_t held, lazy; /* all photos: those that stay, and those that may come and go */
    uint64_t passing;    /* room for the largest of the latter */
    uint64_t photos;     /* of both kinds */
    uint64_t buffers;    /* of the most demanding view */
    uint64_t map;        /* the largest of its buffers */
};

static void add_views(struct device_views *v, const struct sg_engine_kind *engine,
                      struct sg_work work, const struct sg_view *views, size_t n, bool trained)
{
    for (size_t i = 0; i < n; i++) {
        struct sg_footprint f;
        work.width = views[i].camera.width, work.height = views[i].camera.height;
        sg_engine_on_device(engine, &work, &f);
        v->buffers = f.view > v->buffers ? f.view : v->buffers;
        v->map = f.map > v->map ? f.map : v->map;
        if (trained)
            *(views[i].lazy ? &v->lazy : &v->held) += f.photo, v->photos++;
        if (trained && views[i].lazy && f.passing > v->passing)
            v->passing = f.passing;
    }
}

int sg_budget_plan_device(sg_ctx *ctx, const struct sg_scene *scene,
                          const struct sg_train_params *p, int sh_degree, bool accumulate,
                          bool spectral, struct sg_budget *limits)
{
    const struct sg_engine_kind *engine = sg_engine_find(ctx, p->engine, p->cpu);
    struct sg_work work = work_of(ctx, p, sh_degree, accumulate);
    struct sg_footprint need;
    struct device_views v = {0};
    work.anisotropy |= spectral;
    if (!engine || !sg_engine_on_device(engine, &work, &need))
        return engine ? SG_OK : SG_ERR_USAGE;
    add_views(&v, engine, work, scene->train, scene->n_train, true);
    add_views(&v, engine, work, scene->test, scene->n_test, false);
    /* Buffers that grow take half as much again while less than half of the memory is in use. */
    const uint64_t whole = sg_ctx_vram(ctx)->limit, limit = whole / 6 * 5,
                   each = need.gaussian + LISTED * need.instance, least = LEAST * each,
                   others = sg_vram_current(ctx, SG_MEM_TAGS) + v.held + v.buffers;
    const uint64_t largest = sg_ctx_vram(ctx)->largest;
    if (largest && v.map > largest)
        return sg_fail(ctx, SG_ERR_BUDGET,
                       "%s: memory of the device: found photos of which one buffer takes %llu "
                       "bytes, expected at most %llu, which is all that its driver gives at once",
                       scene->path, (unsigned long long) v.map, (unsigned long long) largest);
    /* Each photo that stays is an allocation, of which a driver gives a number. */
    const uint64_t most = sg_ctx_vram(ctx)->most;
    limits->photos_stay &= limit > others && v.lazy < (limit - others) / 2 &&
                           (!most || v.photos + OTHER_ALLOCATIONS <= most);
    const uint64_t photos = v.held + (limits->photos_stay ? v.lazy : v.passing),
                   fixed = others - v.held + photos;
    if (limit < fixed + least)
        return sg_fail(
            ctx, SG_ERR_BUDGET,
            "%s: memory of the device: found a limit of %llu bytes, expected at least %llu: photos "
            "are %llu, the buffers of the largest view %llu, and %d Gaussians %llu",
            scene->path, (unsigned long long) whole,
            (unsigned long long) ((fixed + least) / 5 * 6 + 6), (unsigned long long) photos,
            (unsigned long long) v.buffers, LEAST, (unsigned long long) least);
    lower(ctx, limits, (limit - fixed) / each);
    lower(ctx, limits, need.most);
    uint64_t lists = (limit - fixed - sg_budget_most(limits) * need.gaussian) / need.instance;
    if (largest && need.largest) {
        lower(ctx, limits, largest / need.largest);
        lists = lists < largest / need.instance ? lists : largest / need.instance;
    }
    limits->instances = lists < limits->instances ? lists : limits->instances;
    sg_log(ctx, SG_LOG_DEBUG,
           "memory of the device: limit %llu bytes, %llu for photos and the largest view: at most "
           "%llu Gaussians and %llu instances at once",
           (unsigned long long) whole, (unsigned long long) fixed,
           (unsigned long long) limits->gaussians, (unsigned long long) limits->instances);
    return SG_OK;
}
