/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_TRAIN_RENDERER_H
#define SG_TRAIN_RENDERER_H

#include "engine/engine.h"

/* A renderer of an engine that somebody else owns and whose times it leaves alone. */
int sg_renderer_borrow(struct sg_engine *engine, int sh_degree,
                       const struct sg_render_params *params, sg_renderer **out);

#endif
