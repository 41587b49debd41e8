/* SPDX-License-Identifier: Apache-2.0 */
/* The radii of Gaussians on the screen, for strategies that remove large ones. */
#include "math/real_f32.h"

#include "host_model.h"
#include "math/projection.h"
#include "math/tile_rect.h"

struct radius_job {
    const struct sg_host_model *h;
    struct pinhole view;
    int grid_x, grid_y;
};

#define CHUNK 4096

static void radius_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct radius_job *j = arg;
    const struct sg_host_model *h = j->h;
    const size_t end = (chunk + 1) * CHUNK < h->count ? (chunk + 1) * CHUNK : h->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        const float *p = sg_host_effective(h) + sg_param_index(h->planes, i, 0);
        float planes[SG_P_SH];
        struct splat s;
        struct projection projection;
        for (int k = 0; k < SG_P_SH; k++)
            planes[k] = p[k * SG_LANES];
        project(&j->view, planes + SG_P_XYZ, planes + SG_P_SCALE, planes + SG_P_ROT, &s,
                &projection);
        const struct tile_rect r = tile_rect_make(s.x, s.y, s.sigma, j->grid_x, j->grid_y);
        if (s.visible && r.x0 < r.x1 && r.y0 < r.y1)
            h->at[SG_C_RADIUS][i] = fmaxf(h->at[SG_C_RADIUS][i], (float) r.radius);
    }
}

int sg_host_count_radii(sg_ctx *ctx, struct sg_host_model *h, const struct sg_camera *camera,
                        float mip_kernel)
{
    const struct radius_job job = {h, view_make_mip(camera, mip_kernel),
                                   (camera->width + SG_TILE - 1) / SG_TILE,
                                   (camera->height + SG_TILE - 1) / SG_TILE};
    if (sg_host_alloc(ctx, h, SG_C_RADIUS))
        return SG_ERR_BUDGET;
    sg_parallel_for(ctx, (h->count + CHUNK - 1) / CHUNK, radius_chunk, (void *) &job);
    return SG_OK;
}
