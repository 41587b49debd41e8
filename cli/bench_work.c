/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the jobs of a plan as processes of this program, each in a folder of its own. A crash, a
 * timeout or too much memory is a result of that job and nothing else. Whatever is stopped goes on
 * from its checkpoint the next time. */
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bench.h"
#include "interrupt.h"

#define ARGUMENTS 256
#define GRACE 60.0 /* seconds to save in, after which a process is killed */
#define POLL_NS 20000000
#define MADE "made"   /* marks the folder of a job that is done */
#define STUCK "stuck" /* that of one whose checkpoint cannot be read */

enum state { WAITING, RUNNING, DONE, FAILED };

/* A job while this process knows about it. */
struct work {
    enum state state;
    int phase; /* of its commands */
    pid_t pid;
    int lock;           /* see "hold"; while it is running, else HELD */
    double start, told; /* seconds; when it was told to end, 0 = not */
    const char *why;    /* "timeout" or "memory", then */
    struct outcome out;
    char folder[PATH_MAX];
};

struct scheduler {
    const struct bench *b;
    struct work *work;
    int running, done, failed, left;
    int held; /* jobs that could begin but for a process of an earlier bench */
    char program[PATH_MAX];
};

static int remove_entry(const char *path, const struct stat *st, int kind, struct FTW *walk)
{
    (void) st, (void) kind, (void) walk;
    return remove(path);
}

static void remove_folder(const char *path)
{
    nftw(path, remove_entry, 16, FTW_DEPTH | FTW_PHYS);
}

__attribute__((format(printf, 2, 3))) static const char *below(const struct work *w,
                                                               const char *format, ...)
{
    static char path[PATH_MAX + 64];
    char name[64];
    va_list args;
    va_start(args, format);
    vsnprintf(name, sizeof(name), format, args);
    va_end(args);
    snprintf(path, sizeof(path), "%s/%s", w->folder, name);
    return path;
}

static json_t *load_json(const char *path)
{
    return json_load_file(path, 0, NULL);
}

static char *load_text(const char *path)
{
    FILE *f = fopen(path, "rb");
    char *text = NULL;
    size_t size = 0, capacity = 0, got = 0;
    do {
        capacity = capacity ? 2 * capacity : 65536;
        char *more = f ? realloc(text, capacity + 1) : NULL;
        if (!more)
            break;
        text = more;
        got = fread(text + size, 1, capacity - size, f);
        size += got;
        text[size] = 0;
    } while (size == capacity);
    if (f)
        fclose(f);
    return text;
}

/* ---- what a job runs ---- */

struct command_line {
    char *words[ARGUMENTS];
    int n;
};

__attribute__((format(printf, 2, 3))) static void add(struct command_line *c, const char *format,
                                                      ...)
{
    va_list args;
    va_start(args, format);
    if (c->n < ARGUMENTS - 1 && vasprintf(&c->words[c->n], format, args) >= 0)
        c->n++;
    va_end(args);
    c->words[c->n] = NULL;
}

/* {clean*0.5} becomes half of the clean run's Gaussians. */
static void add_option(struct scheduler *s, struct command_line *c, const struct job *j,
                       const char *text)
{
    double factor;
    if (!plan_limit(text, &factor)) {
        add(c, "%s", text);
        return;
    }
    const char *clean = s->b->plan->jobs[j->needs[j->n_needs - 1]].key;
    const double n = store_metric(s->b->store, clean, "final_gaussians");
    if (!(n >= 0)) { /* which the command refuses */
        add(c, "%s", text);
        return;
    }
    add(c, "%.0f", n * factor > 4 ? floor(n * factor) : 4);
}

static void add_options(struct scheduler *s, struct command_line *c, const struct job *j,
                        const json_t *options)
{
    for (size_t i = 0; i < json_array_size(options); i++)
        add_option(s, c, j, json_string_value(json_array_get(options, i)));
}

static const json_t *options_of(const struct job *j)
{
    return json_object_get(j->config, "options");
}

