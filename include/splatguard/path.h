/* SPDX-License-Identifier: Apache-2.0 */
/* Flights of a camera through a scene, for pictures of views that nobody has taken. */
#ifndef SPLATGUARD_PATH_H
#define SPLATGUARD_PATH_H

#include <stddef.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sg_path_kind {
    /* Once around what the cameras look at, on an ellipse through their middle height, at constant
     * speed, as the videos of Mip-NeRF 360 (Barron et al. 2022). Cameras that look one way are
     * flown past: the ellipse is among them, in the plane across their view. Where cameras look
     * away from each other, so do the frames. The frame after the last would be the first. */
    SG_PATH_ELLIPSE,
    /* From the first camera to the last, through each, on a Catmull-Rom spline. */
    SG_PATH_INTERPOLATE
};

/* Cameras of `frames` frames, with the size, focal lengths and principal point of the first of n
 * cameras. out: frames. Thread safe: it uses the context for messages only. Errors: SG_ERR_USAGE
 * (no cameras or frames, a camera that is none), SG_ERR_INPUT (an ellipse of cameras that are all
 * at one place), SG_ERR_BUDGET. */
SG_API int sg_camera_path(sg_ctx *ctx, enum sg_path_kind kind, const struct sg_camera *cameras,
                          size_t n, size_t frames, struct sg_camera *out);

#ifdef __cplusplus
}
#endif

#endif
