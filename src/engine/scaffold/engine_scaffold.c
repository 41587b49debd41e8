/* SPDX-License-Identifier: Apache-2.0 */
/* The operations of the engine for anchors: its model, and the stages of the engine that draws. */
#include <math.h>
#include <string.h>

#include "engine/cpu/dispatch.h"
#include "math/constants.h"
#include "model/anchors.h"
#include "scaffold.h"
#include "state.h"

static struct scaffold_engine *of(struct sg_engine *base)
{
    return (struct scaffold_engine *) base;
}

static const struct scaffold_engine *of_const(const struct sg_engine *base)
{
    return (const struct scaffold_engine *) base;
}

static void destroy(struct sg_engine *base)
{
    struct scaffold_engine *b = of(base);
    sg_engine_destroy(&b->inner);
    sg_host_clear(&b->anchors);
    void *owned[] = {b->networks,        b->sees,     b->seen,
                     b->drawn,           b->gradient, b->weight_sums,
                     b->weight_gradient, b->place,    b->own_weights};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        sg_free(owned[i]);
    sg_free(b);
}

static const char *variant(const struct sg_engine *base)
{
    return sg_engine_variant(of_const(base)->inner);
}

/* ---- the model ---- */

static int refuse_plain(sg_ctx *ctx, const struct sg_columns *columns)
{
    return columns && columns->networks && columns->at[SG_C_ANCHOR]
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INTERNAL, "engine: found a model without anchors");
}

static int upload(struct sg_engine *base, const struct sg_model *m,
                  const struct sg_columns *columns)
{
    struct scaffold_engine *b = of(base);
    struct sg_networks *networks;
    int code = refuse_plain(base->ctx, columns);
    if (code)
        return code;
    if (!(networks = sg_networks_create(base->ctx, columns->networks->photos)))
        return SG_ERR_BUDGET;
    sg_networks_copy(networks, columns->networks);
    if ((code = sg_host_upload(base->ctx, &b->anchors, m, columns))) {
        sg_free(networks);
        return code;
    }
    sg_free(b->networks);
    b->networks = networks;
    b->host_newer = true, b->device_newer = b->learns = false;
    return SG_OK;
}

static int adopt(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    struct scaffold_engine *b = of(base);
    const int code = refuse_plain(base->ctx, columns);
    if (code)
        return code;
    sg_free(b->networks);
    b->networks = columns->networks;
    sg_host_adopt(&b->anchors, m, columns);
    b->host_newer = true, b->device_newer = b->learns = false;
    return SG_OK;
}

static int download(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    struct scaffold_engine *b = of(base);
    const int code = sg_scaffold_fetch(b);
    if (code)
        return code;
    if (columns && columns->networks)
        sg_networks_copy(columns->networks, b->networks);
    return sg_host_download(&b->anchors, m, columns);
}

static size_t count(const struct sg_engine *base)
{
    return of_const(base)->anchors.count;
}

/* The scales of an anchor's Gaussians are at most its sizes. */
static int read_statistics(struct sg_engine *base, const struct sg_statistics *out)
{
    const struct sg_host_model *h = &of(base)->anchors;
    const int code = sg_scaffold_fetch(of(base));
    if (code)
        return code;
    sg_host_statistics(base->ctx, h, out);
    for (size_t i = 0; i < h->count; i++) {
        const float *p = h->at[SG_C_ANCHOR] + sg_param_index(SG_A_PLANES, i, SG_A_SIZE);
        const float s[3] = {p[0], p[SG_LANES], p[2 * SG_LANES]};
        if (out->largest)
            out->largest[i] = expf(fmaxf(fmaxf(s[0], s[1]), s[2]));
        if (out->log_smallest)
            out->log_smallest[i] = fminf(fminf(s[0], s[1]), s[2]);
    }
    return SG_OK;
}

static int edit(struct sg_engine *base, const struct sg_edit *e)
{
    struct scaffold_engine *b = of(base);
    const int code = sg_scaffold_fetch(b);
    b->learns = false;
    if (code)
        return code;
    if (sg_host_rows_of(e->rows, SG_C_BORN) && sg_host_alloc(base->ctx, &b->anchors, SG_C_BORN))
        return SG_ERR_BUDGET;
    b->host_newer = true; /* also after an error */
    return sg_host_edit(base->ctx, &b->anchors, e);
}

static int floor_scale(struct sg_engine *base, float smallest)
{
    (void) smallest;
    return sg_fail(base->ctx, SG_ERR_USAGE,
                   "engine: found least scales, which anchors do not have");
}

