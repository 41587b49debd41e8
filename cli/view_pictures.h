/* SPDX-License-Identifier: Apache-2.0 */
/* The pictures of a scene and a model that the live view's page asks for. */
#ifndef CLI_VIEW_PICTURES_H
#define CLI_VIEW_PICTURES_H

#include <jansson.h>

#include "view_server.h"

struct view_pictures {
    sg_ctx *own;                  /* of the page's memory */
    sg_ctx *ctx;                  /* of the scene */
    const struct sg_scene *scene; /* or NULL: one camera of no photo */
    struct sg_camera camera;      /* that one */
    double extent;                /* of what it looks at, 1.5 times as far away */
    bool model;                   /* there is one to draw */
    bool browser;                 /* which the page can have, to draw it itself */
    float background[3];          /* then: behind it */
    bool appearances;             /* of the training photos: renders of their views have them */
    bool scores, next;            /* pictures of view_scores.h can be had */
    float *planes;                /* colour, alpha, depth of a picture */
    size_t pixels;                /* that they have room for */
};

/* Hands the page what it needs to know at the beginning. Returns an exit code. */
int view_publish_scene(const struct view_pictures *v, view_server *server, const char *title,
                       bool training);

/* Around the model of a file without photos: in the middle of its Gaussians' positions, as far from
 * there as most of them. */
int view_place_camera(struct view_pictures *v, sg_ctx *ctx, const struct sg_model *model);

/* Draws what the page asks for and answers. renderer: of the model, or NULL for a photo. */
void view_draw(struct view_pictures *v, view_server *server, const struct view_ask *ask,
               sg_renderer *renderer);
void view_pictures_clear(struct view_pictures *v);

#endif
