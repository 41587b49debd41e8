/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_CPU_DISPATCH_H
#define SG_CPU_DISPATCH_H

#include "kernels.h"
#include "engine/registry.h"
#include "splatguard/engine.h"

/* The kernels of a variant ("baseline", "avx2", "avx512", "neon"), or of the best this machine runs
 * if name is NULL. Unknown name or missing instructions: SG_ERR_USAGE. */
int sg_cpu_select(sg_ctx *ctx, const char *name, const struct cpu_kernels **out);

/* Variants compiled in that this machine can run, slowest first; returns their number, at most
 * 4. */
int sg_cpu_variants(const struct cpu_kernels *out[SG_ENGINE_VARIANTS]);

/* Fills in variant and the fields after it, for every variant of the build in the same order.
 * Returns false after the last one. */
bool sg_cpu_describe(size_t index, struct sg_engine_info *out);

#endif
