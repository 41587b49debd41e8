/* SPDX-License-Identifier: Apache-2.0 */
/* The front end: what is common to all engines. Arguments and the order of the stages are checked
 * here, so that an operation can rely on them; clocks run here; operations that an engine lacks
 * have their substitute here. */
#include "engine.h"

#include <math.h>
#include <string.h>

#include "core/clock.h"
#include "host/exposure.h"
#include "host/image_losses.h"
#include "model/anchors.h"
#include "ops.h"
#include "scaffold/scaffold.h"

/* Results of a stage that later stages need. */
enum sg_ready {
    SPLATS = 1,
    LISTS = 2,
    IMAGE = 4,
    IMAGE_GRADIENT = 8,
    SPLAT_GRADIENTS = 16,
    PARAMETER_GRADIENTS = 32,
    ASCENDED = 64,
};

static int need(const struct sg_engine *e, unsigned what, const char *stage, const char *before)
{
    if ((e->ready & what) == what)
        return SG_OK;
    return sg_fail(e->ctx, SG_ERR_INTERNAL, "engine: %s: found no %s of this view and model", stage,
                   before);
}

/* Records which results exist after a stage: of the earlier ones those in `kept`, and what it has
 * made unless it failed. */
static int leave(struct sg_engine *e, int code, unsigned kept, unsigned made)
{
    e->ready = (e->ready & kept) | (code ? 0 : made);
    return code;
}

/* Between these two a stage's time is counted in *sum. */
static double begin(struct sg_engine *e, double *sum)
{
    if (e->clock)
        e->clock(e, e->clocks_stopped ? NULL : sum);
    return sg_seconds();
}

static void lap(struct sg_engine *e, double start, double *sum)
{
    if (e->clock)
        e->clock(e, NULL);
    else if (!e->clocks_stopped)
        *sum += sg_seconds() - start;
}

/* Before what is not a stage: see ops.h. */
static int finish(struct sg_engine *e)
{
    return e->ops->finish ? e->ops->finish(e) : SG_OK;
}

/* ---- the engine itself ---- */

static void drop_photo(struct sg_engine *e, sg_photo photo)
{
    if (!photo || photo > e->photo_count || !e->photos[photo - 1].rgb)
        return;
    if (e->ops->photo_drop && !e->photos[photo - 1].passing)
        e->ops->photo_drop(e, photo);
    e->photos[photo - 1] = (struct sg_photo_entry){0};
}

void sg_engine_destroy(struct sg_engine **engine)
{
    if (!engine || !*engine)
        return;
    struct sg_engine *e = *engine;
    for (size_t i = 0; i < e->photo_count; i++)
        drop_photo(e, (sg_photo) (i + 1));
    sg_free(e->photos);
    e->ops->destroy(e);
    *engine = NULL;
}

sg_ctx *sg_engine_ctx(const struct sg_engine *e)
{
    return e->ctx;
}

const char *sg_engine_variant(const struct sg_engine *e)
{
    return e->ops->variant(e);
}

struct sg_footprint sg_engine_footprint(const struct sg_engine_kind *engine,
                                        const struct sg_work *work)
{
    const struct sg_work drawn = sg_work_drawn(work);
    struct sg_footprint f = engine->footprint(&drawn);
    if (work->anchors)
        f.gaussian = sg_scaffold_footprint(work, f.gaussian);
    return f;
}

bool sg_engine_on_device(const struct sg_engine_kind *engine, const struct sg_work *work,
                         struct sg_footprint *out)
{
    if (engine->on_device)
        *out = engine->on_device(work);
    return engine->on_device != NULL;
}

/* ---- the model ---- */

/* The engine has taken this model, or has failed. */
static int taken(struct sg_engine *e, const struct sg_model *m, int code)
{
    if (!code)
        e->sh_degree = m->sh_degree;
    return leave(e, code, 0, 0);
}

int sg_engine_upload(struct sg_engine *e, const struct sg_model *m,
                     const struct sg_columns *columns)
{
    const int code = finish(e);
    return code ? code : taken(e, m, e->ops->upload(e, m, columns));
}

