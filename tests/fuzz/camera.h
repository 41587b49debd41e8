/* SPDX-License-Identifier: Apache-2.0 */
/* A camera for targets that draw. */
#ifndef FUZZ_CAMERA_H
#define FUZZ_CAMERA_H

#include "splatguard/scene.h"

/* Looks at the origin along z, from so far. */
static inline struct sg_camera front_camera(int side, double distance)
{
    return (struct sg_camera){.width = side,
                              .height = side,
                              .fx = side,
                              .fy = side,
                              .cx = side / 2,
                              .cy = side / 2,
                              .R = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                              .t = {0, 0, distance}};
}

#endif
