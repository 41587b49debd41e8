/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SPECTRAL_PLANS_H
#define SG_SPECTRAL_PLANS_H

#include "anisotropy.h"

/* Anisotropy plans for the newest few image sizes; start zeroed. Thread safety: unsafe. */
#define SG_PLANS 4
struct sg_plans {
    struct sg_plan {
        int width, height;
        unsigned used;
        struct sg_anisotropy *plan;
    } sizes[SG_PLANS];
    unsigned clock;
};

/* The plan for a size. The cache owns it, and it is valid until the next call. params, fft: the
 * same in all calls; may be NULL. Errors: SG_ERR_BUDGET. */
int sg_plans_find(sg_ctx *ctx, struct sg_plans *plans, const struct sg_anisotropy_params *params,
                  const struct sg_fft_kernels *fft, int width, int height,
                  struct sg_anisotropy **out);
void sg_plans_clear(struct sg_plans *plans);

#endif
