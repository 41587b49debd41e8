/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_ATTACK_STATE_H
#define SG_ATTACK_STATE_H

#include "spectral/plans.h"
#include "splatguard/attack.h"
#include "train/trainer.h"

struct sg_attack {
    sg_ctx *ctx;
    struct sg_attack_params params;
    sg_trainer *trainer;            /* the decoy: its state and strategy, not its schedule */
    float *image, *photo, *scratch; /* 3 planes each of the largest view */
    double *rows;                   /* 3 sums per row of the highest view */
    float *extra;                   /* 3 more planes, with a spectral term */
    float *bound;                   /* a plane, with texture: the bound of each pixel */
    struct sg_plans plans;          /* of the spectral term */
    bool on_device;                 /* the newest step took its ascent there */
    double ascend_seconds;          /* of all ascents there, as far as they were known */
};

/* sg_attack_step without waiting for a device: loss to psnr and tv are of a step of a few
 * iterations ago, and inner_seconds is what became known since the last step. out: or NULL. */
int sg_attack_advance(sg_attack *attack, struct sg_attack_step *out);
/* Waits, and fills these in for the newest step, whose sg_attack_advance has filled in *step. */
int sg_attack_values(sg_attack *attack, struct sg_attack_step *step);
/* The same of a step whose number sg_attack_view has said after it: see sg_engine_read_view. `tv`
 * stays where the host knew it. */
uint64_t sg_attack_view(const sg_attack *attack);
int sg_attack_arrived(sg_attack *attack, uint64_t view, bool wait, struct sg_attack_step *step,
                      bool *known);

#endif