/* Where the photos of a scene or poison are. */
static void add_source(struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const char *path = json_string_value(json_object_get(j->config, "path")),
               *layout = json_string_value(json_object_get(j->from, "layout"));
    if (j->kind == JOB_POISON)
        add(c, "%s/scene", s->work[index].folder);
    else if (path)
        add(c, "%s", path);
    else
        add(c, "%s/scene/%s", s->work[index].folder, layout ? layout : "blender");
}

static bool exists(const char *path)
{
    return !access(path, F_OK);
}

/* Options of the scene that a run was given. Its folder brings them to other commands; the file of
 * a pruned model does not. */
static json_t *run_scene_options(const struct job *run)
{
    const json_t *options = options_of(run);
    json_t *of_scene = json_array();
    for (size_t i = 0; i < json_array_size(options); i++) {
        const char *word = json_string_value(json_array_get(options, i));
        const struct sg_option *row = sg_scene_options();
        while (row->name && (strncmp(word, "--", 2) || strcmp(word + 2, row->name)))
            row++;
        if (!row->name || row->transient || strcmp(row->group, "Scene"))
            continue;
        json_array_append(of_scene, json_array_get(options, i));
        if (row->type != SG_OPTION_FLAG)
            json_array_append(of_scene, json_array_get(options, i + 1));
    }
    return of_scene;
}

/* Of a pruned model: its run's. */
static json_t *pruned_scene_options(const struct plan *p, const struct job *j)
{
    return j->kind == JOB_PRUNE ? run_scene_options(&p->jobs[j->needs[1]]) : json_array();
}

/* The same photos for all: the clean scene's test views. model: in the job's folder. */
static void add_eval(struct scheduler *s, struct command_line *c, int index, const char *model)
{
    const struct plan *p = s->b->plan;
    const struct job *j = &p->jobs[index];
    add(c, "eval"), add(c, "%s/%s", s->work[index].folder, model);
    add(c, "--json"), add(c, "--per-view");
    add(c, "--quiet"), add(c, "--threads"), add(c, "%d", p->threads), add(c, "--scene");
    add_source(s, c, j->needs[0]);
    json_t *engine = p->engine ? json_pack("[s, s]", "--engine", p->engine) : NULL;
    json_t *run = pruned_scene_options(p, j);
    const json_t *const lists[] = {engine, json_object_get(j->from, "size"),
                                   json_object_get(j->from, "options"), run};
    json_t *options = options_merge(lists, 4);
    json_decref(engine);
    json_decref(run);
    add_options(s, c, j, options);
    json_decref(options);
}

static void add_train(struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    add(c, "train");
    if (exists(below(&s->work[index], "run/checkpoint.bin"))) {
        add(c, "--resume"), add(c, "%s/run", s->work[index].folder);
        return;
    }
    add_source(s, c, j->kind == JOB_PROXY ? j->needs[0] : j->needs[1]);
    add(c, "-o"), add(c, "%s/run", s->work[index].folder);
    add(c, "--seed"), add(c, "%d", j->seed);
    if (j->kind == JOB_TRAIN)
        add(c, "--eval");
    add_options(s, c, j, options_of(j));
}

static void add_attack(struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    add(c, "attack");
    if (exists(below(&s->work[index], "scene/attack/checkpoint.bin"))) {
        add(c, "--resume"), add(c, "%s/scene", s->work[index].folder);
        return;
    }
    add_source(s, c, j->needs[0]);
    add(c, "-o"), add(c, "%s/scene", s->work[index].folder);
    if (j->n_needs > 1)
        add(c, "--proxy"), add(c, "%s/run", s->work[j->needs[1]].folder);
    add_options(s, c, j, options_of(j));
}

static void add_prune(struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    add(c, "prune"), add(c, "%s/run", s->work[j->needs[1]].folder), add(c, "--json");
    add(c, "-o"), add(c, "%s/model.ply", s->work[index].folder);
    add(c, "--seed"), add(c, "%d", j->seed);
    add_options(s, c, j, options_of(j));
}

