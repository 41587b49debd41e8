/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_SCENE_CAMERAS_H
#define SG_SCENE_CAMERAS_H

#include "core/context.h"
#include "splatguard/scene.h"

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
