/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_CAMERA_H
#define SPLATGUARD_CAMERA_H

#define SG_SIDE_MAX 16384 /* pixels, of every image */

/* A pinhole camera. World to camera: x_c = R x_w + t, with axes x right, y down, z forward. Focal
 * lengths and principal point are in pixels. The top-left corner of the image is (0, 0), so the
 * centre of the top-left pixel is (0.5, 0.5), as in COLMAP. */
struct sg_camera {
    int width, height; /* pixels, 1..SG_SIDE_MAX */
    double fx, fy;     /* 1e-6..1e7 */
    double cx, cy;     /* -1e7..1e7; width/2, height/2 when centred */
    double R[9];       /* row-major rotation, to within 0.05 */
    double t[3];       /* -1e12..1e12 */
};

#endif
