/* SPDX-License-Identifier: Apache-2.0 */
/* The flow of iterations. The host records stages and submits an iteration when it ends, without
 * waiting: a few of them are on the device. How many instances a view has is known there only.
 * Where they have no room the device stops, which means that nothing that is on its way changes the
 * model any more. The host learns of it when it waits for that submission, and then runs the calls
 * of that iteration and of all later ones again, waiting for each number and making room. So the
 * bytes are those of a run that had the room from the beginning.
 *
 * A step is the calls of one view, from what makes its Gaussians to its optimiser (of anchors: to
 * that of the networks), or an exploration. It ends with a submission: what a later step finds out
 * does not concern what it has changed. */
#include <string.h>

#include "engine.h"

static int perform(struct vulkan_engine *e, const struct vulkan_call *c)
{
    struct sg_engine *base = &e->base;
    struct sg_target_pixels target;
    switch (c->stage) {
    case STAGE_SHAPE:
        return sg_vulkan_shape(base, c->shape);
    case STAGE_ANCHORS:
        return sg_vulkan_make_view(e, &c->anchors.camera, c->anchors.appearance);
    case STAGE_PROJECT:
        return sg_vulkan_project(e, &c->project.camera, c->project.sh_degree, &c->project.params);
    case STAGE_BIN:
        return sg_vulkan_bin(e);
    case STAGE_RASTER:
        return sg_vulkan_raster(e, c->flag);
    case STAGE_LOSS:
        target = c->loss.target;
        target.exposure = target.exposure ? c->loss.exposure : NULL;
        return sg_vulkan_loss(base, &target, &c->loss.loss);
    case STAGE_ASCEND_VIEW:
        return sg_vulkan_ascend_view(e, &c->ascent);
    case STAGE_LEARN_EXPOSURES:
        return sg_vulkan_learn_exposures(e, c->exposures.number, &c->exposures.update);
    case STAGE_COUNT_RADII:
        return sg_vulkan_count_radii(e);
    case STAGE_RASTER_BACKWARD:
        return sg_vulkan_raster_backward(e);
    case STAGE_PROJECT_BACKWARD:
        return sg_vulkan_project_backward(e, c->flag);
    case STAGE_SHAPE_BACKWARD:
        return sg_vulkan_shape_backward(base, c->shape);
    case STAGE_OPTIMISE:
        return sg_vulkan_optimise(e, &c->update);
    case STAGE_ANCHORS_PULL:
        return sg_vulkan_anchors_pull(e, c->pull.statistics, c->pull.volume);
    case STAGE_ANCHORS_OPTIMISE:
        return sg_vulkan_anchors_optimise(e, &c->update);
    case STAGE_NETWORKS_LEARN:
        return sg_vulkan_networks_learn(e, &c->networks);
    case STAGE_EXPLORE:
        return sg_vulkan_explore(e, &c->explore);
    default:
        return sg_vulkan_backward_optimise(e, &c->update);
    }
}

/* The step whose calls come next, or NULL. */
static struct vulkan_step *open_step(struct vulkan_flow *f)
{
    struct vulkan_step *last = f->count ? &f->steps[f->count - 1] : NULL;
    return last && !last->number ? last : NULL;
}

/* Forgets the first n steps. */
static void forget(struct vulkan_flow *f, int n)
{
    f->count -= n;
    memmove(f->steps, f->steps + n, (size_t) f->count * sizeof(*f->steps));
}

/* Forgets the steps that are done. */
static void forget_done(struct vulkan_engine *e)
{
    struct vulkan_flow *f = &e->flow;
    int n = 0;
    while (!e->gpu->stopped && n < f->count && f->steps[n].number &&
           f->steps[n].number <= e->gpu->finished)
        n++;
    forget(f, n);
}

/* It makes the Gaussians that its view's projection draws. */
static bool makes_view(enum vulkan_stage stage)
{
    return stage == STAGE_SHAPE || stage == STAGE_ANCHORS;
}