static int reset_opacity(struct sg_engine *base, float limit)
{
    (void) limit;
    return sg_fail(base->ctx, SG_ERR_USAGE,
                   "engine: found a reset of opacity, expected a model "
                   "without networks");
}

static int settle(struct sg_engine *base, const struct sg_settling *s)
{
    struct sg_host_model *h = &of(base)->anchors;
    const int code = sg_scaffold_fetch(of(base));
    if (code || sg_host_alloc(base->ctx, h, SG_C_ANCHOR_STATISTICS))
        return code ? code : SG_ERR_BUDGET;
    of(base)->host_newer = true;
    for (size_t i = 0; i < h->count; i++) {
        float *p = h->at[SG_C_ANCHOR] + sg_param_index(SG_A_PLANES, i, SG_A_SIZE),
              *stat = h->at[SG_C_ANCHOR_STATISTICS] + sg_param_index(SG_A_STATISTICS, i, 0);
        for (int k = 0; k < 3; k++)
            p[k * SG_LANES] = fminf(p[k * SG_LANES], s->log_largest);
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            if (stat[(SG_A_DRAWN + k) * SG_LANES] > s->drawn)
                stat[(SG_A_DRAWN + k) * SG_LANES] = stat[(SG_A_GRADIENT + k) * SG_LANES] = 0;
        if (stat[SG_A_SEEN * SG_LANES] > s->seen)
            stat[SG_A_SEEN * SG_LANES] = stat[SG_A_OPACITY * SG_LANES] = 0;
    }
    return SG_OK;
}

static int hide(struct sg_engine *base, const uint32_t *hidden)
{
    static const int learned[] = {SG_C_ANCHOR_MOMENT1, SG_C_ANCHOR_MOMENT2};
    struct sg_host_model *h = &of(base)->anchors;
    const int code = sg_scaffold_fetch(of(base));
    if (code)
        return code;
    of(base)->host_newer = true;
    float *statistics = h->at[SG_C_ANCHOR_STATISTICS];
    for (size_t i = 0; i < h->count; i++)
        for (int k = 0; k < 3 * SG_ANCHOR_GAUSSIANS; k++) {
            const size_t at = sg_param_index(SG_A_PLANES, i, SG_A_OFFSET + k);
            if (!(hidden[i] >> k / 3 & 1))
                continue;
            h->at[SG_C_ANCHOR][at] = SG_OFFSET_HIDDEN;
            if (statistics) /* of a candidate for growth */
                statistics[sg_param_index(SG_A_STATISTICS, i, SG_A_GRADIENT + k / 3)] =
                    statistics[sg_param_index(SG_A_STATISTICS, i, SG_A_DRAWN + k / 3)] = 0;
            for (int m = 0; m < 2; m++)
                if (h->at[learned[m]])
                    h->at[learned[m]][at] = 0;
        }
    return SG_OK;
}

static int do_project(struct sg_engine *base, const struct sg_camera *camera, int sh_degree,
                      const struct sg_render_params *params)
{
    (void) sh_degree;
    struct scaffold_engine *b = of(base);
    const int code = sg_scaffold_view(b, camera, params->appearance);
    b->inner->step = base->step;
    b->inner->width = base->width, b->inner->height = base->height;
    return code ? code : b->inner->ops->project(b->inner, camera, 0, params);
}

/* ---- the engine that draws ---- */

static int photo_add(struct sg_engine *base, sg_photo photo, const struct sg_photo_entry *p)
{
    struct sg_engine *inner = of(base)->inner;
    return inner->ops->photo_add ? inner->ops->photo_add(inner, photo, p) : SG_OK;
}

static void photo_drop(struct sg_engine *base, sg_photo photo)
{
    struct sg_engine *inner = of(base)->inner;
    if (inner->ops->photo_drop)
        inner->ops->photo_drop(inner, photo);
}

static int wait_for(struct sg_engine *base)
{
    return sg_scaffold_wait(of(base));
}

static void clock_of(struct sg_engine *base, double *sum)
{
    of(base)->inner->clock(of(base)->inner, sum);
}

static int bin(struct sg_engine *base)
{
    return of(base)->inner->ops->bin(of(base)->inner);
}

static int raster(struct sg_engine *base, bool auxiliary)
{
    return of(base)->inner->ops->raster(of(base)->inner, auxiliary);
}

static int read_image(struct sg_engine *base, float *rgb, float *alpha, float *depth)
{
    return of(base)->inner->ops->read_image(of(base)->inner, rgb, alpha, depth);
}

