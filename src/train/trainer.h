/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_TRAINER_H
#define SG_TRAINER_H

#include "backend/backend.h"
#include "splatguard/train.h"

/* All of a run's state is here and in the backend; random draws depend on the iteration only. */
struct sg_trainer {
    sg_ctx *ctx;
    const struct sg_scene *scene;
    struct sg_train_params params;
    struct sg_backend *backend;
    double extent;
    int sh_degree;    /* stored */
    int start_degree; /* active at iteration 0 */
    int iteration;
    int adam_steps[SG_GROUPS];
    uint64_t epoch; /* that `order` is for */
    uint32_t *order;
};

/* The view of iteration it: every epoch visits all views in a random order. */
size_t sg_trainer_pick_view(sg_trainer *t, int it);

/* Advances the step counters of the groups that move and fills in their rates. */
void sg_trainer_adam(sg_trainer *t, const double lr[SG_GROUPS], bool hold_opacity, struct sg_update *u);

#endif
