/* SPDX-License-Identifier: Apache-2.0 */
/* Photos that are read when they are needed: by the caller's function, or again from their file. A
 * thread reads the latter before that. */
#include "scene/photo.h"

#include <pthread.h>

#include "scene/reader.h"

/* Every photo is used once an epoch, so keeping the same ones is as good as keeping the newest. */
struct sg_lazy_photos {
    sg_ctx *ctx;
    struct sg_room room; /* photos make room for other allocations */
    pthread_mutex_t lock;
    pthread_cond_t changed; /* what the reader waits for, or who waits for a photo */
    bool busy;              /* a photo is being read, or the reader will read one next */
    pthread_t reader;
    int trainings; /* that want the reader */
    bool runs, quit;
    const struct sg_view *next;  /* for the reader to read */
    struct sg_lazy_photo *ahead; /* what it has read, until somebody uses that */
    struct sg_scene_files *files;
    struct sg_photo_bytes bytes;
    uint64_t keep; /* most bytes of photos without a user */
    struct sg_lazy_photo *first;
};

struct sg_lazy_photo {
    struct sg_lazy_photos *all;
    struct sg_lazy_photo *next, **link; /* the list of all */
    const struct sg_shot *shot;         /* the file; NULL: a function of the caller */
    int (*read)(void *priv, uint8_t *rgb);
    void *priv;
    uint8_t *rgb; /* or NULL */
    size_t size, bytes;
    int users;
};

struct sg_photo_bytes sg_lazy_photos_bytes(struct sg_lazy_photos *all)
{
    struct sg_photo_bytes bytes = {0};
    if (!all)
        return bytes;
    pthread_mutex_lock(&all->lock);
    bytes = all->bytes;
    pthread_mutex_unlock(&all->lock);
    return bytes;
}

/* The static functions are to be called with the lock; the others take it. */

static void drop(struct sg_lazy_photo *p)
{
    sg_free(p->rgb);
    p->rgb = NULL;
    p->all->bytes.held -= p->bytes;
    p->all->ahead = p->all->ahead == p ? NULL : p->all->ahead;
}

static void hold(struct sg_lazy_photo *p, uint8_t *rgb)
{
    p->rgb = rgb;
    p->all->bytes.held += p->bytes;
}

/* The photo that was read ahead does not count: it comes and goes beside those that stay. */
static bool too_many(const struct sg_lazy_photos *all)
{
    return all->bytes.held - (all->ahead ? all->ahead->bytes : 0) > all->keep;
}

static void drop_unused(struct sg_lazy_photos *all, bool test)
{
    for (struct sg_lazy_photo *p = all->first; p && too_many(all); p = p->next)
        if (p->rgb && !p->users && p != all->ahead &&
            test == (p->shot && p->shot->split == SG_SPLIT_TEST))
            drop(p);
}

static void keep(struct sg_lazy_photos *all, uint64_t bytes)
{
    all->keep = bytes < all->bytes.most ? bytes : all->bytes.most;
    all->bytes.dropped |= all->keep < all->bytes.total;
    drop_unused(all, true);
    drop_unused(all, false);
}

static void add(struct sg_lazy_photo *p, uint64_t read)
{
    struct sg_lazy_photos *all = p->all;
    p->next = all->first, p->link = &all->first;
    if (p->next)
        p->next->link = &p->next;
    all->first = p;
    all->bytes.total += p->bytes;
    all->bytes.read = read > all->bytes.read ? read : all->bytes.read;
    if (p->shot && p->bytes > all->bytes.largest)
        all->bytes.largest = p->bytes;
    keep(all, all->keep);
}

void sg_lazy_photos_keep(struct sg_lazy_photos *all, uint64_t bytes)
{
    if (!all)
        return;
    pthread_mutex_lock(&all->lock);
    keep(all, bytes);
    pthread_mutex_unlock(&all->lock);
}

/* Of struct sg_room: drops half of what is held. Takes the lock. */
static bool halve(void *arg)
{
    struct sg_lazy_photos *all = arg;
    pthread_mutex_lock(&all->lock);
    const struct sg_photo_bytes before = all->bytes;
    const uint64_t kept = all->keep;
    keep(all, before.held / 2);
    const bool dropped = all->bytes.held < before.held;
    if (!dropped) /* those that are held are in use */
        all->keep = kept, all->bytes.dropped = before.dropped;
    pthread_mutex_unlock(&all->lock);
    return dropped;
}

int sg_lazy_photos_create(sg_ctx *ctx, uint64_t most, struct sg_scene_files **files,
                          struct sg_lazy_photos **out)
{
    struct sg_lazy_photos *all = *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*all));
    if (!all) {
        sg_scene_files_destroy(files);
        return SG_ERR_BUDGET;
    }
    all->ctx = ctx;
    all->bytes.most = all->keep = most;
    if (files) {
        all->files = *files;
        *files = NULL;
    }
    pthread_mutex_init(&all->lock, NULL);
    pthread_cond_init(&all->changed, NULL);
    all->room = (struct sg_room){.make = halve, .arg = all};
    sg_room_add(ctx, &all->room);
    return SG_OK;
}

