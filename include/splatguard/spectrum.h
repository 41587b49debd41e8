/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_SPECTRUM_H
#define SPLATGUARD_SPECTRUM_H

#include <stdbool.h>
#include <stdint.h>

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SG_SPECTRUM_BINS_MAX 254
#define SG_SPECTRUM_RINGS 64

struct sg_spectrum_params {
    double low, high; /* the band, as parts of the Nyquist frequency (0.5 cycles a pixel). Default
                         0.3 to 0.9. */
    int bins; /* directions over the full circle, even, 2..SG_SPECTRUM_BINS_MAX. Default 36. */
};
#define SG_SPECTRUM_DEFAULTS .low = 0.3, .high = 0.9, .bins = 36
SG_API struct sg_spectrum_params sg_spectrum_params_default(void);

/* What a coefficient counts, and of which planes. */
enum sg_energy { SG_ENERGY_POWER /* |F|^2 */, SG_ENERGY_AMPLITUDE /* |F| */ };
enum sg_channels {
    SG_CHANNELS_SUM /* of the energies of red, green and blue */,
    SG_CHANNELS_LUMA /* of 0.299 R + ... */
};

/* The anisotropy loss: 1 - entropy of the band's energy over the directions, over ln bins. */
struct sg_anisotropy_params {
    struct sg_spectrum_params band;
    enum sg_energy energy;     /* Default SG_ENERGY_POWER. */
    enum sg_channels channels; /* Default SG_CHANNELS_SUM. */
    bool exact_size; /* Transform awkward sides as they are, not continued to the next quick one.
                        Default false. */
};
#define SG_ANISOTROPY_DEFAULTS .band = {SG_SPECTRUM_DEFAULTS}
SG_API struct sg_anisotropy_params sg_anisotropy_params_default(void);

/* Where the energy of an image is: |DFT|^2, summed over the channels, without the constant term. */
struct sg_spectrum {
    int bins;
    double angular[SG_SPECTRUM_BINS_MAX]; /* share of the band's energy by direction: bin b holds
                                             the frequencies with atan2(vertical, horizontal) in
                                             [-pi, pi) + 2 pi [b, b + 1) / bins. Sums to 1, or is 0
                                             everywhere where the band is empty. */
    double entropy; /* of it, over ln bins: 1 = all directions alike. 1 where the band is empty. */
    double anisotropy;                /* 1 - entropy */
    double band_share;                /* of all energy, what lies in the band */
    double radial[SG_SPECTRUM_RINGS]; /* mean energy of a channel's coefficient in ring i,
                                         |frequency| in 0.5 [i, i + 1) / rings cycles a pixel, over
                                         the number of pixels; values in [0, 1]. 0 for a ring
                                         without coefficients, as small images have */
};

/* rgb: height x width x 3. params may be NULL. amplitude: NULL, or height x width floats for ln(1 +
 * |DFT|) of the channels' mean, zero frequency at [height / 2][width / 2]. Errors: SG_ERR_USAGE,
 * SG_ERR_BUDGET. */
SG_API int sg_spectrum_measure(sg_ctx *ctx, const uint8_t *rgb, int width, int height,
                               const struct sg_spectrum_params *params, struct sg_spectrum *out,
                               float *amplitude);

#ifdef __cplusplus
}
#endif

#endif
