/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "interrupt.h"
#include "page.h"
#include "report.h"

const struct metric_column metric_columns[M_METRICS] = {
    [M_MAX_GAUSSIANS] = {"max_gaussians", "max_gaussians", "final_gaussians", 1, 0},
    [M_GAUSSIANS] = {"gaussians", "final_gaussians", NULL, 1, 0},
    [M_PSNR] = {"psnr", "eval.psnr", NULL, 1, 2},
    [M_SSIM] = {"ssim", "eval.ssim", NULL, 1, 4},
    [M_FPS] = {"fps", "eval.fps", NULL, 1, 1},
    [M_SECONDS] = {"train_seconds", "train_seconds", NULL, 1, 1},
    [M_MEMORY] = {"ledger_megabytes", "peak_ledger_bytes", NULL, 1e-6, 0},
    [M_RSS] = {"rss_megabytes", "peak_rss_bytes", NULL, 1e-6, 0},
    [M_THREADS] = {"threads", "threads", NULL, 1, 0},
};

char *report_copy(const char *text)
{
    return strdup(text ? text : "");
}

/* The same cell of another database, whatever its configuration is there, or NULL. */
static struct result *find_cell(const struct report *r, const char *const *v)
{
    for (size_t i = 0; i < r->n; i++) {
        const struct result *x = &r->results[i];
        const char *const own[] = {x->plan, x->scene, x->photos, x->defense, x->model};
        bool same = x->seed == (v[5] ? atoi(v[5]) : 0);
        for (int k = 0; k < 5 && same; k++)
            same = !strcmp(own[k], v[k] ? v[k] : "");
        if (same)
            return &r->results[i];
    }
    return NULL;
}

static void clear_result(struct result *x)
{
    char *texts[] = {x->plan,   x->scene,   x->photos, x->defense, x->model, x->key,
                     x->status, x->message, x->commit, x->machine, x->engine};
    for (size_t k = 0; k < sizeof(texts) / sizeof(texts[0]); k++)
        free(texts[k]);
    *x = (struct result){0};
}

static int take_cell(void *arg, int columns, const char *const *v)
{
    struct report *r = arg;
    (void) columns;
    if (interrupted())
        return report(NULL, SG_ERR_INTERRUPTED);
    struct result *x = find_cell(r, v);
    const bool done = v[7] && !strcmp(v[7], "done");
    if (x && (!strcmp(x->status, "done") || !done)) {
        r->others += done && strcmp(x->key, v[6]) != 0;
        return STATUS_DONE;
    }
    if (x)
        clear_result(x);
    else if (r->n == r->capacity) {
        const size_t capacity = r->capacity ? 2 * r->capacity : 64;
        struct result *more = realloc(r->results, capacity * sizeof(*more));
        if (!more)
            return no_memory();
        r->results = more, r->capacity = capacity;
    }
    x = x ? x : &r->results[r->n++];
    *x = (struct result){.plan = report_copy(v[0]),
                         .scene = report_copy(v[1]),
                         .photos = report_copy(v[2]),
                         .defense = report_copy(v[3]),
                         .model = report_copy(v[4]),
                         .seed = v[5] ? atoi(v[5]) : 0,
                         .key = report_copy(v[6]),
                         .status = report_copy(v[7]),
                         .message = report_copy(v[8]),
                         .alone = v[9] && atoi(v[9]),
                         .commit = report_copy(v[10]),
                         .machine = report_copy(v[11]),
                         .engine = report_copy(v[12]),
                         .seconds = v[13] ? atof(v[13]) : NAN,
                         .fresh = true};
    for (int m = 0; m < M_METRICS; m++)
        x->value[m] = NAN;
    return STATUS_DONE;
}

/* Results of one key, which can be several cells: of the database that is read now, so that all
 * numbers of a cell are of one run. */
struct keyed {
    struct report *r;
    json_t *index; /* key: number of the first cell with it, which others follow by `same` */
    json_t *known; /* curves of the databases before */
};

