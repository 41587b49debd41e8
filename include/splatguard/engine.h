/* SPDX-License-Identifier: Apache-2.0 */
/* The engines that train and render, and the variants of their kernels. */
#ifndef SPLATGUARD_ENGINE_H
#define SPLATGUARD_ENGINE_H

#include <stdbool.h>
#include <stddef.h>

#include "version.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All texts are static. */
struct sg_engine_info {
    const char *engine;  /* "cpu", "ref": the field `engine` of parameters */
    const char *variant; /* "avx2", ...: the field `cpu` of parameters; NULL = there is only one */
    const char *description;
    bool available;      /* on this machine */
    bool chosen;         /* what this engine runs where `cpu` is NULL */
    const char *missing; /* what the machine lacks; NULL where available */
};

/* The engines and variants of this build: each engine's variants from slow to fast. index: from 0.
 * Returns false after the last one. Thread safety: safe. */
SG_API bool sg_engine_list(size_t index, struct sg_engine_info *out);

#ifdef __cplusplus
}
#endif

#endif
