/* SPDX-License-Identifier: Apache-2.0 */
/* The engines that train and render, and the variants of their kernels. */
#ifndef SPLATGUARD_ENGINE_H
#define SPLATGUARD_ENGINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "version.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What the field `engine` of parameters takes, as the choices of an option and in its help. */
#define SG_ENGINE_CHOICES "cpu|vulkan[:DEVICE]|ref|auto"
#define SG_ENGINE_HELP                                                                             \
    "What computes: cpu; vulkan on a GPU, or on the device with this number or part of a name "    \
    "(see info --devices); ref, the slow scalar oracle; auto, a GPU where there is one that "      \
    "draws a test image as the CPU does, else (or with --cpu) cpu."

/* All texts are static. */
struct sg_engine_info {
    const char *engine;  /* "cpu", "vulkan", "ref": the field `engine` of parameters */
    const char *variant; /* "avx2", ...: the field `cpu` of parameters; NULL = there is only one */
    const char *description;
    bool available;      /* on this machine */
    bool chosen;         /* what this engine runs where `cpu` is NULL */
    const char *missing; /* what the machine lacks; NULL where available */
};

/* The engines and variants of this build: each engine's variants from slow to fast. index: from 0.
 * Returns false after the last one. Thread safety: safe. */
SG_API bool sg_engine_list(size_t index, struct sg_engine_info *out);

/* A device that the engine "vulkan" could run on. Its number is its place in the list. */
struct sg_device_info {
    char name[256], driver[256];
    uint64_t memory, memory_free; /* bytes of its own memory, and of them what is free */
    bool cpu;                     /* a driver on the CPU: used by name only */
    const char *missing;          /* static: what our kernels need and it lacks; NULL = nothing */
};

/* Fills in at most `most` devices; returns their number. missing: NULL, or receives what the
 * machine or this build lacks to have any, a static text, or NULL. Thread safety: safe. */
SG_API size_t sg_device_list(struct sg_device_info *out, size_t most, const char **missing);

/* The processor's name, by which results say where they come from; where the system has none, its
 * architecture, or "unknown". name: size bytes, at least 1; a longer name is cut. Thread safety:
 * safe. */
SG_API void sg_machine_name(char *name, size_t size);

#ifdef __cplusplus
}
#endif

#endif