static int loss(struct sg_engine *base, const struct sg_target_pixels *target,
                const struct sg_loss *l)
{
    return of(base)->inner->ops->loss(of(base)->inner, target, l);
}

static int write_image_gradient(struct sg_engine *base, const float *gradient)
{
    return of(base)->inner->ops->write_image_gradient(of(base)->inner, gradient);
}

static int raster_backward(struct sg_engine *base)
{
    return of(base)->inner->ops->raster_backward(of(base)->inner);
}

static int photo_pass(struct sg_engine *base, sg_photo photo, const struct sg_photo_entry *p)
{
    return of(base)->inner->ops->photo_pass(of(base)->inner, photo, p);
}

static int set_exposures(struct sg_engine *base, const float *values, size_t n)
{
    struct sg_engine *inner = of(base)->inner;
    const int code = inner->ops->set_exposures(inner, values, n);
    inner->exposure_count = code ? 0 : n;
    return code;
}

static int read_exposures(struct sg_engine *base, float *values)
{
    return of(base)->inner->ops->read_exposures(of(base)->inner, values);
}

static int learn_exposures(struct sg_engine *base, size_t number,
                           const struct sg_exposure_update *u)
{
    return of(base)->inner->ops->learn_exposures(of(base)->inner, number, u);
}

static int ascend_view(struct sg_engine *base, const struct sg_view_ascent *a)
{
    return of(base)->inner->ops->ascend_view(of(base)->inner, a);
}

static int ascend(struct sg_engine *base, const struct sg_ascend *a)
{
    return of(base)->inner->ops->ascend(of(base)->inner, a);
}

static int read_step(struct sg_engine *base)
{
    struct sg_engine *inner = of(base)->inner;
    const int code = inner->ops->read_step ? inner->ops->read_step(inner) : SG_OK;
    base->step = inner->step;
    return code;
}

static bool read_arrived(struct sg_engine *base, uint64_t number, struct sg_step *out)
{
    return of(base)->inner->ops->read_arrived(of(base)->inner, number, out);
}

static int read_most(struct sg_engine *base, uint64_t *out)
{
    return of(base)->inner->ops->read_most(of(base)->inner, out);
}

/* ---- anchors and networks ---- */

static int pull(struct sg_engine *base, bool statistics)
{
    struct scaffold_engine *b = of(base);
    const int code =
        b->device ? sg_scaffold_device_pull(b, statistics) : sg_scaffold_pull(b, statistics);
    b->learns = !code;
    if (!b->device) /* its stages are done */
        base->step = b->inner->step;
    return code;
}

static int optimise(struct sg_engine *base, const struct sg_update *u)
{
    struct scaffold_engine *b = of(base);
    if (u->accumulate || u->mean_opacity != 0 || u->mean_scale != 0)
        return sg_fail(base->ctx, SG_ERR_USAGE, "engine: found an update that anchors do not have");
    b->inner->views = base->views;
    if (b->device)
        return sg_scaffold_device_optimise(b, u);
    return u->adam ? sg_scaffold_optimise(b, u) : SG_OK;
}

static int learn_networks(struct sg_engine *base, const struct sg_network_update *u)
{
    struct scaffold_engine *b = of(base);
    if (!b->learns)
        return sg_fail(base->ctx, SG_ERR_INTERNAL,
                       "engine: learn_networks: found no gradients of this view and model");
    b->learns = false;
    if (b->device)
        return sg_scaffold_device_learn(b, u);
    sg_scaffold_learn(b, u);
    return SG_OK;
}

/* out: scales, and the anchors' own values where it has room for them. */
static int read_gradients(struct sg_engine *base, struct sg_model *out)
{
    const struct scaffold_engine *b = of(base);
    if (b->device)
        return b->device->read_gradients(b->inner, out);
    float *anchor = out->columns ? out->columns->at[SG_C_ANCHOR] : NULL;
    const int planes = b->anchors.planes;
    memset(out->params, 0, out->capacity * (size_t) planes * sizeof(float));
    if (anchor)
        memset(anchor, 0, out->capacity * SG_A_PLANES * sizeof(float));
    for (size_t k = 0; k < b->drawing_count; k++) {
        const struct sg_anchor_gradient *g = &b->gradient[k / SG_LANES];
        const size_t i = b->seen[k].anchor, lane = k % SG_LANES;
        for (int axis = 0; axis < 3; axis++)
            out->params[sg_param_index(planes, i, SG_P_SCALE + axis)] = g->reach[axis][lane];
        for (int p = 0; anchor && p < SG_A_PLANES; p++)
            anchor[sg_param_index(SG_A_PLANES, i, p)] = g->anchor[p][lane];
    }
    struct sg_networks *networks = out->columns ? out->columns->networks : NULL;
    if (networks)
        networks->value = *b->weight_gradient;
    for (size_t photo = 0; networks && photo < networks->photos; photo++)
        for (int k = 0; k < SG_APPEARANCE; k++)
            networks->appearance[photo].value[k] =
                photo == b->photo ? b->appearance_gradient[k] : 0;
    return SG_OK;
}

