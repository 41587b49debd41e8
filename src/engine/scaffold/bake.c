/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians that look from everywhere like the mean of those that views make of anchors. */
#include <limits.h>
#include <math.h>

#include "model/anchors.h"
#include "scaffold.h"
#include "splatguard/format.h"
#include "state.h"

/* Of a Gaussian, over the views that drew it: sums weighted by its opacity. */
struct mean {
    double position[3], scale[3], rotation[4], colour[3], opacity;
    uint32_t drawn;
};

static void add(struct mean *m, const float *params, size_t i)
{
    double p[SG_DRAWN_PLANES], dot = 0, length = 0;
    for (int k = 0; k < SG_DRAWN_PLANES; k++)
        p[k] = (double) params[sg_param_index(SG_DRAWN_PLANES, i, k)];
    const double o = 1 / (1 + exp(-p[SG_P_OPACITY]));
    for (int k = 0; k < 4; k++) {
        dot += m->rotation[k] * p[SG_P_ROT + k];
        length += p[SG_P_ROT + k] * p[SG_P_ROT + k];
    }
    /* q and -q are the same rotation. */
    const double unit = length > 0 ? (dot < 0 ? -o : o) / sqrt(length) : 0;
    for (int k = 0; k < 3; k++) {
        m->position[k] += o * p[SG_P_XYZ + k];
        m->scale[k] += o * p[SG_P_SCALE + k];
        m->colour[k] += o * p[SG_P_SH + k];
    }
    for (int k = 0; k < 4; k++)
        m->rotation[k] += unit * p[SG_P_ROT + k];
    m->opacity += o;
    m->drawn++;
}

static int add_view(struct scaffold_engine *b, const struct sg_camera *camera, int appearance,
                    struct mean *means)
{
    const int code = sg_scaffold_view(b, camera, appearance);
    if (code)
        return code;
    const float *params = sg_scaffold_drawn_model(b)->at[SG_C_PARAMETERS];
    for (size_t k = 0; k < b->drawing_count; k++) {
        const struct seen *s = &b->seen[k];
        size_t from = s->first;
        for (size_t g = 0; g < SG_ANCHOR_GAUSSIANS; g++)
            if (s->exists >> g & 1)
                add(&means[s->anchor * SG_ANCHOR_GAUSSIANS + g], params, from++);
    }
    return SG_OK;
}

static float opacity_of(const struct mean *m)
{
    return m->drawn ? (float) fmin(m->opacity / m->drawn, 0.9999) : 0;
}

static void put(const struct mean *m, struct sg_model *out, size_t i)
{
    const float o = opacity_of(m);
    for (int k = 0; k < 3; k++) {
        *sg_model_at(out, i, SG_P_XYZ + k) = (float) (m->position[k] / m->opacity);
        *sg_model_at(out, i, SG_P_SCALE + k) = (float) (m->scale[k] / m->opacity);
        *sg_model_at(out, i, SG_P_SH + k) = (float) (m->colour[k] / m->opacity);
    }
    for (int k = 0; k < 4; k++)
        *sg_model_at(out, i, SG_P_ROT + k) = (float) (m->rotation[k] / m->opacity);
    *sg_model_at(out, i, SG_P_OPACITY) = logf(o / (1 - o));
}

#define LEAST_OPACITY (1 / 255.0f) /* with less it is never drawn */

/* What a view looks like: of its photo, else as asked. */
static int look_of(const size_t *photos, int appearance, size_t v)
{
    if (photos && photos[v] <= INT_MAX)
        return (int) photos[v];
    return appearance == SG_APPEARANCE_INDEX ? (int) v : appearance;
}

static int bake(struct sg_engine *e, const struct sg_view *views, size_t n, const size_t *photos,
                int appearance, struct sg_model **out)
{
    struct scaffold_engine *b = (struct scaffold_engine *) e;
    const size_t most = b->anchors.count * SG_ANCHOR_GAUSSIANS;
    struct mean *means = sg_alloc(e->ctx, SG_MEM_MODEL, most, sizeof(*means));
    int code = means ? SG_OK : SG_ERR_BUDGET;
    size_t count = 0, to = 0;
    for (size_t v = 0; v < n && !code; v++)
        if (!(code = sg_progress(e->ctx, SG_STAGE_EVALUATE, v, n)))
            code = add_view(b, &views[v].camera, look_of(photos, appearance, v), means);
    for (size_t i = 0; i < most && !code; i++)
        count += opacity_of(&means[i]) >= LEAST_OPACITY;
    if (!code && !count)
        code = sg_fail(e->ctx, SG_ERR_INPUT, "model: found no Gaussian in any of %zu views", n);
    if (!code)
        code = sg_model_create(e->ctx, count, 0, out);
    for (size_t i = 0; i < most && !code; i++)
        if (opacity_of(&means[i]) >= LEAST_OPACITY)
            put(&means[i], *out, to++);
    sg_free(means);
    size_t gaussian;
    int plane;
    if (!code && sg_model_find_nonfinite(*out, &gaussian, &plane)) {
        code = sg_fail(e->ctx, SG_ERR_INPUT,
                       "model: found an anchor whose Gaussians are not finite in some view");
        sg_model_destroy(out);
    }
    return code;
}

int sg_model_bake(sg_ctx *ctx, const struct sg_model *model, const struct sg_view *views, size_t n,
                  const size_t *photos, int appearance, struct sg_model **out)
{
    struct sg_engine *e = NULL;
    sg_clear_error(ctx);
    *out = NULL;
    if (!sg_model_has_anchors(model))
        return sg_fail(ctx, SG_ERR_USAGE, "model: found Gaussians, expected anchors");
    int code = sg_engine_create(ctx, "cpu", NULL, &e); /* which has its model in host memory */
    if (!code)
        code = sg_scaffold_wrap(ctx, &e);
    if (!code)
        code = sg_engine_upload(e, model, model->columns);
    if (!code)
        code = bake(e, views, n, photos, appearance, out);
    sg_engine_destroy(&e);
    return code;
}
