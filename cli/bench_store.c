/* SPDX-License-Identifier: Apache-2.0 */
/* The results of benchmarks in an SQLite database. */
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bench.h"

#ifdef SG_SQLITE
#include <sqlite3.h>

#define APPLICATION 0x53475042
#define VERSION 1

struct store {
    sqlite3 *db;
    char *path;
};

/* No value of ours is as long: of pictures, texts of plans and summaries of runs. */
#define VALUE_BYTES (64 << 20)

#define CURVE(later)                                                                               \
    "curve(key TEXT, iteration INT, gaussians INT, loss REAL, psnr REAL, instances INT,"           \
    " seconds REAL" later ", PRIMARY KEY(key, iteration)) WITHOUT ROWID"

/* As SQLite keeps them after CREATE TABLE; what is in a database is compared with them. Of picture,
 * spectrum and audit: "of" is the key of the job whose model is shown, "what" photo or render,
 * "kind" radial or angular. */
static const char *const tables[] = {
    "job(key TEXT PRIMARY KEY, kind TEXT NOT NULL, status TEXT NOT NULL,"
    " exit_status INT, signal INT, message TEXT, started TEXT, seconds REAL, cpu_seconds REAL,"
    " peak_rss INT, beside INT, alone INT, version TEXT, commit_id TEXT, machine TEXT, cores INT,"
    " engine TEXT, config TEXT, command TEXT, run_config TEXT, summary TEXT) WITHOUT ROWID",
    "cell(plan TEXT, position INT, key TEXT, kind TEXT, scene TEXT, photos TEXT,"
    " defense TEXT, model TEXT, seed INT, PRIMARY KEY(plan, position)) WITHOUT ROWID",
    "plan(name TEXT PRIMARY KEY, text TEXT) WITHOUT ROWID",
    "metric(key TEXT, name TEXT, value REAL, PRIMARY KEY(key, name)) WITHOUT ROWID",
    CURVE(", ledger_bytes INT"),
    "view(key TEXT, name TEXT, psnr REAL, ssim REAL, PRIMARY KEY(key, name)) WITHOUT ROWID",
    "picture(of TEXT, what TEXT, view TEXT, png BLOB, PRIMARY KEY(of, what)) WITHOUT ROWID",
    "spectrum(of TEXT, what TEXT, kind TEXT, bin INT, value REAL,"
    " PRIMARY KEY(of, what, kind, bin)) WITHOUT ROWID",
    "audit(key TEXT, position INT, name TEXT, score REAL, verdict TEXT,"
    " tau REAL, tau_error REAL, PRIMARY KEY(key, position)) WITHOUT ROWID",
};
#define TABLES (sizeof(tables) / sizeof(tables[0]))
static const char curve_before[] = CURVE(""); /* to which "upgrade" adds a column */

static int failed(const struct store *s)
{
    if (sqlite3_extended_errcode(s->db) == SQLITE_READONLY_ROLLBACK) { /* nobody wants to write */
        say(stderr,
            "splatguard: %s: found a change that was half done when a bench was killed; the same "
            "bench undoes it and goes on\n",
            s->path);
        return STATUS_INPUT;
    }
    const int result = sqlite3_errcode(s->db) & 0xff;
    /* The number stays when another kind of error follows. */
    const int reason =
        result == SQLITE_CANTOPEN || result == SQLITE_IOERR ? sqlite3_system_errno(s->db) : 0;
    say(stderr, "splatguard: %s: %s%s%s\n", s->path, sqlite3_errmsg(s->db), reason ? ": " : "",
        reason ? strerror(reason) : "");
    return result == SQLITE_NOMEM ? STATUS_BUDGET : STATUS_INPUT;
}

static int run(struct store *s, const char *sql)
{
    return sqlite3_exec(s->db, sql, NULL, NULL, NULL) ? failed(s) : STATUS_DONE;
}

static int read_number(void *number, int columns, char **values, char **names)
{
    (void) columns, (void) names;
    *(long *) number = values[0] ? strtol(values[0], NULL, 10) : 0;
    return 0;
}

static int read_ok(void *ok, int columns, char **values, char **names)
{
    (void) columns, (void) names;
    *(bool *) ok = values[0] && !strcmp(values[0], "ok");
    return 0;
}

