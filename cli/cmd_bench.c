/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bench.h"

struct bench_config {
    const char *output, *work, *data, *shard;
    int jobs, slurm;
    uint64_t max_memory;
    bool retry, keep, list, quiet;
};

#define B(field) offsetof(struct bench_config, field)

static const struct sg_option bench_options[] = {
    TEXT_ROW("output", B(output), "DB",
             "Database of the results; jobs whose results it has are not run again.",
             .letter = 'o'),
    TEXT_ROW("work", B(work), "DIR",
             "Common folder of all jobs for scenes, poisons and runs; DB.work by default."),
    TEXT_ROW("data", B(data), "DIR",
             "Folder that the paths of scenes are relative to; the plan's by default."),
    NUMBER_ROW("jobs", SG_OPTION_INT, B(jobs), 0, 1024, "N",
               "Jobs at the same time; 0 = as many as there are CPUs for their threads.",
               .letter = 'j'),
    NUMBER_ROW("max-memory", SG_OPTION_BYTES, B(max_memory), 0, 9e15, "BYTES",
               "Most memory of all jobs together, by the plan's memory of each job; 0 = no limit."),
    TEXT_ROW(
        "shard", B(shard), "I/N",
        "Only the I-th of N parts of the plan, from 1; cells of one poison are in the same part."),
    NUMBER_ROW("slurm", SG_OPTION_INT, B(slurm), 1, 10000, "N",
               "Only print a script for sbatch that runs the plan as an array of N jobs."),
    FLAG_ROW("retry", B(retry), "Run again what failed, crashed or took too long."),
    FLAG_ROW("keep", B(keep), "Keep the checkpoints of runs that are done."),
    FLAG_ROW("list", B(list), "Only print the jobs of the plan."),
    FLAG_ROW("quiet", B(quiet), "Say only what fails.", .letter = 'q'),
    {0},
};

static void defaults(void *config)
{
    memset(config, 0, sizeof(struct bench_config));
}

static int wrong_shard(const char *text)
{
    say(stderr, "splatguard bench: --shard: found \"%s\", expected I/N with I from 1 to N\n", text);
    return STATUS_USAGE;
}

static void put_argument(const char *before, const char *word)
{
    fputs(before, stdout);
    put_word(stdout, word);
}

static int print_slurm(const struct bench_config *c, const char *plan, int cpus)
{
    char program[PATH_MAX];
    const int code = own_program(&command_bench, program, sizeof(program));
    if (code)
        return code;
    printf("#!/bin/sh\n#SBATCH --job-name=splatguard\n#SBATCH --array=1-%d\n", c->slurm);
    printf("#SBATCH --cpus-per-task=%d\n", cpus);
    printf("# Each job writes a database of its own; splatguard report reads them together.\n");
    put_argument("exec ", program);
    put_argument(" bench ", plan);
    put_argument(" -o ", c->output);
    printf(".$SLURM_ARRAY_TASK_ID --shard $SLURM_ARRAY_TASK_ID/%d", c->slurm);
    if (c->data)
        put_argument(" --data ", c->data);
    if (c->work) {
        put_argument(" --work ", c->work);
        printf(".$SLURM_ARRAY_TASK_ID");
    }
    if (c->jobs)
        printf(" --jobs %d", c->jobs);
    if (c->max_memory)
        printf(" --max-memory %llu", (unsigned long long) c->max_memory);
    printf("%s%s%s\n", c->retry ? " --retry" : "", c->keep ? " --keep" : "",
           c->quiet ? " --quiet" : "");
    return STATUS_DONE;
}

static void print_jobs(const struct plan *p)
{
    for (int i = 0; i < p->n; i++) {
        const struct job *j = &p->jobs[i];
        say(stdout, "%.8s %-6s %s %s %s %s seed %d\n", j->key, job_kinds[j->kind], j->scene,
            j->photos, j->defense, j->model, j->seed);
    }
}

/* What bench writes would change a scene that it lies in. The path may be missing, its folder not.
 */
static int check_outside(const struct plan *p, const char *path)
{
    char folder[PATH_MAX], whole[PATH_MAX];
    const char *place;
    json_t *scene;
    if (!realpath(path, whole) &&
        (!folder_of(path, folder, sizeof(folder)) || !realpath(folder, whole)))
        return STATUS_DONE; /* opening it says what is wrong */
    json_object_foreach(p->places, place, scene)
    {
        if (is_below(whole, place)) {
            say(stderr,
                "splatguard bench: %s: found it in the folder of scene %s, expected it "
                "outside of %s\n",
                path, json_string_value(scene), place);
            return STATUS_INPUT;
        }
    }
    return STATUS_DONE;
}

/* The database, for one bench at a time: two would do each job twice and not see what runs beside
 * it. SQLite does not lock the byte. The lock goes with the process; to close the file before
 * SQLite does would undo SQLite's locks. */
static int claim_database(const char *path, int *lock)
{
    struct flock byte = {
        .l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = 0x40000000 - 1, .l_len = 1};
    *lock = open(path, O_RDWR | O_CLOEXEC);
    if (*lock >= 0 && !fcntl(*lock, F_OFD_SETLK, &byte))
        return STATUS_DONE;
    const bool used = *lock >= 0 && (errno == EAGAIN || errno == EACCES);
    say(stderr, "splatguard bench: %s: %s\n", path,
        used ? "in use by another bench" : strerror(errno));
    return STATUS_INPUT;
}