static int take_metric(void *arg, int columns, const char *const *v)
{
    struct keyed *k = arg;
    (void) columns;
    const json_t *at = v[0] ? json_object_get(k->index, v[0]) : NULL;
    if (!at || !v[1] || !v[2])
        return STATUS_DONE;
    for (struct result *x = &k->r->results[json_integer_value(at)]; x; x = x->same)
        for (int m = 0; m < M_METRICS; m++) {
            const struct metric_column *c = &metric_columns[m];
            double *value = &x->value[m];
            if (!strcmp(v[1], c->first) || (c->then && isnan(*value) && !strcmp(v[1], c->then)))
                *value = atof(v[2]) * c->unit;
        }
    return STATUS_DONE;
}

static int take_point(void *arg, int columns, const char *const *v)
{
    struct keyed *k = arg;
    json_t *curve = v[0] ? json_object_get(k->r->curves, v[0]) : NULL, *point;
    if (!v[0] || json_object_get(k->known, v[0])) /* of a database before */
        return STATUS_DONE;
    if (!curve && json_object_set_new(k->r->curves, v[0], curve = json_array()))
        return STATUS_DONE; /* a key that is no text */
    point = json_array();
    for (int i = 1; i < columns; i++)
        json_array_append_new(point, number_json(v[i] ? atof(v[i]) : NAN));
    return json_array_append_new(curve, point) ? no_memory() : STATUS_DONE;
}

/* The bytes that SQLite's hex() has written, as base64, or NULL. */
static char *base64_of_hex(const char *hex)
{
    const size_t n = strlen(hex) / 2;
    uint8_t *bytes = malloc(n + 1);
    for (size_t i = 0; i < 2 * n && bytes; i++) {
        const int digit = hex[i] <= '9' ? hex[i] - '0' : hex[i] - 'A' + 10;
        bytes[i / 2] = (uint8_t) (i % 2 ? bytes[i / 2] << 4 | digit : digit);
    }
    char *text = bytes ? base64(bytes, n) : NULL;
    free(bytes);
    return text;
}

/* The object of one kind of picture of a job, made where there is none; NULL if it is of a database
 * before, or the names are no text. */
static json_t *picture_of(const struct keyed *k, const char *key, const char *what)
{
    if (!key || !what || json_object_get(k->known, key))
        return NULL;
    json_t *all = json_object_get(k->r->pictures, key);
    if (!all && json_object_set_new(k->r->pictures, key, all = json_object()))
        return NULL;
    json_t *one = json_object_get(all, what);
    if (!one && json_object_set_new(all, what, one = json_object()))
        return NULL;
    return one;
}

static int take_picture(void *arg, int columns, const char *const *v)
{
    (void) columns;
    json_t *one = picture_of(arg, v[0], v[1]);
    char *png = one && v[3] ? base64_of_hex(v[3]) : NULL;
    if (png) {
        json_object_set_new(one, "view", text_json(v[2] ? v[2] : ""));
        json_object_set_new(one, "png", json_string(png));
    }
    free(png);
    return STATUS_DONE;
}

static int take_bin(void *arg, int columns, const char *const *v)
{
    (void) columns;
    json_t *one = picture_of(arg, v[0], v[1]);
    json_t *list = one && v[2] ? json_object_get(one, v[2]) : NULL;
    if (one && v[2] && !list && json_object_set_new(one, v[2], list = json_array()))
        return STATUS_DONE;
    return list && json_array_append_new(list, number_json(v[3] ? atof(v[3]) : NAN)) ? no_memory()
                                                                                     : STATUS_DONE;
}

/* Those of the first versions have no memory. */
static int load_curves(struct keyed *k, struct store *s)
{
    bool has = false;
    int code = store_has(s, "curve", "ledger_bytes", &has);
    if (code)
        return code;
    return store_query(s,
                       has ? "SELECT key, iteration, gaussians, psnr, instances, ledger_bytes"
                             " FROM curve WHERE key IN (SELECT key FROM cell)"
                             " ORDER BY key, iteration"
                           : "SELECT key, iteration, gaussians, psnr, instances, NULL FROM curve"
                             " WHERE key IN (SELECT key FROM cell) ORDER BY key, iteration",
                       take_point, k);
}

