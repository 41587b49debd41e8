/* SPDX-License-Identifier: Apache-2.0 */
/* How much the defense's filter removes where its share follows growth: of every strategy that
 * grows and has the filter. */
#ifndef SG_TRAIN_FILTERING_H
#define SG_TRAIN_FILTERING_H

#include "defense/filter.h"
#include "trainer.h"

/* Largest share that is replaced at a densification where a budget binds. */
#define SG_REPLACED 0.03f

/* Of sg_densify_params: the scores that decide who makes room, as params.at_limit of the trainer
 * says. arg: this. */
struct sg_limit_call {
    sg_trainer *t;
    const struct sg_render_params *render;
    int it;
};
int sg_filtering_at_limit(void *arg, struct sg_scores *out);

/* A strategy's memory of it: numbers without padding, for checkpoints. */
struct sg_filtering {
    double growth;         /* share of the Gaussians that grow at a densification, smoothed */
    uint64_t growths;      /* densifications in the filter's window since its newest removal */
    uint64_t filter_first; /* Gaussians before its first removal; 0 = none yet */
};

/* Of sg_strategy: state is a struct sg_filtering. */
bool sg_filtering_sound(const void *state, int iteration);
/* A densification let this share of the Gaussians grow. */
void sg_filtering_grown(const sg_trainer *t, struct sg_filtering *s, int it, double share);
/* Whether the filter removes in the step from iteration `before` to `it`. */
bool sg_filtering_due(const sg_trainer *t, const struct sg_filtering *s, int before, int it,
                      bool densifies);
/* The share of the next pass, and its iteration; 0 where no pass is left. Where the share follows
 * growth and nothing has grown since the newest pass: as if it had grown once. */
double sg_filtering_next(const sg_trainer *t, int *next);
/* Removes, and fills what `step` tells about that. */
int sg_filtering_run(sg_trainer *t, struct sg_filtering *s, int it,
                     const struct sg_render_params *render, struct sg_defense_step *step);

#endif
