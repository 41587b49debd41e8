/* SPDX-License-Identifier: Apache-2.0 */
/* A training in progress: from its photos to its files. */
#ifndef SG_RUN_TRAIN_H
#define SG_RUN_TRAIN_H

#include "folder.h"
#include "output.h"
#include "splatguard/eval.h"

/* Of the whole run: a resumed run starts from those in its log. */
struct run_totals {
    double seconds, cpu_seconds; /* of training alone, without evaluation and files */
    uint64_t max_gaussians, max_instances;
    uint64_t filter_events, filter_removed; /* of the defense */
    struct sg_train_times parts; /* seconds of the processes before; of the defense only */
};

struct sg_run {
    sg_ctx *ctx;
    struct sg_run_params params;  /* as config.json has them */
    struct sg_train_params train; /* as the trainer gets them: preset and audit are applied */
    bool resume;
    sg_output *output;
    struct sg_scene *scene;
    sg_trainer *trainer;
    struct sg_run_log log;
    struct run_totals totals;
    json_t *earlier;   /* summary.json of the processes before this one, or NULL */
    const char *audit; /* the verdict, or NULL */
    double audit_score;
    float *view_weights, *tolerances;    /* of each training view, from the audit, or NULL */
    double begun;                        /* on the monotonic clock */
    struct sg_train_step step;           /* newest */
    int before;                          /* iteration before it */
    int measured;                        /* iteration of which `step` has all values */
    bool stopped;                        /* by the caller */
    int ended_by;                        /* error that ended it early, or SG_OK */
    int write_error;                     /* of the first file that could not be written */
    char *write_message;                 /* what that said */
    bool log_lost;                       /* log.jsonl is one of them */
    int logged;                          /* iteration of the newest line */
    uint64_t log_instances;              /* the most in it */
    uint64_t cloned, split, pruned;      /* since then */
    size_t first_gaussians;              /* of the run, or of its log */
    size_t window_grown, window_removed; /* over the newest removals */
    int window_from, window_events;
    bool starves;             /* a warning about that was given */
    bool created;             /* its folder has files of this process */
    bool failed;              /* when opened or run */
    bool resumable;           /* the newest checkpoint is of the newest model */
    bool finished;            /* resumed, with nothing left to do */
    int saved;                /* iteration of the newest model that is saved, 0 = none */
    int model_saved;          /* iteration of one that was saved before what it changes */
    int checkpoint;           /* and of the newest checkpoint */
    int from;                 /* iteration that the process begins after */
    struct sg_eval eval;      /* newest measurement */
    const char *corrected_by; /* its corrected values, or NULL: it has none */
    int evaluated;            /* iteration of the newest in the log, 0 = none */
};

/* In the folder of an attack that is claimed already, if nested. */
int sg_run_open_in(sg_ctx *ctx, const struct sg_run_params *params, enum sg_run_start start,
                   bool nested, sg_run **out);

/* The defense that follows from parameters and photos: fills run->train. A resumed run has decided
 * whether there is one. */
int sg_run_decide_defense(sg_run *run);

/* Opens log.jsonl. When resuming, lines of iterations after the checkpoint go, and the totals come
 * from the last one left. */
int sg_run_open_log(sg_run *run);
/* What the engine has measured of the newest step, for which this waits. */
int sg_run_take_values(sg_run *run);
/* Once per iteration; does nothing the second time. The line is written when its values arrive. */
int sg_run_log_step(sg_run *run);
int sg_run_settle_log(sg_run *run, bool wait); /* as sg_run_log_settle, until a write fails */
int sg_run_log_filter(sg_run *run);
int sg_run_log_noise(sg_run *run);
int sg_run_log_eval(sg_run *run);

/* {"anisotropy": seconds, ...} of the defense's parts, of the whole run. The caller owns it. */
json_t *sg_run_defense_seconds(const sg_run *run);

int sg_run_write_summary(sg_run *run);
/* Iterations of the model that the run has, or ends with. */
int sg_run_done(const sg_run *run);

#endif
