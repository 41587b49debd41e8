/* SPDX-License-Identifier: Apache-2.0 */
/* Contexts with the tool's log, memory limit and Ctrl-C, and how their errors are reported. */
#include <malloc.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "commands.h"
#include "interrupt.h"

/* Of --max-memory, if it was given. */
static struct {
    uint64_t whole, outside;
} memory;

/* The instruction set is that of SG_CPU, not of --cpu. */
static bool variant_from_environment;

/* The line on the terminal of a stage. Only the thread that calls the library has to do with it. */
static struct {
    enum sg_stage stage;
    double begin, last;
    bool any;
} shown;

int no_memory(void)
{
    say(stderr, "splatguard: out of memory\n");
    return exit_code(SG_ERR_BUDGET);
}

int report(const sg_ctx *ctx, int error)
{
    if (!error)
        return STATUS_DONE;
    const char *text = ctx ? sg_last_error(ctx) : "";
    if (shown.any)
        fprintf(stderr, "\r\033[K");
    shown.any = false;
    if (error == SG_ERR_BUDGET && !text[0])
        return no_memory();
    if (error == SG_ERR_INTERRUPTED)
        say(stderr, "%s\n", text[0] ? text : "interrupted");
    else
        say(stderr, "splatguard: %s\n", text[0] ? text : "internal error");
    if (error == SG_ERR_BUDGET)
        say_limit(text);
    return exit_code(error);
}

void say_limit(const char *message)
{
    static const char start[] = ": memory: found a limit of ";
    const char *at = strstr(message, start);
    unsigned long long limit, least;
    char enough[80] = "";
    if (at && sscanf(at + strlen(start), "%llu bytes, expected at least %llu", &limit, &least) == 2)
        snprintf(enough, sizeof(enough), "; --max-memory %lluM has room for what is expected",
                 (least + memory.outside + (1 << 20)) >> 20);
    if (memory.whole)
        say(stderr, "the limit is --max-memory, %llu bytes, less %llu for the process itself%s\n",
            (unsigned long long) memory.whole, (unsigned long long) memory.outside, enough);
}

int report_option(const sg_ctx *ctx, const struct command *command, int error)
{
    const char *message = error ? sg_last_error(ctx) : "", *name = options_name(command, message);
    const bool environment = name && !strcmp(name, "cpu") && variant_from_environment;
    if (error == SG_ERR_USAGE && name)
        say(stderr, "splatguard %s: %s%s%s\n", command->name, environment ? "SG_CPU" : "--",
            environment ? "" : name, message + strcspn(message, ":"));
    else if (error)
        return report(ctx, error);
    return exit_code(error);
}

int report_model(const sg_ctx *ctx, const char *path, int error)
{
    static const char start[] = "model: ";
    const char *message = error ? sg_last_error(ctx) : "";
    if (error != SG_ERR_INPUT || strncmp(message, start, strlen(start)) != 0)
        return report(ctx, error);
    say(stderr, "splatguard: %s: %s\n", path, message + strlen(start));
    return exit_code(error);
}

static bool held;

void hold_log(bool hold)
{
    held = hold;
}

static void log_line(void *priv, enum sg_log_level level, const char *message)
{
    (void) priv;
    if (held)
        return;
    fprintf(stderr, "%s%s%s\n", isatty(STDERR_FILENO) ? "\r\033[K" : "",
            level == SG_LOG_WARN ? "warning: " : "", message); /* which is printable */
}

/* How far a stage is, once it takes longer than a second. */
static void show_stage(enum sg_stage stage, uint64_t done, uint64_t total)
{
    const double now = clock_seconds();
    if (stage != shown.stage || !done)
        shown.begin = now;
    shown.stage = stage;
    if (now - shown.begin < 1 || (now - shown.last < 0.1 && done < total))
        return;
    shown.last = now;
    shown.any = done < total;
    fprintf(stderr, "\r\033[K");
    if (shown.any)
        fprintf(stderr, "%s %llu/%llu", sg_stage_name(stage), (unsigned long long) done,
                (unsigned long long) total);
    fflush(stderr);
}

/* visible: NULL = there is no terminal to show stages on, or none is wanted. */
static int on_progress(void *visible, enum sg_stage stage, uint64_t done, uint64_t total)
{
    if (visible && stage <= SG_STAGE_WRITE) /* trainings and attacks have lines of their own */
        show_stage(stage, done, total);
    return interrupt_cancels();
}

uint64_t resident_bytes(pid_t process)
{
    char path[64] = "/proc/self/statm";
    unsigned long long pages = 0;
    if (process)
        snprintf(path, sizeof(path), "/proc/%d/statm", (int) process);
    FILE *f = fopen(path, "r");
    if (f && fscanf(f, "%*u %llu", &pages) != 1)
        pages = 0;
    if (f)
        fclose(f);
    return pages * (uint64_t) sysconf(_SC_PAGESIZE);
}

double clock_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Bytes of the process that the library's ledger does not see: code, stacks, other libraries' own
 * memory. */
static uint64_t outside_ledger(void)
{
    return resident_bytes(0) + (24 << 20);
}

int open_context(sg_ctx **ctx, int threads, uint64_t max_memory, bool quiet)
{
    return open_engine_context(ctx, threads, max_memory, 0, quiet);
}

int open_engine_context(sg_ctx **ctx, int threads, uint64_t max_memory, uint64_t max_vram,
                        bool quiet)
{
    if (max_memory) {
        const uint64_t outside = outside_ledger(), least = outside + (8 << 20);
        /* What is freed goes back to the system at once. */
        mallopt(M_MMAP_THRESHOLD, 1 << 20);
        if (max_memory < least) {
            say(stderr,
                "splatguard: --max-memory: found %llu bytes, expected at least %lluM for the "
                "process itself\n", /* which varies by little */
                (unsigned long long) max_memory, (unsigned long long) (least >> 20) + 1);
            return STATUS_BUDGET;
        }
        memory.whole = max_memory, memory.outside = outside;
        max_memory -= outside;
    }
    const int code = sg_ctx_create(
        ctx,
        &(struct sg_ctx_params){.threads = threads,
                                .max_memory = max_memory,
                                .max_vram = max_vram,
                                .log = log_line,
                                .progress = on_progress,
                                .progress_priv = quiet || !isatty(STDERR_FILENO) ? NULL : &shown,
                                .log_level = quiet ? SG_LOG_WARN : SG_LOG_INFO});
    if (code)
        say(stderr, "splatguard: cannot start %d threads\n", threads);
    return exit_code(code);
}

const char *cpu_variant(const char *option)
{
    const char *environment = getenv("SG_CPU");
    variant_from_environment = !option && environment && environment[0];
    return variant_from_environment ? environment : option;
}
