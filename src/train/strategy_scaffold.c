/* SPDX-License-Identifier: Apache-2.0 */
/* Anchors of Scaffold-GS (Lu et al. 2024): their start, their rates, growth and removal, and the
 * steps of their networks, in the order of the released code. */
#include <math.h>
#include <string.h>

#include "begin.h"
#include "core/clock.h"
#include "core/rng.h"
#include "filtering.h"
#include "growth.h"
#include "math/constants.h"
#include "model/anchors.h"
#include "schedule.h"
#include "strategy.h"
#include "trainer.h"

static size_t most_anchors(const sg_trainer *t)
{
    const uint64_t most = t->budget.gaussians / SG_ANCHOR_GAUSSIANS;
    return !t->budget.gaussians ? SIZE_MAX : most ? (size_t) most : 1;
}

/* Every so many-th point, from the first. Returns how many those are. */
static size_t thin_out(float *xyz, size_t n, size_t every)
{
    const size_t left = (n + every - 1) / every;
    for (size_t i = 1; i < left && every > 1; i++)
        memcpy(xyz + 3 * i, xyz + 3 * i * every, 3 * sizeof(*xyz));
    return left;
}

static int initial(sg_trainer *t, struct sg_model **out)
{
    const struct sg_scene *scene = t->scene;
    const struct sg_train_params *p = &t->params;
    const size_t limit = most_anchors(t);
    const struct sg_anchor_start start = {.voxel = p->scaffold.voxel,
                                          .limit = limit < SIZE_MAX ? limit : 0,
                                          .parts = sg_network_parts(&p->scaffold),
                                          .photos = sg_trainer_appearances(t),
                                          .sizes = {p->scaffold.offsets, p->scaffold.features,
                                                    p->scaffold.hidden, p->scaffold.numbers},
                                          .seed = p->seed};
    struct sg_model *points = NULL;
    float *xyz = NULL;
    size_t cells = 0, n = scene->n_points;
    int code = sg_begins_random(scene, p)
                   ? sg_model_init_random(t->ctx, p->init_points, sg_random_half_side(scene, p),
                                          p->seed, 0, &points)
                   : SG_OK;
    n = points ? points->count : n;
    if (!code && (points || p->scaffold.every > 1) &&
        !(xyz = sg_alloc_raw(t->ctx, SG_MEM_MISC, n, 3 * sizeof(*xyz))))
        code = SG_ERR_BUDGET;
    if (!code && points)
        code = sg_model_get_array(t->ctx, points, "position", xyz, 0);
    else if (!code && xyz)
        memcpy(xyz, scene->points, 3 * n * sizeof(*xyz));
    if (!code && xyz)
        n = thin_out(xyz, n, (size_t) p->scaffold.every);
    if (!code)
        code = sg_anchors_init(t->ctx, xyz ? xyz : scene->points, n, &start, &cells, out);
    if (!code && cells > (*out)->count) {
        t->gaussians_bound = true;
        sg_log(t->ctx, SG_LOG_WARN,
               "%zu initial anchors are more than fit: training starts from %zu of them", cells,
               (*out)->count);
    }
    sg_model_destroy(&points);
    sg_free(xyz);
    return code;
}

static void rates(const sg_trainer *t, int before, int it, double lr[SG_GROUPS])
{
    (void) before;
    const struct sg_train_params *p = &t->params;
    const struct sg_scaffold_params *s = &p->scaffold;
    for (int g = 0; g < SG_GROUPS; g++)
        lr[g] = 0;
    lr[SG_G_OFFSET] = sg_falling_lr(p, it, s->offset_lr_init, s->offset_lr_final) * t->extent;
    lr[SG_G_FEATURE] = (double) s->feature_lr;
    lr[SG_G_SCALE] = (double) s->scaling_lr;
}

static bool grows(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    return it > p->scaffold.from && it < p->densify_until_iter && it < p->iterations &&
           sg_due(before, it, p->densification_interval);
}