int sg_engine_adopt(struct sg_engine *e, struct sg_model *m, struct sg_columns *columns)
{
    if (e->ops->adopt)
        return taken(e, m, e->ops->adopt(e, m, columns));
    const int code = sg_engine_upload(e, m, columns);
    if (code)
        return code;
    sg_free(m->params);
    m->params = NULL;
    sg_columns_clear(columns);
    return SG_OK;
}

int sg_engine_download(struct sg_engine *e, struct sg_model *m, struct sg_columns *columns)
{
    int code = finish(e);
    if (!code)
        code = e->ops->download(e, m, columns);
    if (!code && columns && columns->networks && !sg_networks_finite(columns->networks))
        code = sg_fail(e->ctx, SG_ERR_INPUT,
                       "networks: found weights that are not finite: the training has diverged");
    return code;
}

size_t sg_engine_count(const struct sg_engine *e)
{
    return e->ops->count(e);
}

size_t sg_engine_each(const struct sg_engine *e)
{
    return e->each ? (size_t) e->each : 1;
}

int sg_engine_set_statistic(struct sg_engine *e, enum sg_gradient_statistic statistic)
{
    if (statistic != SG_GRADIENT_NORM && !e->ops->absolute)
        return sg_fail(e->ctx, SG_ERR_USAGE,
                       "statistic: found absolute gradients, which engine %s does not count",
                       e->ops->name);
    const int code = finish(e);
    if (code)
        return code;
    e->statistic = statistic;
    return leave(e, SG_OK, SPLATS | LISTS | IMAGE | IMAGE_GRADIENT, 0);
}

int sg_engine_read_statistics(struct sg_engine *e, const struct sg_statistics *out)
{
    const int code = finish(e);
    return code ? code : e->ops->read_statistics(e, out);
}

/* An index that is out of range would be read. */
static int check_appended(const struct sg_engine *e, const struct sg_edit *edit)
{
    const size_t count = sg_engine_count(e), rows = edit->rows ? edit->rows->count : 0;
    if (rows && (edit->rows->sh_degree != e->sh_degree || count + rows > UINT32_MAX))
        return sg_fail(e->ctx, SG_ERR_USAGE,
                       "edit: found %zu rows of SH degree %d, expected degree %d and at most %zu",
                       rows, edit->rows->sh_degree, e->sh_degree, (size_t) UINT32_MAX - count);
    for (size_t i = 0; i < edit->appended; i++) {
        const bool inserted = edit->kind[i] == SG_EDIT_INSERT;
        if (edit->kind[i] >= SG_EDIT_KEEP || edit->source[i] >= (inserted ? rows : count))
            return sg_fail(e->ctx, SG_ERR_USAGE,
                           "edit: entry %zu: found kind %d of source %u, expected one of %zu "
                           "Gaussians or %zu rows",
                           i, edit->kind[i], edit->source[i], count, rows);
    }
    return SG_OK;
}

int sg_engine_edit(struct sg_engine *e, const struct sg_edit *edit)
{
    int code = check_appended(e, edit);
    if (!code)
        code = finish(e);
    return code ? code : leave(e, e->ops->edit(e, edit), 0, 0);
}

int sg_engine_floor_scale(struct sg_engine *e, float smallest)
{
    const int code = finish(e);
    return code ? code : leave(e, e->ops->floor_scale(e, smallest), IMAGE, 0);
}

int sg_engine_reset_opacity(struct sg_engine *e, float limit)
{
    const int code = finish(e);
    return code ? code : leave(e, e->ops->reset_opacity(e, limit), IMAGE, 0);
}

static int lacks(const struct sg_engine *e, const char *what)
{
    return sg_fail(e->ctx, SG_ERR_USAGE, "engine %s: found a call of %s, which it does not have",
                   e->ops->name, what);
}

