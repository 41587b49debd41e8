/* SPDX-License-Identifier: Apache-2.0 */
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "context.h"
#include "threads.h"
#include "vram.h"

#define ALIGN 64 /* a cache line, and the widest vector */

/* Precedes every allocation. It names the ledger that was charged, so that no other can be
 * credited. */
struct header {
    sg_ctx *owner;
    size_t bytes; /* with this header */
    enum sg_mem_tag tag;
};

struct counter {
    atomic_uint_least64_t current, peak;
};

struct sg_ctx {
    struct sg_ctx_params params;
    sg_pool *pool;
    pthread_mutex_t error_lock, room_lock;
    struct sg_failure failure;
    struct sg_room *rooms;
    struct counter memory[SG_MEM_TAGS + 1]; /* the last one is the total */
    _Atomic uint64_t to_failure;            /* allocations until one is made to fail; 0 = none */
    struct sg_vram vram;
    const struct sg_engine_kind *auto_engine;
    bool held, wanted_to_cancel; /* sg_progress_hold */
    _Atomic uint64_t wanted; /* total bytes that the newest refused allocation would have needed */
};

int sg_ctx_create(sg_ctx **out, const struct sg_ctx_params *params)
{
    *out = NULL;
    sg_ctx *ctx = calloc(1, sizeof(*ctx));
    if (!ctx)
        return SG_ERR_BUDGET;
    if (params)
        ctx->params = *params;
    ctx->vram.given = ctx->params.max_vram;
    int threads = ctx->params.threads;
    if (threads == 0) {
        long online = sysconf(_SC_NPROCESSORS_ONLN);
        threads = online < 1 ? 1 : online > 256 ? 256 : (int) online;
    }
    const bool sound =
        threads >= 1 && threads <= 256 && (unsigned) ctx->params.log_level <= SG_LOG_DEBUG;
    if (!sound || sg_pool_create(&ctx->pool, threads)) {
        free(ctx);
        return sound ? SG_ERR_INTERNAL : SG_ERR_USAGE;
    }
    pthread_mutex_init(&ctx->error_lock, NULL);
    pthread_mutex_init(&ctx->room_lock, NULL);
    *out = ctx;
    return SG_OK;
}

void sg_ctx_destroy(sg_ctx **ctx)
{
    if (!ctx || !*ctx)
        return;
    sg_pool_destroy(&(*ctx)->pool);
    pthread_mutex_destroy(&(*ctx)->error_lock);
    pthread_mutex_destroy(&(*ctx)->room_lock);
    free(*ctx);
    *ctx = NULL;
}

/* NULL: this thread's failures are those of the context. */
static _Thread_local struct sg_failure *apart;

void sg_failures_apart(struct sg_failure *failure)
{
    apart = failure;
}

const char *sg_last_error(const sg_ctx *ctx)
{
    return ctx->failure.text;
}

bool sg_failed(const sg_ctx *ctx)
{
    return (apart ? apart : &ctx->failure)->text[0] != 0;
}

/* Of the character at c; 0: it is no UTF-8. */
static size_t character_bytes(const unsigned char *c)
{
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    const size_t n = c[0] < 0x80 ? 1 : c[0] < 0xe0 ? 2 : c[0] < 0xf0 ? 3 : 4;
    uint32_t value = n == 1 ? c[0] : c[0] & (0x7fu >> n);
    if (n > 1 && (c[0] < 0xc2 || c[0] > 0xf4))
        return 0;
    for (size_t i = 1; i < n; i++) {
        if ((c[i] & 0xc0) != 0x80)
            return 0;
        value = value << 6 | (c[i] & 0x3f);
    }
    return value < least[n] || value > 0x10ffff || value >> 11 == 0x1b ? 0 : n; /* surrogates */
}

