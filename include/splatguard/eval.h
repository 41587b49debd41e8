/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_EVAL_H
#define SPLATGUARD_EVAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "context.h"
#include "render.h"
#include "scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* PSNR in dB of one mean squared error over width x height x 3 bytes; sides of at least 1. Equal
 * images have +inf, which reports show as 100. */
SG_API double sg_psnr_u8(const uint8_t *a, const uint8_t *b, int width, int height);

/* SSIM (Wang et al. 2004): 11-tap Gaussian window, sigma 1.5, zero padding, mean over channels and
 * pixels. a, b: height x width x 3 bytes; sides of at least 1. ctx provides the scratch memory.
 * Errors: SG_ERR_BUDGET. */
SG_API int sg_ssim_u8(sg_ctx *ctx, const uint8_t *a, const uint8_t *b, int width, int height,
                      double *out);

/* Clamps a planar float render to [0, 1] and rounds it to 8 bits, as PNG files would. planar: 3
 * planes of height x width; rgb: height x width x 3. */
SG_API void sg_quantise(const float *planar, int width, int height, uint8_t *rgb);

struct sg_view_score {
    double psnr, ssim;                     /* NAN if the mask leaves no pixel */
    double corrected_psnr, corrected_ssim; /* with match_colours or exposures, else 0 */
};

struct sg_eval {
    size_t views;
    double psnr, ssim;                     /* means over the views that have a used pixel */
    double corrected_psnr, corrected_ssim; /* likewise */
    double fps, fps_mean;           /* from the median and the mean frame time; 0 unless timed */
    struct sg_view_score *per_view; /* views entries; owned by the eval: sg_eval_clear */
};

/* How views are compared. Start from zeros. */
struct sg_eval_params {
    bool fps; /* also renders all views 3 times after 10 warm-up frames */
    /* Also compares after matching the colours of each render to its photo's, for photos whose
     * exposure is not known: the least-squares fit of each channel of the render by a x photo + b
     * is undone. */
    bool match_colours;
    /* n numbers, or NULL: the training photo that each view shows. SIZE_MAX: none. */
    const size_t *photos;
    /* Each render has the appearance of its photo, see sg_renderer_set_photo. With `photos`. */
    bool appearances;
    /* The exposures of the training photos, as from sg_trainer_exposures, or NULL: also compares
     * after the map of each view's photo has been applied to its render. With `photos`, of which
     * none is SIZE_MAX, and without match_colours. */
    const float *exposures;
};

/* Renders n views and compares them with their photos, in the smallest rectangle that holds the
 * used pixels of the mask. Masked pixels in it do not count for PSNR, and count as equal for SSIM.
 * params may be NULL. After an error *out is empty. Errors: SG_ERR_USAGE; SG_ERR_INPUT if there is
 * no view or no used pixel; SG_ERR_BUDGET. */
SG_API int sg_evaluate(sg_ctx *ctx, sg_renderer *renderer, const struct sg_view *views, size_t n,
                       const struct sg_eval_params *params, struct sg_eval *out);
/* What the corrected values come from: "exposure", "matching", or NULL where there are none. */
SG_API const char *sg_eval_corrected_by(const struct sg_eval_params *params);
SG_API void sg_eval_clear(struct sg_eval *eval);

#ifdef __cplusplus
}
#endif

#endif