int sg_engine_relocate(struct sg_engine *e, const struct sg_relocation *r)
{
    const size_t n = sg_engine_count(e);
    if (!e->ops->relocate)
        return lacks(e, "relocate");
    for (size_t i = 0; i < r->count; i++)
        if (r->to[i] >= n || r->from[i] >= n)
            return sg_fail(e->ctx, SG_ERR_USAGE,
                           "relocate: entry %zu: found Gaussians %u and %u, expected two of %zu", i,
                           r->to[i], r->from[i], n);
    const int code = finish(e);
    return code ? code : leave(e, e->ops->relocate(e, r), IMAGE, 0);
}

int sg_engine_explore(struct sg_engine *e, const struct sg_exploration *x)
{
    if (!e->ops->explore)
        return lacks(e, "explore");
    return leave(e, e->ops->explore(e, x), IMAGE, 0);
}

int sg_engine_filter(struct sg_engine *e, const struct sg_camera *const *cameras, size_t n,
                     const struct sg_mip_filter *filter)
{
    if (!e->ops->filter)
        return lacks(e, "filter");
    const int code = finish(e);
    return code ? code : leave(e, e->ops->filter(e, cameras, n, filter), IMAGE, 0);
}

int sg_engine_settle(struct sg_engine *e, const struct sg_settling *s)
{
    if (!e->ops->settle)
        return lacks(e, "settle");
    const int code = finish(e);
    return code ? code : leave(e, e->ops->settle(e, s), IMAGE, 0);
}

int sg_engine_hide(struct sg_engine *e, const uint32_t *hidden)
{
    if (!e->ops->hide)
        return lacks(e, "hide");
    const int code = finish(e);
    return code ? code : leave(e, e->ops->hide(e, hidden), IMAGE, 0);
}

int sg_engine_learn_networks(struct sg_engine *e, const struct sg_network_update *u)
{
    if (!e->ops->learn_networks)
        return lacks(e, "learn_networks");
    return leave(e, e->ops->learn_networks(e, u), IMAGE, 0);
}

int sg_engine_set_shape(struct sg_engine *e, const struct sg_shape *shape)
{
    if (!e->ops->shape)
        return sg_fail(e->ctx, SG_ERR_USAGE, "shape: found %s, which engine %s cannot compute",
                       shape->name, e->ops->name);
    e->shape = shape;
    return leave(e, SG_OK, 0, 0);
}

/* ---- photos ---- */

static int add_photo(struct sg_engine *e, const struct sg_photo_entry *entry, sg_photo *out)
{
    const struct sg_engine_ops *ops = e->ops;
    size_t at = 0;
    while (at < e->photo_count && e->photos[at].rgb)
        at++;
    int code = entry->passing ? SG_OK : finish(e);
    if (code)
        return code;
    if (sg_grow(e->ctx, SG_MEM_MISC, &e->photos, &e->photo_capacity, at + 1, e->photo_count,
                sizeof(*e->photos)))
        return SG_ERR_BUDGET;
    e->photos[at] = *entry;
    e->photo_count = at < e->photo_count ? e->photo_count : at + 1;
    if (entry->passing)
        code = ops->photo_pass(e, (sg_photo) (at + 1), entry);
    else if (ops->photo_add)
        code = ops->photo_add(e, (sg_photo) (at + 1), entry);
    if (code)
        e->photos[at] = (struct sg_photo_entry){0};
    else
        *out = (sg_photo) (at + 1);
    return code;
}

int sg_engine_photo_add(struct sg_engine *e, int width, int height, const uint8_t *rgb,
                        const uint8_t *mask, sg_photo *out)
{
    *out = 0;
    return add_photo(e, &(struct sg_photo_entry){width, height, rgb, mask, false}, out);
}

int sg_engine_photo_pass(struct sg_engine *e, int width, int height, const uint8_t *rgb,
                         const uint8_t *mask, sg_photo *out)
{
    const bool passing = e->ops->photo_pass;
    *out = 0;
    return add_photo(e, &(struct sg_photo_entry){width, height, rgb, mask, passing}, out);
}

int sg_engine_photo_drop(struct sg_engine *e, sg_photo photo)
{
    const bool passing = photo && photo <= e->photo_count && e->photos[photo - 1].passing;
    const int code = photo && !passing ? finish(e) : SG_OK; /* nothing asks for it again */
    drop_photo(e, photo);
    return code;
}

