/* SPDX-License-Identifier: Apache-2.0 */
/* The parts of `splatguard report`: results by groups of seeds, tables, the page. */
#ifndef CLI_REPORT_H
#define CLI_REPORT_H

#include "bench.h"

/* ---- results ---- */

enum report_metric {
    M_MAX_GAUSSIANS,
    M_GAUSSIANS,
    M_PSNR,
    M_SSIM,
    M_FPS,
    M_SECONDS,
    M_MEMORY,
    M_RSS,
    M_THREADS,
    M_METRICS
};
extern const struct metric_column {
    const char *name;         /* in the CSV */
    const char *first, *then; /* of the database's table `metric`: the second where there is no
                                 first */
    double unit;
    int digits;
} metric_columns[M_METRICS];

struct result {
    char *plan, *scene, *photos, *defense, *model, *key, *status, *message, *commit, *machine,
        *engine;
    int seed, alone;
    bool common;                      /* all that has results of its scene has one with this seed */
    double seconds, value[M_METRICS]; /* NAN: not known */
    const struct result *next;        /* of its group */
    bool fresh;                       /* of the database that is read now */
    struct result *same;              /* another fresh one with this key, or NULL */
};

/* Two names of a plan can be one job. More cells of one job than these have neither curves,
 * pictures nor scores of photos: the page is never much larger than its database. */
#define CELLS_OF_JOB 8

/* The seeds of one scene, photos, defense and model. */
struct group {
    const struct result *first; /* others follow by `next` */
    struct result *last;
    int cells, runs; /* asked for, done */
    double mean[M_METRICS], deviation[M_METRICS];
    int common;      /* runs with seeds that every group of the scene has */
    const char *why; /* a status other than done, or NULL */
};

/* A run as the paper prints it; 0: not printed. */
struct paper_row {
    const char *scene, *photos, *defense, *model;
    double gaussians; /* most, millions */
    double megabytes, minutes, fps, psnr, ssim;
};

/* A job that runs need, and that has no result. */
struct obstacle {
    char *kind, *status, *message, *command, *key;
};

/* An audit of a scene's photos of one kind. */
struct audit {
    char *plan, *scene, *photos, *key, *status, *verdict;
    double *scores; /* of single photos, those of which masks leave nothing excepted */
    size_t n, capacity, verdicts[SG_AUDIT_VERDICTS];
    bool fresh; /* of the database that is read now */
};

#define ROC_GRID 50 /* intervals of the horizontal axis */

/* The share of photos over the share of clean ones with at least the same score. */
struct roc {
    size_t clean;        /* photos */
    double (*points)[2]; /* shares of clean ones and of photos, one for each score, or NULL */
    size_t n_points;
    double band[ROC_GRID + 1][2]; /* 95 % of the bootstrap's samples */
    double area, interval[2];     /* below the curve; a tie counts one half */
};

/* Photos of the kind of one audit: of its scene, or of all scenes of its plan. */
struct audit_row {
    const struct audit *first;
    bool all;
    size_t n, verdicts[SG_AUDIT_VERDICTS];
    struct roc roc; /* without points for clean photos, and where there are none of these */
};

struct report {
    struct result *results;
    size_t n, capacity;
    struct group *groups;
    const struct group **by_name; /* the groups, for report_find */
    size_t n_groups;
    json_t *plans;  /* by name */
    json_t *curves; /* key: list of [iteration, Gaussians, PSNR, instances, bytes] */
    /* key: {photo, render: {view, png (base64), radial, angular (lists)}} */
    json_t *pictures;
    size_t others; /* results that a cell has of another configuration, which are left out */
    struct obstacle *obstacles;
    size_t n_obstacles;
    struct audit *audits;
    size_t n_audits;
    struct audit_row *audit_rows;
    size_t n_audit_rows;
};

/* A text for free(), "" for NULL. */
char *report_copy(const char *text);
/* Adds a database's results. Returns an exit code. */
int report_load(struct report *r, const char *path);
int report_group(struct report *r);
void report_clear(struct report *r);

/* Adds a database's audits; compares those of all with the clean photos of their scenes; makes what
 * the page needs of that, which ends early where interrupted() says so. */
int report_load_audits(struct report *r, struct store *s);
int report_audits(struct report *r);
void report_clear_audits(struct report *r);
json_t *report_audits_json(const struct report *r);

/* The share of the clean count that a defense is limited to by {clean*X} in its plan, or 0. */
double report_limit(const struct report *r, const struct result *x);

/* What its plan says of its scene, or NULL. */
const json_t *report_scene(const struct report *r, const struct result *x);

bool same_scene(const struct result *a, const struct result *b); /* and plan and model */

/* The group with other photos or another defense, or NULL. */
const struct group *report_find(const struct report *r, const struct group *like,
                                const char *photos, const char *defense);

/* Over the seeds of a group. */
struct spread {
    double mean, deviation; /* NAN: of none, of one */
};
/* A metric of those of a group that are done in another group too, there and as a share of it. */
struct spread report_pairs(const struct group *of, const struct group *to, enum report_metric m);
struct spread report_shares(const struct group *of, const struct group *to, enum report_metric m);
/* Of a group's runs with the seeds that all runs of the scene have; of all where there are none. */
struct spread report_common(const struct group *of, enum report_metric m);
struct spread report_common_shares(const struct group *of, const struct group *to,
                                   enum report_metric m);

/* What the paper prints of a run, or NULL. */
const struct paper_row *report_paper(const char *scene, const char *photos, const char *defense,
                                     const char *model);
/* The same of a run here. A scene that a plan makes is none of the paper's. */
const struct paper_row *report_paper_of(const struct report *r, const struct result *x);
/* Most Gaussians as a share of its clean run without a defense. NAN: not printed. */
double report_paper_growth(const struct paper_row *p);

/* ---- tables ---- */

enum format { MARKDOWN, HTML };

void put_text(FILE *f, enum format format, const char *text);
void put_heading(FILE *f, enum format format, int level, const char *text);
/* Of the second level; names the model of a run unless that is the default. */
void put_run_heading(FILE *f, enum format format, const char *text, const struct result *x);
void begin_table(FILE *f, enum format format, const char *const *titles, int n);
void begin_row(FILE *f, enum format format, const char *name);
void put_cell(FILE *f, enum format format, const char *text);
void put_number(FILE *f, enum format format, double mean, double deviation, int digits);
void end_row(FILE *f, enum format format);
void end_table(FILE *f, enum format format);

/* Next to the paper; defenses and photos side by side, of scenes and means over scenes; at equal
 * count; what the plans say. */
void put_papers(FILE *f, const struct report *r, enum format format);
void put_sides(FILE *f, const struct report *r, enum format format);
void put_limits(FILE *f, const struct report *r, enum format format);
void put_plans(FILE *f, const struct report *r, enum format format);

void put_tables(FILE *f, const struct report *r, enum format format);
void put_csv(FILE *f, const struct report *r);
/* The page of one run. views: of its pictures, or NULL. Returns an exit code. */
struct model_views;
int put_run(FILE *f, const char *folder, const sg_run_summary *summary,
            const struct sg_run_params *params, struct model_views *views);

void put_page(FILE *f, const struct report *r);

extern const char report_js[]; /* report.js */

#endif
