/* SPDX-License-Identifier: Apache-2.0 */
/* One photo of an audit: its features, and its weight in the verdict on a set. */
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

/* sg_audit_measure for worker threads and within other calls: it does not clear an error. */
int sg_audit_features_of(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width,
                         int height, struct sg_audit_features *out, float *map);

#endif