/* ---- exposures ---- */

int sg_engine_set_exposures(struct sg_engine *e, float *values, size_t n)
{
    if (n && !e->ops->exposure)
        return lacks(e, "set_exposures");
    int code = finish(e);
    if (!code && e->ops->set_exposures)
        code = e->ops->set_exposures(e, values, n);
    e->exposures = code ? NULL : values;
    e->exposure_count = code ? 0 : n;
    return leave(e, code, SPLATS | LISTS | IMAGE, 0);
}

int sg_engine_read_exposures(struct sg_engine *e)
{
    const int code = finish(e);
    return code || !e->ops->read_exposures || !e->exposure_count
               ? code
               : e->ops->read_exposures(e, e->exposures);
}

/* ---- the stages ---- */

static int run_shape(struct sg_engine *e)
{
    if (!e->shape)
        return SG_OK;
    const double start = begin(e, &e->times.shape);
    const int code = e->ops->shape(e, e->shape);
    lap(e, start, &e->times.shape);
    return code;
}

static void clear_step(struct sg_step *step)
{
    *step = (struct sg_step){0};
    for (int k = 0; k < SG_LOSSES; k++)
        step->loss[k] = NAN;
    step->variation = NAN;
}

static int check_filter(const struct sg_engine *e, const struct sg_render_params *params)
{
    if (e->statistic == SG_GRADIENT_MIP && !params->mip_kernel)
        return sg_fail(e->ctx, SG_ERR_USAGE,
                       "render: found no 2D filter, expected that of Mip-Splatting, which the "
                       "statistic needs");
    return !params->mip_kernel || e->ops->mip_kernel
               ? SG_OK
               : sg_fail(e->ctx, SG_ERR_USAGE,
                         "render: found the 2D filter of Mip-Splatting, which engine %s does not "
                         "have",
                         e->ops->name);
}

int sg_engine_project(struct sg_engine *e, const struct sg_camera *camera, int sh_degree,
                      const struct sg_render_params *params)
{
    e->width = camera->width, e->height = camera->height;
    clear_step(&e->step);
    e->optimised = false;
    int code = check_filter(e, params);
    if (!code)
        code = run_shape(e);
    if (code)
        return leave(e, code, 0, 0);
    const double start = begin(e, &e->times.project);
    code = e->ops->project(e, camera, sh_degree, params);
    lap(e, start, &e->times.project);
    return leave(e, code, 0, SPLATS);
}

int sg_engine_bin(struct sg_engine *e)
{
    int code = need(e, SPLATS, "bin", "projection");
    if (code)
        return code;
    const double start = begin(e, &e->times.bin);
    code = e->ops->bin(e);
    lap(e, start, &e->times.bin);
    return leave(e, code, SPLATS, LISTS);
}

int sg_engine_raster(struct sg_engine *e, bool auxiliary)
{
    int code = need(e, LISTS, "raster", "tile lists");
    if (code)
        return code;
    const double start = begin(e, &e->times.raster);
    code = e->ops->raster(e, auxiliary);
    lap(e, start, &e->times.raster);
    return leave(e, code, SPLATS | LISTS, IMAGE);
}

int sg_engine_draw(struct sg_engine *e, const struct sg_camera *camera, int sh_degree,
                   const struct sg_render_params *params, bool auxiliary)
{
    int code = sg_engine_project(e, camera, sh_degree, params);
    if (!code)
        code = sg_engine_bin(e);
    return code ? code : sg_engine_raster(e, auxiliary);
}

int sg_engine_read_image(struct sg_engine *e, float *rgb, float *alpha, float *depth)
{
    int code = need(e, IMAGE, "read_image", "image");
    if (!code)
        code = finish(e);
    return code ? code : e->ops->read_image(e, rgb, alpha, depth);
}

