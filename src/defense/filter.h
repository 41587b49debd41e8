/* SPDX-License-Identifier: Apache-2.0 */
/* The defense in space: Gaussians are scored by their frequency and by what they contribute, and
 * the lowest are removed.
 *
 *     ln score = alpha ln(1 - exp(-2 pi^2 t^2 sigma^2)) + ln hits
 *
 * In logarithms and double precision: the thinnest Gaussians' weights are far below what 1 - exp
 * keeps in float. */
#ifndef SG_DEFENSE_FILTER_H
#define SG_DEFENSE_FILTER_H

#include "engine/engine.h"
#include "splatguard/defense.h"
#include "splatguard/scene.h"

/* ln of a Gaussian's weight; -INFINITY for one that has no thickness or no number for it. */
double sg_filter_log_weight(const struct sg_defense_params *p, float log_smallest);

/* Scores of all Gaussians, or of what the filter removes of anchors. All arrays: one value each. */
struct sg_scores {
    size_t count, unseen; /* unseen: without a hit, -INFINITY */
    bool sampled;         /* not all training views were counted */
    double *score;        /* ln; NULL: there are no scores */
    float *log_smallest;  /* decides between equal scores */
    uint64_t *keys;       /* scratch */
};

/* Room for n of each. SG_ERR_BUDGET. */
int sg_scores_create(sg_ctx *ctx, size_t n, struct sg_scores *out);
/* Entries of a row of the model: those of an anchor are its Gaussians with SG_UNIT_GAUSSIAN. */
size_t sg_filter_each(const struct sg_engine *engine, const struct sg_defense_params *p);

/* Counts hits over the sampled views of the scene at iteration it. An anchor has those of its
 * Gaussians, as p->anchor_sigma, anchor_hits, anchor_score and unit say. */
int sg_score(struct sg_engine *engine, const struct sg_scene *scene,
             const struct sg_defense_params *p, const struct sg_render_params *render,
             uint64_t seed, int it, struct sg_scores *out);
void sg_scores_clear(struct sg_scores *s);

/* The score at rank k (0: lowest) of all. */
double sg_scores_rank(const struct sg_scores *s, size_t k);

/* Clears the entries of the k lowest that are still set in keep, by score, then thickness, then
 * index. k: at most the number of those set. */
void sg_scores_remove(const struct sg_scores *s, size_t k, uint8_t *keep);

/* What a pass at iteration it that removes the share rho keeps of the entries; nothing is removed.
 * keep: s->count. SG_ERR_BUDGET. */
int sg_filter_choose(struct sg_engine *engine, const struct sg_defense_params *p,
                     const struct sg_scores *s, double rho, int it, uint8_t *keep);

/* Removes the share rho. out: all but the losses, in entries. */
int sg_filter(struct sg_engine *engine, const struct sg_scene *scene,
              const struct sg_defense_params *p, const struct sg_render_params *render, double rho,
              uint64_t seed, int it, struct sg_defense_step *out);

#endif