size_t sg_take_printable(const char **text, char *shown)
{
    const unsigned char *c = (const unsigned char *) *text;
    const size_t n = character_bytes(c);
    const bool control = (n == 1 && (*c < ' ' || *c == 127)) ||
                         (n == 2 && c[0] == 0xc2 && c[1] < 0xa0); /* 0x80 to 0x9f */
    const bool good = n && !control;
    memmove(shown, good ? *text : "?", good ? n : 1);
    *text += n ? n : 1;
    return good ? n : 1;
}

void sg_make_printable(char *text)
{
    char *to = text;
    for (const char *c = text; *c;)
        to += sg_take_printable(&c, to);
    *to = 0;
}

void sg_show_bytes(const char *bytes, size_t n, char *text)
{
    for (size_t i = 0; i < n; i++)
        text[i] = bytes[i] >= ' ' && bytes[i] < 127 ? bytes[i] : '?';
    text[n] = 0;
}

int sg_fail(sg_ctx *ctx, int code, const char *format, ...)
{
    struct sg_failure *failure = apart ? apart : &ctx->failure;
    va_list args;
    va_start(args, format);
    pthread_mutex_lock(&ctx->error_lock);
    if (!failure->text[0]) {
        vsnprintf(failure->text, sizeof(failure->text), format, args);
        sg_make_printable(failure->text);
        failure->code = code;
    }
    code = failure->code;
    pthread_mutex_unlock(&ctx->error_lock);
    va_end(args);
    return code;
}

void sg_clear_error(sg_ctx *ctx)
{
    pthread_mutex_lock(&ctx->error_lock);
    (apart ? apart : &ctx->failure)->text[0] = 0;
    pthread_mutex_unlock(&ctx->error_lock);
}

