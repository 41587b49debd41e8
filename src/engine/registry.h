/* SPDX-License-Identifier: Apache-2.0 */
/* The engines of this build. */
#ifndef SG_ENGINE_REGISTRY_H
#define SG_ENGINE_REGISTRY_H

#include "core/context.h"

#define SG_ENGINE_AUTO "auto" /* a GPU where there is one, else the CPU */
#define SG_ENGINES 4          /* the most that there are */
#define SG_ENGINE_VARIANTS 4  /* the most that an engine has */

struct sg_engine_kind;

/* The engine of this name, which may be SG_ENGINE_AUTO; NULL = the first. NULL with SG_ERR_USAGE
 * recorded: unknown. */
const struct sg_engine_kind *sg_engine_find(sg_ctx *ctx, const char *name);

/* Names of all engines, in order; returns their number. */
int sg_engine_names(const char *out[SG_ENGINES]);

/* Names of an engine's variants that run here, slowest first; returns their number, 0 for an engine
 * without any. */
int sg_engine_variants(const char *name, const char *out[SG_ENGINE_VARIANTS]);

#endif