/* The released code rebuilds the tensors of the anchors when they grow, so Adam does not move them
 * then; the networks learn in each iteration. */
static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    const struct sg_train_params *p = &t->params;
    const bool due = grows(t, before, it);
    return (struct sg_strategy_plan){
        .rests = due || sg_filtering_due(t, t->strategy_state, before, it, due),
        .statistics = it > p->densify_from_iter && it < p->densify_until_iter};
}

int sg_trainer_learn_networks(sg_trainer *t, int it)
{
    const struct sg_scaffold_params *s = &t->params.scaffold;
    const double step = (double) t->steps + 1;
    const double unbias = 1 / (1 - pow((double) SG_ADAM_BETA1, step));
    const float first[SG_NETWORK_RATES] = {s->opacity_lr_init, s->covariance_lr_init,
                                           s->colour_lr_init, s->bank_lr_init,
                                           s->appearance_lr_init},
                last[SG_NETWORK_RATES] = {s->opacity_lr_final, s->covariance_lr_final,
                                          s->colour_lr_final, s->bank_lr_final,
                                          s->appearance_lr_final};
    struct sg_network_update u = {.root =
                                      (float) (1 / sqrt(1 - pow((double) SG_ADAM_BETA2, step)))};
    for (int n = 0; n < SG_NETWORK_RATES; n++)
        u.rate[n] = (float) (sg_falling_lr(&t->params, it, first[n], last[n]) * unbias);
    return sg_engine_learn_networks(t->engine, &u);
}

/* What growth reads of the model. */
struct read {
    struct sg_model *model;
    struct sg_columns columns;
};

static int read_model(const sg_trainer *t, struct read *out)
{
    sg_ctx *ctx = t->ctx;
    int code = sg_model_create(ctx, sg_engine_count(t->engine), 0, &out->model);
    if (code)
        return code;
    const size_t n = out->model->capacity;
    float **at = out->columns.at;
    at[SG_C_ANCHOR] = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, SG_A_PLANES * sizeof(float));
    at[SG_C_ANCHOR_STATISTICS] =
        sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, SG_A_STATISTICS * sizeof(float));
    out->columns.networks = sg_networks_create(ctx, 0);
    if (!at[SG_C_ANCHOR] || !at[SG_C_ANCHOR_STATISTICS] || !out->columns.networks)
        return SG_ERR_BUDGET;
    return sg_engine_download(t->engine, out->model, &out->columns);
}

/* Of the anchors that were seen often, those without opacity go. */
static size_t mark_kept(const struct read *r, float seen, float opacity, uint8_t *keep)
{
    const float *statistics = r->columns.at[SG_C_ANCHOR_STATISTICS];
    size_t kept = 0;
    for (size_t i = 0; i < r->model->count; i++) {
        const float *s = statistics + sg_param_index(SG_A_STATISTICS, i, 0);
        const float views = s[SG_A_SEEN * SG_LANES];
        keep[i] = !(views > seen && s[SG_A_OPACITY * SG_LANES] < opacity * views);
        kept += keep[i];
    }
    if (!kept) /* a model keeps at least one */
        kept = keep[0] = 1;
    return kept;
}

static int edit(sg_trainer *t, const uint8_t *keep, size_t kept, const struct sg_model *rows)
{
    const size_t added = rows ? rows->count : 0;
    uint32_t *source = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, added, sizeof(*source));
    uint8_t *kind = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, added, 1);
    int code = source && kind ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < added && !code; i++)
        source[i] = (uint32_t) i, kind[i] = SG_EDIT_INSERT;
    if (!code)
        code = sg_engine_edit(t->engine, &(struct sg_edit){.keep = keep,
                                                           .kept = kept,
                                                           .appended = added,
                                                           .source = source,
                                                           .kind = kind,
                                                           .rows = rows,
                                                           .statistics = true});
    sg_free(source);
    sg_free(kind);
    return code;
}

