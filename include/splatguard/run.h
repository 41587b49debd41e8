/* SPDX-License-Identifier: Apache-2.0 */
/* Runs: a training or an attack with its folder, from the photos to the last file. */
#ifndef SPLATGUARD_RUN_H
#define SPLATGUARD_RUN_H

#include "attack.h"
#include "audit.h"
#include "option.h"
#include "scene.h"
#include "train.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Which rho and lambda the defense has where the parameters leave them to the preset. */
enum sg_run_preset {
    SG_RUN_PRESET_AUTO, /* what sg_defense_automatic says of the photos */
    SG_RUN_PRESET_NS,   /* the published ones: see sg_defense_preset */
    SG_RUN_PRESET_TT,
    SG_RUN_PRESET_MIP
};

/* What the audit of the photos decides before training. */
enum sg_run_audit {
    SG_RUN_AUDIT_OFF,
    SG_RUN_AUDIT_WARN,   /* says what it finds */
    SG_RUN_AUDIT_REFUSE, /* the run ends where the photos look poisoned */
    SG_RUN_AUDIT_DEFEND  /* turns the defense on unless they look clean */
};

struct sg_run_params {
    const char *source;           /* folder of the scene */
    const char *folder;           /* of the run */
    const char *init;             /* run or model file to start from; NULL = points of the scene */
    struct sg_scene_params scene; /* eval: the test views are held out and measured */
    /* tolerance, and rho, rho_least, frequency and lambda of its defense may be SG_TOLERANCE_AUTO
     * or SG_TOLERANCE_PRESET and SG_PRESET_*: the default. The run itself sets white_background,
     * which is the scene's, tolerances, seconds_before and defense.view_weights. */
    struct sg_train_params train;
    enum sg_run_preset preset; /* Default SG_RUN_PRESET_AUTO. */
    enum sg_run_audit audit;   /* Default SG_RUN_AUDIT_OFF. */
    int save_every;      /* iterations between checkpoints, 0 = at the end only. Default 7000. */
    int eval_every;      /* between measurements, likewise. Default 7000. */
    int log_every;       /* between lines of log.jsonl, 1..10 million. Default 100. */
    uint64_t max_memory; /* for config.json and summary.json: what the user allowed the process. The
                            context's own limit is what binds. Default 0. */
    uint64_t max_vram;   /* likewise, of the memory of its device. Default 0. */
    /* NULL, or called after each iteration, and with step NULL before the first file is written.
     * A result other than 0 stops the run, which saves what there is. On a GPU most calls do not
     * wait for it: loss to psnr, render and the losses of the defense are then of an iteration a
     * few before. Default NULL. */
    int (*step)(void *priv, const struct sg_train_step *step);
    void *step_priv;
    void *texts; /* owns what sg_run_read_params has read; else NULL */
};
SG_API struct sg_run_params sg_run_params_default(void);

/* The options of struct sg_run_params itself. Its scene and train have their own tables. */
SG_API const struct sg_option *sg_run_options(void);

/* Whether an option that a user gave has no effect beside the other parameters: a row of any of the
 * three tables. The end of a message, "found without a defense, expected ...", which is static;
 * NULL where it has an effect. */
SG_API const char *sg_run_option_unused(const struct sg_run_params *params,
                                        const struct sg_option *option);

/* The parameters of the run in a folder, from its config.json; train.cpu is the variant that it
 * began with, folder is borrowed. Release *out with sg_run_params_clear, also after an error.
 * Errors: SG_ERR_INPUT for a folder without one, unknown options and values out of range;
 * SG_ERR_BUDGET. */
SG_API int sg_run_read_params(sg_ctx *ctx, const char *folder, struct sg_run_params *out);
/* The same for rendering: source and scene alone are read. A folder of another trainer will do:
 * its cfg_args is read instead, source is then NULL. */
SG_API int sg_run_read_scene(sg_ctx *ctx, const char *folder, struct sg_run_params *out);
SG_API void sg_run_params_clear(struct sg_run_params *params);

/* The exposures of views' photos, by the names of the views, from exposure.json of a run: n x 12
 * numbers, see sg_trainer_exposures. Errors: SG_ERR_INPUT, also where one is not there. */
