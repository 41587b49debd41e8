/* SPDX-License-Identifier: Apache-2.0 */
/* The 3D filter of Mip-Splatting: its standard deviation follows from the camera that sees a
 * Gaussian from nearest, in the order of operations of the released code. */
#include <math.h>
#include <string.h>

#include "host_model.h"
#include "math/constants.h"

#define CHUNK 4096
#define MARGIN 0.15 /* of an image's sides, beyond its edges */
#define FACTOR 0.2f /* variance, squared pixels of the largest focal length */

struct filter_job {
    const struct sg_host_model *h;
    const struct sg_camera *const *cameras;
    size_t n;
    float *filter; /* the least depth; INFINITY where no camera sees it */
};

static bool sees(const struct sg_camera *c, const float *p, float *depth)
{
    const double x = (double) p[0], y = (double) p[SG_LANES], z = (double) p[2 * SG_LANES];
    const double cz = c->R[6] * x + c->R[7] * y + c->R[8] * z + c->t[2], iz = 1 / fmax(cz, 0.001);
    const double u = c->fx * (c->R[0] * x + c->R[1] * y + c->R[2] * z + c->t[0]) * iz + c->cx,
                 v = c->fy * (c->R[3] * x + c->R[4] * y + c->R[5] * z + c->t[1]) * iz + c->cy;
    *depth = (float) cz;
    return cz > (double) SG_Z_MIN && u >= -MARGIN * c->width && u <= (1 + MARGIN) * c->width &&
           v >= -MARGIN * c->height && v <= (1 + MARGIN) * c->height;
}

static void filter_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct filter_job *j = arg;
    const struct sg_host_model *h = j->h;
    const size_t end = (chunk + 1) * CHUNK < h->count ? (chunk + 1) * CHUNK : h->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        const float *p = h->at[SG_C_PARAMETERS] + sg_param_index(h->planes, i, SG_P_XYZ);
        float least = INFINITY, depth;
        for (size_t k = 0; k < j->n; k++)
            if (sees(j->cameras[k], p, &depth))
                least = fminf(least, depth);
        j->filter[i] = least;
    }
}

int sg_host_filter(sg_ctx *ctx, struct sg_host_model *h, const struct sg_camera *const *cameras,
                   size_t n)
{
    struct filter_job job = {h, cameras, n, NULL};
    float most = 0, focal = 0;
    job.filter = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, h->count, sizeof(float));
    if (!job.filter || sg_host_alloc(ctx, h, SG_C_FILTER)) {
        sg_free(job.filter);
        return SG_ERR_BUDGET;
    }
    sg_parallel_for(ctx, (h->count + CHUNK - 1) / CHUNK, filter_chunk, &job);
    for (size_t k = 0; k < n; k++)
        focal = fmaxf(focal, (float) cameras[k]->fx);
    for (size_t i = 0; i < h->count; i++)
        most = isfinite(job.filter[i]) ? fmaxf(most, job.filter[i]) : most;
    for (size_t i = 0; i < h->count && most > 0; i++) /* none is seen: as before */
        h->at[SG_C_FILTER][i] =
            (isfinite(job.filter[i]) ? job.filter[i] : most) / focal * sqrtf(FACTOR);
    sg_free(job.filter);
    return SG_OK;
}
