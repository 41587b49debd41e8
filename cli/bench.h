/* SPDX-License-Identifier: Apache-2.0 */
/* What `splatguard bench` and `report` share: the jobs of a plan and the database of their results.
 */
#ifndef CLI_BENCH_H
#define CLI_BENCH_H

#include "commands.h"

/* ---- plans ---- */

enum job_kind { JOB_SCENE, JOB_PROXY, JOB_POISON, JOB_TRAIN, JOB_PRUNE, JOB_PICTURES, JOB_AUDIT };
extern const char *const job_kinds[]; /* "scene", ... */

#define JOB_NEEDS 3

#define OFF "off"     /* the defense without any */
#define CLEAN "clean" /* photos as they are */

struct job {
    enum job_kind kind;
    char key[33];                                 /* of the configuration, what it needs included */
    const char *scene, *photos, *defense, *model; /* names of the plan; borrowed */
    int seed;
    json_t *config;     /* kind, options, and the keys of what it needs */
    const json_t *from; /* of the plan: the scene's object */
    /* Jobs that come first: the scene; the poison or run; the clean run, or of pictures the photos
     * that the run was trained on. */
    int needs[JOB_NEEDS];
    int n_needs;
};

/* What a plan asks for, by its names; two can be one job. An audit has no defense, model or seed.
 */
struct cell {
    const char *scene, *photos, *defense, *model;
    int seed, job;
};

struct plan {
    json_t *root;
    json_t *places; /* what scenes are read from, their links followed: the scene's name by path */
    char *name, *folder; /* of the file, without its ending; where its paths begin */
    struct job *jobs;    /* each after those that it needs */
    int n;
    struct cell *cells;
    int n_cells;
    int threads;        /* of each job */
    const char *engine; /* that draws, or NULL for the default; borrowed from root */
    bool alone;         /* one job at a time, so that times can be compared */
    double timeout;
    uint64_t memory; /* bytes resident of a job, 0 = no limit */
};

/* Reads a plan; says what is wrong with it. data: folder that paths of scenes are relative to, NULL
 * = the plan's. shard of shards: only the cells of every so many poisons, 0 of 1 = all. Returns an
 * exit code; clear it in any case. */
int plan_read(struct plan *plan, const char *path, const char *data, int shard, int shards);
void plan_clear(struct plan *plan);

/* Whether an option stands for so many times the Gaussians of the clean run: {clean}, {clean*X}. */
bool plan_limit(const char *text, double *factor);
bool options_limited(const json_t *options); /* whether a list has one */

/* The place of the first text in the list that is the same, or the list's length. */
size_t options_place(const json_t *options, const char *text);
/* Options of "--name value" lists, of which the later win; a new array. */
json_t *options_merge(const json_t *const *lists, int n);

/* The finaliser of splitmix64 (Steele et al. 2014). */
uint64_t splitmix(uint64_t x);

/* ---- pictures ---- */

enum picture_kind { PICTURE_PHOTO, PICTURE_RENDER, PICTURE_KINDS };
extern const char *const picture_kinds[PICTURE_KINDS]; /* "photo", "render" */
#define PICTURE_DIRECTIONS 36

struct picture {
    uint8_t *png; /* the middle of one view */
    size_t size;
    /* Means over all views, as of struct sg_spectrum. */
    double radial[SG_SPECTRUM_RINGS], angular[PICTURE_DIRECTIONS];
};

/* Of a model: the same views as photos and as renders. */
struct pictures {
    char view[256]; /* the one that is shown */
    struct picture kinds[PICTURE_KINDS];
};

/* Reads what `render --photo` wrote. Says what is wrong with it. Returns an exit code; clear it in
 * any case. */
int pictures_read(const char *folder, struct pictures *out);
void pictures_clear(struct pictures *pictures);

/* ---- results ---- */

struct outcome {
    const char *status; /* done, failed, crashed, timeout, memory */
    int exit_status, signal;
    char message[256];
    char started[32]; /* ISO 8601 */
    double seconds, cpu_seconds;
    uint64_t peak_rss;
    int beside; /* jobs at the same time, itself included */
    char *command;
    json_t *by; /* version, commit, machine and cores of what ran the first command */
    json_t *run_config, *summary, *eval; /* as their files have them, or NULL */
    json_t *photos;                      /* of an audit, or NULL */
    char *log;                           /* log.jsonl, or NULL */
    const char *shown;                   /* key of the job that `pictures` are of, or NULL */
    struct pictures pictures;
};

struct store;

/* Opens a database, which is made unless it must exist. Says what is wrong with one that is locked,
 * read-only, damaged or not ours. Returns an exit code. */
int store_open(const char *path, bool must_exist, struct store **out);
void store_close(struct store **store);
/* Which cells the plan has now. */
int store_cells(struct store *s, const struct plan *plan);
/* The status of a job, "" if it has none. number: NAN, or that metric of it. */
int store_status(struct store *s, const char *key, char status[16]);
double store_metric(struct store *s, const char *key, const char *name);
/* Replaces a job's rows in one transaction. A result stays where the job has run again, for those
 * that need what it made, and failed; the message says why. */
int store_put(struct store *s, const struct job *job, const struct outcome *o);

/* Whether a table has a column, which those of older databases can lack. */
int store_has(struct store *s, const char *table, const char *column, bool *has);

/* Calls row for each row of a query, with texts of its columns, NULL for null; a result other than
 * 0 stops. Returns an exit code. */
int store_query(struct store *s, const char *sql,
                int (*row)(void *arg, int columns, const char *const *values), void *arg);

/* ---- running ---- */

struct bench {
    struct plan *plan;
    struct store *store;
    const char *work; /* folder of what the jobs make */
    int jobs;         /* at the same time */
    uint64_t memory;  /* that all of them may have, 0 = any */
    bool retry, keep, quiet;
};

/* Runs what is missing. Returns an exit code. */
int bench_run(const struct bench *b);

#endif