void sg_lazy_photos_destroy(struct sg_lazy_photos **photos)
{
    if (!*photos)
        return;
    sg_room_remove((*photos)->ctx, &(*photos)->room);
    sg_scene_files_destroy(&(*photos)->files);
    pthread_cond_destroy(&(*photos)->changed);
    pthread_mutex_destroy(&(*photos)->lock);
    sg_free(*photos);
    *photos = NULL;
}

void sg_lazy_photos_settle(sg_ctx *ctx, struct sg_lazy_photos *all)
{
    pthread_mutex_lock(&all->lock);
    struct sg_photo_bytes *b = &all->bytes;
    const uint64_t limit = sg_mem_limit(ctx), others = sg_mem_current(ctx, SG_MEM_TAGS) - b->held;
    /* The sum depends on the photos alone, not on the order in which threads read them. */
    b->dropped = others + b->total + b->read > limit;
    keep(all, b->dropped ? limit / 2 : UINT64_MAX);
    pthread_mutex_unlock(&all->lock);
}

void sg_lazy_photo_destroy(struct sg_lazy_photo *p)
{
    if (!p)
        return;
    struct sg_lazy_photos *all = p->all;
    pthread_mutex_lock(&all->lock);
    if (p->rgb)
        drop(p);
    all->bytes.total -= p->bytes;
    *p->link = p->next;
    if (p->next)
        p->next->link = p->link;
    pthread_mutex_unlock(&all->lock);
    sg_free(p);
}

/* *hash: of what was read, which is as it was unless this fails. */
static int read_function(sg_ctx *ctx, const struct sg_lazy_photo *p, const struct sg_view *view,
                         uint8_t **rgb, uint64_t *hash)
{
    struct sg_view filled = *view;
    filled.rgb = *rgb = sg_alloc_raw(ctx, SG_MEM_IMAGES, p->size, 1);
    if (!*rgb)
        return SG_ERR_BUDGET;
    const int result = p->read(p->priv, *rgb);
    if (result)
        return sg_fail(ctx, SG_ERR_INPUT, "view \"%s\": read: found result %d, expected 0",
                       view->name, result);
    *hash = sg_view_hash(&filled);
    if (view->hash && view->hash != *hash)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "view \"%s\": read: found other pixels than when the view was added",
                       view->name);
    return SG_OK;
}

static int read_file(sg_ctx *ctx, const struct sg_lazy_photo *p, const struct sg_view *view,
                     uint8_t **rgb)
{
    struct sg_view again = {0};
    bool broken = false;
    int code = sg_view_load(ctx, p->all->files, p->shot, &again, &broken);
    if (!code && (again.hash != view->hash || again.file_width != view->file_width ||
                  again.file_height != view->file_height))
        code =
            sg_fail(ctx, SG_ERR_INPUT,
                    "%s: found another photo or mask than when the scene was loaded", view->path);
    *rgb = again.rgb;
    again.rgb = NULL;
    sg_view_clear(&again);
    return code;
}

/* One photo is read at a time, without the lock: others use photos meanwhile. Call this while
 * nothing is busy, or for what it is busy with. */
static int read_photo(sg_ctx *ctx, struct sg_lazy_photo *p, const struct sg_view *view,
                      uint64_t *hash)
{
    struct sg_lazy_photos *all = p->all;
    uint8_t *rgb = NULL;
    all->busy = true;
    pthread_mutex_unlock(&all->lock);
    const int code =
        p->shot ? read_file(ctx, p, view, &rgb) : read_function(ctx, p, view, &rgb, hash);
    if (code)
        sg_free(rgb);
    pthread_mutex_lock(&all->lock);
    if (!code)
        hold(p, rgb);
    all->bytes.reads += !code;
    all->busy = false;
    pthread_cond_broadcast(&all->changed);
    return code;
}

static void *reader_main(void *arg)
{
    struct sg_lazy_photos *all = arg;
    pthread_mutex_lock(&all->lock);
    while (!all->quit) {
        struct sg_lazy_photo *p = all->next ? all->next->lazy : NULL;
        if (!p) {
            pthread_cond_wait(&all->changed, &all->lock);
            continue;
        }
        /* Whoever needs a photo that could not be read tries again, and reports the error. */
        struct sg_failure failure = {.code = SG_OK};
        sg_failures_apart(&failure);
        const int code = read_photo(all->ctx, p, all->next, NULL);
        sg_failures_apart(NULL);
        all->next = NULL;
        if (!code) {
            all->ahead = p;
            all->bytes.reads_ahead++;
        }
    }
    pthread_mutex_unlock(&all->lock);
    return NULL;
}

