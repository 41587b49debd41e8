/* SPDX-License-Identifier: Apache-2.0 */
#include "budget.h"

#include "splatguard/model.h"

/* Bytes at the worst moment. sg_grow may hold half as much again as it needs. */
#define GROWN(bytes) ((bytes) + (bytes) / 2)
#define LIST_BYTES GROWN(8 + 2 + 48)                             /* an instance: list entry, blocks, gradient */
#define VIEW_BYTES GROWN(64 + 12 + 4 + 2 * 8 + 48)               /* a Gaussian of a view: splat, tiles, slots, order */
#define PLAN_BYTES (3 * 4 + 1 + 2 * (1 + 4) + 3 * 8 + 2 * 4 + 8) /* one that is judged: statistics, scores, order */
#define PIXEL_BYTES (8 * 12 + 16)                      /* renders, gradients, spectra, of training and tests */
#define COLUMN_BYTES (4 * (4 * 16 + 50) + 4 * 16 + 64) /* a thread: rows of the loss and of the transforms */
#define FIXED_BYTES (8 << 20)                          /* tables that do not grow with the input */
#define LISTED 2                                       /* instances a Gaussian to hold at once */
#define LEAST 1000                                     /* Gaussians: a smaller model is none */

/* Bytes of the buffers for the most demanding view. */
static uint64_t largest_view(const struct sg_view *views, size_t n, uint64_t threads, uint64_t most)
{
    for (size_t i = 0; i < n; i++) {
        const uint64_t width = (uint64_t) views[i].camera.width, height = (uint64_t) views[i].camera.height;
        const uint64_t bytes = width * height * PIXEL_BYTES + threads * width * COLUMN_BYTES;
        most = bytes > most ? bytes : most;
    }
    return most;
}

int sg_budget_plan(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_train_params *p, int sh_degree,
                   uint64_t leaving, bool sums, struct sg_budget *out)
{
    *out = (struct sg_budget){.gaussians = p->max_gaussians, .instances = p->max_instances};
    const uint64_t limit = sg_mem_limit(ctx), held = sg_mem_current(ctx, SG_MEM_TAGS);
    if (!limit)
        return SG_OK;
    const uint64_t threads = (uint64_t) sg_ctx_threads(ctx);
    const uint64_t view =
        largest_view(scene->test, scene->n_test, threads, largest_view(scene->train, scene->n_train, threads, 0));
    const uint64_t parameters = (uint64_t) sg_param_count(sh_degree) * sizeof(float);
    /* Parameters, two moments and sums of gradients; an edit, or a checkpoint, has one array more, and all statistics
     * twice. */
    const uint64_t each =
        (sums ? 5 : 4) * parameters + 4 * sizeof(float) + VIEW_BYTES + PLAN_BYTES + LISTED * LIST_BYTES;
    const uint64_t fixed = (held > leaving ? held - leaving : 0) + view + FIXED_BYTES;
    if (limit < fixed + LEAST * each)
        return sg_fail(ctx, SG_ERR_BUDGET,
                       "%s: memory: found a limit of %llu bytes, expected at least %llu: photos and tables are %llu, "
                       "the buffers of the largest view %llu, and %d Gaussians %llu",
                       scene->path, (unsigned long long) limit, (unsigned long long) (fixed + LEAST * each),
                       (unsigned long long) (fixed - view), (unsigned long long) view, LEAST,
                       (unsigned long long) (LEAST * each));
    const uint64_t fit = (limit - fixed) / each;
    out->by_memory = !p->max_gaussians || fit < p->max_gaussians;
    out->gaussians = out->by_memory ? fit : p->max_gaussians;
    const uint64_t lists = (limit - fixed - out->gaussians * (each - LISTED * LIST_BYTES)) / LIST_BYTES;
    out->instances = lists < p->max_instances ? lists : p->max_instances;
    return SG_OK;
}
