/* SPDX-License-Identifier: Apache-2.0 */
/* The model of the live view as a file that a browser draws. */
#ifndef CLI_VIEW_MODEL_H
#define CLI_VIEW_MODEL_H

#include "splatguard/splatguard.h"

#define VIEW_BROWSER_GAUSSIANS 2000000 /* more are too much for many browsers and phones */

/* Whether a browser can draw the model as the engine does. */
bool view_model_fits(const struct sg_model *model, const struct sg_render_params *render);

/* Writes it as a compressed PLY that has no name any more. Returns a descriptor to read it from,
 * which the caller closes, or -1 after a warning. */
int view_model_write(sg_ctx *ctx, const struct sg_model *model);

#endif