/* Databases of the first versions have no pictures. */
static int load_pictures(struct keyed *k, struct store *s)
{
    bool has = false;
    json_t *known = k->known;
    int code = store_has(s, "spectrum", "value", &has);
    if (code || !has)
        return code;
    k->known = json_copy(k->r->pictures);
    code = store_query(s,
                       "SELECT of, what, view, hex(png) FROM picture"
                       " WHERE of IN (SELECT key FROM cell) AND what IN ('photo', 'render')"
                       " AND length(png) <= 1 << 18", /* ours have at most 256 x 256 pixels */
                       take_picture, k);
    if (!code)
        code = store_query(s,
                           "SELECT of, what, kind, value FROM spectrum"
                           " WHERE of IN (SELECT key FROM cell) AND what IN ('photo', 'render')"
                           " AND kind IN ('radial', 'angular') ORDER BY of, what, kind, bin",
                           take_bin, k);
    json_decref(k->known);
    k->known = known;
    return code;
}

/* Parts of one plan have the same text. */
struct reading_plans {
    struct report *r;
    const char *path;
};

static int take_plan(void *arg, int columns, const char *const *v)
{
    struct reading_plans *p = arg;
    struct report *r = p->r;
    (void) columns;
    json_t *plan = v[0] && v[1] ? json_loads(v[1], 0, NULL) : NULL;
    if (plan)
        json_object_del(plan, "shard"); /* which part it is of */
    const json_t *before = plan ? json_object_get(r->plans, v[0]) : NULL;
    if (before && !json_equal(before, plan)) {
        say(stderr,
            "splatguard report: %s: found another plan \"%s\" than in the databases before, "
            "expected parts of one plan\n",
            p->path, v[0]);
        json_decref(plan);
        return STATUS_INPUT;
    }
    if (plan)
        json_object_set_new(r->plans, v[0], plan);
    return STATUS_DONE;
}

static int take_obstacle(void *arg, int columns, const char *const *v)
{
    struct report *r = arg;
    (void) columns;
    for (size_t i = 0; i < r->n_obstacles; i++)
        if (!strcmp(r->obstacles[i].key, v[4] ? v[4] : ""))
            return STATUS_DONE;
    struct obstacle *more = realloc(r->obstacles, (r->n_obstacles + 1) * sizeof(*more));
    if (!more)
        return no_memory();
    r->obstacles = more;
    r->obstacles[r->n_obstacles++] =
        (struct obstacle){report_copy(v[0]), report_copy(v[1]), report_copy(v[2]),
                          report_copy(v[3]), report_copy(v[4])};
    return STATUS_DONE;
}

const json_t *report_scene(const struct report *r, const struct result *x)
{
    return json_object_get(json_object_get(json_object_get(r->plans, x->plan), "scenes"), x->scene);
}

double report_limit(const struct report *r, const struct result *x)
{
    const json_t *defense = json_object_get(
        json_object_get(json_object_get(r->plans, x->plan), "defenses"), x->defense);
    const json_t *prune = json_object_get(defense, "prune"),
                 *options = json_is_array(defense) ? defense
                            : prune                ? prune
                                                   : json_object_get(defense, "train");
    for (size_t i = 0; i < json_array_size(options); i++) {
        const char *text = json_string_value(json_array_get(options, i));
        double share;
        if (text && plan_limit(text, &share))
            return share;
    }
    return 0;
}

/* A job that has failed is one of an earlier plan, unless something could not run. */
#define SOMETHING_WAITS "EXISTS (SELECT 1 FROM cell WHERE key NOT IN (SELECT key FROM job))"

