/* SPDX-License-Identifier: Apache-2.0 */
/* How the set of Gaussians changes while a model learns. Each strategy is a file; the trainer calls
 * it through this table of functions. */
#ifndef SG_STRATEGY_H
#define SG_STRATEGY_H

#include <stdbool.h>
#include <stddef.h>

#include "splatguard/train.h"

struct sg_render_params;

/* What an iteration leaves out because of what the strategy does in it. */
struct sg_strategy_plan {
    bool rests;                     /* no parameter moves */
    bool rests_opacity;             /* opacities do not move */
    bool statistics;                /* the view counts in the statistics of densification */
    bool radii;                     /* and in the largest radii on the screen */
    float mean_opacity, mean_scale; /* weights of these in the loss, see sg_update */
};

/* A step goes from iteration `before` to `it`, which is more than one further where a run's time is
 * short. The random draws of a strategy depend on seed and iteration only. */
struct sg_strategy {
    const char *name; /* in checkpoints: at most 14 characters */
    /* What it remembers, in sg_trainer.strategy_state: numbers without padding, zero in a new run.
     * Checkpoints save it. 0: nothing. */
    size_t state_bytes;
    /* Optional: false for a state that cannot be, in a checkpoint of this iteration. */
    bool (*sound)(const void *state, int iteration);
    /* Its last tenth is as the rest: sg_train_params.tolerance_low_pass is off. */
    bool whole;
    /* Optional: makes the initial model of a new run, in place of Gaussians at the points. */
    int (*initial)(sg_trainer *t, struct sg_model **out);
    /* Optional: changes the initial model of a new run. */
    int (*begin)(sg_trainer *t);
    /* Optional: changes the learning rates of an iteration, one per enum sg_group. */
    void (*rates)(const sg_trainer *t, int before, int it, double *rates);
    /* Optional: what the next pass of the defense's filter removes, see sg_filtering_next. */
    double (*filter_next)(const sg_trainer *t, int *next);
    /* Before the update. */
    struct sg_strategy_plan (*plan)(const sg_trainer *t, int before, int it);
    /* Optional. After the update, with the plan of this step: edits the model. Fills what `out`
     * tells about that. */
    int (*after_step)(sg_trainer *t, const struct sg_strategy_plan *plan, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out);
};

/* Clones, splits, prunes and resets opacities as Kerbl et al. 2023 do; the frequency filter of the
 * defense removes. */
extern const struct sg_strategy sg_strategy_default;

/* Moves nearly transparent Gaussians to where opaque ones are, adds more of those up to a cap, and
 * lets positions explore (Kheradmand et al. 2024). */
extern const struct sg_strategy sg_strategy_mcmc;

/* The default with LightGaussian's pruning during training (Fan et al. 2024). */
extern const struct sg_strategy sg_strategy_lightgaussian;

/* Anchors that grow on grids, and the networks that make Gaussians of them (Lu et al. 2024). */
extern const struct sg_strategy sg_strategy_scaffold;

/* What `count` Gaussians in one place need each to look like one of this opacity: the opacity, and
 * *scale, the factor of its scales. */
double sg_mcmc_share(const struct sg_mcmc_params *p, double opacity, unsigned count, double *scale);
/* How many Gaussians n become in an edit. *bound: whether the budget keeps them from being more. */
size_t sg_mcmc_target(const sg_trainer *t, size_t n, bool *bound);

#endif
