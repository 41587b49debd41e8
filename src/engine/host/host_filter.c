/* SPDX-License-Identifier: Apache-2.0 */
/* The 3D filter of Mip-Splatting: its standard deviation follows from the camera that sees a
 * Gaussian from nearest, in the order of operations of the released code. */
#include <math.h>
#include <string.h>

#include "host_model.h"
#include "math/real_f64.h"

#include "math/mip.h"

#define CHUNK 4096

struct filter_job {
    const struct sg_host_model *h;
    const double (*cameras)[SG_MIP_CAMERA];
    size_t n;
    double margin;
    float *nearest; /* the least depth */
};

static void filter_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct filter_job *j = arg;
    const struct sg_host_model *h = j->h;
    const size_t end = (chunk + 1) * CHUNK < h->count ? (chunk + 1) * CHUNK : h->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        const float *p = h->at[SG_C_PARAMETERS] + sg_param_index(h->planes, i, SG_P_XYZ);
        const double xyz[3] = {(double) p[0], (double) p[SG_LANES], (double) p[2 * SG_LANES]};
        float least = MIP_UNSEEN;
        for (size_t k = 0; k < j->n; k++) {
            const float depth = (float) mip_depth(j->cameras[k], xyz, j->margin);
            if (depth > 0 && depth < least)
                least = depth;
        }
        j->nearest[i] = least;
    }
}

float sg_host_filter_cameras(const struct sg_camera *const *cameras, size_t n,
                             double (*out)[SG_MIP_CAMERA])
{
    float focal = 0;
    for (size_t k = 0; k < n; k++) {
        const struct sg_camera *c = cameras[k];
        const double lens[6] = {c->fx, c->fy, c->cx, c->cy, c->width, c->height};
        memcpy(out[k], c->R, sizeof(c->R));
        memcpy(out[k] + 9, c->t, sizeof(c->t));
        memcpy(out[k] + 12, lens, sizeof(lens));
        focal = fmaxf(focal, (float) c->fx);
    }
    return focal;
}

int sg_host_filter(sg_ctx *ctx, struct sg_host_model *h, const struct sg_camera *const *cameras,
                   size_t n, const struct sg_mip_filter *filter)
{
    double(*numbers)[SG_MIP_CAMERA] = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*numbers));
    float *nearest = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, h->count, sizeof(*nearest)), most = 0;
    if ((n && !numbers) || !nearest || sg_host_alloc(ctx, h, SG_C_FILTER)) {
        sg_free(numbers);
        sg_free(nearest);
        return SG_ERR_BUDGET;
    }
    const float focal = sg_host_filter_cameras(cameras, n, numbers);
    sg_parallel_for(ctx, (h->count + CHUNK - 1) / CHUNK, filter_chunk,
                    &(struct filter_job){h, numbers, n, filter->margin, nearest});
    const float pixels = (float) sqrt(filter->variance);
    for (size_t i = 0; i < h->count; i++)
        most = nearest[i] < MIP_UNSEEN ? fmaxf(most, nearest[i]) : most;
    for (size_t i = 0; i < h->count && most > 0; i++) /* none is seen: as before */
        h->at[SG_C_FILTER][i] = mip_filter(fminf(nearest[i], most), focal, pixels);
    sg_free(numbers);
    sg_free(nearest);
    return SG_OK;
}
