/* SPDX-License-Identifier: Apache-2.0 */
/* One job of a plan: a process of this program in a folder of its own. A crash, a timeout or too
 * much memory is a result of that job and nothing else. */
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bench_work.h"
#include "interrupt.h"

#define GRACE 60.0      /* seconds to save in, after which a process is killed */
#define MADE "made"     /* marks the folder of a job that is done */
#define STUCK "stuck"   /* that of one whose checkpoint cannot be read */
#define BY "by"         /* what ran its first command, and the command */
#define BESIDE "beside" /* most jobs that ran at the same time as its earlier processes */

static int remove_entry(const char *path, const struct stat *st, int kind, struct FTW *walk)
{
    (void) st, (void) kind, (void) walk;
    return remove(path);
}

static void remove_folder(const char *path)
{
    nftw(path, remove_entry, 16, FTW_DEPTH | FTW_PHYS);
}

const char *job_path(const struct work *w, const char *format, ...)
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

/* Where a job saves its progress, until the next call of job_path. */
static const char *checkpoint_path(const struct job *j, const struct work *w)
{
    return job_path(w,
                    j->kind == JOB_POISON ? "scene/attack/checkpoint.bin" : "run/checkpoint.bin");
}

bool job_has_checkpoint(const struct scheduler *s, int index)
{
    return file_exists(checkpoint_path(&s->b->plan->jobs[index], &s->work[index]));
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

bool file_exists(const char *path)
{
    return !access(path, F_OK);
}

/* Whether the job's first phase trains. */
static bool trains(const struct job *j)
{
    return j->kind == JOB_TRAIN || j->kind == JOB_PROXY;
}

/* Whether a training was whole. One that memory has ended is not, and exits with 0 all the same.
 * iteration: its newest one, or NULL. */
static bool is_trained(const struct work *w, int *iteration)
{
    json_t *summary = load_json(job_path(w, "run/summary.json"));
    const bool whole = json_is_false(json_object_get(summary, "interrupted"));
    if (iteration)
        *iteration = (int) json_integer_value(json_object_get(summary, "iterations"));
    json_decref(summary);
    return whole;
}

/* Whether the phase's result is there already, from a process that was stopped after it. */
static bool phase_is_done(const struct job *j, const struct work *w)
{
    if (w->phase > 0)
        return false;
    return trains(j) ? is_trained(w, NULL)
                     : j->kind == JOB_POISON && file_exists(job_path(w, "scene/poison.json"));
}

static void note_command(struct work *w, const struct command_line *c)
{
    char *text = NULL;
    size_t size;
    FILE *f = open_memstream(&text, &size);
    if (!f)
        return;
    fprintf(f, "%s%s", w->out.command ? w->out.command : "", w->out.command ? "\n" : "");
    for (int i = 0; i < c->n; i++) {
        fputs(i ? " " : "", f);
        put_short_word(f, c->words[i]);
    }
    fclose(f);
    free(w->out.command);
    w->out.command = text;
}

static json_t *this_program(void)
{
    char machine[128];
    sg_machine_name(machine, sizeof(machine));
    return json_pack("{s:s,s:s,s:s,s:i}", "version", sg_version(), "commit", SG_COMMIT, "machine",
                     machine, "cores", (int) sysconf(_SC_NPROCESSORS_ONLN));
}

/* For a process that finds the phase done. */
static void note_by(const struct work *w)
{
    json_object_set_new(w->out.by, "command", json_string(w->out.command));
    json_dump_file(w->out.by, job_path(w, BY), JSON_SORT_KEYS | JSON_COMPACT);
}

/* The first phase was done by an earlier process, perhaps of another version or machine. */
static void recall_by(struct work *w)
{
    json_t *by = load_json(job_path(w, BY));
    const char *command = json_string_value(json_object_get(by, "command"));
    if (!command) { /* of a version that did not note it, or written by half */
        json_decref(by);
        return;
    }
    json_decref(w->out.by);
    w->out.by = by;
    w->out.command = strdup(command);
}

static int open_output(const struct work *w, const char *name, int how)
{
    return open(job_path(w, "%s.%d", name, w->phase), O_WRONLY | O_CREAT | O_CLOEXEC | how, 0666);
}

int job_hold(const struct work *w)
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

void job_let_go(struct work *w)
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
    if (!command_make(s, index, &c))
        return false;
    const bool whole = c.n < COMMAND_WORDS - 1;
    note_command(w, &c);
    if (!w->phase)
        note_by(w);
    const int out = open_output(w, "out", O_TRUNC), err = open_output(w, "err", O_APPEND);
    const off_t said = lseek(err, 0, SEEK_END);
    w->said = said > 0 ? (size_t) said : 0;
    const pid_t parent = getpid();
    interrupt_hold();
    w->pid = out < 0 || err < 0 || !whole ? -1 : fork();
    interrupt_release(!w->pid);
    if (!w->pid) {
        setpgid(0, 0);
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        if (getppid() != parent)
            _exit(STATUS_INTERRUPTED);
        dup2(out, STDOUT_FILENO);
        dup2(err, STDERR_FILENO);
        fcntl(w->lock, F_SETFD, 0);       /* the process has it too, until it ends */
        execv("/proc/self/exe", c.words); /* this program, also where its file was replaced */
        _exit(STATUS_INTERNAL);
    }
    if (out >= 0)
        close(out);
    if (err >= 0)
        close(err);
    command_clear(&c);
    if (w->pid < 0)
        snprintf(w->out.message, sizeof(w->out.message), "cannot start: %s",
                 whole ? strerror(errno) : "too many options");
    w->told = 0;
    return w->pid > 0;
}