static int find_target(const struct sg_engine *e, const struct sg_target *t,
                       struct sg_target_pixels *out)
{
    *out = (struct sg_target_pixels){.photo = t->photo, .planes = t->planes};
    if (t->exposure > e->exposure_count)
        return sg_fail(e->ctx, SG_ERR_USAGE,
                       "losses: found exposure %zu, expected one of the %zu that the engine has",
                       t->exposure, e->exposure_count);
    if (t->exposure && e->ops->learn_exposures)
        out->device_exposure = t->exposure;
    else if (t->exposure)
        out->exposure = e->exposures + (t->exposure - 1) * SG_EXPOSURE;
    out->ascended = t->ascended && !t->photo && !t->planes;
    if (out->ascended)
        return need(e, ASCENDED, "losses", "ascended image");
    if (!t->photo)
        return t->planes ? SG_OK
                         : sg_fail(e->ctx, SG_ERR_USAGE,
                                   "losses: found no target, expected a photo or planes");
    const struct sg_photo_entry *p = t->photo <= e->photo_count ? &e->photos[t->photo - 1] : NULL;
    if (!p || !p->rgb)
        return sg_fail(e->ctx, SG_ERR_USAGE, "losses: found photo %u, which has not been added",
                       t->photo);
    if (p->width != e->width || p->height != e->height)
        return sg_fail(e->ctx, SG_ERR_USAGE,
                       "losses: found a photo of %d x %d, expected %d x %d as the view", p->width,
                       p->height, e->width, e->height);
    out->rgb = t->planes ? NULL : p->rgb;
    out->mask = p->mask;
    return SG_OK;
}

int sg_engine_losses(struct sg_engine *e, const struct sg_target *target,
                     const struct sg_loss *losses, size_t n)
{
    struct sg_target_pixels pixels;
    int code = need(e, IMAGE, "losses", "image");
    if (!code)
        code = find_target(e, target, &pixels);
    for (size_t i = 0; i < n && !code; i++)
        if ((losses[i].kind == SG_LOSS_PHOTOMETRIC) != (i == 0))
            code = sg_fail(
                e->ctx, SG_ERR_USAGE,
                "losses: found kind %d at place %zu, expected the photometric loss once and first",
                (int) losses[i].kind, i);
    if (code || !n)
        return code;
    for (size_t i = 0; i < n && !code; i++) {
        const double start = begin(e, &e->times.loss[losses[i].kind]);
        code = e->ops->loss(e, &pixels, &losses[i]);
        lap(e, start, &e->times.loss[losses[i].kind]);
    }
    e->exposed = target->exposure;
    return leave(e, code, SPLATS | LISTS | IMAGE, IMAGE_GRADIENT);
}

bool sg_engine_ascends_views(const struct sg_engine *e)
{
    return e->ops->ascend_view != NULL;
}

int sg_engine_ascend_view(struct sg_engine *e, const struct sg_view_ascent *a)
{
    struct sg_target_pixels pixels;
    int code =
        e->ops->ascend_view ? need(e, IMAGE, "ascend_view", "image") : lacks(e, "ascend_view");
    if (!code)
        code = find_target(e, &(struct sg_target){.photo = a->photo}, &pixels);
    if (code)
        return code;
    const double start = begin(e, &e->times.ascend);
    code = e->ops->ascend_view(e, a);
    lap(e, start, &e->times.ascend);
    return leave(e, code, SPLATS | LISTS | IMAGE, ASCENDED);
}

int sg_engine_write_image_gradient(struct sg_engine *e, const float *gradient)
{
    int code = need(e, IMAGE, "write_image_gradient", "image");
    if (code || (code = finish(e)))
        return code;
    code = e->ops->write_image_gradient(e, gradient);
    e->exposed = 0;
    return leave(e, code, SPLATS | LISTS | IMAGE, IMAGE_GRADIENT);
}

int sg_engine_raster_backward(struct sg_engine *e)
{
    int code = need(e, LISTS | IMAGE | IMAGE_GRADIENT, "raster_backward", "gradient of the image");
    if (code)
        return code;
    const double start = begin(e, &e->times.raster_backward);
    code = e->ops->raster_backward(e);
    lap(e, start, &e->times.raster_backward);
    return leave(e, code, ~(unsigned) SPLAT_GRADIENTS, SPLAT_GRADIENTS);
}

