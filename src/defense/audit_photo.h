/* SPDX-License-Identifier: Apache-2.0 */
/* What one photo is worth in the judgement of a set. */
#ifndef SG_DEFENSE_AUDIT_PHOTO_H
#define SG_DEFENSE_AUDIT_PHOTO_H

#include "splatguard/audit.h"

/* Masks outline things. One in which this share of the pixels is border can hide any pattern from us. */
#define SG_AUDIT_RAGGED 0.25

/* Nothing in it varies, or a mask leaves nothing: it says nothing about the others, however many there are of it. */
static inline bool sg_audit_blank(const struct sg_audit_features *f)
{
    return !(f->tv_down + f->tv_across > 0) && f->ragged <= SG_AUDIT_RAGGED;
}

/* A score that no clean photo had, and most of a strong poison's have. Clean photos cannot outvote these: they may look
 * away from the scene, and then take nothing from the attack. */
#define SG_AUDIT_CERTAIN 0.99

#endif