void job_watch(const struct scheduler *s, struct work *w)
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
    const int mark = stuck ? open(job_path(w, STUCK), O_WRONLY | O_CREAT | O_CLOEXEC, 0666) : -1;
    if (mark >= 0)
        close(mark);
}

/* Whether a line of a command says no reason, but what there is now: it follows the reason. */
static bool is_aside(const char *line)
{
    static const char *const asides[] = {"Continue with:", "the model of iteration ",
                                         "the limit is --max-memory,",
                                         "this is where the scene was;"};
    bool is = false;
    for (size_t i = 0; i < sizeof(asides) / sizeof(asides[0]); i++)
        is |= !strncmp(line, asides[i], strlen(asides[i]));
    return is;
}

/* What a job was ended for, or the last reason that its process has said. */
static void last_words(const struct plan *p, struct work *w)
{
    char *text = load_text(job_path(w, "err.%d", w->phase));
    if (w->why && !strcmp(w->why, "timeout"))
        snprintf(w->out.message, sizeof(w->out.message), "took %.0f s, the limit is %.0f s",
                 w->out.seconds, p->timeout);
    else if (w->why)
        snprintf(w->out.message, sizeof(w->out.message),
                 "took more memory than the limit of %llu bytes", (unsigned long long) p->memory);
    else {
        const char *last = NULL;
        char *rest = text && strlen(text) > w->said ? text + w->said : NULL;
        for (char *line; (line = strsep(&rest, "\n"));)
            if (*line && !is_aside(line))
                last = line;
        if (last)
            snprintf(w->out.message, sizeof(w->out.message), "%s", last), mark_stuck(w, last);
        else
            snprintf(w->out.message, sizeof(w->out.message), "ended %s %d without a word",
                     w->out.signal ? "by signal" : "with status",
                     w->out.signal ? w->out.signal : w->out.exit_status);
    }
    free(text);
}

/* Returns an exit code. */
static int collect(struct scheduler *s, const struct job *j, struct work *w)
{
    if (j->kind == JOB_PICTURES) {
        char views[PATH_MAX + 64];
        snprintf(views, sizeof(views), "%s", job_path(w, "views"));
        const int code = pictures_read(views, &w->out.pictures);
        w->out.shown = s->b->plan->jobs[j->needs[1]].key;
        if (!s->b->keep)
            remove_folder(views);
        return code;
    }
    if (j->kind == JOB_AUDIT) {
        w->out.summary = load_json(job_path(w, "out.0"));
        w->out.photos = json_incref(json_object_get(w->out.summary, "images"));
        json_object_del(w->out.summary, "images");
        return w->out.photos ? STATUS_DONE : STATUS_INPUT;
    }
    if (trains(j)) {
        w->out.summary = load_json(job_path(w, "run/summary.json"));
        w->out.run_config = load_json(job_path(w, "run/config.json"));
        w->out.log = load_text(job_path(w, "run/log.jsonl"));
    } else if (j->kind == JOB_POISON) {
        w->out.summary = load_json(job_path(w, "scene/poison.json"));
        json_object_del(w->out.summary, "growth");
    } else if (j->kind == JOB_PRUNE)
        w->out.summary = load_json(job_path(w, "out.0"));
    if (j->kind == JOB_TRAIN || j->kind == JOB_PRUNE)
        w->out.eval = load_json(job_path(w, "out.1"));
    const json_t *left = json_object_get(w->out.summary, "gaussians");
    if (j->kind == JOB_PRUNE && left) { /* the most were there before it pruned */
        const char *run = s->b->plan->jobs[j->needs[1]].key;
        json_object_set(w->out.summary, "final_gaussians", (json_t *) left);
        json_object_set_new(w->out.summary, "max_gaussians",
                            number_json(store_metric(s->b->store, run, "max_gaussians")));
    }
    return STATUS_DONE;
}