/* The model from the cameras of its own training photos, and these photos. */
static void add_render(struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const struct job *of = &s->b->plan->jobs[j->needs[1]];
    const bool run = of->kind == JOB_TRAIN;
    json_t *brought = pruned_scene_options(s->b->plan, of);
    const json_t *const lists[] = {options_of(j), brought};
    json_t *options = options_merge(lists, 2);
    add(c, "render"), add(c, "%s/%s", s->work[j->needs[1]].folder, run ? "run" : "model.ply");
    add(c, "--scene"), add_source(s, c, j->needs[2]);
    add(c, "-o"), add(c, "%s/views", s->work[index].folder);
    add(c, "--split"), add(c, "train"), add(c, "--photo");
    add_options(s, c, j, options);
    json_decref(brought);
    json_decref(options);
}

/* Photos as training sees them: without the test views. */
static void add_audit(struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    add(c, "audit"), add_source(s, c, j->needs[0]), add(c, "--json"), add(c, "--eval");
    add_options(s, c, j, options_of(j));
}

/* The command of a job's phase; false: there is none left. */
static bool make_command(struct scheduler *s, int index, struct command_line *c)
{
    const struct plan *p = s->b->plan;
    const struct job *j = &p->jobs[index];
    const struct work *w = &s->work[index];
    const json_t *synth = json_object_get(j->config, "synth");
    const bool measured = j->kind == JOB_TRAIN || j->kind == JOB_PRUNE;
    c->n = 0;
    add(c, "splatguard");
    if (w->phase == 1 && measured)
        add_eval(s, c, index, j->kind == JOB_TRAIN ? "run" : "model.ply");
    else if (w->phase == 0 && j->kind == JOB_SCENE && synth) {
        add(c, "synth"), add(c, "-o"), add(c, "%s/scene", w->folder);
        add_options(s, c, j, synth);
    } else if (w->phase == 0 && j->kind != JOB_SCENE)
        (j->kind == JOB_POISON     ? add_attack
         : j->kind == JOB_PRUNE    ? add_prune
         : j->kind == JOB_PICTURES ? add_render
         : j->kind == JOB_AUDIT    ? add_audit
                                   : add_train)(s, c, index);
    else {
        free(c->words[0]);
        return false;
    }
    if (w->phase == 0)
        add(c, "--quiet"), add(c, "--threads"), add(c, "%d", p->threads);
    return true;
}

/* Whether the phase's result is there already, from a process that was stopped after it. */
static bool phase_is_done(const struct job *j, struct work *w)
{
    if (w->phase > 0)
        return false;
    if (j->kind == JOB_TRAIN || j->kind == JOB_PROXY) {
        json_t *summary = load_json(below(w, "run/summary.json"));
        const bool done = json_is_false(json_object_get(summary, "interrupted"));
        json_decref(summary);
        return done;
    }
    return j->kind == JOB_POISON && exists(below(w, "scene/poison.json"));
}

/* ---- processes ---- */

static void note_command(struct work *w, const struct command_line *c)
{
    char *text = NULL;
    size_t size;
    FILE *f = open_memstream(&text, &size);
    if (!f)
        return;
    fprintf(f, "%s%s", w->out.command ? w->out.command : "", w->out.command ? "\n" : "");
    for (int i = 0; i < c->n; i++)
        fprintf(f, "%s%s", i ? " " : "", c->words[i]);
    fclose(f);
    free(w->out.command);
    w->out.command = text;
}

static int open_output(const struct work *w, const char *name, bool append)
{
    return open(below(w, "%s.%d", name, w->phase),
                O_WRONLY | O_CREAT | O_CLOEXEC | (append ? O_APPEND : O_TRUNC), 0666);
}

#define HELD (-1)
#define NO_LOCK (-2)

/* The lock of a job's folder, beside it, which is kept until the job ends. HELD: by a process of an
 * earlier bench, which was killed and still saves what it has. NO_LOCK: the file cannot be opened,
 * which errno explains. */