int report_load(struct report *r, const char *path)
{
    struct store *s;
    struct keyed k = {.r = r, .index = json_object()};
    if (!r->curves)
        r->curves = json_object(), r->plans = json_object(), r->pictures = json_object();
    k.known = json_copy(r->curves);
    int code = store_open(path, true, &s);
    if (!code) /* until it is closed: a bench may store a job meanwhile */
        code = store_query(s, "BEGIN", NULL, NULL);
    if (!code) /* texts of a job no longer than ours: many cells can be one job */
        code = store_query(
            s,
            "SELECT c.plan, c.scene, c.photos, c.defense, c.model, c.seed, c.key,"
            " substr(j.status, 1, 16), substr(j.message, 1, 256), j.alone,"
            " substr(j.commit_id, 1, 128), substr(j.machine, 1, 128),"
            " substr(j.engine, 1, 128), j.seconds FROM cell c LEFT JOIN job j USING(key)"
            " WHERE c.kind IS NOT 'audit' ORDER BY c.plan, c.position",
            take_cell, r);
    for (size_t i = r->n; i-- > 0;) {
        struct result *x = &r->results[i];
        const json_t *same = json_object_get(k.index, x->key);
        if (!x->fresh)
            continue;
        x->same = same ? &r->results[json_integer_value(same)] : NULL;
        json_object_set_new(k.index, x->key, json_integer((json_int_t) i));
    }
    if (!code)
        code = store_query(s, "SELECT name, text FROM plan", take_plan,
                           &(struct reading_plans){r, path});
    if (!code)
        code = store_query(s,
                           "SELECT kind, CASE status WHEN 'done' THEN 'not again' ELSE status END,"
                           " message, command, key FROM job WHERE CASE"
                           " WHEN status = 'done' THEN message IS NOT NULL AND " SOMETHING_WAITS
                           " WHEN kind = 'audit' THEN key IN (SELECT key FROM cell)"
                           " WHEN kind = 'pictures' THEN EXISTS (SELECT 1 FROM cell c, plan p"
                           " WHERE p.name = c.plan AND c.key = json_extract(config, '$.needs_1')"
                           " AND json_extract(p.text, '$.pictures'))"
                           " ELSE key NOT IN (SELECT key FROM cell) AND " SOMETHING_WAITS
                           " END ORDER BY kind, key",
                           take_obstacle, r);
    if (!code)
        code = store_query(s,
                           "SELECT key, name, value FROM metric"
                           " WHERE key IN (SELECT key FROM cell)",
                           take_metric, &k);
    if (!code)
        code = load_curves(&k, s);
    if (!code)
        code = load_pictures(&k, s);
    if (!code)
        code = report_load_audits(r, s);
    if (!code && r->others)
        say(stderr,
            "warning: %s: %zu results are left out: those before are of the same cells, with "
            "another configuration\n",
            path, r->others);
    r->others = 0;
    for (size_t i = 0; i < r->n; i++)
        r->results[i].fresh = false;
    json_decref(k.index);
    json_decref(k.known);
    store_close(&s);
    return code;
}

bool same_scene(const struct result *a, const struct result *b)
{
    return !strcmp(a->plan, b->plan) && !strcmp(a->scene, b->scene) && !strcmp(a->model, b->model);
}

static int compare_names(const struct result *a, const struct result *b)
{
    const char *const of_a[] = {a->scene, a->defense, a->photos, a->model, a->plan},
                      *const of_b[] = {b->scene, b->defense, b->photos, b->model, b->plan};
    int order = 0;
    for (int k = 0; k < 5 && !order; k++)
        order = strcmp(of_a[k], of_b[k]);
    return order;
}

static bool is_alike(const struct result *a, const struct result *b)
{
    return !compare_names(a, b);
}

static int by_name(const void *a, const void *b)
{
    return compare_names((*(const struct group *const *) a)->first,
                         (*(const struct group *const *) b)->first);
}

static void add_to_group(struct group *g, const struct result *x)
{
    g->cells++;
    if (strcmp(x->status, "done")) {
        g->why = *x->status ? x->status : "not run";
        return;
    }
    g->runs++;
    for (int m = 0; m < M_METRICS; m++) { /* Welford's; deviation is the sum of squares so far */
        const double before = g->runs > 1 ? g->mean[m] : 0;
        g->mean[m] = before + (x->value[m] - before) / g->runs;
        g->deviation[m] += (x->value[m] - before) * (x->value[m] - g->mean[m]);
    }
}

/* Whether all that has results of this scene has one with this seed. */
static bool is_common(const struct report *r, const struct result *x)
{
    size_t groups = 0, runs = 0;
    for (size_t i = 0; i < r->n_groups; i++)
        groups += r->groups[i].runs && same_scene(r->groups[i].first, x);
    for (size_t i = 0; i < r->n; i++)
        runs += r->results[i].seed == x->seed && !strcmp(r->results[i].status, "done") &&
                same_scene(&r->results[i], x);
    return runs == groups;
}

