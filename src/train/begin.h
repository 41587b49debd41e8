/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_BEGIN_H
#define SG_BEGIN_H

#include "trainer.h"

/* The k-th of `limit` items taken evenly out of n. */
size_t sg_evenly(size_t n, size_t k, size_t limit);

/* Whether a run without an initial model begins with random points, and half of the side of the
 * cube that they are drawn from. */
bool sg_begins_random(const struct sg_scene *scene, const struct sg_train_params *p);
float sg_random_half_side(const struct sg_scene *scene, const struct sg_train_params *p);

/* Gives the engine its Gaussians: those of `initial`, or the scene's points or random ones where it
 * is NULL. */
int sg_trainer_init_model(sg_trainer *t, const struct sg_model *initial);

/* How many of a checkpoint's n Gaussians the run keeps: fewer where the limits have become tighter
 * by more than those of memory vary from run to run, which then follow the checkpoint. */
size_t sg_trainer_fit_count(sg_trainer *t, size_t n);

#endif
