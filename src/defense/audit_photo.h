/* SPDX-License-Identifier: Apache-2.0 */
/* What one photo is worth in the judgement of a set. */
#ifndef SG_DEFENSE_AUDIT_PHOTO_H
#define SG_DEFENSE_AUDIT_PHOTO_H

#include <math.h>

#include "splatguard/audit.h"

/* Masks outline things. One in which this share of the pixels is border can hide any pattern from
 * us. */
#define SG_AUDIT_RAGGED 0.25

/* Its vote, 0..1: photos with less than 100 x 100 pixels of content have less of one, blank ones
 * none, so that it takes content to outvote others. */
static inline double sg_audit_vote(const struct sg_audit_features *f)
{
    return fmin(f->content / 1e4, 1);
}

/* A score that no clean photo had, and most of a strong poison's have. Clean photos cannot outvote
 * these: they may look away from the scene, and then take nothing from the attack. */
#define SG_AUDIT_CERTAIN 0.99

#endif