void outcome_clear(struct outcome *o)
{
    json_decref(o->by);
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
    const int made = done ? open(job_path(w, MADE), O_WRONLY | O_CREAT | O_CLOEXEC, 0666) : -1;
    if (made >= 0)
        close(made);
    w->out.status = status;
    const int code = store_put(s->b->store, j, &w->out);
    if (code)
        return code;
    w->state = done ? DONE : FAILED;
    s->done += w->state == DONE, s->failed += w->state == FAILED;
    if (w->state == DONE && !s->b->keep)
        remove(checkpoint_path(j, w));
    job_let_go(w);
    if (!s->b->quiet || w->state == FAILED)
        say(stderr, "%-7s %-6s %s %s %s seed %d, %.1f s%s%s\n", status, job_kinds[j->kind],
            j->scene, j->photos, j->defense, j->seed, w->out.seconds,
            w->out.message[0] && w->state == FAILED ? ": " : "",
            w->state == FAILED ? w->out.message : "");
    outcome_clear(&w->out);
    return STATUS_DONE;
}

/* The next phase that is not done, or the end. */
static int advance(struct scheduler *s, int index)
{
    struct work *w = &s->work[index];
    const struct job *j = &s->b->plan->jobs[index];
    if (phase_is_done(j, w)) {
        w->phase++;
        recall_by(w);
    }
    if (start_phase(s, index))
        return STATUS_DONE;
    s->running--;
    return finish(s, index, w->pid < 0 ? "failed" : "done");
}

int job_reap(struct scheduler *s, int index, int status, const struct rusage *usage)
{
    struct work *w = &s->work[index];
    struct outcome *o = &w->out;
    const struct job *j = &s->b->plan->jobs[index];
    const uint64_t rss = (uint64_t) usage->ru_maxrss * 1024;
    o->cpu_seconds += (double) usage->ru_utime.tv_sec + 1e-6 * (double) usage->ru_utime.tv_usec +
                      (double) usage->ru_stime.tv_sec + 1e-6 * (double) usage->ru_stime.tv_usec;
    o->peak_rss = rss > o->peak_rss ? rss : o->peak_rss;
    o->seconds = clock_seconds() - w->start;
    o->exit_status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    o->signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    w->pid = 0;
    int iteration;
    const bool done = !o->signal && !o->exit_status && !w->why,
               cut = done && !w->phase && trains(j) && !is_trained(w, &iteration);
    if (done && !cut) {
        w->phase++;
        return advance(s, index);
    }
    s->running--;
    if (!w->why && interrupted()) { /* it goes on the next time */
        w->state = WAITING;
        job_let_go(w);
        outcome_clear(o);
        return STATUS_DONE;
    }
    if (cut)
        snprintf(o->message, sizeof(o->message), "ended at iteration %d for lack of memory",
                 iteration);
    else
        last_words(s->b->plan, w);
    return finish(s, index,
                  w->why                                   ? w->why
                  : o->signal                              ? "crashed"
                  : cut || o->exit_status == STATUS_BUDGET ? "memory"
                                                           : "failed");
}

/* How many jobs ran at the same time as this one, itself included, counts over all its processes.
 */
static void note_beside(struct work *w, int running)
{
    FILE *f = w->out.beside < running ? fopen(job_path(w, BESIDE), "we") : NULL;
    if (f) {
        fprintf(f, "%d\n", running);
        fclose(f);
    }
    w->out.beside = running > w->out.beside ? running : w->out.beside;
}

static int recall_beside(const struct work *w)
{
    char *text = load_text(job_path(w, BESIDE));
    const int n = text ? atoi(text) : 0;
    free(text);
    return n;
}

int job_begin(struct scheduler *s, int index)
{
    struct work *w = &s->work[index];
    const struct job *j = &s->b->plan->jobs[index];
    time_t t = time(NULL);
    struct tm utc;
    const bool goes_on = job_has_checkpoint(s, index) && !file_exists(job_path(w, STUCK));
    if (!goes_on && !phase_is_done(j, w))
        remove_folder(w->folder);
    if (mkdir(w->folder, 0777) && errno != EEXIST) {
        say(stderr, "splatguard bench: %s: cannot make the folder: %s\n", w->folder,
            strerror(errno));
        return STATUS_INPUT;
    }
    w->out = (struct outcome){.by = this_program(), .beside = recall_beside(w)};
    strftime(w->out.started, sizeof(w->out.started), "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&t, &utc));
    w->state = RUNNING, w->phase = 0, w->why = NULL, w->pid = 0;
    w->start = clock_seconds();
    s->running++;
    for (int i = 0; i < s->b->plan->n; i++)
        if (s->work[i].state == RUNNING)
            note_beside(&s->work[i], s->running);
    return advance(s, index);
}

bool job_has_product(const struct scheduler *s, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const struct work *w = &s->work[index];
    if (j->kind == JOB_SCENE)
        return !json_object_get(j->config, "synth") || file_exists(job_path(w, MADE));
    return j->kind == JOB_PRUNE ? file_exists(job_path(w, "model.ply")) : phase_is_done(j, w);
}