/* New anchors know when they grew, where the filter asks for that. */
static int date(const sg_trainer *t, int it, struct sg_model *rows)
{
    if (!rows || !sg_spares_anchors(&t->params))
        return SG_OK;
    float *born = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, rows->capacity, sizeof(*born));
    for (size_t i = 0; i < rows->capacity && born; i++)
        born[i] = (float) it;
    rows->columns->at[SG_C_BORN] = born;
    return born ? SG_OK : SG_ERR_BUDGET;
}

int sg_trainer_grow_anchors(sg_trainer *t, int it, struct sg_train_step *step)
{
    const struct sg_train_params *p = &t->params;
    const double start = sg_seconds();
    const float seen = p->scaffold.seen * (float) p->densification_interval;
    struct read r = {0};
    struct sg_model *rows = NULL;
    bool bound = false;
    int code = read_model(t, &r);
    const size_t n = code ? 0 : r.model->count;
    uint8_t *keep = sg_alloc_raw(t->ctx, SG_MEM_OPTIMISER, n, 1);
    if (!keep)
        code = SG_ERR_BUDGET;
    const size_t kept = code ? 0 : mark_kept(&r, seen, p->scaffold.min_opacity, keep),
                 most = most_anchors(t);
    if (!code)
        code =
            sg_grow_anchors(t->ctx,
                            &(struct sg_anchor_view){n, r.model->params, r.columns.at[SG_C_ANCHOR],
                                                     r.columns.at[SG_C_ANCHOR_STATISTICS]},
                            &(struct sg_growth_params){.voxel = r.columns.networks->voxel,
                                                       .factor = p->scaffold.cells,
                                                       .grids = p->scaffold.grids,
                                                       .finer = p->scaffold.finer,
                                                       .gradient = sg_trainer_growth_threshold(t),
                                                       .drawn = seen / 2,
                                                       .drop = p->scaffold.drop,
                                                       .log_size_max = p->scaffold.log_size_max,
                                                       .limit = most > kept ? most - kept : 0,
                                                       .seed = p->seed,
                                                       .stream = (uint64_t) it},
                            &rows, &bound);
    sg_model_destroy(&r.model); /* before the edit needs memory */
    sg_columns_clear(&r.columns);
    if (!code)
        code = date(t, it, rows);
    if (!code)
        code = sg_engine_settle(t->engine,
                                &(struct sg_settling){seen / 2, seen, p->scaffold.log_size_max});
    if (!code)
        code = edit(t, keep, kept, rows);
    if (!code) {
        t->gaussians_bound |= bound;
        step->cloned = SG_ANCHOR_GAUSSIANS * (rows ? rows->count : 0);
        step->pruned = SG_ANCHOR_GAUSSIANS * (n - kept);
        sg_log(t->ctx, SG_LOG_DEBUG, "iteration %d: of %zu anchors %zu removed, %zu new", it, n,
               n - kept, rows ? rows->count : 0);
    }
    sg_free(keep);
    sg_model_destroy(&rows);
    t->densify_seconds += sg_seconds() - start;
    return code;
}

static int after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out)
{
    (void) planned;
    const bool due = grows(t, before, it),
               filters = sg_filtering_due(t, t->strategy_state, before, it, due);
    const double gaussians = (double) sg_trainer_gaussians(t);
    int code = it < t->params.iterations ? sg_trainer_learn_networks(t, it) : SG_OK;
    if (!code && due)
        code = sg_trainer_grow_anchors(t, it, out);
    if (!code && due)
        sg_filtering_grown(t, t->strategy_state, it, fmin((double) out->cloned / gaussians, 1));
    if (!code && filters)
        code = sg_filtering_run(t, t->strategy_state, it, render, &out->defense);
    return code;
}

const struct sg_strategy sg_strategy_scaffold = {
    .name = "scaffold",
    .state_bytes = sizeof(struct sg_filtering),
    .sound = sg_filtering_sound,
    .whole = true,
    .initial = initial,
    .rates = rates,
    .plan = plan,
    .after_step = after_step,
};
