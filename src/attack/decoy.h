/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_ATTACK_DECOY_H
#define SG_ATTACK_DECOY_H

#include "train/strategy.h"

/* Clones, splits and prunes as the default does, from the first interval to the last iteration,
 * with no reset of opacities: the decoy grows during the whole attack. */
extern const struct sg_strategy sg_strategy_decoy;

/* The same of anchors (Scaffold-GS): they grow and go as in training, and their networks learn in
 * each iteration. */
extern const struct sg_strategy sg_strategy_decoy_anchors;

#endif
