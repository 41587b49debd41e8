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
    double seconds, value[M_METRICS]; /* NAN: not known */
};

/* The seeds of one scene, photos, defense and model. */
struct group {
    const struct result *first;
    int cells, runs; /* asked for, done */
    double mean[M_METRICS], deviation[M_METRICS];
    const char *why; /* a status other than done, or NULL */
};

struct report {
    struct result *results;
    size_t n, capacity;
    struct group *groups;
    size_t n_groups;
    json_t *plans;  /* by name */
    json_t *curves; /* key: list of [iteration, Gaussians, PSNR, instances, bytes] */
    /* key: {photo, render: {view, png (base64), radial, angular (lists)}} */
    json_t *pictures;
};

/* Adds a database's results. Returns an exit code. */
int report_load(struct report *r, const char *path);
int report_group(struct report *r);
void report_clear(struct report *r);

/* The share of the clean count that a defense is limited to by {clean*X} in its plan, or 0. */
double report_limit(const struct report *r, const struct result *x);

/* The group with other photos or another defense, or NULL. */
const struct group *report_find(const struct report *r, const struct group *like,
                                const char *photos, const char *defense);

/* ---- tables ---- */

enum format { MARKDOWN, HTML };

void put_tables(FILE *f, const struct report *r, enum format format);
void put_csv(FILE *f, const struct report *r);
/* The page of one run. views: of its pictures, or NULL. Returns an exit code. */
struct model_views;
int put_run(FILE *f, const char *folder, const sg_run_summary *summary,
            const struct sg_run_params *params, struct model_views *views);

void put_page(FILE *f, const struct report *r);

extern const char report_js[]; /* report.js */

#endif
