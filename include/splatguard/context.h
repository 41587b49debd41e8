/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_CONTEXT_H
#define SPLATGUARD_CONTEXT_H

#include <stddef.h>
#include <stdint.h>

#include "error.h"
#include "version.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Errors are returned, not logged. */
enum sg_log_level {
    SG_LOG_WARN,  /* the call continues, but its result may not be what the caller meant */
    SG_LOG_INFO,  /* what was loaded */
    SG_LOG_DEBUG, /* decisions: engine and kernels, memory plan, bands, densification */
};

/* The purpose of an allocation. Every allocation of the library has one. */
enum sg_mem_tag {
    SG_MEM_MISC,      /* parsers, names, small tables                              */
    SG_MEM_IMAGES,    /* decoded photos, masks                                     */
    SG_MEM_MODEL,     /* Gaussian parameters                                       */
    SG_MEM_OPTIMISER, /* Adam moments, densification statistics                    */
    SG_MEM_SPLATS,    /* projected Gaussians of one view and their gradients       */
    SG_MEM_INSTANCES, /* tile lists, sort keys, per-instance gradients             */
    SG_MEM_FRAME,     /* render target, loss gradient, loss scratch                */
    SG_MEM_TAGS
};

/* Loading, audits, evaluation, synthesis, trainings, attacks and the writing of .sog report
 * progress in these stages; other formats and single views do not. The comments name the units of
 * `done` and `total`. A stage can be reported more than once, each time from 0. */
enum sg_stage {
    SG_STAGE_LOAD,     /* sg_scene_load: photos; 0 of 1 within large text files of COLMAP */
    SG_STAGE_AUDIT,    /* sg_audit_scene: photos */
    SG_STAGE_EVALUATE, /* sg_evaluate: renders; sg_model_bake: views */
    SG_STAGE_SYNTH,    /* sg_synth_write: pictures, then groups of points */
    SG_STAGE_WRITE,    /* sg_model_write of .sog: groups of Gaussians; 0 of 1 before a picture */
    SG_STAGE_INIT,   /* sg_model_init_points and a new trainer, also of anchors: groups of points */
    SG_STAGE_TRAIN,  /* sg_trainer_step: iterations; `done` is the number before this one */
    SG_STAGE_COUNT,  /* within an iteration of training or of an attack, and in sg_prune and
                        sg_prune_scores: views that are looked at */
    SG_STAGE_ATTACK, /* sg_attack_step: iterations; `done` is the number before this one */
    SG_STAGE_ASCEND, /* sg_attack_step, _poison and _naive: steps of the inner ascent */
    SG_STAGES
};

/* A context owns the thread pool, the memory ledger, the logger and the last error.
 * Thread safety: one call at a time per context, unless a function says otherwise; different
 * contexts are independent. */
typedef struct sg_ctx sg_ctx;

struct sg_ctx_params {
    /* Worker threads, 1..256; 0 = one per online CPU. Results do not depend on it, unless
     * max_memory is reached: more threads leave less memory to the model. Default 0. */
    int threads;
    uint64_t max_memory; /* bytes that may be allocated at once; 0 = no limit. Default 0. */
    /* Bytes of a device's memory that its engine may hold at once; 0 = nine tenths of what is free
     * when it starts, which several contexts on one device do not share: give each its own limit.
     * Default 0. */
    uint64_t max_vram;
    /* NULL = silent. Called on any thread, perhaps on several at once. The message is valid during
     * the call only. Default NULL. */
    void (*log)(void *priv, enum sg_log_level level, const char *message);
    void *log_priv;
    enum sg_log_level log_level; /* the most detailed level that is sent. Default SG_LOG_WARN. */
    /* NULL = none. Called only on the thread that called the library, from within that call. It
     * must not use the context. A result other than 0 cancels: the call soon ends with
     * SG_ERR_INTERRUPTED and frees what it made. Functions that work on an object document its
     * state after that. Default NULL. */
    int (*progress)(void *priv, enum sg_stage stage, uint64_t done, uint64_t total);
    void *progress_priv;
};

/* params may be NULL for the defaults. The caller owns *out and frees it with sg_ctx_destroy.
 * Errors, which have no message: SG_ERR_USAGE (threads, log_level), SG_ERR_BUDGET, SG_ERR_INTERNAL
 * (threads cannot start). */
SG_API int sg_ctx_create(sg_ctx **out, const struct sg_ctx_params *params);

/* Accepts NULL; sets *ctx to NULL. Destroy the objects of the context first. */
SG_API void sg_ctx_destroy(sg_ctx **ctx);

/* Message of the last failed call, "" if none; valid until the next call on this context. */
SG_API const char *sg_last_error(const sg_ctx *ctx);

/* What to show for the character at *text, a text that ends with a zero, such as the name of a
 * photo: names may hold commands of terminals. That is the character, or "?" for a control
 * character and a byte that is not UTF-8. *text moves on to what follows. shown: room for
 * SG_CHARACTER bytes, or where the character itself is. Returns their number. Thread safe. */
#define SG_CHARACTER 4
SG_API size_t sg_take_printable(const char **text, char *shown);

/* "load", "audit", ... */
SG_API const char *sg_stage_name(enum sg_stage stage);

/* Threads that work, the caller's among them. */
SG_API int sg_ctx_threads(const sg_ctx *ctx);

/* sg_ctx_params.max_memory. */
SG_API uint64_t sg_mem_limit(const sg_ctx *ctx);

/* Zeroed memory of count x size bytes, 64-byte aligned, that counts as the library's own: for
 * callers that keep to the context's limit. NULL where it does not fit: that is the last error,
 * unless a call before has failed and no other has begun since. Thread safe. */
SG_API void *sg_mem_alloc(sg_ctx *ctx, enum sg_mem_tag tag, size_t count, size_t size);
SG_API void sg_mem_free(void *memory); /* NULL-safe, thread safe */

/* Bytes allocated under one tag, now and at most so far. SG_MEM_TAGS asks for the total. */
SG_API uint64_t sg_mem_current(const sg_ctx *ctx, enum sg_mem_tag tag);
SG_API uint64_t sg_mem_peak(const sg_ctx *ctx, enum sg_mem_tag tag);
SG_API const char *sg_mem_tag_name(enum sg_mem_tag tag);
/* The same of a device's memory, which counts apart. */
SG_API uint64_t sg_vram_current(const sg_ctx *ctx, enum sg_mem_tag tag);
SG_API uint64_t sg_vram_peak(const sg_ctx *ctx, enum sg_mem_tag tag);

#ifdef __cplusplus
}
#endif

#endif
