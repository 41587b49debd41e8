/* SPDX-License-Identifier: Apache-2.0 */
/* The engines of this build. */
#ifndef SG_ENGINE_REGISTRY_H
#define SG_ENGINE_REGISTRY_H

#include "core/context.h"

#define SG_ENGINE_AUTO "auto" /* a GPU where there is one, else the CPU */
#define SG_ENGINES 4          /* the most that there are */
#define SG_ENGINE_VARIANTS 4  /* the most that an engine has */

struct sg_engine;
struct sg_engine_kind;

/* The engine of this name; NULL or SG_ENGINE_AUTO: the CPU's where a variant is named, else a GPU
 * that passes sg_engine_try, else the CPU's. A context keeps the choice. NULL with SG_ERR_USAGE
 * recorded: unknown. */
const struct sg_engine_kind *sg_engine_find(sg_ctx *ctx, const char *name, const char *variant);

/* What "auto" is to mean: the candidate, or the CPU where it fails or computes something else. */
const struct sg_engine_kind *sg_engine_choose(sg_ctx *ctx, const struct sg_engine_kind *candidate);

/* trial.c: draws a small model, and compares image and gradients with those of the CPU engine.
 * SG_ERR_INTERNAL where they differ. */
int sg_engine_try(struct sg_engine *candidate);

/* Names of all engines, in order; returns their number. */
int sg_engine_names(const char *out[SG_ENGINES]);

/* Names of an engine's variants that run here, slowest first; returns their number, 0 for an engine
 * without any. */
int sg_engine_variants(const char *name, const char *out[SG_ENGINE_VARIANTS]);

#endif
