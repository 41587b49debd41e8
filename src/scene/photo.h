/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SCENE_PHOTO_H
#define SG_SCENE_PHOTO_H

#include "core/internal.h"
#include "splatguard/scene.h"

/* State shared by the photos of a scene that are read when they are needed. */
struct sg_lazy_photos;
/* keep: bytes of photos without a user that stay in memory. */
int sg_lazy_photos_create(sg_ctx *ctx, uint64_t keep, struct sg_lazy_photos **out);
/* After all of its photos. NULL-safe. */
void sg_lazy_photos_destroy(struct sg_lazy_photos **photos);
/* Bytes that may be held at once, beyond those that are held now. NULL: 0. */
uint64_t sg_lazy_photos_to_come(const struct sg_lazy_photos *photos);

/* Reads the photo for the first time. Sets view->lazy and view->hash; the view has its name, camera
 * and mask. */
int sg_lazy_photo_create(sg_ctx *ctx, struct sg_lazy_photos *all, const struct sg_view_desc *desc,
                         struct sg_view *view);
void sg_lazy_photo_destroy(struct sg_lazy_photo *photo); /* NULL-safe */

/* sg_view_pixels for the library's own threads: it clears no error, and several may call it at
 * once.
 */
int sg_photo_pixels(sg_ctx *ctx, const struct sg_view *view, const uint8_t **rgb);

#endif
