/* SPDX-License-Identifier: Apache-2.0 */
/* How well the audit tells the photos of each kind from the clean ones of the same scene: ROC
 * curves over the scores of single photos, and their spread by the bootstrap (Efron 1979). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "interrupt.h"
#include "report.h"

/* ---- what the databases have ---- */

static void clear_audit(struct audit *a)
{
    char *texts[] = {a->plan, a->scene, a->photos, a->key, a->status, a->verdict};
    for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++)
        free(texts[i]);
    free(a->scores);
    *a = (struct audit){0};
}

/* The same cell of a database before, whatever its configuration is there, or NULL. */
static struct audit *find_audit(struct report *r, const char *const *v)
{
    for (size_t i = 0; i < r->n_audits; i++) {
        const char *const own[] = {r->audits[i].plan, r->audits[i].scene, r->audits[i].photos};
        bool same = true;
        for (int k = 0; k < 3 && same; k++)
            same = !strcmp(own[k], v[k] ? v[k] : "");
        if (same)
            return &r->audits[i];
    }
    return NULL;
}

static int take_audit(void *arg, int columns, const char *const *v)
{
    struct report *r = arg;
    struct audit *a = find_audit(r, v);
    (void) columns;
    const bool done = v[4] && !strcmp(v[4], "done");
    if (a && (!strcmp(a->status, "done") || !done)) {
        r->others += done && v[3] && strcmp(a->key, v[3]) != 0;
        return STATUS_DONE;
    }
    if (a)
        clear_audit(a);
    else {
        struct audit *more = realloc(r->audits, (r->n_audits + 1) * sizeof(*more));
        if (!more)
            return no_memory();
        r->audits = more;
        a = &more[r->n_audits++];
    }
    json_t *summary = v[5] ? json_loads(v[5], 0, NULL) : NULL;
    *a = (struct audit){.plan = report_copy(v[0]),
                        .scene = report_copy(v[1]),
                        .photos = report_copy(v[2]),
                        .key = report_copy(v[3]),
                        .status = report_copy(v[4]),
                        .verdict =
                            report_copy(json_string_value(json_object_get(summary, "verdict"))),
                        .fresh = true};
    json_decref(summary);
    return STATUS_DONE;
}

/* Photos of which masks leave nothing have no score. */
static int take_photo(void *arg, int columns, const char *const *v)
{
    struct report *r = arg;
    const double score = v[1] ? atof(v[1]) : NAN;
    int cells = 0;
    (void) columns;
    if (interrupted())
        return report(NULL, SG_ERR_INTERRUPTED);
    for (size_t i = 0; i < r->n_audits && v[0] && v[2] && isfinite(score); i++) {
        struct audit *a = &r->audits[i];
        if (!a->fresh || strcmp(a->key, v[0]) || cells++ >= CELLS_OF_JOB)
            continue;
        if (a->n == a->capacity) {
            const size_t capacity = a->capacity ? 2 * a->capacity : 256;
            double *more = realloc(a->scores, capacity * sizeof(*more));
            if (!more)
                return no_memory();
            a->scores = more, a->capacity = capacity;
        }
        a->scores[a->n++] = score;
        for (int k = 0; k < SG_AUDIT_VERDICTS; k++)
            a->verdicts[k] += !strcmp(v[2], sg_audit_verdict_name((enum sg_audit_verdict) k));
    }
    return STATUS_DONE;
}

int report_load_audits(struct report *r, struct store *s)
{
    bool has = false;
    int code = store_has(s, "audit", "score", &has);
    if (code || !has)
        return code;
    code = store_query(s,
                       "SELECT c.plan, c.scene, c.photos, c.key, substr(j.status, 1, 16),"
                       " j.summary"
                       " FROM cell c LEFT JOIN job j USING(key) WHERE c.kind='audit'"
                       " ORDER BY c.plan, c.position",
                       take_audit, r);
    if (!code)
        code = store_query(s,
                           "SELECT key, score, verdict FROM audit"
                           " WHERE key IN (SELECT key FROM cell) ORDER BY key, position",
                           take_photo, r);
    for (size_t i = 0; i < r->n_audits; i++)
        r->audits[i].fresh = false;
    return code;
}

/* ---- curves ---- */

#define SAMPLES 1000 /* of the bootstrap */
#define OUTSIDE 25   /* of them on each side of a 95 % interval, its end included */

/* A score, and how many photos of each kind have it. */
struct level {
    double score;
    size_t found, clean;
};

static int highest_first(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x < y) - (x > y);
}

/* Levels of both lists, the highest first. at: those of the n photos, then of the m clean ones. */
static size_t make_levels(const double *photos, size_t n, const double *clean, size_t m,
                          struct level *levels, size_t *at)
{
    size_t count = 0;
    for (size_t i = 0, k = 0; i < n || k < m;) {
        const bool first = k == m || (i < n && photos[i] >= clean[k]);
        const double score = first ? photos[i] : clean[k];
        if (!count || levels[count - 1].score > score)
            levels[count++] = (struct level){.score = score};
        if (first)
            levels[count - 1].found++, at[i++] = count - 1;
        else
            levels[count - 1].clean++, at[n + k++] = count - 1;
    }
    return count;
}

