/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/render.h"

#include "backend/backend.h"

struct sg_renderer {
    sg_ctx *ctx;
    struct sg_backend *backend;
    struct sg_render_params params;
    int degree;
};

int sg_renderer_create(sg_ctx *ctx, const char *backend, const char *cpu, const struct sg_model *model,
                       const struct sg_render_params *params, sg_renderer **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    sg_renderer *r = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*r));
    if (!r)
        return SG_ERR_BUDGET;
    r->ctx = ctx;
    r->params = params ? *params : *sg_render_params();
    r->degree = model->active_sh_degree;
    int code = sg_backend_create(ctx, backend ? backend : "cpu", cpu, &r->backend);
    if (!code)
        code = r->backend->ops->upload(r->backend, model, NULL);
    if (code) {
        sg_renderer_destroy(&r);
        return code;
    }
    *out = r;
    return SG_OK;
}

void sg_renderer_destroy(sg_renderer **renderer)
{
    if (!renderer || !*renderer)
        return;
    sg_backend_destroy(&(*renderer)->backend);
    sg_free((*renderer)->ctx, *renderer);
    *renderer = NULL;
}

int sg_render(sg_renderer *r, const struct sg_camera *camera, float *rgb, float *alpha, float *depth,
              struct sg_render_stats *stats)
{
    sg_clear_error(r->ctx);
    if (camera->width < 1 || camera->height < 1 || camera->width > 16384 || camera->height > 16384)
        return sg_fail(r->ctx, SG_ERR_USAGE, "render: found an image of %d x %d, expected sides of 1 to 16384",
                       camera->width, camera->height);
    if (!(camera->fx > 0) || !(camera->fy > 0))
        return sg_fail(r->ctx, SG_ERR_USAGE, "render: found focal lengths %g and %g, expected positive ones",
                       camera->fx, camera->fy);
    const struct sg_backend_ops *ops = r->backend->ops;
    int code = ops->project(r->backend, camera, r->degree, &r->params);
    if (!code)
        code = ops->rasterize(r->backend, alpha || depth, stats);
    return code ? code : ops->read_image(r->backend, rgb, alpha, depth);
}
