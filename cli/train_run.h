/* SPDX-License-Identifier: Apache-2.0 */
/* A training in progress: from its photos to its files. */
#ifndef CLI_TRAIN_RUN_H
#define CLI_TRAIN_RUN_H

#include "progress.h"
#include "run_folder.h"

/* Of the whole run: a resumed one goes on from those in its log. */
struct train_totals {
    double seconds, cpu_seconds; /* of training alone, without evaluation and files */
    uint64_t max_gaussians, max_instances;
    uint64_t filter_events, filter_removed; /* of the defense */
    struct sg_train_times parts; /* seconds of the processes before; of the defense only */
};

struct train_run {
    struct train_config *config;
    sg_ctx *ctx;
    struct sg_scene *scene;
    struct sg_train_params train; /* what the trainer gets: presets and audit are applied */
    sg_trainer *trainer;
    FILE *log;
    char *log_path;
    struct progress progress;
    struct train_totals totals;
    const char *audit; /* the verdict, or NULL */
    double audit_score;
    float *view_weights, *tolerances;    /* of each training view, from the audit, or NULL */
    double begun;                        /* the command, on the monotonic clock */
    struct sg_train_step step;           /* newest */
    int before;                          /* iteration before it */
    int error;                           /* that ended it, or SG_OK */
    int trouble;                         /* exit code of the first file that could not be written */
    bool log_lost;                       /* log.jsonl is one of them */
    int logged;                          /* iteration of the newest line */
    uint64_t cloned, split, pruned;      /* since then */
    size_t first_gaussians;              /* of the run, or of its log */
    size_t window_grown, window_removed; /* over the newest removals */
    int window_from, window_events;
    bool starves;        /* and has been told so */
    bool created;        /* its folder has files of this process */
    bool resumable;      /* the newest checkpoint is of the newest model */
    bool finished;       /* resumed, with nothing left to do */
    int saved;           /* iteration of the newest model that is saved, 0 = none */
    struct sg_eval eval; /* newest measurement */
    int evaluated;       /* its iteration, 0 = none */
};

/* All of these return an exit code after printing what is wrong. */

/* Values that no run can have, before anything is read; and options of a defense that is not asked
 * for, unless
 * resumed. */
int train_check(const struct train_run *r, const bool *given);

/* What the preset decides where the options do not, as config.json keeps it. */
void train_settle_defense(struct train_config *c, const struct sg_defense_params *preset);

/* The defense that follows from the options and the photos. A resumed run has decided whether there
 * is one. */
int train_decide(struct train_run *r);

/* Trainer on the loaded scene, from points, a model or the checkpoint. variant: the CPU's when the
 * run began, or
 * NULL. */
int train_start(struct train_run *r, const char *variant);

/* All iterations that are left, with what is due between them and at the end; what there is, is
 * saved, interrupted or not. */
int train_whole(struct train_run *r);

/* Opens log.jsonl. When resuming, lines of iterations after the checkpoint go, and the totals come
 * from the last one left. */
int train_log_open(struct train_run *r);
int train_log_step(struct train_run *r); /* once per iteration; does nothing the second time */
int train_log_filter(struct train_run *r);
int train_log_eval(struct train_run *r);

/* {"anisotropy": seconds, ...} of the defense's parts, of the whole run. The caller owns it. */
json_t *train_log_parts(const struct train_run *r);

int train_summary_write(struct train_run *r);

#endif
