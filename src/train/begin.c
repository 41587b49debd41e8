/* SPDX-License-Identifier: Apache-2.0 */
/* The Gaussians that a run begins with, thinned out evenly where there are more than its limits
 * allow. */
#include "begin.h"

#include <string.h>

#include "model/anchors.h"
#include "schedule.h"

size_t sg_evenly(size_t n, size_t k, size_t limit)
{
    return (size_t) ((uint64_t) n * k / limit);
}

bool sg_begins_random(const struct sg_scene *scene, const struct sg_train_params *p)
{
    return p->random_points || !scene->n_points;
}

float sg_random_half_side(const struct sg_scene *scene, const struct sg_train_params *p)
{
    const bool cube = p->strategy != SG_STRATEGY_MCMC || scene->format == SG_FORMAT_BLENDER;
    const double extent = scene->extent > 0 ? scene->extent : 1;
    return p->random_extent > 0 ? (float) ((double) p->random_extent * extent)
           : cube               ? 1.3f
                                : (float) (3 * extent);
}

static void say_thinned(sg_ctx *ctx, size_t n, size_t limit)
{
    sg_log(ctx, SG_LOG_WARN,
           "%zu initial Gaussians are more than fit: training starts from %zu of them", n, limit);
}

/* The number of Gaussians that a run without an initial model begins with. */
static size_t initial_count(const struct sg_scene *scene, const struct sg_train_params *p)
{
    return sg_begins_random(scene, p) ? p->init_points : scene->n_points;
}

/* Of at most `limit` Gaussians, 0 = any number: thinned out before they cost more than their
 * points. */
static int initial_model(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_train_params *p,
                         uint64_t limit, struct sg_model **out)
{
    const size_t n = initial_count(scene, p);
    if (limit && n > limit)
        say_thinned(ctx, n, limit);
    if (sg_begins_random(scene, p))
        return sg_model_init_random(ctx, limit && n > limit ? limit : n,
                                    sg_random_half_side(scene, p), p->seed, p->sh_degree, out);
    if (!limit || n <= limit)
        return sg_model_init_points(ctx, scene->points, scene->point_colors, n, p->sh_degree, out);
    float *points = sg_alloc_raw(ctx, SG_MEM_MISC, limit, 3 * sizeof(*points));
    uint8_t *colors = sg_alloc_raw(ctx, SG_MEM_MISC, limit, 3);
    int code = points && colors ? SG_OK : SG_ERR_BUDGET;
    for (size_t k = 0; k < limit && !code; k++) {
        memcpy(points + 3 * k, scene->points + 3 * sg_evenly(n, k, limit), 3 * sizeof(*points));
        memcpy(colors + 3 * k, scene->point_colors + 3 * sg_evenly(n, k, limit), 3);
    }
    if (!code)
        code = sg_model_init_points(ctx, points, colors, limit, p->sh_degree, out);
    sg_free(points);
    sg_free(colors);
    return code;
}

/* A copy of a model, thinned out evenly to `count` Gaussians, with at most this SH degree. */
static int reduced_copy(sg_ctx *ctx, const struct sg_model *m, uint64_t count, int sh_degree,
                        struct sg_model **out)
{
    const int code = sg_model_create_like(ctx, m, count, sh_degree, out);
    if (code)
        return code;
    if (count < m->count)
        say_thinned(ctx, sg_model_gaussians(m), sg_model_gaussians(*out));
    for (size_t k = 0; k < count; k++)
        sg_model_copy_row(m, sg_evenly(m->count, k, count), *out, k);
    return SG_OK;
}

/* The memory of the process itself varies a little from run to run, and so does the rest of
 * --max-memory. */
#define UNCERTAIN 0.03

size_t sg_trainer_fit_count(sg_trainer *t, size_t n)
{
    const size_t each = sg_engine_each(t->engine), limit = t->budget.gaussians / each,
                 most = sg_budget_most(&t->budget) / each;
    if (!t->budget.gaussians || n <= most)
        return n;
    if (t->budget.by_memory && (double) n <= (1 + UNCERTAIN) * (double) limit) {
        t->budget.gaussians = n * each;
        return n;
    }
    sg_log(
        t->ctx, SG_LOG_WARN,
        "the checkpoint's %zu Gaussians are more than fit now: training continues with %zu of them",
        n * each, limit * each);
    return limit;
}

/* Whether a model is of the kind that is trained, and its networks have the parts that learn. */
static int check_kind(const sg_trainer *t, const struct sg_model *m)
{
    return t->params.model != SG_MODEL_SCAFFOLD
               ? sg_model_refuse_anchors(t->ctx, m)
               : sg_model_expect_anchors(t->ctx, m, "model", sg_network_parts(&t->params.scaffold),
                                         sg_trainer_appearances(t));
}

int sg_trainer_init_model(sg_trainer *t, const struct sg_model *initial)
{
    const size_t each = sg_engine_each(t->engine);
    const uint64_t limit = sg_budget_most(&t->budget);
    struct sg_model *made = NULL;
    if (initial && t->params.random_points)
        return sg_fail(t->ctx, SG_ERR_USAGE,
                       "init: found an initial model and random_points, expected one of them");
    if (initial && t->strategy->initial)
        return sg_fail(t->ctx, SG_ERR_USAGE,
                       "init: found an initial model, expected none with %s, which makes its "
                       "own",
                       t->strategy->name);
    if (!initial && !t->scene->n_points && t->scene->format != SG_FORMAT_BLENDER)
        sg_log(
            t->ctx, SG_LOG_WARN,
            "%s: found no points: training starts from random ones, at most %.3g scene units from "
            "the origin along each axis; --random-extent 1 to 3 can suit a large scene better",
            t->scene->path, (double) sg_random_half_side(t->scene, &t->params));
    const size_t n = initial ? initial->count * each : initial_count(t->scene, &t->params);
    if (t->params.strategy == SG_STRATEGY_MCMC && n > t->params.mcmc.cap_max)
        sg_log(t->ctx, SG_LOG_WARN,
               "%zu initial Gaussians are more than --cap-max, %llu, which limits growth alone; "
               "--max-gaussians thins them out",
               n, (unsigned long long) t->params.mcmc.cap_max);
    int code = initial ? sg_model_check(t->ctx, initial, "initial model") : SG_OK;
    if (!code && initial)
        code = check_kind(t, initial);
    if (code)
        return code;
    t->gaussians_bound = limit && n > limit && !t->strategy->initial;
    t->from_points = !initial;
    if (!initial && t->strategy->initial)
        code = t->strategy->initial(t, &made);
    else if (!initial)
        code = initial_model(t->ctx, t->scene, &t->params, limit, &made);
    else if (t->gaussians_bound || initial->sh_degree > t->sh_degree)
        code = reduced_copy(t->ctx, initial, t->gaussians_bound ? limit / each : initial->count,
                            t->sh_degree, &made);
    if (!code) {
        t->start_degree = (made ? made : initial)->active_sh_degree;
        code = made ? sg_engine_adopt(t->engine, made,
                                      made->columns ? made->columns : &(struct sg_columns){0})
                    : sg_engine_upload(t->engine, initial, initial->columns);
    }
    sg_model_destroy(&made);
    return code;
}
