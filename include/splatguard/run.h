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
    const char *init;             /* PLY of the model to start from; NULL = points of the scene */
    struct sg_scene_params scene; /* eval: the test views are held out and measured */
    /* tolerance, and rho, rho_least, frequency and lambda of its defense may be SG_TOLERANCE_AUTO
     * or SG_TOLERANCE_PRESET and SG_PRESET_*: the default. */
    struct sg_train_params train;
    enum sg_run_preset preset; /* Default SG_RUN_PRESET_AUTO. */
    enum sg_run_audit audit;   /* Default SG_RUN_AUDIT_OFF. */
    int save_every;      /* iterations between checkpoints, 0 = at the end only. Default 7000. */
    int eval_every;      /* between measurements, likewise. Default 7000. */
    int log_every;       /* between lines of log.jsonl, 1..10 million. Default 100. */
    uint64_t max_memory; /* for config.json and summary.json: what the user allowed the process. The
                            context's own limit is what binds. Default 0. */
};
SG_API struct sg_run_params sg_run_params_default(void);

/* The options of struct sg_run_params itself. Its scene and train have their own tables. */
SG_API const struct sg_option *sg_run_options(void);

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
    const char *proxy;  /* PLY or run folder; NULL = one is trained */
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
    uint64_t max_memory;  /* see sg_run_params */
    bool keep_decoy;      /* writes attack/decoy.ply. Default false. */
};
SG_API struct sg_attack_run_params sg_attack_run_params_default(void);

/* The options of struct sg_attack_run_params itself. Its scene and attack have their own tables. */
SG_API const struct sg_option *sg_attack_run_options(void);

#ifdef __cplusplus
}
#endif

#endif
