/* SPDX-License-Identifier: Apache-2.0 */
/* Scores of all Gaussians of a model: what published methods prune by. */
#ifndef SG_PRUNE_SCORE_H
#define SG_PRUNE_SCORE_H

#include "engine/engine.h"
#include "splatguard/prune.h"

/* LightGaussian's, of the model that an engine holds, which `model` is a copy of. *unseen: the
 * Gaussians that no view shows. */
int sg_lightgaussian(struct sg_engine *engine, const struct sg_scene *scene,
                     const struct sg_model *model, const struct sg_prune_params *params,
                     const struct sg_render_params *render, double *score, size_t *unseen);

/* The factor of each Gaussian's volume in its score; volume: n of them. SG_ERR_BUDGET. */
int sg_volume_factors(sg_ctx *ctx, const struct sg_prune_params *params, const double *volume,
                      size_t n, double *factor);

/* PUP 3D-GS's. *unseen: the Gaussians that no view shows. Others have the score of these where the
 * views do not determine all of a position and a size. */
int sg_pup(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *model,
           const struct sg_prune_params *params, double *score, size_t *unseen);

/* The Fisher information itself, for tests: 36 values, a symmetric matrix, per Gaussian. */
int sg_pup_fisher(sg_ctx *ctx, const struct sg_camera *const *views, size_t n,
                  const struct sg_model *model, const struct sg_prune_params *params,
                  double *fisher);

/* ln det of a symmetric positive semidefinite matrix of 6 x 6; -INFINITY for a singular one, NAN
 * for one with a value that is not finite. */
double sg_log_det6(const double *matrix);

/* Which Gaussians stay after a round: clears the bytes of those with at most the score at rank
 * trunc(ratio (n - 1)), where NAN is the highest score. One stays in any case. Returns how many are
 * cleared. sorted: room for n values. */
size_t sg_prune_choose(const double *score, size_t n, double ratio, double *sorted, uint8_t *keep);

#endif
