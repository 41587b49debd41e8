/* SPDX-License-Identifier: Apache-2.0 */
#include "view_server.h"

#include <arpa/inet.h>
#include <dlfcn.h>
#include <errno.h>
#include <math.h>
#include <microhttpd.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "commands.h"

#define CLIENTS 256              /* connections at once, of which most can be idle */
#define CLIENT_BYTES (16 * 1024) /* of headers */
#define CLIENT_SECONDS 10        /* without a byte */
#define WAITING 8                /* pictures that wait to be drawn */
#define TOKEN 32                 /* letters: 128 bits */

struct view_file {
    const char *name, *type, *text;
};
extern const char view_html[], view_css[], view_js[], view_icon_svg[], page_css[];
#ifdef SG_PLAYCANVAS
extern const char view_draw_js[], playcanvas_js[], playcanvas_txt[];
#endif
static const struct view_file files[] = {
    {"", "text/html; charset=utf-8", view_html},
    {"view.css", "text/css; charset=utf-8", view_css},
    {"page.css", "text/css; charset=utf-8", page_css},
    {"view.js", "text/javascript; charset=utf-8", view_js},
#ifdef SG_PLAYCANVAS
    {"draw.js", "text/javascript; charset=utf-8", view_draw_js},
    {"playcanvas.js", "text/javascript; charset=utf-8", playcanvas_js},
    {"playcanvas.txt", "text/plain; charset=utf-8", playcanvas_txt},
#endif
    {"icon.svg", "image/svg+xml", view_icon_svg}};

/* A request for a picture, from its first line to its last byte. */
struct request {
    struct MHD_Connection *connection;
    struct view_ask ask;
    bool asked, answered;
    uint8_t *pixels; /* of the answer, or NULL */
    int width, height;
};

struct view_server {
    sg_ctx *ctx;
    struct MHD_Daemon *daemon;
    char token[TOKEN + 1], address[64 + TOKEN];
    int port;
    pthread_mutex_t lock;
    pthread_cond_t more;              /* requests */
    struct request *waiting[WAITING]; /* the oldest first */
    int n_waiting;
    struct request *drawing;
    struct MHD_Response *scene, *state, *model; /* or NULL */
    bool closing;
    atomic_int wish;
    /* Of the server's own thread: those that have not shown the token yet, the oldest first. */
    struct MHD_Connection *strangers[CLIENTS];
    int n_strangers, n_connections;
};

/* ---- libmicrohttpd ---- */

/* Loaded when a page opens: it brings libraries for TLS along, which no other command should load.
 * mhd.start_daemon is MHD_start_daemon. */
#define MHD_FUNCTIONS(F)                                                                           \
    F(add_response_header)                                                                         \
    F(create_response_from_buffer)                                                                 \
    F(create_response_from_callback)                                                               \
    F(create_response_from_fd)                                                                     \
    F(destroy_response)                                                                            \
    F(get_connection_info)                                                                         \
    F(get_connection_values)                                                                       \
    F(get_daemon_info)                                                                             \
    F(lookup_connection_value)                                                                     \
    F(queue_response)                                                                              \
    F(resume_connection)                                                                           \
    F(start_daemon)                                                                                \
    F(stop_daemon)                                                                                 \
    F(suspend_connection)

static struct {
#define F(name) __typeof__(MHD_##name) *name;
    MHD_FUNCTIONS(F)
#undef F
} mhd;

/* Returns NULL, or what is wrong. dlsym returns an object's pointer; POSIX lets it be a function's.
 */
