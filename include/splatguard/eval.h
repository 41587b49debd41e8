/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_EVAL_H
#define SPLATGUARD_EVAL_H

#include <stdint.h>

#include "context.h"
#include "render.h"
#include "scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* PSNR in dB of one mean squared error over width x height x 3 bytes. Equal images have +inf, which
 * reports show as 100. */
SG_API double sg_psnr_u8(const uint8_t *a, const uint8_t *b, int width, int height);

/* SSIM (Wang et al. 2004): 11-tap Gaussian window, sigma 1.5, zero padding, mean over channels and
 * pixels. a, b: height x width x 3 bytes. ctx provides the scratch memory. */
SG_API int sg_ssim_u8(sg_ctx *ctx, const uint8_t *a, const uint8_t *b, int width, int height,
                      double *out);

/* Clamps a planar float render to [0, 1] and rounds it to 8 bits, as PNG files would. planar: 3
 * planes of height x width; rgb: height x width x 3. */
SG_API void sg_quantise(const float *planar, int width, int height, uint8_t *rgb);

struct sg_view_score {
    double psnr, ssim; /* NAN if the mask leaves no pixel */
};

struct sg_eval {
    size_t views;
    double psnr, ssim;              /* means over the views that have a used pixel */
    double fps, fps_mean;           /* from the median and the mean frame time; 0 unless timed */
    struct sg_view_score *per_view; /* views entries; owned by the eval: sg_eval_clear */
};

/* Renders n views and compares them with their photos, without masked pixels. time_fps: also
 * renders all views 3 times after 10 warm-up frames. After an error *out is empty. Errors:
 * SG_ERR_INPUT if there is no view or no used pixel, SG_ERR_BUDGET. */
SG_API int sg_evaluate(sg_ctx *ctx, sg_renderer *renderer, const struct sg_view *views, size_t n,
                       int time_fps, struct sg_eval *out);
SG_API void sg_eval_clear(struct sg_eval *eval);

#ifdef __cplusplus
}
#endif

#endif
