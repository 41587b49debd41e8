/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_BEGIN_H
#define SG_BEGIN_H

#include "trainer.h"

/* Gives the backend its Gaussians: those of `initial`, or the scene's points or random ones where it is NULL. */
int sg_begin(sg_trainer *t, const struct sg_model *initial);

/* Takes Gaussians away, evenly, where a checkpoint brought more than the limits allow now. */
int sg_thin_out(sg_trainer *t);

#endif