static const char *load_mhd(void)
{
    void *library = dlopen("libmicrohttpd.so.12", RTLD_NOW | RTLD_LOCAL);
    const void *from;
    if (!library)
        return dlerror();
#define F(name)                                                                                    \
    if (!(from = dlsym(library, "MHD_" #name)))                                                    \
        return dlerror();                                                                          \
    *(const void **) &mhd.name = from;
    MHD_FUNCTIONS(F)
#undef F
    return NULL;
}

/* ---- answers ---- */

/* PlayCanvas sorts Gaussians on a thread of its own, whose script it makes itself: "blob:". Such a
 * thread has the page's policy. */
#ifdef SG_PLAYCANVAS
#define WORKERS "worker-src blob:; "
#else
#define WORKERS ""
#endif

static void add_headers(struct MHD_Response *r, const char *type)
{
    static const char *const headers[][2] = {
        {"Content-Security-Policy",
         "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src "
         "'self'; " WORKERS "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
        {"X-Content-Type-Options", "nosniff"},
        {"Referrer-Policy", "no-referrer"},
        {"Cross-Origin-Resource-Policy", "same-origin"},
        {"Cross-Origin-Opener-Policy", "same-origin"},
        {"Cache-Control", "no-store"}};
    for (size_t i = 0; i < sizeof(headers) / sizeof(headers[0]); i++)
        mhd.add_response_header(r, headers[i][0], headers[i][1]);
    mhd.add_response_header(r, "Content-Type", type);
}

static enum MHD_Result send_response(struct MHD_Connection *c, unsigned status, const char *type,
                                     struct MHD_Response *r)
{
    if (!r)
        return MHD_NO;
    add_headers(r, type);
    const enum MHD_Result done = mhd.queue_response(c, status, r);
    mhd.destroy_response(r);
    return done;
}

/* A text that outlives the answer. */
static enum MHD_Result send_text(struct MHD_Connection *c, unsigned status, const char *type,
                                 const char *text)
{
    return send_response(
        c, status, type,
        mhd.create_response_from_buffer(strlen(text), (void *) text, MHD_RESPMEM_PERSISTENT));
}

static enum MHD_Result say_status(struct MHD_Connection *c, unsigned status, const char *text)
{
    return send_text(c, status, "text/plain; charset=utf-8", text);
}

/* One answer for all who ask, which another thread may replace. */
static enum MHD_Result send_shared(view_server *s, struct MHD_Connection *c,
                                   struct MHD_Response *const *shared, unsigned status,
                                   const char *without)
{
    pthread_mutex_lock(&s->lock);
    const enum MHD_Result done = *shared ? mhd.queue_response(c, MHD_HTTP_OK, *shared) : MHD_NO;
    const bool there = *shared;
    pthread_mutex_unlock(&s->lock);
    return there ? done : say_status(c, status, without);
}

/* What is on its way out counts in the context until its last byte is sent. */
struct outgoing {
    uint8_t *data;
    size_t size;
};

static ssize_t read_outgoing(void *cls, uint64_t at, char *to, size_t most)
{
    const struct outgoing *o = cls;
    if (at >= o->size)
        return MHD_CONTENT_READER_END_OF_STREAM;
    const size_t n = o->size - at < most ? (size_t) (o->size - at) : most;
    memcpy(to, o->data + at, n);
    return (ssize_t) n;
}

static void free_outgoing(void *cls)
{
    struct outgoing *o = cls;
    sg_mem_free(o->data);
    sg_mem_free(o);
}

/* An answer that owns its data. NULL: they are freed. */
static struct MHD_Response *answer(view_server *s, uint8_t *data, size_t size)
{
    struct MHD_Response *r = NULL;
    struct outgoing *o = sg_mem_alloc(s->ctx, SG_MEM_FRAME, 1, sizeof(*o));
    if (o) {
        *o = (struct outgoing){.data = data, .size = size};
        r = mhd.create_response_from_callback(size, 1 << 15, read_outgoing, o, free_outgoing);
    }
    if (!r) {
        sg_mem_free(data);
        sg_mem_free(o);
    }
    return r;
}

/* Encoded here, so that the thread of the model goes on. */
static enum MHD_Result send_picture(view_server *s, struct request *q)
{
    void *data = NULL;
    size_t size = 0;
    struct MHD_Response *r = NULL;
    if (q->pixels && !sg_picture_encode(s->ctx, q->ask.still ? SG_PICTURE_PNG : SG_PICTURE_JPEG,
                                        q->pixels, q->width, q->height, &data, &size))
        r = answer(s, data, size);
    sg_mem_free(q->pixels);
    q->pixels = NULL;
    return r ? send_response(q->connection, MHD_HTTP_OK, q->ask.still ? "image/png" : "image/jpeg",
                             r)
             : say_status(q->connection, MHD_HTTP_SERVICE_UNAVAILABLE, "cannot be drawn\n");
}

/* ---- requests ---- */

/* In a time that does not depend on where they differ. */
static bool same_token(const char *a, const char *b)
{
    unsigned different = 0;
    for (int i = 0; i < TOKEN; i++)
        different |= (unsigned) (a[i] ^ b[i]);
    return !different;
}

/* Whether a Host or Origin is this server. A site that makes a name of its own resolve to 127.0.0.1
 * (DNS rebinding) has that name in both. */
static bool is_here(const view_server *s, const char *place)
{
    char here[32], local[32];
    snprintf(here, sizeof(here), "127.0.0.1:%d", s->port);
    snprintf(local, sizeof(local), "localhost:%d", s->port);
    const bool bare = s->port == 80 && /* which browsers leave out */
                      (!strcmp(place, "127.0.0.1") || !strcmp(place, "localhost"));
    return bare || !strcmp(place, here) || !strcmp(place, local);
}

static enum MHD_Result count_header(void *cls, enum MHD_ValueKind kind, const char *name,
                                    const char *value)
{
    (void) kind, (void) value;
    int *n = cls;
    n[0] += !strcasecmp(name, "Host"), n[1] += !strcasecmp(name, "Origin");
    return MHD_YES;
}

static bool is_allowed(const view_server *s, struct MHD_Connection *c, const char *url)
{
    const char *host = mhd.lookup_connection_value(c, MHD_HEADER_KIND, "Host"),
               *origin = mhd.lookup_connection_value(c, MHD_HEADER_KIND, "Origin");
    int n[2] = {0};
    mhd.get_connection_values(c, MHD_HEADER_KIND, count_header, n);
    if (n[0] != 1 || n[1] > 1 || !host || !is_here(s, host))
        return false;
    if (n[1] && !(origin && !strncmp(origin, "http://", 7) && is_here(s, origin + 7)))
        return false;
    return strlen(url) > TOKEN + 1 && url[TOKEN + 1] == '/' && same_token(url + 1, s->token);
}

/* A number of the query, or NAN. */
static double number(struct MHD_Connection *c, const char *name)
{
    const char *text = mhd.lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, name);
    char *end;
    const double v = text && text[0] ? strtod(text, &end) : NAN;
    return text && text[0] && !*end ? v : NAN;
}

static bool read_ask(struct MHD_Connection *c, struct view_ask *a)
{
    static const char *const pose[7] = {"qw", "qx", "qy", "qz", "tx", "ty", "tz"};
    const double kind = number(c, "kind"), view = number(c, "view"), still = number(c, "still");
    double length = 0;
    *a = (struct view_ask){.still = still == 1, .scale = number(c, "scale")};
    if (!(kind >= 0 && kind < VIEW_KINDS && kind == floor(kind)) ||
        !(view >= 0 && view < 1e9 && view == floor(view)) || !(still == 0 || still == 1) ||
        !(a->scale >= 0.05 && a->scale <= 1))
        return false;
    a->kind = (enum view_kind) kind, a->view = (size_t) view;
    for (int i = 0; i < 7; i++) {
        a->pose[i] = number(c, pose[i]);
        if (!(fabs(a->pose[i]) < (i < 4 ? 2 : 1e12)))
            return false;
        length += i < 4 ? a->pose[i] * a->pose[i] : 0;
    }
    return length > 0.01;
}

static enum MHD_Result queue_picture(view_server *s, struct request *q)
{
    if (!read_ask(q->connection, &q->ask))
        return say_status(q->connection, MHD_HTTP_BAD_REQUEST, "not a picture\n");
    pthread_mutex_lock(&s->lock);
    const bool room = s->n_waiting < WAITING && !s->closing;
    if (room) {
        q->asked = true;
        s->waiting[s->n_waiting++] = q;
        mhd.suspend_connection(q->connection);
        pthread_cond_signal(&s->more);
    }
    pthread_mutex_unlock(&s->lock);
    return room ? MHD_YES
                : say_status(q->connection, MHD_HTTP_SERVICE_UNAVAILABLE,
                             "too many pictures are waiting\n");
}

static enum MHD_Result serve(view_server *s, struct request *q, const char *name, bool post)
{
    static const char *const wishes[] = {
        [VIEW_GO] = "go", [VIEW_PAUSE] = "pause", [VIEW_STOP] = "stop"};
    struct MHD_Connection *c = q->connection;
    if (post) {
        for (int i = 0; i < 3; i++)
            if (!strcmp(name, wishes[i])) {
                int old = atomic_load(&s->wish);
                while (old != VIEW_STOP && !atomic_compare_exchange_weak(&s->wish, &old, i))
                    ;
                return say_status(c, MHD_HTTP_OK, "done\n");
            }
        return say_status(c, MHD_HTTP_NOT_FOUND, "no such wish\n");
    }
    if (!strcmp(name, "picture"))
        return queue_picture(s, q);
    if (!strcmp(name, "scene"))
        return send_shared(s, c, &s->scene, MHD_HTTP_SERVICE_UNAVAILABLE, "not yet\n");
    if (!strcmp(name, "state"))
        return send_shared(s, c, &s->state, MHD_HTTP_SERVICE_UNAVAILABLE, "not yet\n");
    if (!strcmp(name, "model.ply"))
        return send_shared(s, c, &s->model, MHD_HTTP_NOT_FOUND,
                           "no model that a browser can draw\n");
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++)
        if (!strcmp(name, files[i].name))
            return send_text(c, MHD_HTTP_OK, files[i].type, files[i].text);
    return say_status(c, MHD_HTTP_NOT_FOUND, "no such page\n");
}

static void forget_stranger(view_server *s, const struct MHD_Connection *c)
{
    for (int i = 0; i < s->n_strangers; i++)
        if (s->strangers[i] == c) {
            memmove(&s->strangers[i], &s->strangers[i + 1],
                    (size_t) (--s->n_strangers - i) * sizeof(s->strangers[0]));
            return;
        }
}

/* A connection begins or ends. At CLIENTS of them the server accepts no other one, so that the
 * oldest stranger makes room for whoever comes next. */
static void count_connection(void *cls, struct MHD_Connection *c, void **kept,
                             enum MHD_ConnectionNotificationCode what)
{
    (void) kept;
    view_server *s = cls;
    if (what == MHD_CONNECTION_NOTIFY_CLOSED) {
        s->n_connections--;
        forget_stranger(s, c);
        return;
    }
    s->n_connections++;
    s->strangers[s->n_strangers++] = c;
    if (s->n_connections == CLIENTS && s->n_strangers > 1)
        shutdown(
            mhd.get_connection_info(s->strangers[0], MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd,
            SHUT_RDWR);
}

/* libmicrohttpd calls it when the headers are there, for each piece of a body, and when all is
 * there; again after a picture was drawn. */
static enum MHD_Result handle(void *cls, struct MHD_Connection *c, const char *url,
                              const char *method, const char *version, const char *upload,
                              size_t *upload_size, void **kept)
{
    (void) version, (void) upload;
    view_server *s = cls;
    struct request *q = *kept;
    if (!q) {
        *kept = q = sg_mem_alloc(s->ctx, SG_MEM_MISC, 1, sizeof(*q));
        if (!q)
            return MHD_NO;
        q->connection = c;
        return MHD_YES;
    }
    if (*upload_size) /* no request has a body */
        return MHD_NO;
    const bool post = !strcmp(method, "POST");
    pthread_mutex_lock(&s->lock);
    const bool answered = q->answered;
    pthread_mutex_unlock(&s->lock);
    if (answered)
        return send_picture(s, q);
    if (q->asked)
        return MHD_YES;
    if (!is_allowed(s, c, url))
        return say_status(c, MHD_HTTP_FORBIDDEN,
                          "Open the address that splatguard has printed, with all its letters.\n");
    forget_stranger(s, c);
    if (!post && strcmp(method, "GET"))
        return say_status(c, MHD_HTTP_METHOD_NOT_ALLOWED, "GET or POST\n");
    return serve(s, q, url + TOKEN + 2, post);
}

/* A connection has ended, perhaps before its picture was drawn. */
static void completed(void *cls, struct MHD_Connection *c, void **kept,
                      enum MHD_RequestTerminationCode how)
{
    (void) c, (void) how;
    view_server *s = cls;
    struct request *q = *kept;
    if (!q)
        return;
    pthread_mutex_lock(&s->lock);
    for (int i = 0; i < s->n_waiting; i++)
        if (s->waiting[i] == q) {
            memmove(&s->waiting[i], &s->waiting[i + 1],
                    (size_t) (--s->n_waiting - i) * sizeof(s->waiting[0]));
            break;
        }
    s->drawing = s->drawing == q ? NULL : s->drawing;
    pthread_mutex_unlock(&s->lock);
    sg_mem_free(q->pixels);
    sg_mem_free(q);
    *kept = NULL;
}

/* ---- the thread of the model ---- */

bool view_server_next(view_server *s, double seconds, struct view_ask *ask)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    const double at = (double) until.tv_nsec * 1e-9 + seconds;
    until.tv_sec += (time_t) at;
    until.tv_nsec = (long) ((at - floor(at)) * 1e9);
    pthread_mutex_lock(&s->lock);
    while (!s->n_waiting && seconds > 0 && !pthread_cond_timedwait(&s->more, &s->lock, &until))
        ;
    const bool any = s->n_waiting > 0;
    if (any) {
        s->drawing = s->waiting[0];
        *ask = s->drawing->ask;
        memmove(&s->waiting[0], &s->waiting[1], (size_t) --s->n_waiting * sizeof(s->waiting[0]));
    }
    pthread_mutex_unlock(&s->lock);
    return any;
}

void view_server_answer(view_server *s, uint8_t *pixels, int width, int height)
{
    pthread_mutex_lock(&s->lock);
    struct request *q = s->drawing;
    s->drawing = NULL;
    if (q) {
        q->pixels = pixels, q->width = width, q->height = height;
        q->answered = true;
        mhd.resume_connection(q->connection);
    }
    pthread_mutex_unlock(&s->lock);
    if (!q)
        sg_mem_free(pixels);
}

/* What was there before ends with those who still get it. */
static void share(view_server *s, struct MHD_Response **shared, struct MHD_Response *r,
                  const char *type)
{
    if (r)
        add_headers(r, type);
    pthread_mutex_lock(&s->lock);
    struct MHD_Response *old = *shared;
    *shared = r;
    pthread_mutex_unlock(&s->lock);
    if (old)
        mhd.destroy_response(old);
}

static void share_json(view_server *s, struct MHD_Response **shared, const char *json)
{
    const size_t n = strlen(json);
    uint8_t *copy = sg_mem_alloc(s->ctx, SG_MEM_MISC, n, 1);
    struct MHD_Response *r = copy ? answer(s, memcpy(copy, json, n), n) : NULL;
    if (r)
        share(s, shared, r, "application/json");
}

void view_server_set_scene(view_server *s, const char *json)
{
    share_json(s, &s->scene, json);
}

void view_server_set_state(view_server *s, const char *json)
{
    share_json(s, &s->state, json);
}

bool view_server_draws(void)
{
#ifdef SG_PLAYCANVAS
    return true;
#else
    return false;
#endif
}

void view_server_set_model(view_server *s, int fd)
{
    struct stat info;
    struct MHD_Response *r = /* read from its file piece by piece */
        fstat(fd, &info) ? NULL : mhd.create_response_from_fd((size_t) info.st_size, fd);
    if (!r)
        close(fd);
    share(s, &s->model, r, "application/octet-stream");
}

enum view_wish view_server_wish(const view_server *s)
{
    return (enum view_wish) atomic_load_explicit(&s->wish, memory_order_relaxed);
}

const char *view_server_address(const view_server *s)
{
    return s->address;
}

/* ---- begin and end ---- */

static bool make_token(char *token)
{
    uint8_t random[TOKEN / 2];
    if (getrandom(random, sizeof(random), 0) != (ssize_t) sizeof(random))
        return false;
    for (size_t i = 0; i < sizeof(random); i++)
        snprintf(token + 2 * i, 3, "%02x", random[i]);
    return true;
}

int view_server_find(void)
{
    const char *missing = load_mhd();
    if (missing)
        say(stderr, "splatguard: found no HTTP server: %s; install libmicrohttpd 0.9.71 or newer\n",
            missing);
    return missing ? STATUS_USAGE : STATUS_DONE;
}

int view_server_open(sg_ctx *ctx, int port, view_server **out)
{
    struct sockaddr_in place = {.sin_family = AF_INET,
                                .sin_port = htons((uint16_t) port),
                                .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    *out = NULL;
    const int code = view_server_find();
    if (code)
        return code;
    view_server *s = *out = sg_mem_alloc(ctx, SG_MEM_MISC, 1, sizeof(*s));
    if (!s)
        return no_memory();
    pthread_condattr_t monotonic;
    s->ctx = ctx;
    pthread_mutex_init(&s->lock, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&s->more, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (!make_token(s->token)) {
        say(stderr, "splatguard: cannot make a token: %s\n", strerror(errno));
        view_server_close(out);
        return STATUS_INTERNAL;
    }
    pthread_mutex_lock(&s->lock); /* requests wait until the port is known */
    errno = 0;
    s->daemon = mhd.start_daemon(
        MHD_USE_AUTO | MHD_USE_INTERNAL_POLLING_THREAD | MHD_ALLOW_SUSPEND_RESUME, (uint16_t) port,
        NULL, NULL, handle, s, MHD_OPTION_SOCK_ADDR, &place, MHD_OPTION_CONNECTION_LIMIT,
        (unsigned) CLIENTS, MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t) CLIENT_BYTES,
        MHD_OPTION_CONNECTION_TIMEOUT, (unsigned) CLIENT_SECONDS, MHD_OPTION_NOTIFY_CONNECTION,
        count_connection, s, MHD_OPTION_NOTIFY_COMPLETED, completed, s, MHD_OPTION_END);
    const union MHD_DaemonInfo *info =
        s->daemon ? mhd.get_daemon_info(s->daemon, MHD_DAEMON_INFO_BIND_PORT) : NULL;
    s->port = info ? info->port : 0;
    pthread_mutex_unlock(&s->lock);
    if (!info) {
        say(stderr, "splatguard: --port: cannot listen at 127.0.0.1:%d: %s\n", port,
            strerror(errno ? errno : EIO));
        view_server_close(out);
        return STATUS_INPUT;
    }
    snprintf(s->address, sizeof(s->address), "http://127.0.0.1:%d/%s/", s->port, s->token);
    return STATUS_DONE;
}

void view_server_close(view_server **server)
{
    view_server *s = server ? *server : NULL;
    struct view_ask ask;
    if (!s)
        return;
    pthread_mutex_lock(&s->lock);
    s->closing = true;
    pthread_mutex_unlock(&s->lock);
    while (s->daemon && view_server_next(s, 0, &ask)) /* none may be suspended at the end */
        view_server_answer(s, NULL, 0, 0);
    if (s->daemon)
        mhd.stop_daemon(s->daemon);
    struct MHD_Response *const shared[] = {s->scene, s->state, s->model};
    for (int k = 0; k < 3; k++)
        if (shared[k])
            mhd.destroy_response(shared[k]);
    pthread_mutex_destroy(&s->lock);
    pthread_cond_destroy(&s->more);
    sg_mem_free(s);
    *server = NULL;
}