/* A step has changed what a later one needs, before its end. */
static bool has_changed(const struct vulkan_step *s)
{
    bool changed = false;
    for (int k = 0; s && k < s->count; k++) {
        const struct vulkan_call *c = &s->calls[k];
        changed |= c->stage == STAGE_LEARN_EXPOSURES || c->stage == STAGE_COUNT_RADII ||
                   c->stage == STAGE_ANCHORS_OPTIMISE ||
                   (c->stage == STAGE_PROJECT_BACKWARD && c->flag) ||
                   (c->stage == STAGE_ANCHORS_PULL && c->pull.statistics);
    }
    return changed;
}

/* Ends a step: the device goes on with it. */
static int end_step(struct vulkan_engine *e, struct vulkan_step *s)
{
    struct gpu *g = e->gpu;
    s->number = g->recording ? gpu_next(g) : g->submissions;
    return sg_gpu_submit(g);
}

/* Makes room for a call in the open step, or opens one. When another view begins, the open step is
 * ended if it has changed something; else it is abandoned, for nobody reads its results. */
static int begin_call(struct vulkan_engine *e, const struct vulkan_call *c)
{
    struct vulkan_flow *f = &e->flow;
    struct vulkan_step *s = open_step(f);
    const bool made = s && s->count == 1 && makes_view(s->calls[0].stage);
    int code = SG_OK;
    if (e->gpu->stopped && (code = sg_flow_finish(&e->base)))
        return code;
    if (c->stage == STAGE_EXPLORE && s && s->count > 0 && (code = sg_flow_finish(&e->base)))
        return code; /* what was drawn may still be asked for */
    forget_done(e);
    if (makes_view(c->stage) || c->stage == STAGE_EXPLORE || (c->stage == STAGE_PROJECT && !made)) {
        if (has_changed(open_step(f)) && (code = end_step(e, open_step(f))))
            return code;
        if (!open_step(f)) {
            if (f->count == VK_STEPS && (code = sg_flow_finish(&e->base)))
                return code;
            f->count++;
        }
        f->steps[f->count - 1].count = 0;
        f->steps[f->count - 1].number = 0;
    } else if (!open_step(f) || open_step(f)->count == VK_CALLS) { /* a caller's own order */
        if ((code = sg_flow_finish(&e->base)))
            return code;
        if (open_step(f)) /* its view has had room, so that nothing has to be run again */
            open_step(f)->count = 0;
    }
    return SG_OK;
}

#define RESULT_BYTES (VK_RESULTS * sizeof(uint32_t))
#define ARRIVAL_BYTES (RESULT_BYTES + 2 * sizeof(uint32_t)) /* and the most instances so far */

/* Keeps the results of the view for the host. */
static int keep_results(struct vulkan_engine *e, uint64_t view)
{
    struct gpu *g = e->gpu;
    struct vulkan_flow *f = &e->flow;
    const uint64_t turn = view % (GPU_FLIGHTS + 1); /* the same when it is run again */
    const uint64_t at = turn * ARRIVAL_BYTES;
    int code = sg_gpu_window(g, &f->arrived, (GPU_FLIGHTS + 1) * ARRIVAL_BYTES);
    if (!code)
        code = sg_gpu_lists_learned(g, &e->lists);
    if (!code)
        code = sg_gpu_copy(g, &e->lists.results, 0, &f->arrived, at, RESULT_BYTES);
    if (!code)
        code = sg_gpu_copy(g, &e->lists.most, 0, &f->arrived, at + RESULT_BYTES,
                           ARRIVAL_BYTES - RESULT_BYTES);
    if (!code)
        f->arrivals[turn] = (struct vulkan_arrival){gpu_next(g), view, e->terms};
    return code;
}

/* The optimiser of a view, after which its results are complete. */
static bool optimises(enum vulkan_stage stage)
{
    return stage == STAGE_OPTIMISE || stage == STAGE_BACKWARD_OPTIMISE ||
           stage == STAGE_ANCHORS_OPTIMISE;
}

/* The last call of a step. After the optimiser of anchors that of their networks follows. */
static bool ends(enum vulkan_stage stage)
{
    return stage == STAGE_OPTIMISE || stage == STAGE_BACKWARD_OPTIMISE ||
           stage == STAGE_NETWORKS_LEARN || stage == STAGE_EXPLORE;
}