/* ---- hits ---- */

/* The Gaussians of an anchor in the arrays of the engine that draws, and their numbers; returns how
 * many. exists: on a device, of all anchors, which then have places for all of their Gaussians. */
static int made_of(const struct scaffold_engine *b, const uint32_t *exists, size_t k,
                   size_t at[SG_ANCHOR_GAUSSIANS], size_t number[SG_ANCHOR_GAUSSIANS],
                   size_t *anchor)
{
    const uint32_t bits = exists ? exists[k] : b->seen[k].exists;
    const size_t first = exists ? k * SG_ANCHOR_GAUSSIANS : b->seen[k].first;
    int n = 0;
    *anchor = exists ? k : b->seen[k].anchor;
    for (size_t g = 0; g < SG_ANCHOR_GAUSSIANS; g++)
        if (bits >> g & 1) {
            at[n] = first + (exists ? g : (size_t) n);
            number[n++] = g;
        }
    return n;
}

/* What `n` Gaussians of a view add to an entry. */
static void add_value(const struct sg_weighing *how, size_t at, double value, int n, double *hits,
                      uint32_t *made)
{
    hits[at] = how->combine == SG_COMBINE_MAX ? fmax(hits[at], value) : hits[at] + value;
    if (made)
        made[at] += (uint32_t) n;
}

/* From those of Gaussians to those of entries: of anchors, or single ones. smallest: their scales,
 * if they have a weight. */
static void add_hits(const struct scaffold_engine *b, const struct sg_weighing *how,
                     const double *own, const float *smallest, const uint32_t *exists, double *hits,
                     uint32_t *made)
{
    const size_t anchors = exists ? b->anchors.count : b->drawing_count;
    const bool once =
        how->kind == SG_HIT_VIEWS && !how->weight && !how->shared && how->combine == SG_COMBINE_SUM;
    for (size_t k = 0; k < anchors; k++) {
        size_t at[SG_ANCHOR_GAUSSIANS], number[SG_ANCHOR_GAUSSIANS], anchor;
        const int n = made_of(b, exists, k, at, number, &anchor);
        double all = 0, sum = 0, most = 0;
        for (int i = 0; i < n; i++)
            all += own[at[i]];
        if (how->kind == SG_HIT_VIEWS)
            all = all > 0;
        for (int i = 0; i < n; i++) {
            const double h = how->shared ? all : own[at[i]],
                         value =
                             h > 0 && how->weight ? h * how->weight(how->arg, smallest[at[i]]) : h;
            sum += value;
            most = fmax(most, value);
            if (how->single)
                add_value(how, anchor * SG_ANCHOR_GAUSSIANS + number[i], value, 1, hits, made);
        }
        sum = once ? all : sum;
        if (!how->single)
            add_value(how, anchor, how->combine == SG_COMBINE_MAX ? most : sum, n, hits, made);
    }
}

static int weigh_hits(struct sg_engine *base, const struct sg_camera *view,
                      const struct sg_render_params *params, const struct sg_weighing *how,
                      double *hits, uint32_t *made)
{
    struct scaffold_engine *b = of(base);
    struct sg_engine *inner = b->inner;
    int code = sg_scaffold_view(b, view, params->appearance);
    if (!code)
        code = sg_scaffold_wait(b);
    if (code)
        return code;
    const size_t n = sg_scaffold_drawn(b);
    double *own = sg_alloc(base->ctx, SG_MEM_SPLATS, n, sizeof(*own));
    float *smallest =
        how->weight ? sg_alloc_raw(base->ctx, SG_MEM_SPLATS, n, sizeof(*smallest)) : NULL;
    uint32_t *exists =
        b->device ? sg_alloc_raw(base->ctx, SG_MEM_SPLATS, b->anchors.count, sizeof(*exists))
                  : NULL;
    if (!own || (how->weight && !smallest) || (b->device && !exists))
        code = SG_ERR_BUDGET;
    if (!code && smallest)
        code =
            inner->ops->read_statistics(inner, &(struct sg_statistics){.log_smallest = smallest});
    if (!code)
        code = inner->ops->count_hits(inner, view, params, how->kind, own);
    if (!code && exists)
        code = b->device->read_exists(inner, exists);
    if (!code)
        add_hits(b, how, own, smallest, exists, hits, made);
    sg_free(own);
    sg_free(smallest);
    sg_free(exists);
    return code;
}

