/* SPDX-License-Identifier: Apache-2.0 */
#include "view_scores.h"

#include <stdlib.h>
#include <string.h>

#define SH_C0 0.28209479177387814f /* of degree 0 */

int view_scores_copy(struct view_scores *s, sg_ctx *ctx, const struct sg_model *model)
{
    view_scores_clear(s);
    const int error = sg_model_create(ctx, model->count, 0, &s->model);
    if (error)
        return error;
    s->ctx = ctx;
    s->grey = sg_mem_alloc(ctx, SG_MEM_FRAME, model->count, sizeof(*s->grey));
    s->score = sg_mem_alloc(ctx, SG_MEM_FRAME, model->count, sizeof(*s->score));
    s->hits = sg_mem_alloc(ctx, SG_MEM_FRAME, model->count, sizeof(*s->hits));
    s->stays = sg_mem_alloc(ctx, SG_MEM_FRAME, model->count, sizeof(*s->stays));
    if (!s->grey || !s->score || !s->hits || !s->stays) {
        view_scores_clear(s);
        return SG_ERR_BUDGET;
    }
    for (size_t i = 0; i < model->count; i++) {
        const float *dc = sg_model_at(model, i, SG_P_SH);
        for (int p = 0; p < SG_P_SH; p++)
            *sg_model_at(s->model, i, p) = *sg_model_at(model, i, p);
        s->grey[i] =
            0.5f + SH_C0 * (0.30f * dc[0] + 0.59f * dc[SG_LANES] + 0.11f * dc[2 * SG_LANES]);
    }
    return SG_OK;
}

struct rank {
    double value;
    size_t at;
};

static int by_value(const void *a, const void *b)
{
    const struct rank *x = a, *y = b;
    return x->value != y->value ? (x->value > y->value) - (x->value < y->value)
                                : (x->at > y->at) - (x->at < y->at);
}

/* All Gaussians by rising value. The caller frees it; NULL: no memory. */
static struct rank *ranks_of(const struct view_scores *s, const double *value)
{
    const size_t n = s->model->count;
    struct rank *ranks = sg_mem_alloc(s->ctx, SG_MEM_FRAME, n, sizeof(*ranks));
    for (size_t i = 0; i < n && ranks; i++)
        ranks[i] = (struct rank){value[i], i};
    if (ranks)
        qsort(ranks, n, sizeof(*ranks), by_value);
    return ranks;
}

int view_scores_lowest(struct view_scores *s, double share)
{
    const size_t n = s->model->count;
    struct rank *ranks = ranks_of(s, s->score);
    for (size_t k = 0; k < n && ranks; k++)
        s->stays[ranks[k].at] = k >= (size_t) (share * (double) n);
    sg_mem_free(ranks);
    return ranks ? SG_OK : SG_ERR_BUDGET;
}

static void set_colour(struct sg_model *m, size_t i, const float *rgb)
{
    for (int ch = 0; ch < 3; ch++)
        *sg_model_at(m, i, SG_P_SH + ch) = (rgb[ch] - 0.5f) / SH_C0;
}

/* Between colours whose brightness falls evenly, so that it can be read without seeing colours. u:
 * 0..1 */
static void ramp(float u, float *rgb)
{
    static const float stops[5][3] = {{0.99f, 0.91f, 0.14f},
                                      {0.37f, 0.79f, 0.38f},
                                      {0.13f, 0.57f, 0.55f},
                                      {0.23f, 0.32f, 0.55f},
                                      {0.27f, 0.00f, 0.33f}};
    const int k = u < 1 ? (int) (4 * u) : 3;
    for (int ch = 0; ch < 3; ch++)
        rgb[ch] = stops[k][ch] + (4 * u - (float) k) * (stops[k + 1][ch] - stops[k][ch]);
}

int view_scores_paint(struct view_scores *s, enum view_kind kind, const char *engine,
                      const char *cpu, const struct sg_render_params *render)
{
    static const float red[3] = {1, 0.1f, 0.1f};
    const size_t n = s->model->count;
    if (s->renderer && s->painted == kind)
        return SG_OK;
    sg_renderer_destroy(&s->renderer);
    struct rank *ranks = ranks_of(s, kind == VIEW_HITS ? s->hits : s->score);
    if (!ranks)
        return SG_ERR_BUDGET;
    for (size_t k = 0, first = 0; k < n; k++) {
        const float grey = s->grey[ranks[k].at] * 0.7f, stays[3] = {grey, grey, grey};
        float colour[3];
        first = k && ranks[k].value > ranks[first].value ? k : first; /* equals look the same */
        ramp((float) first / (float) (n > 1 ? n - 1 : 1), colour);
        set_colour(s->model, ranks[k].at,
                   kind != VIEW_NEXT       ? colour
                   : s->stays[ranks[k].at] ? stays
                                           : red);
    }
    sg_mem_free(ranks);
    s->painted = kind;
    return sg_renderer_create(s->ctx, engine, cpu, s->model, render, &s->renderer);
}

void view_scores_clear(struct view_scores *s)
{
    sg_renderer_destroy(&s->renderer);
    sg_model_destroy(&s->model);
    sg_mem_free(s->grey);
    sg_mem_free(s->score);
    sg_mem_free(s->hits);
    sg_mem_free(s->stays);
    *s = (struct view_scores){0};
}
