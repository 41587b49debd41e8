/* SPDX-License-Identifier: Apache-2.0 */
/* A model in colours that say what the defense's filter finds of its Gaussians. */
#ifndef CLI_VIEW_SCORES_H
#define CLI_VIEW_SCORES_H

#include "view_server.h"

struct view_scores {
    sg_ctx *ctx;            /* of its memory */
    struct sg_model *model; /* a copy without SH, in the colours of `painted` */
    float *grey;            /* what its Gaussians have of brightness */
    double *score, *hits;   /* see sg_trainer_scores */
    uint8_t *stays;         /* likewise */
    sg_renderer *renderer;
    enum view_kind painted;
};

/* Forgets what there was, and copies `model` for the arrays of scores, which the caller fills in.
 * Errors: SG_ERR_BUDGET. */
int view_scores_copy(struct view_scores *s, sg_ctx *ctx, const struct sg_model *model);

/* Sets `stays` of all but this share with the lowest scores. Errors: SG_ERR_BUDGET. */
int view_scores_lowest(struct view_scores *s, double share);

/* Paints: VIEW_SCORE and VIEW_HITS from yellow, the lowest, to violet; VIEW_NEXT red what goes and
 * grey what stays. The renderer is s->renderer. Errors: those of sg_renderer_create. */
int view_scores_paint(struct view_scores *s, enum view_kind kind, const char *engine,
                      const char *cpu, const struct sg_render_params *render);

void view_scores_clear(struct view_scores *s);

#endif
