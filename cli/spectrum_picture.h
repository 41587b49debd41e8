/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_SPECTRUM_PICTURE_H
#define CLI_SPECTRUM_PICTURE_H

#include "splatguard/splatguard.h"

#define PICTURE_IMAGES_MAX 6

/* One image to draw: a column of the picture. */
struct picture_image {
    const char *title;
    int width, height;
    const uint8_t *rgb;     /* height x width x 3 */
    const float *amplitude; /* height x width, ln(1 + |DFT|) */
    struct sg_spectrum spectrum;
};

/* A part of an image, in pixels; width 0: none. */
struct picture_crop {
    int x, y, width, height;
};

/* Draws photos, the same crop of all, differences from the first where sizes agree, spectra, and
 * the angular and radial distributions of all. The caller frees *rgb with sg_free. Returns a
 * library error. */
int picture_draw(sg_ctx *ctx, const struct picture_image *images, int n, double gain,
                 const struct picture_crop *crop, uint8_t **rgb, int *width, int *height);

#endif