/* Before anything is written to it. */
static int check_whole(struct store *s)
{
    bool ok = false;
    if (sqlite3_exec(s->db, "PRAGMA quick_check(1)", read_ok, &ok, NULL))
        return failed(s);
    if (!ok)
        say(stderr, "splatguard: %s: database disk image is malformed; it stays as it is\n",
            s->path);
    return ok ? STATUS_DONE : STATUS_INPUT;
}

static bool is_ours(const char *sql)
{
    static const char create[] = "CREATE TABLE ";
    const size_t n = sizeof(create) - 1;
    bool ours = false;
    if (!sql || strncmp(sql, create, n))
        return false;
    for (size_t i = 0; i < TABLES; i++)
        ours |= !strcmp(sql + n, tables[i]);
    return ours || !strcmp(sql + n, curve_before);
}

/* Our tables alone, to the letter: a view, a trigger, a computed column, a check or an index of a
 * stranger's database could run for ever, or make gigabytes of a few bytes. */
static int check_tables(struct store *s)
{
    sqlite3_stmt *q = NULL;
    int result, code = STATUS_DONE;
    if (sqlite3_prepare_v2(s->db, "SELECT type, name, sql FROM sqlite_master", -1, &q, NULL))
        return failed(s);
    while (!code && (result = sqlite3_step(q)) != SQLITE_DONE) {
        const char *text[3];
        for (int i = 0; i < 3; i++)
            text[i] = result == SQLITE_ROW ? (const char *) sqlite3_column_text(q, i) : NULL;
        if (result != SQLITE_ROW)
            code = failed(s);
        else if (!is_ours(text[2])) {
            say(stderr,
                "splatguard: %s: found the %.20s \"%.60s\", expected only tables as splatguard "
                "bench makes them; it stays as it is\n",
                s->path, text[0] ? text[0] : "thing", text[1] ? text[1] : "");
            code = STATUS_INPUT;
        }
    }
    sqlite3_finalize(q);
    return code;
}

static int make_tables(struct store *s)
{
    char sql[1024];
    int code = STATUS_DONE;
    for (size_t i = 0; i < TABLES && !code; i++) {
        snprintf(sql, sizeof(sql), "CREATE TABLE IF NOT EXISTS %s", tables[i]);
        code = run(s, sql);
    }
    return code;
}

/* One of ours, or a new one, which is an empty file: one of no tables can be another's. */
static int check_kind(struct store *s)
{
    long application = 0, version = 0, pages = 0;
    char text[64];
    if (sqlite3_exec(s->db, "PRAGMA application_id", read_number, &application, NULL) ||
        sqlite3_exec(s->db, "PRAGMA user_version", read_number, &version, NULL) ||
        sqlite3_exec(s->db, "PRAGMA page_count", read_number, &pages, NULL))
        return failed(s);
    if (!pages) {
        snprintf(text, sizeof(text), "PRAGMA application_id=%d; PRAGMA user_version=%d;",
                 APPLICATION, VERSION);
        int code = run(s, "BEGIN IMMEDIATE");
        if (!code)
            code = make_tables(s);
        if (!code)
            code = run(s, text);
        return code ? code : run(s, "COMMIT");
    }
    if (application != APPLICATION || version != VERSION) {
        say(stderr,
            "splatguard: %s: found a database that is not of this version of splatguard bench; "
            "it stays as it is\n",
            s->path);
        return STATUS_INPUT;
    }
    return check_tables(s);
}

/* Ends a transaction: what is half done is undone. */
static int end(struct store *s, int code)
{
    if (!code)
        code = run(s, "COMMIT");
    if (code)
        sqlite3_exec(s->db, "ROLLBACK", NULL, NULL, NULL);
    return code;
}

int store_has(struct store *s, const char *table, const char *column, bool *has)
{
    char sql[160];
    long columns = 0;
    snprintf(sql, sizeof(sql), "SELECT count(*) FROM pragma_table_info('%s') WHERE name='%s'",
             table, column);
    if (sqlite3_exec(s->db, sql, read_number, &columns, NULL))
        return failed(s);
    *has = columns > 0;
    return STATUS_DONE;
}

/* Adds what an older database lacks. */
static int upgrade(struct store *s)
{
    bool has = false;
    int code = run(s, "BEGIN IMMEDIATE");
    if (code)
        return code;
    code = make_tables(s);
    if (!code)
        code = store_has(s, "curve", "ledger_bytes", &has);
    if (!code && !has)
        code = run(s, "ALTER TABLE curve ADD COLUMN ledger_bytes INT");
    return end(s, code);
}

