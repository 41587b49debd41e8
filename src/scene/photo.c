/* SPDX-License-Identifier: Apache-2.0 */
/* Photos that are read by the caller's function when they are needed. */
#include "scene/photo.h"

#include <pthread.h>

#include "scene/reader.h"

/* Every photo is used once an epoch, so keeping the same ones is as good as keeping the newest. */
struct sg_lazy_photos {
    pthread_mutex_t lock;
    uint64_t keep;           /* most bytes of photos without a user */
    uint64_t held;           /* bytes now */
    uint64_t total, largest; /* of all photos that are read when needed */
};

struct sg_lazy_photo {
    struct sg_lazy_photos *all;
    int (*read)(void *priv, uint8_t *rgb);
    void *priv;
    uint8_t *rgb; /* or NULL */
    size_t bytes;
    int users;
};

int sg_lazy_photos_create(sg_ctx *ctx, uint64_t keep, struct sg_lazy_photos **out)
{
    *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(**out));
    if (!*out)
        return SG_ERR_BUDGET;
    (*out)->keep = keep;
    pthread_mutex_init(&(*out)->lock, NULL);
    return SG_OK;
}

void sg_lazy_photos_destroy(struct sg_lazy_photos **photos)
{
    if (*photos)
        pthread_mutex_destroy(&(*photos)->lock);
    sg_free(*photos);
    *photos = NULL;
}

uint64_t sg_lazy_photos_to_come(const struct sg_lazy_photos *p)
{
    if (!p)
        return 0;
    const uint64_t most = (p->total < p->keep ? p->total : p->keep) + p->largest;
    return most > p->held ? most - p->held : 0;
}

void sg_lazy_photo_destroy(struct sg_lazy_photo *p)
{
    if (!p)
        return;
    p->all->held -= p->rgb ? p->bytes : 0;
    p->all->total -= p->bytes;
    sg_free(p->rgb);
    sg_free(p);
}

/* To be called with the lock. view->hash 0: it is taken from what is read. */
static int read_photo(sg_ctx *ctx, struct sg_lazy_photo *p, const struct sg_view *view,
                      uint64_t *hash)
{
    struct sg_view filled = *view;
    filled.rgb = sg_alloc_raw(ctx, SG_MEM_IMAGES, p->bytes, 1);
    if (!filled.rgb)
        return SG_ERR_BUDGET;
    int code = SG_OK;
    const int result = p->read(p->priv, filled.rgb);
    *hash = result ? 0 : sg_view_hash(&filled);
    if (result)
        code = sg_fail(ctx, SG_ERR_INPUT, "view \"%s\": read: found result %d, expected 0",
                       view->name, result);
    else if (view->hash && view->hash != *hash)
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "view \"%s\": read: found other pixels than when the view was added",
                       view->name);
    if (code) {
        sg_free(filled.rgb);
        return code;
    }
    p->rgb = filled.rgb;
    p->all->held += p->bytes;
    return SG_OK;
}

/* To be called with the lock. */
static void let_go(struct sg_lazy_photo *p)
{
    if (--p->users || p->all->held <= p->all->keep)
        return;
    sg_free(p->rgb);
    p->rgb = NULL;
    p->all->held -= p->bytes;
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
    uint64_t hash;
    pthread_mutex_lock(&p->all->lock);
    const int code = p->rgb ? SG_OK : read_photo(ctx, p, view, &hash);
    p->users += !code;
    *rgb = p->rgb;
    pthread_mutex_unlock(&p->all->lock);
    return code;
}

void sg_view_release(const struct sg_view *view)
{
    struct sg_lazy_photo *p = view->lazy;
    if (!p)
        return;
    pthread_mutex_lock(&p->all->lock);
    let_go(p);
    pthread_mutex_unlock(&p->all->lock);
}

int sg_lazy_photo_create(sg_ctx *ctx, struct sg_lazy_photos *all, const struct sg_view_desc *d,
                         struct sg_view *view)
{
    struct sg_lazy_photo *p = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*p));
    if (!p)
        return SG_ERR_BUDGET;
    *p = (struct sg_lazy_photo){.all = all,
                                .read = d->read,
                                .priv = d->read_priv,
                                .bytes = 3 * (size_t) d->camera.width * (size_t) d->camera.height};
    const int code = read_photo(ctx, p, view, &view->hash);
    if (code) {
        sg_free(p);
        return code;
    }
    p->users = 1;
    let_go(p);
    all->total += p->bytes;
    all->largest = p->bytes > all->largest ? p->bytes : all->largest;
    view->lazy = p;
    return SG_OK;
}
