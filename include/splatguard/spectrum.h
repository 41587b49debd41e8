/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_SPECTRUM_H
#define SPLATGUARD_SPECTRUM_H

#include <stdbool.h>
#include <stdint.h>

#include "context.h"
#include "picture.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SG_SPECTRUM_BINS_MAX 254
#define SG_SPECTRUM_RINGS 64

struct sg_spectrum_params {
    /* The band, relative to the Nyquist frequency (0.5 cycles per pixel): 0 <= low <= high <= 1.
     * Default 0.3 to 0.9. */
    double low, high;
    int bins; /* directions over the full circle, even, 2..SG_SPECTRUM_BINS_MAX. Default 36. */
};
#define SG_SPECTRUM_DEFAULTS .low = 0.3, .high = 0.9, .bins = 36
SG_API struct sg_spectrum_params sg_spectrum_params_default(void);

/* What a coefficient F of the transform contributes, and from which planes. */
enum sg_energy { SG_ENERGY_POWER /* |F|^2 */, SG_ENERGY_AMPLITUDE /* |F| */ };
enum sg_channels {
    SG_CHANNELS_SUM /* the sum of the energies of red, green and blue */,
    SG_CHANNELS_LUMA /* the energy of 0.299 R + 0.587 G + 0.114 B */
};

/* The anisotropy loss: 1 - H / ln(bins), H the entropy of the band's energy over the directions. */
struct sg_anisotropy_params {
    struct sg_spectrum_params band;
    enum sg_energy energy;     /* Default SG_ENERGY_POWER. */
    enum sg_channels channels; /* Default SG_CHANNELS_SUM. */
    /* Do not continue sides that are slow to transform to the next quick length. Default false. */
    bool exact_size;
};
#define SG_ANISOTROPY_DEFAULTS .band = {SG_SPECTRUM_DEFAULTS}
SG_API struct sg_anisotropy_params sg_anisotropy_params_default(void);

/* The energy of an image by direction and frequency: |DFT|^2, summed over the channels, without the
 * constant term. */
struct sg_spectrum {
    int bins;
    /* Share of the band's energy by direction. Bin b has the frequencies whose angle
     * atan2(vertical, horizontal) is in -pi + 2 pi [b, b + 1) / bins. The shares sum to 1; all are
     * 0 if the band is empty. */
    double angular[SG_SPECTRUM_BINS_MAX];
    double
        entropy; /* of `angular`, divided by ln(bins): 1 = all directions alike, or an empty band */
    double anisotropy; /* 1 - entropy */
    double band_share; /* share of the band in all energy */
    /* Mean energy of a channel's coefficient in ring i, divided by the number of pixels (of values
     * in [0, 1]). Ring i has frequencies of 0.5 [i, i + 1) / SG_SPECTRUM_RINGS cycles per pixel. 0
     * for rings without coefficients, which small images have. */
    double radial[SG_SPECTRUM_RINGS];
};

/* Measures an image. rgb: height x width x 3. params may be NULL. amplitude: NULL, or height x
 * width floats that receive ln(1 + |DFT|) of the mean of the channels, with frequency zero at
 * [height / 2][width / 2]. Errors: SG_ERR_USAGE, also for a side outside 1..SG_SIDE_MAX;
 * SG_ERR_BUDGET. */
SG_API int sg_spectrum_measure(sg_ctx *ctx, const uint8_t *rgb, int width, int height,
                               const struct sg_spectrum_params *params, struct sg_spectrum *out,
                               float *amplitude);

#define SG_SPECTRUM_IMAGES_MAX 6 /* in a picture */

/* One image to draw: a column of the picture. */
struct sg_spectrum_image {
    const char *title;
    struct sg_picture picture;
    float *amplitude; /* height x width, of sg_spectrum_measure */
    struct sg_spectrum spectrum;
};

/* A part of every image, in pixels, and within each; width 0: none. */
struct sg_spectrum_crop {
    int x, y, width, height;
};

/* Draws up to SG_SPECTRUM_IMAGES_MAX photos, the same crop of all, `gain` times the differences
 * from the first where sizes agree, spectra, and the angular and radial distributions of all, into
 * a PNG. Errors: SG_ERR_USAGE for another number of images and a crop that is not within all of
 * them, SG_ERR_INPUT where it cannot be written or another's file is there, SG_ERR_BUDGET. */
SG_API int sg_spectrum_write_picture(sg_ctx *ctx, const char *path,
                                     const struct sg_spectrum_image *images, int n, double gain,
                                     const struct sg_spectrum_crop *crop);

#ifdef __cplusplus
}
#endif

#endif
