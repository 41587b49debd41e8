/* SPDX-License-Identifier: Apache-2.0 */
/* Pixels where a Gaussian more or less hangs on rounding. Elsewhere engines agree closely. */
#ifndef TESTS_ENGINE_EDGES_H
#define TESTS_ENGINE_EDGES_H

#include "models.h"

#define mask real_mask /* a type there, and a name in tests */
#include "math/real_f64.h"

#include "engine/ref/render.h"
#undef mask

/* Counts the pixels where, by the oracle in double precision, an alpha or a transmittance is within
 * that share of its cut-off. edges, or NULL: of each pixel, whether it is one of them. */
static inline size_t find_edges(const struct sg_model *m, const struct sg_camera *camera,
                                const struct sg_render_params *params, double share, uint8_t *edges)
{
    const struct pinhole view = view_make_mip(camera, params->mip_kernel);
    const int grid_x = (camera->width + SG_TILE - 1) / SG_TILE,
              grid_y = (camera->height + SG_TILE - 1) / SG_TILE;
    const double alpha_min = (double) SG_ALPHA_MIN, t_min = (double) SG_T_MIN;
    struct ref_splat *splats = calloc(m->count, sizeof(*splats));
    struct ref_entry *list = calloc(m->count, sizeof(*list));
    assert_true(splats && list);
    for (size_t i = 0; i < m->count; i++) {
        double planes[SG_PARAMS_MAX] = {0};
        for (int p = 0; p < sg_param_count(m->sh_degree); p++)
            planes[p] = (double) *sg_model_at(m, i, p);
        ref_project(&view, planes, m->sh_degree, grid_x, grid_y, &splats[i]);
    }
    size_t found = 0;
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            const size_t n = ref_tile_list(splats, m->count, x / SG_TILE, y / SG_TILE, list);
            bool edge = false;
            double t = 1;
            for (size_t k = 0; k < n && t >= t_min; k++) {
                double dx, dy, gauss, alpha = 0;
                if (ref_pair(&splats[list[k].id], x, y, &dx, &dy, &gauss, &alpha))
                    t *= 1 - alpha;
                edge |= fabs(alpha - alpha_min) < share * alpha_min;
                edge |= fabs(t - t_min) < share * t_min;
            }
            found += edge;
            if (edges)
                edges[(size_t) y * (size_t) camera->width + (size_t) x] = edge;
        }
    free(splats);
    free(list);
    return found;
}

#endif