SG_API int sg_run_read_exposures(sg_ctx *ctx, const char *folder, const struct sg_view *views,
                                 size_t n, float *out);

/* Whether a run could be opened with these parameters, as far as can be known before anything is
 * read. SG_ERR_USAGE; a message about a field begins with it ("defense.rho: ..."). */
SG_API int sg_run_check(sg_ctx *ctx, const struct sg_run_params *params);

/* The model of an iteration of a run (0 = the newest), or `path` itself if it is a file. Writes its
 * path to `out`. Errors: SG_ERR_INPUT where there is none, SG_ERR_BUDGET for more than `size`. */
SG_API int sg_run_find_model(sg_ctx *ctx, const char *path, int iteration, char *out, size_t size);

/* A run that is open: its folder is locked. Thread safety: unsafe. */
typedef struct sg_run sg_run;

enum sg_run_start {
    SG_RUN_NEW,     /* the folder must be new or empty, or hold a run without any result */
    SG_RUN_REPLACE, /* an earlier run in it goes */
    SG_RUN_RESUME /* goes on from its checkpoint, with parameters of sg_run_read_params: iterations,
                     limits, source, the three intervals, links and strictness may have changed */
};

/* Checks the parameters, locks the folder, loads the scene, audits it where they say so, decides
 * the defense, makes the trainer and writes what is known before training: config.json,
 * cameras.json, input.ply and cfg_args. What it finds on the way is logged to the context. `params`
 * and its texts must outlive the run; the caller closes *out. Errors: those of sg_scene_load,
 * sg_trainer_create and sg_trainer_resume; SG_ERR_INPUT for a folder that is in use, holds
 * something else or lies in a scene; SG_ERR_POISONED; SG_ERR_INTERRUPTED where `step` stopped it,
 * with nothing changed. */
SG_API int sg_run_open(sg_ctx *ctx, const struct sg_run_params *params, enum sg_run_start start,
                       sg_run **out);

/* Runs the remaining iterations, saving and evaluating on schedule, then writes model, checkpoint
 * and summary.json. Errors on the way that leave the training whole (a full disk) are logged as
 * warnings; the first of them is returned at the end. SG_ERR_INTERRUPTED: `step` or the context's
 * progress function stopped the run, and everything is saved. Where memory runs out, the model so
 * far is saved, the error is logged, and the result is SG_OK: see struct sg_run_status. */
SG_API int sg_run_train(sg_run *run);

struct sg_run_status {
    int iteration;           /* done */
    int iterations;          /* of the parameters */
    int saved;               /* iteration of the newest model in the folder, 0 = none */
    bool finished;           /* it was done already when it was opened: nothing is left to do */
    bool resumable;          /* the newest checkpoint is of the newest model */
    int ended_by;            /* error that ended it early with a model saved, or SG_OK */
    bool defended;           /* by the spectral defense: asked for, or turned on by the audit */
    uint64_t filter_removed; /* Gaussians that the defense's filter has removed, in all processes */
    struct sg_train_limits limits;
};
SG_API void sg_run_status(const sg_run *run, struct sg_run_status *out);

/* For `step` after sg_run_open, which may look at the model between two iterations: neither changes
 * the result. The scene belongs to the run. The renderer is that of sg_trainer_renderer, which the
 * caller destroys before `step` returns. */
SG_API const struct sg_scene *sg_run_scene(const sg_run *run);
SG_API int sg_run_renderer(sg_run *run, sg_renderer **out);
/* Likewise: sg_trainer_model and sg_trainer_scores. */
SG_API int sg_run_model(sg_run *run, struct sg_model **out);
SG_API int sg_run_scores(sg_run *run, double *score, double *hits, uint8_t *stays,
                         struct sg_filter_pass *next);

/* Unlocks the folder. A run that failed before its first save leaves nothing behind. NULL-safe;
 * sets *run to NULL. */
SG_API void sg_run_close(sg_run **run);

/* What summary.json says of a run. */
typedef struct sg_run_summary sg_run_summary;

/* The caller destroys *out. Errors: SG_ERR_INPUT, SG_ERR_BUDGET. */
SG_API int sg_run_summary_read(sg_ctx *ctx, const char *folder, sg_run_summary **out);
/* A number by its key, "psnr"; by keys in each other with a dot between: "stage_seconds.loss". true
 * and false are 1 and 0; NAN where there is no such number. */
