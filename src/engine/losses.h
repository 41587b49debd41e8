/* SPDX-License-Identifier: Apache-2.0 */
/* What a render is compared with, and by which losses. */
#ifndef SG_ENGINE_LOSSES_H
#define SG_ENGINE_LOSSES_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "splatguard/spectrum.h"
#include "splatguard/variation.h"

/* Pixels where the photo's mask is 0 do not count: they are equal to the render and have no
 * gradient. */
struct sg_target {
    uint32_t photo;      /* a handle, or 0 with planes */
    const float *planes; /* host, 3 planes: an image instead of the photo's; or NULL */
    bool ascended;       /* without both: the image that sg_engine_ascend_view has left */
    /* 0, or 1 + the number of the photo's exposure (sg_engine_set_exposures): the photometric loss
     * compares the photo with the exposed render. The other losses are of the render itself. */
    size_t exposure;
};

/* Losses on the render alone: kind, name, and the type of their parameters. Each has a function for
 * engines in host memory, sg_image_loss_NAME (host/image_losses.h), and an oracle, sg_ref_loss_NAME
 * (ref/ref_losses.h). */
#define SG_IMAGE_LOSSES(L)                                                                         \
    /* of its spectrum; the same parameters in all calls */                                        \
    L(ANISOTROPY, anisotropy, struct sg_anisotropy_params)                                         \
    L(TOTAL_VARIATION, total_variation, enum sg_tv_penalty)

enum sg_loss_kind {
    SG_LOSS_PHOTOMETRIC,
#define L(kind, name, type) SG_LOSS_##kind,
    SG_IMAGE_LOSSES(L)
#undef L
        SG_LOSSES
};

/* (1 - lambda) L1 + lambda (1 - SSIM). The target of a value is the nearest to the render within
 * `tolerance` of the photo, for L1 and SSIM alike. It counts as a constant, and a value that is its
 * own target has no gradient. So a change of the photo by at most `tolerance` has no gradient at a
 * model that shows the unchanged photo.
 *
 * low_pass adds low_pass x the mean of the squared differences from the photo itself after a
 * low-pass filter, the window of SSIM. What oscillates in a changed photo is small there. Where the
 * photo is within `tolerance` of black (of white), a darker (brighter) render counts as equal,
 * because a change of the photo can have moved such a value in one direction only. */
struct sg_photometric {
    float lambda_dssim;
    float tolerance; /* 0..1, of the value range; 0: the target is the photo */
    float low_pass;  /* weight */
};

struct sg_photometric_value {
    double l1, ssim; /* means over all values; masked-out pixels count as equal */
    double mse;      /* on unclamped values */
    double total;    /* (1 - lambda) l1 + lambda (1 - ssim), and the low-pass term */
};

struct sg_loss {
    enum sg_loss_kind kind;
    double weight; /* of a photometric loss always 1 */
    union {
        struct sg_photometric photometric;
#define L(kind, name, type) type name;
        SG_IMAGE_LOSSES(L)
#undef L
    };
};

/* Of grey levels; a little more, so that photos exactly that far apart agree however both are
 * rounded. */
static inline float sg_loss_tolerance(float levels)
{
    return levels > 0 ? levels / 255 + 0x1p-20f : 0;
}

/* Equal images have an SSIM of 1, which its sum reaches up to rounding only. */
static inline struct sg_photometric_value sg_photometric_value_of(double l1, double mse,
                                                                  double ssim, float lambda_dssim)
{
    const double s = l1 == 0 ? 1 : ssim, lambda = (double) lambda_dssim;
    return (struct sg_photometric_value){
        .l1 = l1, .ssim = s, .mse = mse, .total = (1 - lambda) * l1 + lambda * (1 - s)};
}

/* In dB; at most 100. */
static inline double sg_photometric_psnr(const struct sg_photometric_value *v)
{
    return -10 * log10(v->mse > 1e-10 ? v->mse : 1e-10);
}

#endif
