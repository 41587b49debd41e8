/* SPDX-License-Identifier: Apache-2.0 */
#include "renderer.h"

#include <limits.h>

#include "engine/scaffold/scaffold.h"
#include "model/anchors.h"
#include "option/option.h"
#include "scene/reader.h"

struct sg_renderer {
    sg_ctx *ctx;
    struct sg_engine *engine;
    bool borrowed, drawn;
    struct sg_render_params params;
    size_t index;  /* of the view in a list */
    size_t photo;  /* whose appearance it has; SIZE_MAX: by params */
    int degree;    /* drawn */
    int sh_degree; /* of the model */
};

int sg_renderer_borrow(struct sg_engine *engine, int sh_degree,
                       const struct sg_render_params *params, sg_renderer **out)
{
    *out = sg_alloc(sg_engine_ctx(engine), SG_MEM_MISC, 1, sizeof(**out));
    if (!*out)
        return SG_ERR_BUDGET;
    **out = (struct sg_renderer){.ctx = sg_engine_ctx(engine),
                                 .engine = engine,
                                 .borrowed = true,
                                 .params = *params,
                                 .index = SIZE_MAX,
                                 .photo = SIZE_MAX,
                                 .degree = sh_degree};
    return SG_OK;
}

struct sg_render_params sg_render_params_default(void)
{
    return (struct sg_render_params){SG_RENDER_DEFAULTS};
}

int sg_render_check_appearance(sg_ctx *ctx, const struct sg_model *model,
                               const struct sg_render_params *params)
{
    const size_t learned = sg_model_appearances(model);
    const int wanted = params->appearance;
    char found[32];
    sg_clear_error(ctx);
    if (wanted >= 0 ? (size_t) wanted < learned : learned > 0)
        return SG_OK;
    sg_option_get(sg_option_find(sg_render_options(), "appearance"), params, found, sizeof(found));
    return learned ? sg_fail(ctx, SG_ERR_USAGE,
                             "appearance: found %s, expected a photo from 0 to %zu, or index, mean "
                             "or zero",
                             found, learned - 1)
                   : sg_fail(ctx, SG_ERR_USAGE,
                             "appearance: found %s, expected none: the model has no appearances of "
                             "photos",
                             found);
}

static int check_background(sg_ctx *ctx, const float background[3])
{
    for (int ch = 0; ch < 3; ch++)
        if (!(background[ch] >= 0 && background[ch] <= 1))
            return sg_fail(ctx, SG_ERR_USAGE, "background[%d]: found %g, expected 0 to 1", ch,
                           (double) background[ch]);
    return SG_OK;
}

static int hold_model(sg_ctx *ctx, const char *name, const char *cpu, const struct sg_model *model,
                      struct sg_engine **out)
{
    int code = sg_engine_create(ctx, name, cpu, out);
    if (!code && sg_model_has_anchors(model))
        code = sg_scaffold_wrap(ctx, out);
    if (!code)
        code = sg_engine_upload(*out, model, model->columns);
    if (code)
        sg_engine_destroy(out);
    return sg_engine_give_way(ctx, name, cpu, code) ? hold_model(ctx, name, cpu, model, out) : code;
}

int sg_renderer_create(sg_ctx *ctx, const char *engine, const char *cpu,
                       const struct sg_model *model, const struct sg_render_params *params,
                       sg_renderer **out)
{
    const struct sg_render_params defaults = sg_render_params_default();
    sg_clear_error(ctx);
    *out = NULL;
    struct sg_engine *e = NULL;
    params = params ? params : &defaults;
    int code = sg_check_options(ctx, sg_render_options(), params);
    if (!code)
        code = check_background(ctx, params->background);
    if (!code)
        code = hold_model(ctx, engine, cpu, model, &e);
    if (!code)
        code = sg_renderer_borrow(e, model->active_sh_degree, params, out);
    if (code)
        sg_engine_destroy(&e);
    else {
        (*out)->borrowed = false;
        (*out)->sh_degree = model->sh_degree;
    }
    return code;
}

void sg_renderer_destroy(sg_renderer **renderer)
{
    if (!renderer || !*renderer)
        return;
    if (!(*renderer)->borrowed)
        sg_engine_destroy(&(*renderer)->engine);
    sg_free(*renderer);
    *renderer = NULL;
}

void sg_renderer_set_index(sg_renderer *r, size_t index)
{
    r->index = index;
}

void sg_renderer_set_photo(sg_renderer *r, size_t photo)
{
    r->photo = photo;
}

int sg_render(sg_renderer *r, const struct sg_camera *camera, float *rgb, float *alpha,
              float *depth, struct sg_render_stats *stats)
{
    sg_clear_error(r->ctx);
    int code = sg_camera_check(r->ctx, camera, SG_ERR_USAGE, "render");
    if (code)
        return code;
    struct sg_render_params params = r->params;
    if (params.appearance == SG_APPEARANCE_INDEX && r->index <= INT_MAX)
        params.appearance = (int) r->index;
    if (r->photo <= INT_MAX)
        params.appearance = (int) r->photo;
    if (r->borrowed) /* renders of a borrowed engine do not count in the owner's times */
        sg_engine_stop_clocks(r->engine, true);
    code = sg_engine_draw(r->engine, camera, r->degree, &params, alpha || depth);
    if (!code)
        code = sg_engine_read_image(r->engine, rgb, alpha, depth);
    struct sg_step step;
    if (!code && stats && !(code = sg_engine_read_step(r->engine, &step)))
        *stats = step.stats;
    if (r->borrowed)
        sg_engine_stop_clocks(r->engine, false);
    r->drawn = !code;
    return code;
}

int sg_render_backward(sg_renderer *r, const float *gradient, struct sg_model *out)
{
    sg_clear_error(r->ctx);
    if (r->borrowed)
        return sg_fail(r->ctx, SG_ERR_USAGE,
                       "render: found the renderer of a trainer, expected one of a model");
    if (sg_engine_each(r->engine) > 1)
        return sg_fail(r->ctx, SG_ERR_USAGE,
                       "render: found a model of anchors, expected one of Gaussians");
    if (!r->drawn)
        return sg_fail(r->ctx, SG_ERR_USAGE,
                       "render: found no view that was drawn, expected sg_render before");
    if (out->count != sg_engine_count(r->engine) || out->sh_degree != r->sh_degree)
        return sg_fail(r->ctx, SG_ERR_USAGE,
                       "render: found %zu Gaussians of SH degree %d for gradients, expected %zu of "
                       "degree %d",
                       out->count, out->sh_degree, sg_engine_count(r->engine), r->sh_degree);
    int code = sg_engine_write_image_gradient(r->engine, gradient);
    if (!code)
        code = sg_engine_raster_backward(r->engine);
    if (!code)
        code = sg_engine_project_backward(r->engine, false);
    if (!code)
        code = sg_engine_read_gradients(r->engine, out);
    return code;
}
