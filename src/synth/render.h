/* SPDX-License-Identifier: Apache-2.0 */
/* Cameras and pictures of the scene. */
#ifndef SG_SYNTH_RENDER_H
#define SG_SYNTH_RENDER_H

#include <stdbool.h>
#include <stdint.h>

#include "core/context.h"
#include "scene.h"

/* A pinhole; the three axes are unit vectors. */
struct synth_camera {
    struct vec centre, right, up, forward;
    int width, height;
    double focal; /* pixels; the principal point is the middle of the image */
};

struct synth_camera sg_synth_camera_at(struct vec centre, struct vec target, int width, int height,
                                       double angle_x);

/* height x width x 4 bytes: sRGB, straight alpha, 0 where no solid is. samples: per pixel and axis.
 */
int sg_synth_render(sg_ctx *ctx, const struct synth_scene *scene, const struct synth_camera *camera,
                    int samples, uint8_t *rgba);

/* The surface point behind image position (x, y), pixel corners at integers, and its colour seen
 * from there. */
bool sg_synth_pick(const struct synth_scene *scene, const struct synth_camera *camera, double x,
                   double y, struct vec *point, uint8_t rgb[3]);

#endif