static void count_common(struct report *r)
{
    for (size_t i = 0; i < r->n_groups; i++)
        for (const struct result *x = r->groups[i].first; x; x = x->next)
            r->groups[i].common += x->common && !strcmp(x->status, "done");
}

int report_group(struct report *r)
{
    r->groups = calloc(r->n + 1, sizeof(*r->groups));
    r->by_name = calloc(r->n + 1, sizeof(struct group *));
    if (!r->groups || !r->by_name)
        return no_memory();
    for (size_t i = 0; i < r->n && !interrupted(); i++) {
        struct group *g = r->groups;
        while (g < r->groups + r->n_groups && !is_alike(g->first, &r->results[i]))
            g++;
        if (g == r->groups + r->n_groups) {
            r->n_groups++;
            g->first = &r->results[i];
        } else
            g->last->next = &r->results[i];
        g->last = &r->results[i];
        add_to_group(g, &r->results[i]);
    }
    for (size_t i = 0; i < r->n_groups; i++)
        for (int m = 0; m < M_METRICS; m++) {
            struct group *g = &r->groups[i];
            g->mean[m] = g->runs ? g->mean[m] : NAN;
            g->deviation[m] = g->runs > 1 ? sqrt(g->deviation[m] / (g->runs - 1)) : NAN;
        }
    for (size_t i = 0; i < r->n && !interrupted(); i++)
        r->results[i].common = is_common(r, &r->results[i]);
    for (size_t i = 0; i < r->n_groups; i++)
        r->by_name[i] = &r->groups[i];
    if (!interrupted()) {
        count_common(r);
        qsort(r->by_name, r->n_groups, sizeof(*r->by_name), by_name);
    }
    return STATUS_DONE;
}

const struct group *report_find(const struct report *r, const struct group *like,
                                const char *photos, const char *defense)
{
    struct result wanted = *like->first;
    wanted.photos = (char *) photos, wanted.defense = (char *) defense;
    const struct group group = {.first = &wanted}, *key = &group;
    const struct group **found =
        bsearch(&key, r->by_name, r->n_groups, sizeof(*r->by_name), by_name);
    return found ? *found : NULL;
}

/* Of each run of a group the value of the run with its seed in another group, or its own value as a
 * share of that. common: only of the seeds that all runs of the scene have. */
static struct spread pair(const struct group *of, const struct group *to, enum report_metric m,
                          bool share, bool common)
{
    double sum = 0, squares = 0;
    int n = 0;
    for (const struct result *a = of && to ? of->first : NULL; a; a = a->next) {
        if (strcmp(a->status, "done") || (common && !a->common))
            continue;
        for (const struct result *b = to->first; b; b = b->next) {
            if (b->seed != a->seed || strcmp(b->status, "done"))
                continue;
            const double v = share ? a->value[m] / b->value[m] : b->value[m],
                         d = v - sum / (n + !n);
            n++;
            squares += n > 1 ? d * d * (n - 1) / n : 0;
            sum += v;
        }
    }
    return (struct spread){n ? sum / n : NAN, n > 1 ? sqrt(squares / (n - 1)) : NAN};
}

struct spread report_pairs(const struct group *of, const struct group *to, enum report_metric m)
{
    return pair(of, to, m, false, false);
}

struct spread report_shares(const struct group *of, const struct group *to, enum report_metric m)
{
    return pair(of, to, m, true, false);
}

struct spread report_common(const struct group *of, enum report_metric m)
{
    return pair(of, of, m, false, of && of->common);
}

struct spread report_common_shares(const struct group *of, const struct group *to,
                                   enum report_metric m)
{
    return pair(of, to, m, true, of && of->common);
}

void report_clear(struct report *r)
{
    for (size_t i = 0; i < r->n_obstacles; i++) {
        struct obstacle *o = &r->obstacles[i];
        free(o->kind), free(o->status), free(o->message), free(o->command), free(o->key);
    }
    free(r->obstacles);
    for (size_t i = 0; i < r->n; i++)
        clear_result(&r->results[i]);
    free(r->results);
    free(r->groups);
    free(r->by_name);
    report_clear_audits(r);
    json_decref(r->curves);
    json_decref(r->pictures);
    json_decref(r->plans);
    *r = (struct report){0};
}
