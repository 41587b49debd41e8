/* SPDX-License-Identifier: Apache-2.0 */
/* The files that make folders of pictures into scenes. */
#ifndef SG_SYNTH_FILES_H
#define SG_SYNTH_FILES_H

#include "render.h"

/* A surface point and where its view sees it: point i belongs to view i mod views. */
struct synth_point {
    struct vec p;
    double x, y;
    uint8_t rgb[3];
};

/* transforms_SPLIT.json with frames ./SPLIT/r_0 ... */
int sg_synth_write_transforms(sg_ctx *ctx, const char *folder, const char *split,
                              const struct synth_camera *cameras, int count, double angle_x);

/* View k of images.bin is cameras[order[k]]; view_of is the inverse for the cameras that have
 * points, the first `views` of them. */
struct synth_colmap {
    const struct synth_camera *cameras;
    const int *order, *view_of;
    int count, views;
    const struct synth_point *points;
    int n_points;
};

#define SYNTH_COLMAP_NAME "view_%04d.png"

/* cameras.bin, images.bin and points3D.bin. */
int sg_synth_write_colmap(sg_ctx *ctx, const char *folder, const struct synth_colmap *model);

#endif
