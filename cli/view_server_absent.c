/* SPDX-License-Identifier: Apache-2.0 */
/* view_server.h where libmicrohttpd is missing: it says so. */
#include "commands.h"
#include "view_server.h"

int view_server_find(void)
{
    say(stderr, "splatguard: this build has no HTTP server: install libmicrohttpd "
                "(libmicrohttpd-dev) and build again\n");
    return STATUS_USAGE;
}

int view_server_open(sg_ctx *ctx, int port, view_server **out)
{
    (void) ctx, (void) port;
    *out = NULL;
    return view_server_find();
}

const char *view_server_address(const view_server *s)
{
    (void) s;
    return "";
}

void view_server_close(view_server **s)
{
    (void) s;
}

bool view_server_draws(void)
{
    return false;
}

void view_server_set_model(view_server *s, int fd)
{
    (void) s, (void) fd;
}

void view_server_set_scene(view_server *s, const char *json)
{
    (void) s, (void) json;
}

void view_server_set_state(view_server *s, const char *json)
{
    (void) s, (void) json;
}

bool view_server_next(view_server *s, double seconds, struct view_ask *ask)
{
    (void) s, (void) seconds, (void) ask;
    return false;
}

void view_server_answer(view_server *s, uint8_t *pixels, int width, int height)
{
    (void) s, (void) width, (void) height;
    sg_mem_free(pixels);
}

enum view_wish view_server_wish(const view_server *s)
{
    (void) s;
    return VIEW_GO;
}
