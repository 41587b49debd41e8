/* SPDX-License-Identifier: Apache-2.0 */
/* An attack in progress, and its files: attack/log.jsonl, the poisoned scene, poison.json. */
#ifndef SG_RUN_ATTACK_H
#define SG_RUN_ATTACK_H

#include "attack/attack.h"
#include "files.h"
#include "output.h"
#include "splatguard/run.h"

struct attack_run {
    sg_ctx *ctx;
    const struct sg_attack_run_params *params;
    struct sg_attack_params attack_params; /* with the preset applied */
    bool resume;
    bool keeps_earlier; /* what is replaced stays until the proxy is trained */
    struct sg_scene *scene;
    sg_attack *attack;
    bool has_proxy;    /* it was trained, to the end */
    const char *proxy; /* path of its model */
    size_t proxy_gaussians;
    struct sg_run_log log;
    struct sg_attack_step step; /* newest */
    int logged;                 /* iteration of the newest line */
    int checkpoint;             /* iteration of the newest one, 0: none */
    bool stopped;               /* by the caller */
    struct {
        double seconds, inner_seconds, inner_bytes;
        uint64_t max_gaussians, peak_rss; /* bytes */
    } totals; /* of the whole attack: a resumed attack starts from those in its log */
    struct sg_attack_run_status *status;
};

/* Whether the caller wants to stop. */
bool sg_attack_ask(struct attack_run *r, const struct sg_attack_step *step);

int sg_attack_open_log(struct attack_run *r); /* resuming: removes later lines */
int sg_attack_log_step(struct attack_run *r);

/* The poisoned scene, then poison.json. */
int sg_attack_write(struct attack_run *r);

#endif
