/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SCENE_CAMERAS_H
#define SG_SCENE_CAMERAS_H

#include "core/context.h"
#include "splatguard/scene.h"

/* In the world. */
static inline void sg_camera_centre(const struct sg_camera *c, double centre[3])
{
    for (int i = 0; i < 3; i++)
        centre[i] = -(c->R[i] * c->t[0] + c->R[3 + i] * c->t[1] + c->R[6 + i] * c->t[2]);
}

/* Refuses photos alone, whose cameras say nothing. */
static inline int sg_check_cameras(sg_ctx *ctx, const struct sg_scene *scene)
{
    return scene->format != SG_FORMAT_PHOTOS
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT, "%s: found photos without cameras, expected a scene",
                         scene->path);
}

/* The cameras of the training views, for engines. NULL without memory; sg_free. */
static inline const struct sg_camera **sg_training_cameras(sg_ctx *ctx,
                                                           const struct sg_scene *scene)
{
    const struct sg_camera **cameras =
        sg_alloc_raw(ctx, SG_MEM_MISC, scene->n_train, sizeof(*cameras));
    for (size_t i = 0; cameras && i < scene->n_train; i++)
        cameras[i] = &scene->train[i].camera;
    return cameras;
}

#endif
