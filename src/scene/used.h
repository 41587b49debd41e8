/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SCENE_USED_H
#define SG_SCENE_USED_H

#include <string.h>

#include "core/context.h"
#include "splatguard/scene.h"

/* Whether any of these views has a used pixel. */
static inline bool sg_views_used(const struct sg_view *views, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!views[i].mask ||
            memchr(views[i].mask, 255,
                   (size_t) views[i].camera.width * (size_t) views[i].camera.height))
            return true;
    return false;
}

/* Refuses a scene from whose training views nothing can learn; one without views is not refused. */
static inline int sg_check_used(sg_ctx *ctx, const struct sg_scene *scene)
{
    return !scene->n_train || sg_views_used(scene->train, scene->n_train)
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT,
                         "%s: found no training view with a used pixel: masks leave nothing",
                         scene->path);
}

/* Pixels of the largest of these views. */
static inline size_t sg_views_largest(const struct sg_view *views, size_t n)
{
    size_t largest = 0;
    for (size_t i = 0; i < n; i++) {
        const size_t pixels = (size_t) views[i].camera.width * (size_t) views[i].camera.height;
        largest = pixels > largest ? pixels : largest;
    }
    return largest;
}

#endif