static int count_hits(struct sg_engine *base, const struct sg_camera *view,
                      const struct sg_render_params *params, enum sg_hit kind, double *hits)
{
    return weigh_hits(base, view, params, &(struct sg_weighing){.kind = kind}, hits, NULL);
}

static const struct sg_engine_ops common = {
    .name = "scaffold",
    .exposure = true,
    .destroy = destroy,
    .variant = variant,
    .upload = upload,
    .adopt = adopt,
    .download = download,
    .count = count,
    .read_statistics = read_statistics,
    .edit = edit,
    .floor_scale = floor_scale,
    .reset_opacity = reset_opacity,
    .settle = settle,
    .hide = hide,
    .photo_add = photo_add,
    .photo_drop = photo_drop,
    .project = do_project,
    .bin = bin,
    .raster = raster,
    .read_image = read_image,
    .loss = loss,
    .write_image_gradient = write_image_gradient,
    .raster_backward = raster_backward,
    .project_backward = pull,
    .optimise = optimise,
    .learn_networks = learn_networks,
    .read_gradients = read_gradients,
    .read_step = read_step,
    .count_hits = count_hits,
    .weigh_hits = weigh_hits,
};

/* The optional ones are those that the engine that draws has. */
static struct sg_engine_ops ops_over(const struct sg_engine_ops *inner)
{
    struct sg_engine_ops ops = common;
    if (inner->photo_pass)
        ops.photo_pass = photo_pass;
    if (inner->set_exposures)
        ops.set_exposures = set_exposures, ops.read_exposures = read_exposures,
        ops.learn_exposures = learn_exposures;
    if (inner->ascend_view)
        ops.ascend_view = ascend_view;
    if (inner->ascend)
        ops.ascend = ascend, ops.ascends_spectrum = inner->ascends_spectrum;
    if (inner->finish)
        ops.finish = wait_for, ops.read_arrived = read_arrived, ops.read_most = read_most;
    return ops;
}

int sg_scaffold_wrap(sg_ctx *ctx, struct sg_engine **engine)
{
    struct sg_engine *inner = *engine;
    const struct cpu_kernels *kernels = NULL;
    const bool ref = !strcmp(inner->ops->name, "ref"), cpu = !strcmp(inner->ops->name, "cpu");
    struct scaffold_engine *b = NULL;
    int code = ref ? SG_OK : sg_cpu_select(ctx, cpu ? sg_engine_variant(inner) : NULL, &kernels);
    if (!code &&
        (!(b = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*b))) ||
         !(b->weight_gradient = sg_alloc(ctx, SG_MEM_SPLATS, 1, sizeof(*b->weight_gradient)))))
        code = SG_ERR_BUDGET;
    if (code) {
        sg_free(b);
        return code;
    }
    b->ops = ops_over(inner->ops);
    b->base = (struct sg_engine){.ops = &b->ops,
                                 .ctx = ctx,
                                 .clock = inner->clock ? clock_of : NULL,
                                 .each = SG_ANCHOR_GAUSSIANS,
                                 .volume = SG_ANCHOR_VOLUME};
    b->inner = inner;
    b->device = inner->ops->anchors;
    b->neural = ref ? sg_ref_neural : kernels->neural;
    b->neural_backward = ref ? sg_ref_neural_backward : kernels->neural_backward;
    b->pick = ref ? sg_ref_pick : kernels->pick;
    *engine = &b->base;
    return SG_OK;
}

uint64_t sg_scaffold_footprint(const struct sg_work *work, uint64_t drawn)
{
    struct sg_work own = *work;
    own.sh_degree = 0;
    const uint64_t seen =
        sizeof(struct sg_anchor_gradient) / SG_LANES + sizeof(struct seen) + sizeof(uint32_t) + 1;
    /* Gradients and statistics of what a view draws, with room for views that draw more. */
    const uint64_t pulled = (SG_DRAWN_PLANES + 2) * sizeof(float);
    /* Growth reads a copy of what it needs. */
    const uint64_t read = (SG_DRAWN_PLANES + SG_A_PLANES + SG_A_STATISTICS) * sizeof(float);
    return drawn + pulled * 3 / 2 +
           (sg_host_footprint(&own, false) + seen * 3 / 2 + read) / SG_ANCHOR_GAUSSIANS;
}
