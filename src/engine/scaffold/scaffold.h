/* SPDX-License-Identifier: Apache-2.0 */
/* An engine for models of anchors (Scaffold-GS, Lu et al. 2024). It holds the anchors and their
 * networks; for each view it makes Gaussians of them, which another engine draws. Gradients come
 * back the same way. To its caller an anchor is a Gaussian that is drawn as up to
 * SG_ANCHOR_GAUSSIANS ones. */
#ifndef SG_SCAFFOLD_H
#define SG_SCAFFOLD_H

#include "engine/engine.h"

/* Puts an engine that draws with *engine, and owns it, in its place. Anchors and networks are in
 * host memory, or on the device of *engine. Where that fails *engine stays as it was:
 * SG_ERR_BUDGET. */
int sg_scaffold_wrap(sg_ctx *ctx, struct sg_engine **engine);

/* Bytes of a Gaussian that anchors are drawn as, where `drawn` is the footprint of one that is
 * stored. */
uint64_t sg_scaffold_footprint(const struct sg_work *work, uint64_t drawn);

#endif