SG_API double sg_run_summary_number(const sg_run_summary *summary, const char *key);
SG_API void sg_run_summary_destroy(sg_run_summary **summary);

enum sg_attack_method {
    SG_METHOD_POISON_SPLAT,
    SG_METHOD_NOISE, /* enum sg_naive_attack */
    SG_METHOD_TV_PER_VIEW,
    SG_METHOD_DRIFT
};
enum sg_attack_schedule {
    SG_SCHEDULE_AUTO, /* see sg_attack_preset */
    SG_SCHEDULE_NS,
    SG_SCHEDULE_MIP,
    SG_SCHEDULE_TT
};
enum sg_attack_views { SG_ATTACK_ALL_VIEWS, SG_ATTACK_TRAIN_VIEWS };

struct sg_attack_run_params {
    const char *source; /* folder of the scene */
    const char *folder; /* of the poisoned scene */
    const char *proxy;  /* run or model file; NULL = one is trained */
    struct sg_scene_params scene;
    /* iterations, inner and update_interval may be SG_ATTACK_BY_PRESET: the default. */
    struct sg_attack_params attack;
    struct sg_poison_files files;
    enum sg_attack_method method;   /* Default SG_METHOD_POISON_SPLAT. */
    enum sg_attack_schedule preset; /* Default SG_SCHEDULE_AUTO. */
    /* Which views are poisoned of COLMAP and nerfstudio scenes; test files of Blender scenes stay
     * clean. Default SG_ATTACK_ALL_VIEWS. */
    enum sg_attack_views views;
    float ratio;          /* share of the views to poison, drawn by seed, 0..1. Default 1. */
    float spare;          /* share of each photo, from the left, that stays, 0..1. Default 0. */
    int proxy_iterations; /* 1..10 million. Default 30000. */
    int save_every;       /* iterations between checkpoints; 0 = when stopped only. Default 5000. */
    uint64_t max_memory, max_vram; /* see sg_run_params */
    bool keep_decoy;               /* writes attack/decoy.ply. Default false. */
    /* NULL, or called after each iteration, and with step NULL where the attack can be stopped
     * between iterations. A result other than 0 stops it, with everything saved. On a GPU loss to
     * psnr, tv and inner_seconds are of an iteration a few before. Default NULL. */
    int (*step)(void *priv, const struct sg_attack_step *step);
    int (*proxy_step)(void *priv, const struct sg_train_step *step); /* of the proxy's training */
    void *step_priv;
    void *texts; /* owns what sg_attack_run_read_params has read; else NULL */
};
SG_API struct sg_attack_run_params sg_attack_run_params_default(void);

/* The parameters of the attack in a folder, from attack/config.json; folder is borrowed. Release
 * *out with sg_attack_run_params_clear, also after an error. Errors: as of sg_run_read_params. */
SG_API int sg_attack_run_read_params(sg_ctx *ctx, const char *folder,
                                     struct sg_attack_run_params *out);
SG_API void sg_attack_run_params_clear(struct sg_attack_run_params *params);

/* What an attack has done; valid from the first call of `step` on. */
struct sg_attack_run_status {
    int first, iterations; /* where it began or went on, and where it ends */
    bool finished;         /* resumed, with nothing left to do */
    bool resumable;        /* after an error: there is something to go on from */
};

/* Trains the proxy where none is given, runs the attack, writes the poisoned scene and poison.json.
 * While it runs, FOLDER/attack holds the proxy's run, the checkpoint and the log; poison.json comes
 * last and marks a finished attack. A finished one that is replaced stays until the new proxy is
 * trained. status may be NULL. Errors: those of sg_run_open, sg_run_train, sg_attack_create,
 * sg_attack_resume and sg_poisoned_scene_begin; SG_ERR_INTERRUPTED. After an error of a new attack
 * nothing of it is left unless it can be resumed. */
SG_API int sg_attack_run(sg_ctx *ctx, const struct sg_attack_run_params *params,
                         enum sg_run_start start, struct sg_attack_run_status *status);

/* The options of struct sg_attack_run_params itself. Its scene and attack have their own tables. */
SG_API const struct sg_option *sg_attack_run_options(void);

#ifdef __cplusplus
}
#endif

#endif
