/* SPDX-License-Identifier: Apache-2.0 */
/* The order in which the jobs of a plan run: each after those that it needs, as many at a time as
 * fit. Whatever is stopped goes on from its checkpoint the next time. */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>

#include "bench_work.h"
#include "interrupt.h"

#define POLL_NS 20000000

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
            w->lock = job_hold(w);
            s->held += w->lock == HELD;
            if (w->lock == NO_LOCK) {
                say(stderr, "splatguard bench: %s.lock: %s\n", w->folder, strerror(errno));
                code = STATUS_INPUT;
            } else if (w->lock >= 0)
                code = job_begin(s, i);
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
            code = job_reap(s, i, status, &usage);
        else if (interrupted() && w->told == 0)
            w->told = clock_seconds(), kill(w->pid, SIGTERM);
        else
            job_watch(s, w);
    }
    return code;
}

/* Of the clean run a limit needs its number only. */
static bool needs_product(const struct job *j, int k)
{
    return k != j->n_needs - 1 || !options_limited(json_object_get(j->config, "options"));
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
                !job_has_product(s, j->needs[k]))
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
    char program[PATH_MAX];
    int code = own_program(&command_bench, program, sizeof(program)); /* jobs can find it */
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
        job_let_go(&s.work[i]);
        outcome_clear(&s.work[i].out);
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
