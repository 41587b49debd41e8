/* SPDX-License-Identifier: Apache-2.0 */
/* The library's private services, all reached through a context: errors, log, tagged memory,
 * threads. */
#ifndef SG_CORE_CONTEXT_H
#define SG_CORE_CONTEXT_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "splatguard/context.h"

/* Records code and message and returns the code. The first failure since the last sg_clear_error
 * wins: later ones change nothing and get its code, so that code and message agree. Thread safe. */
__attribute__((format(printf, 3, 4))) int sg_fail(sg_ctx *ctx, int code, const char *format, ...);
void sg_clear_error(sg_ctx *ctx);
bool sg_failed(const sg_ctx *ctx); /* Whether a call has failed since then. For functions that
                                      return yes or no, and may run out of memory. */
/* A failure: the code, and the message, which is empty where nothing has failed. */
struct sg_failure {
    char text[1024];
    int code;
};
/* From here on the failures of this thread are recorded in *failure, which begins with zeros, and
 * not in a context. NULL ends that. For work that is repeated if it fails. */
void sg_failures_apart(struct sg_failure *failure);

/* Replaces control characters, and bytes that are not UTF-8, by "?", since messages quote file
 * contents. */
void sg_make_printable(char *text);

/* The beginning of any file as text: at most n bytes and a zero; bytes that are not ASCII become
 * "?". */
void sg_show_bytes(const char *bytes, size_t n, char *text);

__attribute__((format(printf, 3, 4))) void sg_log(sg_ctx *ctx, enum sg_log_level level,
                                                  const char *format, ...);

/* Total bytes that the newest refused allocation would have needed. */
uint64_t sg_mem_wanted(const sg_ctx *ctx);

/* What "auto" means in this context: an engine, once one is chosen. */
struct sg_engine_kind;
const struct sg_engine_kind **sg_ctx_auto_engine(sg_ctx *ctx);

/* For tests: the nth allocation from now on fails as if the system had no memory; 0 = none. Returns
 * whether the allocation of the call before has failed. */
bool sg_fail_allocation(sg_ctx *ctx, uint64_t nth);

/* 64-byte aligned, zeroed. NULL after recording SG_ERR_BUDGET, on overflow of count x size too.
 * Thread safe. */
void *sg_alloc(sg_ctx *ctx, enum sg_mem_tag tag, size_t count, size_t size);
/* Same, contents undefined. */
void *sg_alloc_raw(sg_ctx *ctx, enum sg_mem_tag tag, size_t count, size_t size);
/* Grows *array (may point to NULL) to hold at least `need` items, keeping the first `keep`;
 * amortised. */
int sg_grow(sg_ctx *ctx, enum sg_mem_tag tag, void *array, size_t *capacity, size_t need,
            size_t keep, size_t size);
/* What an allocation of `bytes` is charged with. */
size_t sg_mem_cost(size_t bytes);
/* Measures what this thread holds of the memory that it allocates from here on, until it calls
 * sg_meter_end with the same meter. Memory that another thread frees stays counted. */
struct sg_meter {
    int64_t now, peak;
};
void sg_meter_begin(struct sg_meter *meter);
void sg_meter_end(struct sg_meter *meter);
/* Charges `bytes` to the ledger for memory that another library will allocate. *room is not to be
 * used; release it with sg_free. Without a limit nothing is charged. */
int sg_reserve(sg_ctx *ctx, enum sg_mem_tag tag, uint64_t bytes, void **room);
/* Something that can be freed to make room: it is asked when an allocation would exceed the limit.
 */
struct sg_room {
    /* Frees a part and returns whether it did. Called on any thread that allocates, on one at a
     * time; must not allocate. */
    bool (*make)(void *arg);
    void *arg;
    struct sg_room *next, **link; /* private */
};
void sg_room_add(sg_ctx *ctx, struct sg_room *room);
void sg_room_remove(sg_ctx *ctx, struct sg_room *room);
/* NULL-safe, thread safe. Every allocation knows its context and is credited to that one. */
void sg_free(void *memory);
char *sg_strdup(sg_ctx *ctx, const char *text);
__attribute__((format(printf, 2, 3))) char *sg_strf(sg_ctx *ctx, const char *format, ...);

/* Calls fn(arg, i, thread) for every i in 0..n-1, each once, on the pool and the calling thread;
 * returns when all are done. Items are handed out in rising order. thread is 0..threads-1: use it
 * for scratch, never for results. */
void sg_parallel_for(sg_ctx *ctx, size_t n, void (*fn)(void *arg, size_t i, int thread), void *arg);

/* Calls the caller's progress function. SG_ERR_INTERRUPTED if that cancels. Only on the thread that
 * called the library. */
int sg_progress(sg_ctx *ctx, enum sg_stage stage, uint64_t done, uint64_t total);

/* Around work that has to be done whole. In between sg_progress does not fail. The second call
 * gives the work's own error `code` back; or SG_ERR_INTERRUPTED, with a message of this stage, if
 * the caller wanted to cancel meanwhile. */
void sg_progress_hold(sg_ctx *ctx);
int sg_progress_release(sg_ctx *ctx, int code, enum sg_stage stage, uint64_t done, uint64_t total);
/* sg_parallel_for that reports how many items are done. SG_ERR_INTERRUPTED: fn was not called for
 * some items. After SG_OK the caller checks the results of the items. */
int sg_parallel_stage(sg_ctx *ctx, enum sg_stage stage, size_t n,
                      void (*fn)(void *arg, size_t i, int thread), void *arg);

#endif