/* After the device has stopped, and all is waited for: runs the steps again from the one that had
 * no room. */
static int run_again(struct vulkan_engine *e)
{
    struct gpu *g = e->gpu;
    struct vulkan_flow *f = &e->flow;
    const uint64_t stopped = g->stopped;
    int first = 0;
    while (first < f->count && f->steps[first].number && f->steps[first].number < stopped)
        first++;
    forget(f, first);
    for (uint32_t i = 0; i < GPU_FLIGHTS + 1; i++)
        if (f->arrivals[i].number >= stopped)
            f->arrivals[i].number = 0;
    sg_log(e->base.ctx, SG_LOG_DEBUG, "vulkan: instances had no room: %d steps are run again",
           f->count);
    bool learned = false;
    for (int i = 0; i < f->count; i++)
        learned |= f->steps[i].number || has_changed(&f->steps[i]);
    int code = sg_gpu_go_on(g);
    f->again = true;
    f->repeats++;
    for (int i = 0; i < f->count && !code; i++) {
        struct vulkan_step *s = &f->steps[i];
        for (int k = 0; k < s->count && !code; k++)
            if (!(code = perform(e, &s->calls[k])) && optimises(s->calls[k].stage))
                code = keep_results(e, s->view);
        if (!code && s->number)
            code = end_step(e, s);
    }
    f->again = false;
    e->lists.known = e->lists.band_count > 1;
    if (code) {
        f->count = 0;
        f->lost = learned;
    }
    return code != GPU_STOPPED
               ? code
               : sg_fail(e->base.ctx, SG_ERR_INTERNAL, "vulkan: lists had no room again");
}

/* Nobody takes the model for one that has learned from all steps. */
static int check_lost(const struct vulkan_engine *e)
{
    if (!e->flow.lost)
        return SG_OK;
    return e->gpu->lost
               ? sg_gpu_flush(e->gpu) /* says so */
               : sg_fail(e->base.ctx, SG_ERR_BUDGET,
                         "vulkan: iterations are lost, since the device had no memory to run them "
                         "again");
}

int sg_flow_run(struct vulkan_engine *e, const struct vulkan_call *c)
{
    struct vulkan_step *s;
    int code = check_lost(e);
    if (!code)
        code = begin_call(e, c);
    if (code)
        return code;
    while ((code = perform(e, c)) == GPU_STOPPED)
        if ((code = run_again(e)))
            return code;
    if (code || !(s = open_step(&e->flow)))
        return code;
    s->calls[s->count++] = *c;
    if (optimises(c->stage)) {
        s->view = e->base.views + 1;
        code = keep_results(e, s->view);
    }
    return code || !ends(c->stage) ? code : end_step(e, s);
}

int sg_flow_finish(struct sg_engine *base)
{
    struct vulkan_engine *e = vulkan_of(base);
    int code = check_lost(e);
    if (code)
        return code;
    while ((code = sg_gpu_flush(e->gpu)) == GPU_STOPPED)
        if ((code = run_again(e)))
            return code;
    forget_done(e);
    return code;
}

bool sg_flow_arrived(struct vulkan_engine *e, uint64_t view, struct sg_step *out)
{
    const struct vulkan_flow *f = &e->flow;
    const struct vulkan_arrival *newest = NULL;
    for (uint32_t i = 0; i < GPU_FLIGHTS + 1; i++) {
        const struct vulkan_arrival *a = &f->arrivals[i];
        if (a->number && a->number <= e->gpu->finished &&
            (!e->gpu->stopped || a->number < e->gpu->stopped) && (!view || a->view == view) &&
            (!newest || a->number > newest->number))
            newest = a;
    }
    if (!newest)
        return false;
    const uint32_t *r = (const uint32_t *) ((const char *) f->arrived.mapped +
                                            (size_t) (newest - f->arrivals) * ARRIVAL_BYTES);
    sg_vulkan_read_results(&newest->terms, r, out);
    out->number = newest->view;
    out->most = r[VK_RESULTS] | (uint64_t) r[VK_RESULTS + 1] << 32;
    return true;
}