static int hold(const struct work *w)
{
    char path[PATH_MAX + 8];
    snprintf(path, sizeof(path), "%s.lock", w->folder);
    const int lock = open(path, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (lock < 0)
        return NO_LOCK;
    if (flock(lock, LOCK_EX | LOCK_NB)) {
        close(lock);
        return HELD;
    }
    return lock;
}

static void let_go(struct work *w)
{
    if (w->lock >= 0)
        close(w->lock);
    w->lock = HELD;
}

/* Starts the phase, in a process group that a terminal's Ctrl-C does not reach: this process tells
 * it to end. It ends too where this process dies. */
static bool start_phase(struct scheduler *s, int index)
{
    struct work *w = &s->work[index];
    struct command_line c;
    if (!make_command(s, index, &c))
        return false;
    const bool whole = c.n < ARGUMENTS - 1;
    note_command(w, &c);
    const int out = open_output(w, "out", false), err = open_output(w, "err", true);
    const pid_t parent = getpid();
    w->pid = out < 0 || err < 0 || !whole ? -1 : fork();
    if (!w->pid) {
        setpgid(0, 0);
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        if (getppid() != parent)
            _exit(STATUS_INTERRUPTED);
        dup2(out, STDOUT_FILENO);
        dup2(err, STDERR_FILENO);
        fcntl(w->lock, F_SETFD, 0); /* the process has it too, until it ends */
        execv(s->program, c.words);
        _exit(STATUS_INTERNAL);
    }
    if (out >= 0)
        close(out);
    if (err >= 0)
        close(err);
    for (int i = 0; i < c.n; i++)
        free(c.words[i]);
    if (w->pid < 0)
        snprintf(w->out.message, sizeof(w->out.message), "cannot start: %s",
                 whole ? strerror(errno) : "too many options");
    w->told = 0;
    return w->pid > 0;
}

/* Ends what takes too long or too much. */
static void watch(const struct scheduler *s, struct work *w)
{
    const struct plan *p = s->b->plan;
    const double t = clock_seconds();
    if (w->told > 0) {
        if (t - w->told > GRACE)
            kill(w->pid, SIGKILL);
    } else if (p->timeout > 0 && t - w->start > p->timeout)
        w->why = "timeout", w->told = t, kill(w->pid, SIGTERM);
    else if (p->memory && resident_bytes(w->pid) > p->memory)
        w->why = "memory", w->told = t - GRACE, kill(w->pid, SIGKILL);
}

/* Marks a job that a line is said of because it cannot go on: its checkpoint is damaged, or of
 * another version. */
static void mark_stuck(const struct work *w, const char *line)
{
    static const char name[] = "checkpoint.bin: ";
    const char *at = strstr(line, name), *rest = at ? at + strlen(name) : "";
    const bool stuck = !strncmp(rest, "found ", 6) || !strncmp(rest, "byte ", 5);
    const int mark = stuck ? open(below(w, STUCK), O_WRONLY | O_CREAT | O_CLOEXEC, 0666) : -1;
    if (mark >= 0)
        close(mark);
}

/* What a job was ended for, or the last line that its process has said; how to continue it is of no
 * use here. */
static void last_words(const struct plan *p, struct work *w)
{
    char *text = load_text(below(w, "err.%d", w->phase)), *rest = text;
    if (w->why && !strcmp(w->why, "timeout"))
        snprintf(w->out.message, sizeof(w->out.message), "took %.0f s, the limit is %.0f s",
                 w->out.seconds, p->timeout);
    else if (w->why)
        snprintf(w->out.message, sizeof(w->out.message),
                 "took more memory than the limit of %llu bytes", (unsigned long long) p->memory);
    else {
        const char *last = "";
        for (char *line; (line = strsep(&rest, "\n"));)
            if (*line && strncmp(line, "Continue with:", strlen("Continue with:")))
                last = line;
        snprintf(w->out.message, sizeof(w->out.message), "%s", last);
        mark_stuck(w, last);
    }
    free(text);
}

/* Returns an exit code. */
static int collect(struct scheduler *s, const struct job *j, struct work *w)
{
    if (j->kind == JOB_PICTURES) {
        char views[PATH_MAX + 64];
        snprintf(views, sizeof(views), "%s", below(w, "views"));
        const int code = pictures_read(views, &w->out.pictures);
        w->out.shown = s->b->plan->jobs[j->needs[1]].key;
        if (!s->b->keep)
            remove_folder(views);
        return code;
    }
    if (j->kind == JOB_AUDIT) {
        w->out.summary = load_json(below(w, "out.0"));
        w->out.photos = json_incref(json_object_get(w->out.summary, "images"));
        json_object_del(w->out.summary, "images");
        return w->out.photos ? STATUS_DONE : STATUS_INPUT;
    }
    if (j->kind == JOB_TRAIN || j->kind == JOB_PROXY) {
        w->out.summary = load_json(below(w, "run/summary.json"));
        w->out.run_config = load_json(below(w, "run/config.json"));
        w->out.log = load_text(below(w, "run/log.jsonl"));
    } else if (j->kind == JOB_POISON) {
        w->out.summary = load_json(below(w, "scene/poison.json"));
        json_object_del(w->out.summary, "growth");
    } else if (j->kind == JOB_PRUNE)
        w->out.summary = load_json(below(w, "out.0"));
    if (j->kind == JOB_TRAIN || j->kind == JOB_PRUNE)
        w->out.eval = load_json(below(w, "out.1"));
    const json_t *left = json_object_get(w->out.summary, "gaussians");
    if (j->kind == JOB_PRUNE && left) { /* the most were there before it pruned */
        const char *run = s->b->plan->jobs[j->needs[1]].key;
        json_object_set(w->out.summary, "final_gaussians", (json_t *) left);
        json_object_set_new(w->out.summary, "max_gaussians",
                            number_json(store_metric(s->b->store, run, "max_gaussians")));
    }
    return STATUS_DONE;
}

static void clear_outcome(struct outcome *o)
{
    json_decref(o->summary);
    json_decref(o->run_config);
    json_decref(o->eval);
    json_decref(o->photos);
    free(o->log);
    free(o->command);
    pictures_clear(&o->pictures);
    *o = (struct outcome){0};
}

/* Stores what came of a job. What it made stays for those that need it; checkpoints go. */
static int finish(struct scheduler *s, int index, const char *status)
{
    const struct job *j = &s->b->plan->jobs[index];
    struct work *w = &s->work[index];
    if (!strcmp(status, "done") && collect(s, j, w)) {
        status = "failed";
        snprintf(w->out.message, sizeof(w->out.message), "its result cannot be read");
    }
    const bool done = !strcmp(status, "done");
    /* Before the result is stored: a job that has one, but not this mark, is done twice. */
    const int made = done ? open(below(w, MADE), O_WRONLY | O_CREAT | O_CLOEXEC, 0666) : -1;
    if (made >= 0)
        close(made);
    w->out.status = status;
    const int code = store_put(s->b->store, j, &w->out);
    if (code)
        return code;
    w->state = done ? DONE : FAILED;
    s->done += w->state == DONE, s->failed += w->state == FAILED;
    if (w->state == DONE && !s->b->keep) {
        remove(below(w, "run/checkpoint.bin"));
        remove(below(w, "scene/attack/checkpoint.bin"));
    }
    let_go(w);
    if (!s->b->quiet || w->state == FAILED)
        say(stderr, "%-7s %-6s %s %s %s seed %d, %.1f s%s%s\n", status, job_kinds[j->kind],
            j->scene, j->photos, j->defense, j->seed, w->out.seconds,
            w->out.message[0] && w->state == FAILED ? ": " : "",
            w->state == FAILED ? w->out.message : "");
    clear_outcome(&w->out);
    return STATUS_DONE;
}

/* The next phase that is not done, or the end. */
static int advance(struct scheduler *s, int index)
{
    struct work *w = &s->work[index];
    const struct job *j = &s->b->plan->jobs[index];
    if (phase_is_done(j, w))
        w->phase++;
    if (start_phase(s, index))
        return STATUS_DONE;
    s->running--;
    return finish(s, index, w->pid < 0 ? "failed" : "done");
}

/* A process has ended. */
static int reap(struct scheduler *s, int index, int status, const struct rusage *usage)
{
    struct work *w = &s->work[index];
    struct outcome *o = &w->out;
    const uint64_t rss = (uint64_t) usage->ru_maxrss * 1024;
    o->cpu_seconds += (double) usage->ru_utime.tv_sec + 1e-6 * (double) usage->ru_utime.tv_usec +
                      (double) usage->ru_stime.tv_sec + 1e-6 * (double) usage->ru_stime.tv_usec;
    o->peak_rss = rss > o->peak_rss ? rss : o->peak_rss;
    o->seconds = clock_seconds() - w->start;
    o->exit_status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    o->signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    w->pid = 0;
    if (!o->signal && !o->exit_status && !w->why) {
        w->phase++;
        return advance(s, index);
    }
    s->running--;
    if (!w->why && interrupted()) { /* it goes on the next time */
        w->state = WAITING;
        let_go(w);
        clear_outcome(o);
        return STATUS_DONE;
    }
    last_words(s->b->plan, w);
    return finish(s, index,
                  w->why                            ? w->why
                  : o->signal                       ? "crashed"
                  : o->exit_status == STATUS_BUDGET ? "memory"
                                                    : "failed");
}

static int begin(struct scheduler *s, int index)
{
    struct work *w = &s->work[index];
    const struct job *j = &s->b->plan->jobs[index];
    time_t t = time(NULL);
    struct tm utc;
    const bool saved =
        exists(below(w, "run/checkpoint.bin")) || exists(below(w, "scene/attack/checkpoint.bin"));
    const bool goes_on = saved && !exists(below(w, STUCK));
    if (!goes_on && !phase_is_done(j, w))
        remove_folder(w->folder);
    if (mkdir(w->folder, 0777) && errno != EEXIST) {
        say(stderr, "splatguard bench: %s: cannot make the folder: %s\n", w->folder,
            strerror(errno));
        return STATUS_INPUT;
    }
    w->out = (struct outcome){0};
    strftime(w->out.started, sizeof(w->out.started), "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&t, &utc));
    w->state = RUNNING, w->phase = 0, w->why = NULL, w->pid = 0;
    w->start = clock_seconds();
    s->running++;
    for (int i = 0; i < s->b->plan->n; i++) {
        struct work *other = &s->work[i];
        if (other->state == RUNNING && other->out.beside < s->running)
            other->out.beside = s->running;
    }
    return advance(s, index);
}

/* ---- the order ---- */

/* Can begin: 1; waits for another: 0; needs one that has failed: -1. */
static int is_ready(const struct scheduler *s, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    int ready = 1;
    for (int i = 0; i < j->n_needs; i++) {
        const enum state needed = s->work[j->needs[i]].state;
        if (needed == FAILED)
            return -1;
        ready &= needed == DONE;
    }
    return ready;
}

static bool has_room(const struct scheduler *s)
{
    const struct bench *b = s->b;
    const uint64_t each = b->plan->memory;
    return s->running < b->jobs &&
           (!b->memory || !each || (uint64_t) (s->running + 1) * each <= b->memory ||
            s->running == 0);
}

static int start_ready(struct scheduler *s)
{
    int code = STATUS_DONE;
    s->held = 0;
    for (int i = 0; i < s->b->plan->n && !code && !interrupted(); i++) {
        struct work *w = &s->work[i];
        const int ready = w->state == WAITING ? is_ready(s, i) : 0;
        if (ready < 0) {
            w->state = FAILED; /* no row: it has not run */
            s->left++;
        } else if (ready && has_room(s)) {
            w->lock = hold(w);
            s->held += w->lock == HELD;
            if (w->lock == NO_LOCK) {
                say(stderr, "splatguard bench: %s.lock: %s\n", w->folder, strerror(errno));
                code = STATUS_INPUT;
            } else if (w->lock >= 0)
                code = begin(s, i);
        }
    }
    return code;
}

static int wait_some(struct scheduler *s)
{
    int code = STATUS_DONE;
    nanosleep(&(struct timespec){.tv_nsec = POLL_NS}, NULL);
    for (int i = 0; i < s->b->plan->n && !code; i++) {
        struct work *w = &s->work[i];
        int status;
        struct rusage usage;
        if (w->state != RUNNING || w->pid <= 0)
            continue;
        if (wait4(w->pid, &status, WNOHANG, &usage) == w->pid)
            code = reap(s, i, status, &usage);
        else if (interrupted() && w->told == 0)
            w->told = clock_seconds(), kill(w->pid, SIGTERM);
        else
            watch(s, w);
    }
    return code;
}

/* Whether what a job has made for others is there, and whole. */
static bool has_product(const struct scheduler *s, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    struct work *w = &s->work[index];
    if (j->kind == JOB_SCENE)
        return !json_object_get(j->config, "synth") || exists(below(w, MADE));
    return j->kind == JOB_PRUNE ? exists(below(w, "model.ply")) : phase_is_done(j, w);
}

/* Of the clean run a limit needs its number only. */
static bool needs_product(const struct job *j, int k)
{
    const json_t *options = options_of(j);
    double factor;
    for (size_t i = 0; i < json_array_size(options) && k == j->n_needs - 1; i++)
        if (plan_limit(json_string_value(json_array_get(options, i)), &factor))
            return false;
    return true;
}

/* Results stay when the folders of their jobs are gone. These jobs run again where others need what
 * they made: those that have no result, or have to run again themselves. */
static void repeat_needed(struct scheduler *s)
{
    const struct plan *p = s->b->plan;
    for (int i = p->n; i-- > 0;) { /* needs come before */
        const struct job *j = &p->jobs[i];
        if (s->work[i].state != WAITING || is_ready(s, i) < 0)
            continue;
        for (int k = 0; k < j->n_needs; k++)
            if (s->work[j->needs[k]].state == DONE && needs_product(j, k) &&
                !has_product(s, j->needs[k]))
                s->work[j->needs[k]].state = WAITING;
    }
}

/* What is there already. */
static int recall(struct scheduler *s)
{
    const struct plan *p = s->b->plan;
    for (int i = 0; i < p->n; i++) {
        struct work *w = &s->work[i];
        char status[16];
        if (snprintf(w->folder, sizeof(w->folder), "%s/%s", s->b->work, p->jobs[i].key) >=
            (int) sizeof(w->folder)) {
            say(stderr, "splatguard bench: %s: the name is too long\n", s->b->work);
            return STATUS_INPUT;
        }
        const int code = store_status(s->b->store, p->jobs[i].key, status);
        if (code)
            return code;
        if (!strcmp(status, "done"))
            w->state = DONE;
        else if (*status && !s->b->retry)
            w->state = FAILED;
    }
    repeat_needed(s);
    return STATUS_DONE;
}

static void stop_all(struct scheduler *s)
{
    for (int i = 0; i < s->b->plan->n; i++)
        if (s->work[i].pid > 0)
            kill(s->work[i].pid, SIGTERM);
    for (int i = 0; i < s->b->plan->n; i++)
        while (s->work[i].pid > 0 && waitpid(s->work[i].pid, NULL, 0) < 0 && errno == EINTR)
            ;
}

int bench_run(const struct bench *b)
{
    struct scheduler s = {.b = b, .work = calloc((size_t) b->plan->n + 1, sizeof(struct work))};
    if (!s.work)
        return no_memory();
    for (int i = 0; i < b->plan->n; i++)
        s.work[i].lock = HELD;
    int code = own_program(&command_bench, s.program, sizeof(s.program));
    if (!code)
        code = recall(&s);
    int had = 0;
    for (int i = 0; i < b->plan->n && !code; i++)
        had += s.work[i].state == DONE;
    interrupt_catch();
    while (!code && !(code = start_ready(&s)) && (s.running || s.held))
        code = wait_some(&s);
    if (code)
        stop_all(&s);
    int waiting = 0, failed = 0;
    for (int i = 0; i < b->plan->n; i++) {
        waiting += s.work[i].state == WAITING;
        failed += s.work[i].state == FAILED;
        let_go(&s.work[i]);
        clear_outcome(&s.work[i].out);
    }
    if (!code)
        say(stderr,
            "%d jobs were done before, %d are done now, %d failed, %d need one of these, %d "
            "are left\n",
            had, s.done, s.failed, s.left, waiting);
    const int before = failed - s.failed - s.left;
    if (!code && before)
        say(stderr, "%d jobs have failed before; --retry runs them again\n", before);
    free(s.work);
    if (!code && interrupted())
        return STATUS_INTERRUPTED;
    return code ? code : failed ? STATUS_INPUT : STATUS_DONE;
}
