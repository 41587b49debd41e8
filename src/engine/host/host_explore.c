/* SPDX-License-Identifier: Apache-2.0 */
/* What densification as Markov chain Monte Carlo does to a model in host memory. */
#include "core/rng.h"
#include "host_model.h"
#include "math/real_f32.h"

#include "math/explore.h"

void sg_host_relocate(struct sg_host_model *h, const struct sg_relocation *r)
{
    float *params = h->at[SG_C_PARAMETERS], *moments[] = {h->at[SG_C_MOMENT1], h->at[SG_C_MOMENT2]};
    for (size_t k = 0; k < r->count; k++) {
        float *to = params + sg_param_index(h->planes, r->to[k], 0);
        const float *from = params + sg_param_index(h->planes, r->from[k], 0);
        for (int p = 0; p < h->planes; p++)
            to[p * SG_LANES] = from[p * SG_LANES];
        to[SG_P_OPACITY * SG_LANES] = r->opacity[k];
        for (int p = SG_P_SCALE; p < SG_P_SCALE + 3; p++)
            to[p * SG_LANES] += r->scale[k];
        for (int m = 0; m < 2 && r->fresh[k]; m++)
            for (int p = 0; p < h->planes && moments[m]; p++)
                moments[m][sg_param_index(h->planes, r->to[k], p)] = 0;
    }
}

struct explore_job {
    const struct sg_host_model *h;
    struct sg_exploration how;
};

#define CHUNK 4096

static void explore_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct explore_job *j = arg;
    const struct sg_host_model *h = j->h;
    const size_t end = (chunk + 1) * CHUNK < h->count ? (chunk + 1) * CHUNK : h->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        float *p = h->at[SG_C_PARAMETERS] + sg_param_index(h->planes, i, 0), planes[SG_P_SH], n[3];
        const float gate = explore_gate(p[SG_P_OPACITY * SG_LANES], j->how.gate, j->how.dead);
        if (!(gate > 0))
            continue;
        for (size_t k = 0; k < SG_P_SH; k++)
            planes[k] = p[k * SG_LANES];
        for (size_t k = 0; k < 3; k++)
            n[k] = j->how.amount * gate *
                   sg_rng_normal(j->how.seed, SG_RNG_EXPLORE, j->how.stream, 3 * i + k);
        explore_move(planes + SG_P_ROT, planes + SG_P_SCALE, n, planes + SG_P_XYZ);
        for (size_t k = 0; k < 3; k++)
            p[(SG_P_XYZ + k) * SG_LANES] = planes[SG_P_XYZ + k];
    }
}

void sg_host_explore(sg_ctx *ctx, struct sg_host_model *h, const struct sg_exploration *x)
{
    sg_parallel_for(ctx, (h->count + CHUNK - 1) / CHUNK, explore_chunk,
                    &(struct explore_job){h, *x});
}