void sg_log(sg_ctx *ctx, enum sg_log_level level, const char *format, ...)
{
    if (!ctx->params.log || level > ctx->params.log_level)
        return;
    char text[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    sg_make_printable(text);
    ctx->params.log(ctx->params.log_priv, level, text);
}

int sg_ctx_threads(const sg_ctx *ctx)
{
    return sg_pool_threads(ctx->pool);
}

void sg_parallel_for(sg_ctx *ctx, size_t n, void (*fn)(void *, size_t, int), void *arg)
{
    sg_pool_run(ctx->pool, n, fn, arg);
}

const char *sg_stage_name(enum sg_stage stage)
{
    static const char *const names[SG_STAGES] = {
        [SG_STAGE_LOAD] = "load",     [SG_STAGE_AUDIT] = "audit", [SG_STAGE_EVALUATE] = "evaluate",
        [SG_STAGE_SYNTH] = "synth",   [SG_STAGE_WRITE] = "write", [SG_STAGE_INIT] = "init",
        [SG_STAGE_TRAIN] = "train",   [SG_STAGE_COUNT] = "count", [SG_STAGE_ATTACK] = "attack",
        [SG_STAGE_ASCEND] = "ascend",
    };
    return (unsigned) stage < SG_STAGES ? names[stage] : "unknown";
}

static int cancelled(sg_ctx *ctx, enum sg_stage stage, uint64_t done, uint64_t total)
{
    sg_clear_error(ctx); /* of items that failed at the same time */
    return sg_fail(ctx, SG_ERR_INTERRUPTED, "%s: cancelled after %llu of %llu",
                   sg_stage_name(stage), (unsigned long long) done, (unsigned long long) total);
}

int sg_progress(sg_ctx *ctx, enum sg_stage stage, uint64_t done, uint64_t total)
{
    const struct sg_ctx_params *p = &ctx->params;
    if (!p->progress || ctx->wanted_to_cancel || !p->progress(p->progress_priv, stage, done, total))
        return SG_OK;
    ctx->wanted_to_cancel = ctx->held;
    return ctx->held ? SG_OK : cancelled(ctx, stage, done, total);
}

void sg_progress_hold(sg_ctx *ctx)
{
    ctx->held = true;
}

int sg_progress_release(sg_ctx *ctx, int code, enum sg_stage stage, uint64_t done, uint64_t total)
{
    const bool wanted = ctx->wanted_to_cancel;
    ctx->held = ctx->wanted_to_cancel = false;
    return !code && wanted ? cancelled(ctx, stage, done, total) : code;
}

struct stage_job {
    const struct sg_ctx_params *params;
    enum sg_stage stage;
    size_t n;
    void (*fn)(void *, size_t, int);
    void *arg;
    atomic_size_t done;
    atomic_bool cancelled;
};

static void report_item(struct stage_job *j)
{
    const struct sg_ctx_params *p = j->params;
    if (p->progress(p->progress_priv, j->stage, atomic_load(&j->done), j->n))
        atomic_store(&j->cancelled, true);
}

static void stage_item(void *arg, size_t i, int thread)
{
    struct stage_job *j = arg;
    if (!thread && !atomic_load(&j->cancelled)) /* thread 0 is the caller's */
        report_item(j);
    if (atomic_load(&j->cancelled))
        return;
    j->fn(j->arg, i, thread);
    atomic_fetch_add(&j->done, 1);
}

int sg_parallel_stage(sg_ctx *ctx, enum sg_stage stage, size_t n, void (*fn)(void *, size_t, int),
                      void *arg)
{
    if (!ctx->params.progress || !n) {
        sg_parallel_for(ctx, n, fn, arg);
        return SG_OK;
    }
    struct stage_job j = {.params = &ctx->params, .stage = stage, .n = n, .fn = fn, .arg = arg};
    report_item(&j); /* 0: other threads can be ahead of the caller's first item */
    if (!atomic_load(&j.cancelled))
        sg_parallel_for(ctx, n, stage_item, &j);
    if (!atomic_load(&j.cancelled))
        report_item(&j);
    return atomic_load(&j.cancelled) ? cancelled(ctx, stage, atomic_load(&j.done), n) : SG_OK;
}

const char *sg_version(void)
{
    return SG_VERSION;
}

const char *sg_mem_tag_name(enum sg_mem_tag tag)
{
    static const char *names[SG_MEM_TAGS + 1] = {
        [SG_MEM_MISC] = "misc",     [SG_MEM_IMAGES] = "images",
        [SG_MEM_MODEL] = "model",   [SG_MEM_OPTIMISER] = "optimiser",
        [SG_MEM_SPLATS] = "splats", [SG_MEM_INSTANCES] = "instances",
        [SG_MEM_FRAME] = "frame",   [SG_MEM_TAGS] = "total",
    };
    return tag >= 0 && tag <= SG_MEM_TAGS ? names[tag] : "unknown";
}

uint64_t sg_mem_wanted(const sg_ctx *ctx)
{
    return ctx->wanted;
}

struct sg_vram *sg_ctx_vram(sg_ctx *ctx)
{
    return &ctx->vram;
}

const struct sg_engine_kind **sg_ctx_auto_engine(sg_ctx *ctx)
{
    return &ctx->auto_engine;
}

uint64_t sg_vram_current(const sg_ctx *ctx, enum sg_mem_tag tag)
{
    return ctx->vram.current[tag];
}

uint64_t sg_vram_peak(const sg_ctx *ctx, enum sg_mem_tag tag)
{
    return ctx->vram.peak[tag];
}

uint64_t sg_mem_limit(const sg_ctx *ctx)
{
    return ctx->params.max_memory;
}

uint64_t sg_mem_current(const sg_ctx *ctx, enum sg_mem_tag tag)
{
    return atomic_load_explicit(&ctx->memory[tag].current, memory_order_relaxed);
}

uint64_t sg_mem_peak(const sg_ctx *ctx, enum sg_mem_tag tag)
{
    return atomic_load_explicit(&ctx->memory[tag].peak, memory_order_relaxed);
}

static void raise_peak(struct counter *c, uint64_t now)
{
    uint64_t peak = atomic_load_explicit(&c->peak, memory_order_relaxed);
    while (now > peak && !atomic_compare_exchange_weak_explicit(
                             &c->peak, &peak, now, memory_order_relaxed, memory_order_relaxed))
        ;
}

/* Adds to the total unless that would exceed the limit. One atomic step, so that two threads cannot
 * both take the last free bytes. */
static bool reserve(sg_ctx *ctx, size_t bytes, uint64_t *held)
{
    struct counter *total = &ctx->memory[SG_MEM_TAGS];
    *held = atomic_load_explicit(&total->current, memory_order_relaxed);
    do {
        if (ctx->params.max_memory && *held + bytes > ctx->params.max_memory)
            return false;
    } while (!atomic_compare_exchange_weak_explicit(&total->current, held, *held + bytes,
                                                    memory_order_relaxed, memory_order_relaxed));
    return true;
}

void sg_room_add(sg_ctx *ctx, struct sg_room *room)
{
    pthread_mutex_lock(&ctx->room_lock);
    room->next = ctx->rooms, room->link = &ctx->rooms;
    if (room->next)
        room->next->link = &room->next;
    ctx->rooms = room;
    pthread_mutex_unlock(&ctx->room_lock);
}

void sg_room_remove(sg_ctx *ctx, struct sg_room *room)
{
    pthread_mutex_lock(&ctx->room_lock);
    *room->link = room->next;
    if (room->next)
        room->next->link = room->link;
    pthread_mutex_unlock(&ctx->room_lock);
}

/* Whether anything was freed. */
static bool make_room(sg_ctx *ctx)
{
    bool made = false;
    pthread_mutex_lock(&ctx->room_lock);
    for (struct sg_room *r = ctx->rooms; r && !made; r = r->next)
        made = r->make(r->arg);
    pthread_mutex_unlock(&ctx->room_lock);
    return made;
}

static void discharge(struct counter *c, size_t bytes)
{
    atomic_fetch_sub_explicit(&c->current, bytes, memory_order_relaxed);
}

/* NULL: this thread measures nothing. */
static _Thread_local struct sg_meter *meter;

void sg_meter_begin(struct sg_meter *m)
{
    *m = (struct sg_meter){0};
    meter = m;
}

void sg_meter_end(struct sg_meter *m)
{
    if (meter == m)
        meter = NULL;
}

static void measure(int64_t bytes)
{
    if (!meter)
        return;
    meter->now += bytes;
    meter->peak = meter->now > meter->peak ? meter->now : meter->peak;
}

size_t sg_mem_cost(size_t bytes)
{
    return (bytes + 2 * ALIGN - 1) / ALIGN * ALIGN;
}

bool sg_fail_allocation(sg_ctx *ctx, uint64_t nth)
{
    return atomic_exchange(&ctx->to_failure, nth) == 0;
}

/* Counts down to the allocation that a test makes fail. */
static bool fails(sg_ctx *ctx)
{
    uint64_t left = atomic_load_explicit(&ctx->to_failure, memory_order_relaxed);
    while (left && !atomic_compare_exchange_weak(&ctx->to_failure, &left, left - 1))
        ;
    return left == 1;
}

void *sg_alloc_raw(sg_ctx *ctx, enum sg_mem_tag tag, size_t count, size_t size)
{
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > SIZE_MAX / 2 - 2 * ALIGN) {
        sg_fail(ctx, SG_ERR_BUDGET,
                "memory: %zu items of %zu bytes for %s exceed the address space", count, size,
                sg_mem_tag_name(tag));
        return NULL;
    }
    bytes = sg_mem_cost(bytes);
    uint64_t held;
    struct header *h = NULL;
    bool reserved = reserve(ctx, bytes, &held);
    while (!reserved && bytes <= ctx->params.max_memory && make_room(ctx))
        reserved = reserve(ctx, bytes, &held);
    if (reserved) {
        h = fails(ctx) ? NULL : aligned_alloc(ALIGN, bytes);
        if (!h)
            discharge(&ctx->memory[SG_MEM_TAGS], bytes);
    }
    if (!h) {
        const unsigned long long limit = ctx->params.max_memory;
        ctx->wanted = held + bytes;
        if (limit && held + bytes > limit)
            sg_fail(ctx, SG_ERR_BUDGET, "memory: %zu bytes for %s refused: %llu held, limit %llu",
                    bytes, sg_mem_tag_name(tag), (unsigned long long) held, limit);
        else
            sg_fail(ctx, SG_ERR_BUDGET, "memory: the system has no %zu bytes for %s: %llu held",
                    bytes, sg_mem_tag_name(tag), (unsigned long long) held);
        return NULL;
    }
    *h = (struct header){ctx, bytes, tag};
    /* The peak is raised only when an allocation succeeds, so that a refusal leaves the ledger
     * unchanged. */
    struct counter *own = &ctx->memory[tag];
    raise_peak(&ctx->memory[SG_MEM_TAGS], held + bytes);
    raise_peak(own, atomic_fetch_add_explicit(&own->current, bytes, memory_order_relaxed) + bytes);
    measure((int64_t) bytes);
    return (char *) h + ALIGN;
}

