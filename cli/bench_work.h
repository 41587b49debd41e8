/* SPDX-License-Identifier: Apache-2.0 */
/* Inside `splatguard bench`: the jobs of a plan while they run. Each has a folder of its own and
 * runs one or two commands of this program there, its phases. Functions are for one thread. */
#ifndef CLI_BENCH_WORK_H
#define CLI_BENCH_WORK_H

#include <limits.h>
#include <sys/resource.h>

#include "bench.h"

enum state { WAITING, RUNNING, DONE, FAILED };

#define HELD (-1)    /* no lock: another process has it */
#define NO_LOCK (-2) /* its file cannot be opened, which errno explains */

/* A job while this process knows about it. */
struct work {
    enum state state;
    int phase;          /* of its commands */
    pid_t pid;          /* of the phase that runs, else 0 */
    int lock;           /* see job_hold; while it is running, else HELD */
    double start, told; /* seconds; when it was told to end, 0 = not */
    const char *why;    /* "timeout" or "memory", then */
    size_t said;        /* bytes that earlier processes of this phase have said */
    struct outcome out;
    char folder[PATH_MAX];
};

struct scheduler {
    const struct bench *b;
    struct work *work; /* of each job of the plan */
    int running, done, failed, left;
    int held; /* jobs that could begin but for a process of an earlier bench */
};

/* ---- bench_command.c: what a job runs ---- */

#define COMMAND_WORDS 256

/* An argument vector, which ends with NULL. One of COMMAND_WORDS - 1 words may lack some. */
struct command_line {
    char *words[COMMAND_WORDS];
    int n;
};

/* The command of a job's phase; clear it. false: there is none left. */
bool command_make(const struct scheduler *s, int index, struct command_line *c);
void command_clear(struct command_line *c);

/* ---- bench_job.c: one job ---- */

/* A path in a job's folder, until the next call. */
__attribute__((format(printf, 2, 3))) const char *job_path(const struct work *w, const char *format,
                                                           ...);
bool file_exists(const char *path);
/* Whether a stopped job has saved its progress. */
bool job_has_checkpoint(const struct scheduler *s, int index);

/* The lock of a job's folder, beside it, which is kept until the job ends. HELD: by a process of an
 * earlier bench, which was killed and still saves what it has. */
int job_hold(const struct work *w);
void job_let_go(struct work *w);

/* Starts a job that is held. Returns an exit code. */
int job_begin(struct scheduler *s, int index);
/* Its process has ended. Starts the next phase, or stores what came of the job. Returns an exit
 * code. */
int job_reap(struct scheduler *s, int index, int status, const struct rusage *usage);
/* Ends what takes too long or too much. */
void job_watch(const struct scheduler *s, struct work *w);

/* Whether what a job has made for others is there, and whole. */
bool job_has_product(const struct scheduler *s, int index);

void outcome_clear(struct outcome *o);

#endif