/* The folder of the jobs, for one bench at a time: the lock goes with the process. */
static int claim_work(const char *work, int *lock)
{
    char path[PATH_MAX + 8];
    if (mkdir(work, 0777) && errno != EEXIST) {
        say(stderr, "splatguard bench: %s: cannot make the folder: %s\n", work, strerror(errno));
        return STATUS_INPUT;
    }
    snprintf(path, sizeof(path), "%s/.bench", work);
    *lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (*lock >= 0 && !flock(*lock, LOCK_EX | LOCK_NB)) {
        if (!ftruncate(*lock, 0)) /* on a full disk it has no text, but is a lock */
            dprintf(*lock, "%ld", (long) getpid());
        return STATUS_DONE;
    }
    char owner[16] = "";
    if (*lock >= 0 && errno == EWOULDBLOCK && read(*lock, owner, sizeof(owner) - 1) >= 0) {
        owner[strspn(owner, "0123456789")] = 0;
        say(stderr, "splatguard bench: %s: in use by another bench%s%s\n", work,
            *owner ? ", process " : "", owner);
    } else
        say(stderr, "splatguard bench: %s: %s\n", work, strerror(errno));
    return STATUS_INPUT;
}

static int run_plan(const struct bench_config *c, struct plan *p)
{
    struct bench b = {.plan = p,
                      .jobs = c->jobs,
                      .memory = c->max_memory,
                      .retry = c->retry,
                      .keep = c->keep,
                      .quiet = c->quiet};
    char work[PATH_MAX], whole[PATH_MAX];
    int database = -1, lock = -1;
    cpu_set_t set;
    const int cpus = sched_getaffinity(0, sizeof(set), &set) ? (int) sysconf(_SC_NPROCESSORS_ONLN)
                                                             : CPU_COUNT(&set);
    if (!b.jobs)
        b.jobs = cpus / p->threads > 1 ? cpus / p->threads : 1;
    if (p->alone)
        b.jobs = 1;
    snprintf(work, sizeof(work), "%s%s", c->work ? c->work : c->output, c->work ? "" : ".work");
    int code = check_outside(p, c->output);
    if (!code)
        code = check_outside(p, work);
    if (!code)
        code = store_open(c->output, false, &b.store);
    if (!code)
        code = claim_work(work, &lock);
    if (!code)
        code = claim_database(c->output, &database);
    if (!code && !realpath(work, whole)) {
        say(stderr, "splatguard bench: %s: %s\n", work, strerror(errno));
        code = STATUS_INPUT;
    }
    b.work = whole;
    if (c->shard) /* the database has it with the plan */
        json_object_set_new(p->root, "shard", json_string(c->shard));
    if (!code)
        code = store_cells(b.store, p);
    if (!code)
        code = bench_run(&b);
    if (code == STATUS_INTERRUPTED)
        say(stderr, "interrupted; the same command continues\n");
    store_close(&b.store);
    if (database >= 0)
        close(database);
    if (lock >= 0)
        close(lock);
    return code;
}

static int run_bench(const void *config, const bool *given, const char *const *positional,
                     int count)
{
    (void) given, (void) count;
    const struct bench_config *c = config;
    struct plan plan = {0};
    int shard = 1, shards = 1;
    char rest;
    if (c->shard && (sscanf(c->shard, "%9d/%9d%c", &shard, &shards, &rest) != 2 || shard < 1 ||
                     shards < 1 || shard > shards))
        return wrong_shard(c->shard);
    if (c->shard && c->slurm) {
        say(stderr, "splatguard bench: --slurm and --shard exclude each other: the script has the "
                    "parts\n");
        return STATUS_USAGE;
    }
    if (!c->output && !c->list)
        return missing(&command_bench, "-o DB");
    int code = plan_read(&plan, positional[0], c->data, shard - 1, shards);
    if (!code && c->max_memory && !plan.memory) {
        say(stderr, "splatguard bench: --max-memory: found a plan without `memory`, expected one "
                    "that says what a job takes\n");
        code = STATUS_USAGE;
    }
    if (!code && c->list)
        print_jobs(&plan);
    else if (!code && c->slurm)
        code = print_slurm(c, positional[0], plan.threads * (c->jobs && !plan.alone ? c->jobs : 1));
    else if (!code)
        code = run_plan(c, &plan);
    plan_clear(&plan);
    return code;
}

const struct command command_bench = {
    .name = "bench",
    .arguments = "PLAN.json -o DB [options]",
    .summary = "Runs a plan of attacks and defenses and keeps the results in a database.",
    .description =
        "Runs the scenes, photos, defenses, models and seeds of PLAN, each as a process of its "
        "own, as many at a time as there are CPUs. Proxies and poisons are made once. A run that "
        "crashes or takes too long is a row of the database; the exit status is 2 then. It can be "
        "stopped at any time: the same command continues, and runs only what is missing or has "
        "changed. See docs/bench.md.",
    .options = bench_options,
    .config_size = sizeof(struct bench_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_bench,
};