/* The area below the curve, in which photos of equal score are a slanting line. heights: the
 * highest share of photos found at each share of clean ones. */
static double walk(const struct level *levels, size_t count, size_t n, size_t m, double *heights)
{
    double area = 0;
    size_t x = 0, y = 0, k = 0; /* clean ones, photos, points of the grid */
    for (size_t i = 0; i < count; i++) {
        const size_t dx = levels[i].clean, dy = levels[i].found;
        area += (double) dx * ((double) y + 0.5 * (double) dy);
        for (; k <= ROC_GRID && k * m < (x + dx) * ROC_GRID; k++) {
            const double along = ((double) (k * m) / ROC_GRID - (double) x) / (double) dx;
            heights[k] = ((double) y + along * (double) dy) / (double) n;
        }
        x += dx, y += dy;
    }
    for (; k <= ROC_GRID; k++)
        heights[k] = 1;
    return area / ((double) n * (double) m);
}

/* Draws as many photos of each kind as there are, with replacement. random: a state of splitmix64
 * (Steele et al. 2014). */
static void draw_sample(struct level *levels, size_t count, const size_t *at, size_t n, size_t m,
                        uint64_t *random)
{
    for (size_t i = 0; i < count; i++)
        levels[i].found = levels[i].clean = 0;
    for (size_t i = 0; i < n + m; i++) {
        const uint64_t x = splitmix(*random += 0x9e3779b97f4a7c15u) >> 32;
        if (i < n)
            levels[at[x * n >> 32]].found++;
        else
            levels[at[n + (x * m >> 32)]].clean++;
    }
}

/* The interval that OUTSIDE of the samples are above, and as many below. */
static void interval(double *samples, double out[2])
{
    qsort(samples, SAMPLES, sizeof(*samples), highest_first);
    out[0] = samples[SAMPLES - OUTSIDE], out[1] = samples[OUTSIDE - 1];
}

static int make_roc(double *photos, size_t n, double *clean, size_t m, struct roc *out)
{
    struct level *levels = calloc(n + m + 1, sizeof(*levels));
    size_t *at = calloc(n + m + 1, sizeof(*at)), x = 0, y = 0;
    double(*samples)[SAMPLES] = calloc(ROC_GRID + 2, sizeof(*samples)), heights[ROC_GRID + 1];
    uint64_t random = 0;
    *out = (struct roc){.clean = m, .points = calloc(n + m + 1, sizeof(*out->points))};
    const bool room = levels && at && samples && out->points;
    if (room) {
        qsort(photos, n, sizeof(*photos), highest_first);
        qsort(clean, m, sizeof(*clean), highest_first);
        const size_t count = make_levels(photos, n, clean, m, levels, at);
        out->area = walk(levels, count, n, m, heights);
        for (size_t i = 0; i < count; i++) {
            x += levels[i].clean, y += levels[i].found;
            out->points[i][0] = (double) x / (double) m;
            out->points[i][1] = (double) y / (double) n;
        }
        out->n_points = count;
        for (size_t s = 0; s < SAMPLES && !interrupted(); s++) {
            draw_sample(levels, count, at, n, m, &random);
            samples[ROC_GRID + 1][s] = walk(levels, count, n, m, heights);
            for (int k = 0; k <= ROC_GRID; k++)
                samples[k][s] = heights[k];
        }
        for (int k = 0; k <= ROC_GRID; k++)
            interval(samples[k], out->band[k]);
        interval(samples[ROC_GRID + 1], out->interval);
    }
    free(levels);
    free(at);
    free(samples);
    return room ? STATUS_DONE : no_memory();
}

/* ---- rows: photos of one kind, of one scene or of all scenes of a plan ---- */

static bool is_of(const struct audit *a, const struct audit *like, bool all, const char *photos)
{
    return a->n && !strcmp(a->plan, like->plan) && (all || !strcmp(a->scene, like->scene)) &&
           !strcmp(a->photos, photos);
}

static bool has_scene(const struct report *r, const struct audit *like, const char *photos)
{
    for (size_t i = 0; i < r->n_audits; i++)
        if (is_of(&r->audits[i], like, false, photos))
            return true;
    return false;
}

/* Scores of photos of the kind, from scenes that the kind `other` has too. NULL without memory. */
static double *collect(const struct report *r, const struct audit *like, bool all,
                       const char *photos, const char *other, size_t *n)
{
    size_t most = 1;
    for (size_t i = 0; i < r->n_audits; i++)
        most += r->audits[i].n;
    double *scores = calloc(most, sizeof(*scores));
    *n = 0;
    for (size_t i = 0; i < r->n_audits && scores; i++) {
        const struct audit *a = &r->audits[i];
        if (!is_of(a, like, all, photos) || !has_scene(r, a, other))
            continue;
        memcpy(scores + *n, a->scores, a->n * sizeof(*scores));
        *n += a->n;
    }
    return scores;
}

