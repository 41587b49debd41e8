/* SPDX-License-Identifier: Apache-2.0 */
/* An attack in progress, and what it leaves: attack/log.jsonl, the poisoned scene, poison.json. */
#ifndef CLI_ATTACK_RUN_H
#define CLI_ATTACK_RUN_H

#include "attack_config.h"
#include "progress.h"
#include "run_folder.h"

struct attack_run {
    struct attack_config *config;
    sg_ctx *ctx;
    struct sg_scene *scene;
    struct sg_attack_params params; /* with the preset applied */
    sg_attack *attack;
    const char *proxy; /* path of its model */
    size_t proxy_gaussians;
    bool lasting; /* there is something to go on from */
    FILE *log;
    char *log_path;
    struct progress progress;
    struct sg_attack_step step; /* newest */
    int logged;                 /* iteration of the newest line */
    struct {
        double seconds, inner_seconds, inner_bytes;
        uint64_t max_gaussians;
    } totals; /* of the whole attack: a resumed one goes on from those in its log */
};

/* These return an exit code after printing what is wrong. */
int attack_load(struct attack_run *r); /* the scene */

/* The scene is loaded and its preset applied. proxy: path of a model, or NULL to train one
 * first. */
int attack_whole(struct attack_run *r, const char *proxy);

int attack_log_open(struct attack_run *r); /* when resuming, lines after the checkpoint go */
int attack_log_step(struct attack_run *r);

/* The poisoned scene, then poison.json. */
int attack_write(struct attack_run *r);

#endif