void *sg_alloc(sg_ctx *ctx, enum sg_mem_tag tag, size_t count, size_t size)
{
    void *memory = sg_alloc_raw(ctx, tag, count, size);
    if (memory)
        memset(memory, 0, count * size);
    return memory;
}

int sg_reserve(sg_ctx *ctx, enum sg_mem_tag tag, uint64_t bytes, void **room)
{
    *room = NULL;
    if (!sg_mem_limit(ctx))
        return SG_OK;
    *room = sg_alloc_raw(ctx, tag, bytes < SIZE_MAX ? (size_t) bytes : SIZE_MAX, 1);
    return *room ? SG_OK : SG_ERR_BUDGET;
}

void sg_free(void *memory)
{
    if (!memory)
        return;
    struct header *h = (struct header *) ((char *) memory - ALIGN);
    discharge(&h->owner->memory[h->tag], h->bytes);
    discharge(&h->owner->memory[SG_MEM_TAGS], h->bytes);
    measure(-(int64_t) h->bytes);
    free(h);
}

int sg_grow(sg_ctx *ctx, enum sg_mem_tag tag, void *array, size_t *capacity, size_t need,
            size_t keep, size_t size)
{
    if (need <= *capacity)
        return SG_OK;
    void *old;
    memcpy(&old, array, sizeof(old));
    size_t grown = *capacity + *capacity / 2;
    if (grown < need)
        grown = need;
    if (!keep) { /* free first: the peak is then the larger of the two, not their sum */
        sg_free(old);
        old = NULL;
        memcpy(array, &old, sizeof(old));
        *capacity = 0;
    }
    void *fresh = sg_alloc_raw(ctx, tag, grown, size);
    if (!fresh)
        return SG_ERR_BUDGET;
    if (keep)
        memcpy(fresh, old, keep * size);
    sg_free(old);
    memcpy(array, &fresh, sizeof(fresh));
    *capacity = grown;
    return SG_OK;
}

char *sg_strf(sg_ctx *ctx, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    int n = vsnprintf(NULL, 0, format, args);
    va_end(args);
    char *text = n < 0 ? NULL : sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) n + 1, 1);
    if (!text)
        return NULL;
    va_start(args, format);
    vsnprintf(text, (size_t) n + 1, format, args);
    va_end(args);
    return text;
}

char *sg_strdup(sg_ctx *ctx, const char *text)
{
    return sg_strf(ctx, "%s", text);
}

/* Clears no message: a call that has failed may be going on beside it. */
void *sg_mem_alloc(sg_ctx *ctx, enum sg_mem_tag tag, size_t count, size_t size)
{
    return sg_alloc(ctx, tag, count, size);
}

void sg_mem_free(void *memory)
{
    sg_free(memory);
}
