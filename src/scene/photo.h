/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SCENE_PHOTO_H
#define SG_SCENE_PHOTO_H

#include "core/context.h"
#include "splatguard/scene.h"

/* Photos of a scene that are read when they are needed, and their common state. Bytes are those
 * that the context counts. Photos without a user are dropped, half of what is held at a time, where
 * an allocation would exceed the limit of the context. */
struct sg_lazy_photos;
struct sg_scene_files;
struct sg_shot;

/* most: bytes of photos without a user that may stay in memory. files: the photos are read from
 * them; NULL for scenes from memory. Takes the files, also where it fails. */
int sg_lazy_photos_create(sg_ctx *ctx, uint64_t most, struct sg_scene_files **files,
                          struct sg_lazy_photos **out);
/* After all of its photos. NULL-safe. */
void sg_lazy_photos_destroy(struct sg_lazy_photos **photos);

/* Bytes of a scene's lazy photos. */
struct sg_photo_bytes {
    uint64_t held;               /* now */
    uint64_t total;              /* all at once */
    uint64_t read;               /* while one of them is read, itself included */
    uint64_t most;               /* that may stay */
    uint64_t largest;            /* of one that can be read ahead; 0 = none can */
    uint64_t reads, reads_ahead; /* how often a photo was read again; by the reader */
    bool dropped;                /* not all of them have always stayed */
};
struct sg_photo_bytes sg_lazy_photos_bytes(struct sg_lazy_photos *photos); /* NULL: zeros */
/* From now on at most `bytes` stay without a user. Test photos are dropped first. NULL-safe. */
void sg_lazy_photos_keep(struct sg_lazy_photos *photos, uint64_t bytes);
/* The reader is a thread that reads a photo from its file before it is needed. It never calls a
 * caller's function. It runs until everybody who has started it has stopped it. Where the system
 * has no thread for it, nothing is read ahead. */
void sg_lazy_photos_start_reader(struct sg_lazy_photos *photos);
void sg_lazy_photos_stop_reader(struct sg_lazy_photos *photos);
/* Asks the reader for the photo that will be used next. It stays in memory until it has been used,
 * beside those that may stay; until then the reader reads no other. Whoever uses the photo waits
 * for the reader, and reads the photo where the reader could not: errors are reported there. Does
 * nothing where no reader runs or the photo has no file. */
void sg_photo_read_ahead(const struct sg_view *view);
/* After all photos of a folder were added: where they do not all fit, with one that is being read,
 * half of the memory limit is left to those who use the photos. */
void sg_lazy_photos_settle(sg_ctx *ctx, struct sg_lazy_photos *photos);

/* Reads the photo for the first time. Sets view->lazy and view->hash; the view has its name, camera
 * and mask. */
int sg_lazy_photo_create(sg_ctx *ctx, struct sg_lazy_photos *all, const struct sg_view_desc *desc,
                         struct sg_view *view);
/* Of a view that was loaded from files: takes its pixels. read: bytes that loading needed. Thread
 * safe. */
int sg_lazy_photo_keep(sg_ctx *ctx, struct sg_lazy_photos *all, const struct sg_shot *shot,
                       uint64_t read, struct sg_view *view);
void sg_lazy_photo_destroy(struct sg_lazy_photo *photo); /* NULL-safe */

/* Drops the pixels of a photo without a user, which are read again if they are needed. Does nothing
 * where they cannot be. */
void sg_photo_forget(const struct sg_view *view);

/* sg_view_pixels for the library's own threads: it clears no error, and several may call it at
 * once. */
int sg_photo_pixels(sg_ctx *ctx, const struct sg_view *view, const uint8_t **rgb);

#endif