/* Says why there is no file and will be none: SQLite would name the reason of another try. */
static bool cannot_make(const char *path, bool must_exist)
{
    char folder[PATH_MAX];
    if (must_exist)
        say(stderr, "splatguard: %s: %s, expected a database of splatguard bench or a run\n", path,
            strerror(errno));
    else if (folder_of(path, folder, sizeof(folder)) && access(folder, W_OK))
        say(stderr, "splatguard: %s: cannot make the database: %s\n", path, strerror(errno));
    else
        return false;
    return true;
}

/* Removes an empty file that SQLite made for a database which could not be written. Where it is
 * locked another bench fills it. */
static void remove_empty(struct store *s)
{
    struct stat st;
    const bool locked = (sqlite3_errcode(s->db) & 0xff) == SQLITE_BUSY;
    sqlite3_close(s->db);
    s->db = NULL;
    if (!locked && !stat(s->path, &st) && !st.st_size)
        unlink(s->path);
}

int store_open(const char *path, bool must_exist, struct store **out)
{
    struct stat st;
    struct store *s = *out = calloc(1, sizeof(*s));
    if (!s || !(s->path = strdup(path)))
        return no_memory();
    const bool there = !stat(path, &st);
    if (there && (!S_ISREG(st.st_mode) || (must_exist && !st.st_size))) {
        say(stderr, "splatguard: %s: found %s, expected a database of splatguard bench\n", path,
            S_ISREG(st.st_mode) ? "an empty file" : "what is no file");
        return STATUS_INPUT;
    }
    if (!there && cannot_make(path, must_exist))
        return STATUS_INPUT;
    const int flags =
        must_exist ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
    char *file = NULL; /* to SQLite ":memory:" and "file:x" would be no files of these names */
    if (asprintf(&file, "%s%s", *path == '/' ? "" : "./", path) < 0)
        return no_memory();
    const int opened = sqlite3_open_v2(file, &s->db, flags, NULL);
    free(file);
    if (opened)
        return failed(s);
    sqlite3_extended_result_codes(s->db, 1);
    sqlite3_busy_timeout(s->db, must_exist ? 2000 : 10000); /* milliseconds */
    /* Text of a stranger's database is data: nothing in its schema runs. */
    sqlite3_db_config(s->db, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    sqlite3_db_config(s->db, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, NULL);
    sqlite3_db_config(s->db, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, NULL);
    sqlite3_db_config(s->db, SQLITE_DBCONFIG_ENABLE_VIEW, 0, NULL);
    /* What another program has not moved from its log to its database stays there. */
    sqlite3_db_config(s->db, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    sqlite3_limit(s->db, SQLITE_LIMIT_LENGTH, VALUE_BYTES);
    int code = check_kind(s);
    if (!code)
        sqlite3_db_config(s->db, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 0, NULL);
    if (!code && !must_exist)
        code = check_whole(s);
    if (!code && !must_exist)
        code = upgrade(s);
    if (code && !there)
        remove_empty(s);
    return code;
}

void store_close(struct store **store)
{
    if (*store) {
        sqlite3_close((*store)->db);
        free((*store)->path);
    }
    free(*store);
    *store = NULL;
}

/* A statement with its values: types "t" text, "i" whole number, "r" number, "j" JSON, "b" bytes
 * and their number. Without NAN: that is null. */
static int put(struct store *s, const char *sql, const char *types, ...)
{
    sqlite3_stmt *q = NULL;
    if (sqlite3_prepare_v2(s->db, sql, -1, &q, NULL))
        return failed(s);
    int result = SQLITE_OK;
    va_list args;
    va_start(args, types);
    for (int i = 0; types[i] && result == SQLITE_OK; i++) {
        const char *text = types[i] == 't' ? va_arg(args, const char *) : NULL;
        if (types[i] == 't' && text)
            result = sqlite3_bind_text(q, i + 1, text, -1, SQLITE_TRANSIENT);
        else if (types[i] == 'i')
            result = sqlite3_bind_int64(q, i + 1, va_arg(args, long long));
        else if (types[i] == 'r') {
            const double v = va_arg(args, double);
            if (isfinite(v))
                result = sqlite3_bind_double(q, i + 1, v);
        } else if (types[i] == 'b') {
            const void *bytes = va_arg(args, const void *);
            result = sqlite3_bind_blob64(q, i + 1, bytes, va_arg(args, size_t), SQLITE_TRANSIENT);
        } else if (types[i] == 'j') {
            json_t *value = va_arg(args, json_t *);
            char *dump = value ? json_dumps(value, JSON_SORT_KEYS | JSON_COMPACT) : NULL;
            if (value)
                result =
                    dump ? sqlite3_bind_text(q, i + 1, dump, -1, SQLITE_TRANSIENT) : SQLITE_NOMEM;
            free(dump);
        }
    }
    va_end(args);
    if (result == SQLITE_OK)
        result = sqlite3_step(q);
    const int code = result == SQLITE_DONE || result == SQLITE_ROW ? STATUS_DONE
                     : result == SQLITE_NOMEM                      ? no_memory()
                                                                   : failed(s);
    sqlite3_finalize(q);
    return code;
}

static const char *text_of(const json_t *object, const char *name)
{
    return json_string_value(json_object_get(object, name));
}

/* The cells of a shard take the place of those that the plan has in the database. */
static int check_shard(struct store *s, const struct plan *plan)
{
    sqlite3_stmt *q = NULL;
    const char *now = text_of(plan->root, "shard"), *then = NULL;
    if (!now)
        return STATUS_DONE;
    if (sqlite3_prepare_v2(s->db, "SELECT json_extract(text, '$.shard') FROM plan WHERE name=?", -1,
                           &q, NULL))
        return failed(s);
    sqlite3_bind_text(q, 1, plan->name, -1, SQLITE_TRANSIENT);
    const bool is_there = sqlite3_step(q) == SQLITE_ROW;
    if (is_there)
        then = (const char *) sqlite3_column_text(q, 0);
    const bool other = is_there && (!then || strcmp(then, now));
    if (other)
        say(stderr,
            "splatguard bench: %s: found %s%s of the plan %s, expected a database of its own "
            "for shard %s\n",
            s->path, then ? "shard " : "all", then ? then : "", plan->name, now);
    sqlite3_finalize(q);
    return other ? STATUS_INPUT : STATUS_DONE;
}

int store_cells(struct store *s, const struct plan *plan)
{
    int code = run(s, "BEGIN IMMEDIATE");
    if (code)
        return code;
    code = check_shard(s, plan);
    if (!code)
        code = put(s, "DELETE FROM cell WHERE plan=?", "t", plan->name);
    if (!code)
        code = put(s, "INSERT OR REPLACE INTO plan VALUES(?,?)", "tj", plan->name, plan->root);
    for (int i = 0; i < plan->n_cells && !code; i++) {
        const struct cell *c = &plan->cells[i];
        const struct job *j = &plan->jobs[c->job];
        code = put(s, "INSERT INTO cell VALUES(?,?,?,?,?,?,?,?,?)",
                   "tittttt"
                   "ti",
                   plan->name, (long long) i, j->key, job_kinds[j->kind], c->scene, c->photos,
                   c->defense, c->model, (long long) c->seed);
    }
    return end(s, code);
}

int store_status(struct store *s, const char *key, char status[16])
{
    sqlite3_stmt *q = NULL;
    status[0] = 0;
    if (sqlite3_prepare_v2(s->db, "SELECT status FROM job WHERE key=?", -1, &q, NULL))
        return failed(s);
    sqlite3_bind_text(q, 1, key, -1, SQLITE_TRANSIENT);
    const int result = sqlite3_step(q);
    const char *text = result == SQLITE_ROW ? (const char *) sqlite3_column_text(q, 0) : NULL;
    if (text)
        snprintf(status, 16, "%s", text);
    const int code = result == SQLITE_ROW || result == SQLITE_DONE ? STATUS_DONE : failed(s);
    sqlite3_finalize(q);
    return code;
}

double store_metric(struct store *s, const char *key, const char *name)
{
    sqlite3_stmt *q = NULL;
    double v = NAN;
    if (sqlite3_prepare_v2(s->db, "SELECT value FROM metric WHERE key=? AND name=?", -1, &q, NULL))
        return v;
    sqlite3_bind_text(q, 1, key, -1, SQLITE_TRANSIENT);
    sqlite3_bind_text(q, 2, name, -1, SQLITE_TRANSIENT);
    if (sqlite3_step(q) == SQLITE_ROW && sqlite3_column_type(q, 0) != SQLITE_NULL)
        v = sqlite3_column_double(q, 0);
    sqlite3_finalize(q);
    return v;
}

/* Every number of a JSON object, those in objects with a dot: "stage_seconds.loss". */
static int put_numbers(struct store *s, const char *key, const char *prefix, const json_t *object)
{
    const char *name;
    json_t *value;
    int code = STATUS_DONE;
    json_object_foreach((json_t *) object, name, value)
    {
        char path[128];
        snprintf(path, sizeof(path), "%s%s%s", prefix, *prefix ? "." : "", name);
        if (code)
            return code;
        if (json_is_object(value))
            code = put_numbers(s, key, path, value);
        else if (json_is_number(value))
            code = put(s, "INSERT OR REPLACE INTO metric VALUES(?,?,?)", "ttr", key, path,
                       json_number_value(value));
    }
    return code;
}

static double number_of(const json_t *object, const char *name)
{
    const json_t *v = json_object_get(object, name);
    return json_is_number(v) ? json_number_value(v) : NAN;
}

static int put_curve(struct store *s, const char *key, const char *log)
{
    int code = STATUS_DONE;
    for (const char *line = log; line && *line && !code;) {
        const size_t n = strcspn(line, "\n");
        json_t *o = json_loadb(line, n, 0, NULL);
        if (json_is_object(o) && json_object_get(o, "gaussians") && json_object_get(o, "loss"))
            code = put(s, "INSERT OR REPLACE INTO curve VALUES(?,?,?,?,?,?,?,?)", "tirrrrrr", key,
                       (long long) number_of(o, "iteration"), number_of(o, "gaussians"),
                       number_of(o, "loss"), number_of(o, "psnr"), number_of(o, "instances"),
                       number_of(o, "train_seconds"), number_of(o, "ledger_bytes"));
        json_decref(o);
        line += n + (line[n] == '\n');
    }
    return code;
}

static int put_eval(struct store *s, const char *key, const json_t *eval)
{
    const json_t *views = json_object_get(eval, "per_view");
    int code = eval ? put_numbers(s, key, "eval", eval) : STATUS_DONE;
    for (size_t i = 0; i < json_array_size(views) && !code; i++) {
        const json_t *v = json_array_get(views, i);
        code = put(s, "INSERT OR REPLACE INTO view VALUES(?,?,?,?)", "ttrr", key,
                   text_of(v, "name"), number_of(v, "psnr"), number_of(v, "ssim"));
    }
    return code;
}

static int put_audit(struct store *s, const char *key, const json_t *photos)
{
    int code = STATUS_DONE;
    for (size_t i = 0; i < json_array_size(photos) && !code; i++) {
        const json_t *p = json_array_get(photos, i);
        code = put(s, "INSERT INTO audit VALUES(?,?,?,?,?,?,?)", "titrtrr", key, (long long) i,
                   text_of(p, "name"), number_of(p, "score"), text_of(p, "verdict"),
                   number_of(p, "tau"), number_of(p, "tau_error"));
    }
    return code;
}

static int put_spectrum(struct store *s, const char *of, const char *what, const char *kind,
                        const double *values, int n)
{
    int code = STATUS_DONE;
    for (int i = 0; i < n && !code; i++)
        code = put(s, "INSERT OR REPLACE INTO spectrum VALUES(?,?,?,?,?)", "tttir", of, what, kind,
                   (long long) i, values[i]);
    return code;
}

/* In place of earlier ones. */
static int put_pictures(struct store *s, const char *of, const struct pictures *pictures)
{
    int code = put(s, "DELETE FROM picture WHERE of=?", "t", of);
    if (!code)
        code = put(s, "DELETE FROM spectrum WHERE of=?", "t", of);
    for (int k = 0; k < PICTURE_KINDS && !code; k++) {
        const struct picture *p = &pictures->kinds[k];
        code = put(s, "INSERT OR REPLACE INTO picture VALUES(?,?,?,?)", "tttb", of,
                   picture_kinds[k], pictures->view, (const void *) p->png, p->size);
        if (!code)
            code = put_spectrum(s, of, picture_kinds[k], "radial", p->radial, SG_SPECTRUM_RINGS);
        if (!code)
            code = put_spectrum(s, of, picture_kinds[k], "angular", p->angular, PICTURE_DIRECTIONS);
    }
    return code;
}

/* Its pictures are results of another job, and stay. */
static int store_drop(struct store *s, const char *key)
{
    static const char *const sql[] = {"DELETE FROM metric WHERE key=?",
                                      "DELETE FROM curve WHERE key=?",
                                      "DELETE FROM view WHERE key=?", "DELETE FROM job WHERE key=?",
                                      "DELETE FROM audit WHERE key=?"};
    int code = STATUS_DONE;
    for (size_t i = 0; i < sizeof(sql) / sizeof(sql[0]) && !code; i++)
        code = put(s, sql[i], "t", key);
    return code;
}

int store_put(struct store *s, const struct job *j, const struct outcome *o)
{
    const json_t *variant = json_object_get(o->run_config, "cpu_variant");
    char before[16];
    int code = run(s, "BEGIN IMMEDIATE");
    if (code)
        return code;
    code = store_status(s, j->key, before);
    if (!code && !strcmp(before, "done") && strcmp(o->status, "done")) /* its result stays */
        return end(s, put(s, "UPDATE job SET message=? WHERE key=?", "tt", o->message, j->key));
    if (!code)
        code = store_drop(s, j->key);
    if (!code)
        code = put(s, "INSERT INTO job VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)",
                   "ttt"
                   "ii"
                   "tt"
                   "rr"
                   "iii"
                   "ttt"
                   "i"
                   "tjtjj",
                   j->key, job_kinds[j->kind], o->status, (long long) o->exit_status,
                   (long long) o->signal, o->message[0] ? o->message : NULL, o->started, o->seconds,
                   o->cpu_seconds, (long long) o->peak_rss, (long long) o->beside,
                   (long long) (o->beside == 1), text_of(o->by, "version"),
                   text_of(o->by, "commit"), text_of(o->by, "machine"),
                   (long long) json_integer_value(json_object_get(o->by, "cores")),
                   json_string_value(variant), j->config, o->command, o->run_config, o->summary);
    if (!code && o->summary)
        code = put_numbers(s, j->key, "", o->summary);
    if (!code)
        code = put_eval(s, j->key, o->eval);
    if (!code)
        code = put_curve(s, j->key, o->log);
    if (!code)
        code = put_audit(s, j->key, o->photos);
    if (!code && o->shown)
        code = put_pictures(s, o->shown, &o->pictures);
    return end(s, code);
}

int store_query(struct store *s, const char *sql,
                int (*row)(void *arg, int columns, const char *const *values), void *arg)
{
    sqlite3_stmt *q = NULL;
    if (sqlite3_prepare_v2(s->db, sql, -1, &q, NULL))
        return failed(s);
    int result, stop = 0;
    while (!stop && (result = sqlite3_step(q)) == SQLITE_ROW) {
        const char *values[32];
        const int n = sqlite3_column_count(q);
        for (int i = 0; i < n && i < 32; i++)
            values[i] = (const char *) sqlite3_column_text(q, i);
        stop = row(arg, n, values);
    }
    const int code = stop ? stop : result == SQLITE_DONE ? STATUS_DONE : failed(s);
    sqlite3_finalize(q);
    return code;
}

#else

int store_open(const char *path, bool must_exist, struct store **out)
{
    (void) must_exist;
    *out = NULL;
    say(stderr,
        "splatguard: %s: this build has no SQLite, which results are kept in; build it where "
        "libsqlite3-dev is installed\n",
        path);
    return STATUS_USAGE;
}

void store_close(struct store **store)
{
    *store = NULL;
}

int store_cells(struct store *s, const struct plan *plan)
{
    (void) s, (void) plan;
    return STATUS_INTERNAL;
}

int store_status(struct store *s, const char *key, char status[16])
{
    (void) s, (void) key;
    status[0] = 0;
    return STATUS_INTERNAL;
}

double store_metric(struct store *s, const char *key, const char *name)
{
    (void) s, (void) key, (void) name;
    return NAN;
}

int store_put(struct store *s, const struct job *job, const struct outcome *o)
{
    (void) s, (void) job, (void) o;
    return STATUS_INTERNAL;
}

int store_has(struct store *s, const char *table, const char *column, bool *has)
{
    (void) s, (void) table, (void) column;
    *has = false;
    return STATUS_INTERNAL;
}

int store_query(struct store *s, const char *sql,
                int (*row)(void *arg, int columns, const char *const *values), void *arg)
{
    (void) s, (void) sql, (void) row, (void) arg;
    return STATUS_INTERNAL;
}

#endif