static int run_project_backward(struct sg_engine *e, bool statistics)
{
    const double start = begin(e, &e->times.project_backward);
    int code = e->ops->project_backward(e, statistics);
    lap(e, start, &e->times.project_backward);
    if (code || !e->shape)
        return code;
    const double between = begin(e, &e->times.shape);
    code = e->ops->shape_backward(e, e->shape);
    lap(e, between, &e->times.shape);
    return code;
}

int sg_engine_project_backward(struct sg_engine *e, bool statistics)
{
    int code = need(e, SPLATS | SPLAT_GRADIENTS, "project_backward", "gradients of the splats");
    if (code)
        return code;
    code = run_project_backward(e, statistics);
    return leave(e, code, ~(unsigned) (SPLAT_GRADIENTS | PARAMETER_GRADIENTS), PARAMETER_GRADIENTS);
}

int sg_engine_count_radii(struct sg_engine *e)
{
    int code = e->ops->count_radii ? need(e, SPLATS, "count_radii", "a projected view")
                                   : lacks(e, "count_radii");
    return code ? code : e->ops->count_radii(e);
}

/* Of the newest view that was optimised, as far as its results are known. */
static void note_step(struct sg_engine *e)
{
    if (!e->optimised)
        return;
    if (e->step.stats.instances > e->most_instances)
        e->most_instances = e->step.stats.instances;
    e->learned = e->step;
    e->learned.number = e->views;
    e->learned.most = e->most_instances;
}

int sg_engine_learn_exposures(struct sg_engine *e, const struct sg_exposure_update *update)
{
    int code = need(e, IMAGE_GRADIENT, "learn_exposures", "losses");
    if (!code && !e->exposed)
        code = sg_fail(e->ctx, SG_ERR_INTERNAL,
                       "engine: learn_exposures: found losses without an exposure");
    if (code)
        return code;
    const double start = begin(e, &e->times.optimise);
    if (e->ops->learn_exposures)
        code = e->ops->learn_exposures(e, e->exposed - 1, update);
    else if (!(code = finish(e)) && (!e->ops->read_step || !(code = e->ops->read_step(e))))
        sg_host_learn_exposures(e->exposures, e->exposure_count, e->exposed - 1, e->step.exposure,
                                update);
    lap(e, start, &e->times.optimise);
    return code;
}

int sg_engine_optimise(struct sg_engine *e, const struct sg_update *update)
{
    const bool ready = e->ready & PARAMETER_GRADIENTS;
    const bool fused = !ready && e->ops->project_backward_optimise && !e->shape;
    int code =
        ready ? SG_OK : need(e, SPLATS | SPLAT_GRADIENTS, "optimise", "gradients of the splats");
    if (code)
        return code;
    if (!ready && !fused)
        code = run_project_backward(e, update->statistics);
    if (!code) {
        const double start = begin(e, &e->times.optimise);
        code = (fused ? e->ops->project_backward_optimise : e->ops->optimise)(e, update);
        lap(e, start, &e->times.optimise);
    }
    e->optimised = !code;
    e->views += e->optimised;
    note_step(e);
    return leave(e, code, IMAGE, 0);
}

int sg_engine_read_gradients(struct sg_engine *e, struct sg_model *out)
{
    int code = SG_OK;
    if (!(e->ready & PARAMETER_GRADIENTS)) {
        code = need(e, SPLATS | SPLAT_GRADIENTS, "read_gradients", "gradients of the splats");
        if (!code)
            code = run_project_backward(e, false); /* optimise does it again, with its statistics */
    }
    if (!code)
        code = finish(e);
    return code ? code : e->ops->read_gradients(e, out);
}

int sg_engine_read_step(struct sg_engine *e, struct sg_step *out)
{
    int code = finish(e);
    if (!code && e->ops->read_step)
        code = e->ops->read_step(e);
    note_step(e);
    *out = e->step;
    return code;
}