static int add_row(struct report *r, const struct audit *like, bool all)
{
    struct audit_row *more = realloc(r->audit_rows, (r->n_audit_rows + 1) * sizeof(*more));
    if (!more)
        return no_memory();
    r->audit_rows = more;
    struct audit_row *row = &more[r->n_audit_rows++];
    *row = (struct audit_row){.first = like, .all = all};
    for (size_t i = 0; i < r->n_audits; i++)
        if (is_of(&r->audits[i], like, all, like->photos)) {
            row->n += r->audits[i].n;
            for (int k = 0; k < SG_AUDIT_VERDICTS; k++)
                row->verdicts[k] += r->audits[i].verdicts[k];
        }
    if (!strcmp(like->photos, CLEAN))
        return STATUS_DONE;
    size_t n, m;
    double *photos = collect(r, like, all, like->photos, CLEAN, &n),
           *clean = collect(r, like, all, CLEAN, like->photos, &m);
    int code = photos && clean ? STATUS_DONE : no_memory();
    if (!code && n && m)
        code = make_roc(photos, n, clean, m, &row->roc);
    free(photos);
    free(clean);
    return code;
}

/* Of how many scenes, and whether this audit is the first of them. */
static size_t count_scenes(const struct report *r, const struct audit *like, bool *first)
{
    size_t n = 0;
    *first = false;
    for (size_t i = 0; i < r->n_audits; i++)
        if (is_of(&r->audits[i], like, true, like->photos)) {
            *first |= !n && &r->audits[i] == like;
            n++;
        }
    return n;
}

int report_audits(struct report *r)
{
    int code = STATUS_DONE;
    for (size_t i = 0; i < r->n_audits && !code && !interrupted(); i++)
        code = add_row(r, &r->audits[i], false);
    for (size_t i = 0; i < r->n_audits && !code && !interrupted(); i++) {
        bool first;
        if (count_scenes(r, &r->audits[i], &first) > 1 && first)
            code = add_row(r, &r->audits[i], true);
    }
    return code;
}

void report_clear_audits(struct report *r)
{
    for (size_t i = 0; i < r->n_audits; i++)
        clear_audit(&r->audits[i]);
    for (size_t i = 0; i < r->n_audit_rows; i++)
        free(r->audit_rows[i].roc.points);
    free(r->audits);
    free(r->audit_rows);
}

/* ---- for the page ---- */

static json_t *pair(double a, double b)
{
    return json_pack("[o,o]", number_json(a), number_json(b));
}

/* The clean photos of the scene, of which each kind has a curve. */
static const struct audit *clean_of(const struct report *r, const struct audit *like)
{
    for (size_t i = 0; i < r->n_audits; i++)
        if (is_of(&r->audits[i], like, false, CLEAN))
            return &r->audits[i];
    return NULL;
}

/* Shares of both kinds that the audit calls poisoned, and at least suspicious. */
static json_t *marks_json(const struct audit *a, const struct audit *clean)
{
    json_t *marks = json_array();
    size_t found = 0, wrong = 0;
    static const enum sg_audit_verdict verdicts[] = {SG_AUDIT_POISONED, SG_AUDIT_SUSPICIOUS};
    for (int k = 0; k < 2; k++) {
        found += a->verdicts[verdicts[k]], wrong += clean->verdicts[verdicts[k]];
        json_array_append_new(
            marks, pair((double) wrong / (double) clean->n, (double) found / (double) a->n));
    }
    return marks;
}

json_t *report_audits_json(const struct report *r)
{
    json_t *list = json_array();
    for (size_t i = 0; i < r->n_audit_rows; i++) {
        const struct audit_row *row = &r->audit_rows[i];
        const struct roc *c = &row->roc;
        const struct audit *clean = clean_of(r, row->first);
        if (row->all || !c->points || !clean)
            continue;
        json_t *points = json_array(), *band = json_array();
        json_array_append_new(points, pair(0, 0));
        for (size_t k = 0; k < c->n_points; k++)
            json_array_append_new(points, pair(c->points[k][0], c->points[k][1]));
        for (int k = 0; k <= ROC_GRID; k++)
            json_array_append_new(band, pair(c->band[k][0], c->band[k][1]));
        json_array_append_new(
            list, json_pack("{s:o,s:o,s:o,s:I,s:I,s:o,s:o,s:o,s:o,s:o}", "plan",
                            text_json(row->first->plan), "scene", text_json(row->first->scene),
                            "photos", text_json(row->first->photos), "n", (json_int_t) row->n,
                            "clean", (json_int_t) c->clean, "area", number_json(c->area),
                            "interval", pair(c->interval[0], c->interval[1]), "points", points,
                            "band", band, "marks", marks_json(row->first, clean)));
    }
    return list;
}
