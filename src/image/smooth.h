/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_IMAGE_SMOOTH_H
#define SG_IMAGE_SMOOTH_H

#include <splatguard/scene.h>

#include "core/context.h"

/* rgb, out: height x width x 3, not the same memory. mask: height x width, 0 = unused, NULL = all
 * are used; unused pixels are copied and have no influence. kind: not SG_SMOOTH_OFF. With the
 * Gaussian and the bilateral filter each pixel becomes a weighted mean of its neighbourhood. Values
 * are rounded to nearest; the image is mirrored at its border without repeating the border's
 * pixels. Safe from worker threads. SG_ERR_BUDGET. */
int sg_smooth(sg_ctx *ctx, enum sg_smooth kind, const uint8_t *rgb, const uint8_t *mask, int width,
              int height, uint8_t *out);
/* The bilateral filter for a standard deviation of the sum of differences of the three channels, in
 * grey levels. On all threads; call it on the thread that called the library. */
int sg_smooth_bilateral(sg_ctx *ctx, double sigma, const uint8_t *rgb, const uint8_t *mask,
                        int width, int height, uint8_t *out);
#define SG_SMOOTH_SIGMA 75 /* of SG_SMOOTH_BILATERAL */

/* The wavelet filter. Unused pixels count as the mean of the used ones. */
int sg_smooth_wavelet(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width, int height,
                      uint8_t *out);

/* Index i reflected at the borders of 0..n - 1, without repeating the border's pixel. */
int sg_mirror(int i, int n);

#endif