int sg_engine_read_arrived(struct sg_engine *e, bool wait, struct sg_step *out)
{
    int code = SG_OK;
    clear_step(out);
    if (!e->ops->read_arrived) {
        if (e->optimised)
            code = sg_engine_read_step(e, out);
        *out = e->learned;
        return code;
    }
    if (!wait && e->ops->read_arrived(e, 0, out))
        return SG_OK;
    code = finish(e);
    if (!code)
        e->ops->read_arrived(e, 0, out);
    return code;
}

uint64_t sg_engine_views(const struct sg_engine *e)
{
    return e->views;
}

int sg_engine_read_view(struct sg_engine *e, uint64_t number, bool wait, struct sg_step *out,
                        bool *known)
{
    int code = SG_OK;
    if (!e->ops->read_arrived) {
        code = sg_engine_read_arrived(e, wait, out);
        *known = !code && out->number == number;
        return code;
    }
    clear_step(out);
    *known = e->ops->read_arrived(e, number, out);
    if (*known || !wait)
        return SG_OK;
    code = finish(e);
    *known = !code && e->ops->read_arrived(e, number, out);
    return code;
}

int sg_engine_most_instances(struct sg_engine *e, uint64_t *out)
{
    const int code = finish(e);
    *out = e->most_instances;
    return code || !e->ops->read_most ? code : e->ops->read_most(e, out);
}

int sg_engine_count_hits(struct sg_engine *e, const struct sg_camera *const *views, size_t n,
                         const struct sg_render_params *params, enum sg_hit kind, double *hits)
{
    int code = check_filter(e, params);
    if (!code)
        code = run_shape(e);
    if (!code)
        code = finish(e);
    const double start = begin(e, &e->times.count);
    e->optimised = false; /* other views are drawn, which are no step */
    memset(hits, 0, sg_engine_count(e) * sizeof(*hits));
    for (size_t v = 0; v < n && !code; v++)
        if (!(code = sg_progress(e->ctx, SG_STAGE_COUNT, v, n)))
            code = e->ops->count_hits(e, views[v], params, kind, hits);
    lap(e, start, &e->times.count);
    return leave(e, code, 0, 0);
}

void sg_engine_set_volume(struct sg_engine *e, float weight)
{
    e->volume = weight;
}

int sg_engine_weigh_hits(struct sg_engine *e, const struct sg_camera *const *views, size_t n,
                         const struct sg_render_params *params, const struct sg_weighing *how,
                         double *hits)
{
    if (!e->ops->weigh_hits)
        return lacks(e, "weigh_hits");
    const size_t count = sg_engine_count(e) * (how->single ? sg_engine_each(e) : 1);
    uint32_t *made = NULL;
    if (how->combine == SG_COMBINE_MEAN &&
        !(made = sg_alloc(e->ctx, SG_MEM_OPTIMISER, count, sizeof(*made))))
        return SG_ERR_BUDGET;
    int code = finish(e);
    const double start = begin(e, &e->times.count);
    e->optimised = false; /* other views are drawn, which are no step */
    memset(hits, 0, count * sizeof(*hits));
    for (size_t v = 0; v < n && !code; v++)
        if (!(code = sg_progress(e->ctx, SG_STAGE_COUNT, v, n)))
            code = e->ops->weigh_hits(e, views[v], params, how, hits, made);
    for (size_t i = 0; i < count && made; i++)
        hits[i] /= made[i] ? made[i] : 1;
    sg_free(made);
    lap(e, start, &e->times.count);
    return leave(e, code, 0, 0);
}

/* ---- images on their own ---- */

int sg_engine_ascend(struct sg_engine *e, const struct sg_ascend *a)
{
    if (a->spectral && !e->ops->ascends_spectrum)
        sg_host_descend(a);
    if (e->ops->ascend) {
        const int code = a->continues ? SG_OK : finish(e);
        return code ? code : e->ops->ascend(e, a);
    }
    sg_ref_ascend(e->ctx, a);
    return SG_OK;
}

/* ---- clocks ---- */

struct sg_engine_times sg_engine_times(const struct sg_engine *e)
{
    return e->times;
}

void sg_engine_stop_clocks(struct sg_engine *e, bool stop)
{
    e->clocks_stopped = stop;
}