void sg_lazy_photos_start_reader(struct sg_lazy_photos *all)
{
    pthread_mutex_lock(&all->lock);
    if (!all->trainings++) /* without a thread, photos are read when they are needed */
        all->runs = !pthread_create(&all->reader, NULL, reader_main, all);
    pthread_mutex_unlock(&all->lock);
}

void sg_lazy_photos_stop_reader(struct sg_lazy_photos *all)
{
    pthread_mutex_lock(&all->lock);
    const bool last = !--all->trainings && all->runs;
    all->quit = last;
    pthread_cond_broadcast(&all->changed);
    pthread_mutex_unlock(&all->lock);
    if (last)
        pthread_join(all->reader, NULL);
    pthread_mutex_lock(&all->lock);
    if (last) {
        all->quit = all->runs = false;
        all->busy &= !all->next; /* what it was asked for and has not begun */
        all->next = NULL;
        pthread_cond_broadcast(&all->changed); /* to those who wait for what was asked for */
    }
    if (all->ahead)
        drop(all->ahead);
    pthread_mutex_unlock(&all->lock);
}

void sg_photo_read_ahead(const struct sg_view *view)
{
    struct sg_lazy_photo *p = view->lazy;
    if (!p || !p->shot)
        return;
    struct sg_lazy_photos *all = p->all;
    pthread_mutex_lock(&all->lock);
    if (all->runs && !all->busy && !all->ahead && !p->rgb) {
        all->busy = true;
        all->next = view;
        pthread_cond_broadcast(&all->changed);
    }
    pthread_mutex_unlock(&all->lock);
}

int sg_view_pixels(sg_ctx *ctx, const struct sg_view *view, const uint8_t **rgb)
{
    sg_clear_error(ctx);
    return sg_photo_pixels(ctx, view, rgb);
}

int sg_photo_pixels(sg_ctx *ctx, const struct sg_view *view, const uint8_t **rgb)
{
    struct sg_lazy_photo *p = view->lazy;
    *rgb = view->rgb;
    if (!p)
        return SG_OK;
    struct sg_lazy_photos *all = p->all;
    uint64_t hash;
    pthread_mutex_lock(&all->lock);
    while (!p->rgb && all->busy)
        pthread_cond_wait(&all->changed, &all->lock);
    const int code = p->rgb ? SG_OK : read_photo(ctx, p, view, &hash);
    if (!code && all->ahead == p)
        all->ahead = NULL;
    p->users += !code;
    *rgb = p->rgb;
    pthread_mutex_unlock(&all->lock);
    return code;
}

void sg_view_release(const struct sg_view *view)
{
    struct sg_lazy_photo *p = view->lazy;
    if (!p)
        return;
    pthread_mutex_lock(&p->all->lock);
    if (!--p->users && too_many(p->all))
        drop(p);
    pthread_mutex_unlock(&p->all->lock);
}

void sg_photo_forget(const struct sg_view *view)
{
    struct sg_lazy_photo *p = view->lazy;
    if (!p)
        return;
    pthread_mutex_lock(&p->all->lock);
    if (p->rgb && !p->users && p != p->all->ahead) {
        drop(p);
        p->all->bytes.dropped = true;
    }
    pthread_mutex_unlock(&p->all->lock);
}

int sg_lazy_photo_create(sg_ctx *ctx, struct sg_lazy_photos *all, const struct sg_view_desc *d,
                         struct sg_view *view)
{
    struct sg_lazy_photo *p = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*p));
    if (!p)
        return SG_ERR_BUDGET;
    const size_t size = 3 * (size_t) d->camera.width * (size_t) d->camera.height;
    *p = (struct sg_lazy_photo){.all = all,
                                .read = d->read,
                                .priv = d->read_priv,
                                .size = size,
                                .bytes = sg_mem_cost(size)};
    pthread_mutex_lock(&all->lock);
    while (all->busy)
        pthread_cond_wait(&all->changed, &all->lock);
    const int code = read_photo(ctx, p, view, &view->hash);
    if (!code)
        add(p, p->bytes);
    pthread_mutex_unlock(&all->lock);
    if (code)
        sg_free(p);
    else
        view->lazy = p;
    return code;
}

int sg_lazy_photo_keep(sg_ctx *ctx, struct sg_lazy_photos *all, const struct sg_shot *shot,
                       uint64_t read, struct sg_view *view)
{
    struct sg_lazy_photo *p = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*p));
    if (!p)
        return SG_ERR_BUDGET;
    const size_t size = 3 * (size_t) view->camera.width * (size_t) view->camera.height;
    *p = (struct sg_lazy_photo){.all = all, .shot = shot, .size = size, .bytes = sg_mem_cost(size)};
    pthread_mutex_lock(&all->lock);
    hold(p, view->rgb);
    view->rgb = NULL;
    view->lazy = p;
    add(p, read);
    pthread_mutex_unlock(&all->lock);
    return SG_OK;
}
