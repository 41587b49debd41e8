/* SPDX-License-Identifier: Apache-2.0 */
/* The HTTP server of `view` and `train --view`: a thread of its own for the sockets, and a queue of
 * pictures that the thread of the model draws. Only the machine itself reaches it, and only by an
 * address with the token. */
#ifndef CLI_VIEW_SERVER_H
#define CLI_VIEW_SERVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "splatguard/splatguard.h"

#define VIEW_MEMORY (128 << 20) /* bytes of pictures and of what waits to be sent */
#define VIEW_PIXELS (1 << 21)   /* most of a picture; larger ones are reduced */

enum view_kind {
    VIEW_COLOUR,
    VIEW_DEPTH,
    VIEW_ALPHA,
    VIEW_DIFFERENCE,
    VIEW_PHOTO,
    VIEW_SCORE, /* see view_scores.h, with the next two */
    VIEW_HITS,
    VIEW_NEXT,
    VIEW_KINDS
};

/* What the page asks for. */
struct view_ask {
    enum view_kind kind;
    bool still;     /* PNG, else JPEG: the camera is moving */
    size_t view;    /* of the scene: size and focal length are of its photo */
    double scale;   /* of the photo's sides, 0.05..1 */
    double pose[7]; /* of the camera: a quaternion w x y z of R, not all zeros, and t */
};

/* Buttons of the page. */
enum view_wish { VIEW_GO, VIEW_PAUSE, VIEW_STOP };

typedef struct view_server view_server;

/* Loads the HTTP server's library. Says what is missing. Returns an exit code. */
int view_server_find(void);
/* port: 0 = any that is free. ctx: for its memory; the server's threads allocate in it. Returns an
 * exit code. */
int view_server_open(sg_ctx *ctx, int port, view_server **out);
/* The page's address, with the token. */
const char *view_server_address(const view_server *s);
/* Answers what still waits, joins the thread. NULL-safe; sets *s to NULL. */
void view_server_close(view_server **s);

/* Whether the program has the scripts with which a browser draws a model. */
bool view_server_draws(void);
/* The compressed PLY that they draw: takes the descriptor over. To be called before the page is
 * told of it. */
void view_server_set_model(view_server *s, int fd);

/* JSON that the page reads: once, or again and again. The text is copied; without memory the former
 * stays. */
void view_server_set_scene(view_server *s, const char *json);
void view_server_set_state(view_server *s, const char *json);

/* The next picture that is wanted, after at most so many seconds. To be called, with the next, on
 * one thread. */
bool view_server_next(view_server *s, double seconds, struct view_ask *ask);
/* height x width x 3 bytes of sg_mem_alloc, which it takes over; NULL = it cannot be drawn. */
void view_server_answer(view_server *s, uint8_t *pixels, int width, int height);

enum view_wish view_server_wish(const view_server *s);

#endif
