/* SPDX-License-Identifier: Apache-2.0 */
#include "densify.h"

#include <math.h>
#include <string.h>

#include "math/constants.h"

/* Clones take the place after all survivors, then the first children, then the second, in index order: the order of the
 * released code. The screen-size test of the paper is left out because it is dead there: the radii are cleared by the
 * clone step before they are read. */
struct plan {
    uint8_t *keep, *kind;
    uint32_t *source;
    size_t appended;
};

static void append(struct plan *p, size_t source, enum sg_edit_kind kind)
{
    p->source[p->appended] = (uint32_t) source;
    p->kind[p->appended++] = (uint8_t) kind;
}

int sg_densify(struct sg_backend *backend, const struct sg_densify_params *p, struct sg_densify_result *result)
{
    sg_ctx *ctx = backend->ctx;
    const size_t n = backend->ops->count(backend);
    int code = SG_ERR_BUDGET;
    struct plan plan = {0};
    *result = (struct sg_densify_result){0};
    float *stats = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, 3 * sizeof(float));
    plan.keep = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, 1);
    plan.kind = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, SG_SPLIT_CHILDREN);
    plan.source = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, SG_SPLIT_CHILDREN * sizeof(uint32_t));
    if (!stats || !plan.keep || !plan.kind || !plan.source)
        goto done;
    float *gradient = stats, *opacity = stats + n, *scale = stats + 2 * n;
    if ((code = backend->ops->read_statistics(
             backend, &(struct sg_statistics){.gradient = gradient, .opacity = opacity, .largest = scale})))
        goto done;

    /* Who grows. At the limit the remaining room goes to the first in the model's order. */
    size_t room = !p->max_gaussians ? SIZE_MAX : p->max_gaussians > n ? p->max_gaussians - n : 0;
    enum { STAYS, CLONES, SPLITS };
    for (size_t i = 0; i < n; i++) {
        plan.keep[i] = STAYS;
        if (!(gradient[i] >= p->gradient) || !room)
            continue;
        plan.keep[i] = scale[i] <= p->split_scale ? CLONES : SPLITS;
        room--;
    }
    /* A Gaussian and its copies share opacity, so that they are pruned together; children are smaller. */
#define DIES(i, s) (opacity[i] < SG_PRUNE_OPACITY || (p->prune_scale > 0 && (s) > p->prune_scale))
    for (size_t i = 0; i < n; i++)
        if (plan.keep[i] == CLONES) {
            result->cloned++;
            if (DIES(i, scale[i]))
                result->pruned++;
            else
                append(&plan, i, SG_EDIT_COPY);
        }
    for (int child = 0; child < SG_SPLIT_CHILDREN; child++)
        for (size_t i = 0; i < n; i++)
            if (plan.keep[i] == SPLITS) {
                result->split += child == 0;
                if (DIES(i, scale[i] / SG_SPLIT_SHRINK))
                    result->pruned++;
                else
                    append(&plan, i, SG_EDIT_CHILD);
            }
    size_t kept = 0;
    for (size_t i = 0; i < n; i++) {
        const bool parent = plan.keep[i] == SPLITS, dies = DIES(i, scale[i]);
        result->pruned += !parent && dies;
        plan.keep[i] = !parent && !dies;
        kept += plan.keep[i];
    }
#undef DIES
    if (kept + plan.appended == 0) {
        code = sg_fail(ctx, SG_ERR_INPUT, "train: every Gaussian became transparent: the scene cannot be fitted");
        goto done;
    }
    code = backend->ops->edit(backend, &(struct sg_edit){.keep = plan.keep,
                                                         .kept = kept,
                                                         .appended = plan.appended,
                                                         .source = plan.source,
                                                         .kind = plan.kind,
                                                         .seed = p->seed,
                                                         .stream = p->stream});
done:
    sg_free(ctx, stats);
    sg_free(ctx, plan.keep);
    sg_free(ctx, plan.kind);
    sg_free(ctx, plan.source);
    return code;
}
