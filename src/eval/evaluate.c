/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "core/compare.h"
#include "core/internal.h"
#include "scene/photo.h"
#include "splatguard/eval.h"

#define WARM_UP 10
#define ROUNDS 3
#define EQUAL_PSNR 100.0 /* reported for identical images, whose PSNR is infinite */

static int time_frames(sg_ctx *ctx, sg_renderer *r, const struct sg_view *views, size_t n,
                       float *rgb, struct sg_eval *out)
{
    double *frames = sg_alloc_raw(ctx, SG_MEM_MISC, ROUNDS * n, sizeof(double)), sum = 0;
    int code = frames ? SG_OK : SG_ERR_BUDGET;
    const size_t total = n + WARM_UP + ROUNDS * n; /* renders, those that were scored too */
    for (size_t i = 0; i < WARM_UP && !code; i++)
        if (!(code = sg_progress(ctx, SG_STAGE_EVALUATE, n + i, total)))
            code = sg_render(r, &views[i % n].camera, rgb, NULL, NULL, NULL);
    for (size_t i = 0; i < ROUNDS * n && !code; i++) {
        if ((code = sg_progress(ctx, SG_STAGE_EVALUATE, n + WARM_UP + i, total)))
            break;
        const double start = sg_seconds();
        code = sg_render(r, &views[i % n].camera, rgb, NULL, NULL, NULL);
        sum += frames[i] = sg_seconds() - start;
    }
    if (!code) {
        qsort(frames, ROUNDS * n, sizeof(double), sg_double_ascending);
        out->fps = 1 / frames[ROUNDS * n / 2];
        out->fps_mean = (double) (ROUNDS * n) / sum;
    }
    sg_free(frames);
    return code;
}

/* Pixels that the mask leaves out are taken from the render, as in the loss; PSNR is then of the
 * others alone. */
static double used_share(const uint8_t *mask, const uint8_t *render, size_t pixels, uint8_t *photo)
{
    size_t used = 0;
    for (size_t i = 0; i < pixels; i++)
        if (mask[i])
            used++;
        else
            memcpy(photo + 3 * i, render + 3 * i, 3);
    return (double) used / (double) pixels;
}

static int score_view(sg_ctx *ctx, const struct sg_view *v, const uint8_t *render, uint8_t *photo,
                      struct sg_view_score *score)
{
    const int w = v->camera.width, h = v->camera.height;
    const size_t pixels = (size_t) w * (size_t) h;
    double share = 1;
    const uint8_t *rgb;
    int code = sg_photo_pixels(ctx, v, &rgb);
    if (code)
        return code;
    memcpy(photo, rgb, 3 * pixels);
    sg_view_release(v);
    if (v->mask)
        share = used_share(v->mask, render, pixels, photo);
    code = sg_ssim_u8(ctx, render, photo, w, h, &score->ssim);
    score->psnr =
        share > 0 ? fmin(sg_psnr_u8(render, photo, w, h) + 10 * log10(share), EQUAL_PSNR) : NAN;
    score->ssim = share > 0 ? score->ssim : NAN;
    return code;
}

int sg_evaluate(sg_ctx *ctx, sg_renderer *r, const struct sg_view *views, size_t n, int time_fps,
                struct sg_eval *out)
{
    sg_clear_error(ctx);
    *out = (struct sg_eval){.views = n};
    if (!n)
        return sg_fail(ctx, SG_ERR_INPUT, "evaluation: found no views, expected at least one");
    size_t pixels = 0;
    double measured = 0;
    for (size_t i = 0; i < n; i++) {
        const size_t p = (size_t) views[i].camera.width * (size_t) views[i].camera.height;
        pixels = p > pixels ? p : pixels;
    }
    int code = SG_ERR_BUDGET;
    float *rgb = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float));
    uint8_t *bytes = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3);
    uint8_t *photo = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3);
    out->per_view = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*out->per_view));
    if (!rgb || !bytes || !photo || !out->per_view)
        goto done;
    for (size_t i = 0; i < n; i++) {
        const struct sg_camera *c = &views[i].camera;
        struct sg_view_score *score = &out->per_view[i];
        const size_t timed = time_fps ? WARM_UP + ROUNDS * n : 0;
        if ((code = sg_progress(ctx, SG_STAGE_EVALUATE, i, n + timed)) ||
            (code = sg_render(r, c, rgb, NULL, NULL, NULL)))
            goto done;
        sg_quantise(rgb, c->width, c->height, bytes);
        if ((code = score_view(ctx, &views[i], bytes, photo, score)))
            goto done;
        if (isnan(score->psnr))
            continue;
        measured++;
        out->psnr += score->psnr, out->ssim += score->ssim;
    }
    if (!(measured > 0)) {
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "evaluation: found no view with a used pixel, expected at least one");
        goto done;
    }
    out->psnr /= measured, out->ssim /= measured;
    if (time_fps)
        code = time_frames(ctx, r, views, n, rgb, out);
done:
    sg_free(rgb);
    sg_free(bytes);
    sg_free(photo);
    if (code)
        sg_eval_clear(out);
    return code;
}

void sg_eval_clear(struct sg_eval *eval)
{
    sg_free(eval->per_view);
    *eval = (struct sg_eval){0};
}
