/* SPDX-License-Identifier: Apache-2.0 */
/* The weight of a photo in the verdict on a set. */
#ifndef SG_DEFENSE_AUDIT_PHOTO_H
#define SG_DEFENSE_AUDIT_PHOTO_H

#include <math.h>

#include "splatguard/audit.h"

/* Masks outline objects. A mask in which more than this share of the pixels is border could hide
 * any pattern from the audit. */
#define SG_AUDIT_RAGGED 0.25

/* Its vote, 0..1: less for photos with less than 100 x 100 pixels of content, 0 for blank ones. So
 * photos without content cannot outvote others. */
static inline double sg_audit_vote(const struct sg_audit_features *f)
{
    return fmin(f->content / 1e4, 1);
}

/* A score that no clean photo had, but most photos of a strong poison have. Clean photos cannot
 * outvote these, since photos that do not show the scene do not weaken an attack. */
#define SG_AUDIT_CERTAIN 0.99

#endif
