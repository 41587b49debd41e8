/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "core/compare.h"
#include "core/context.h"
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
    const size_t total = n + WARM_UP + ROUNDS * n; /* renders, including those of the scores */
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

/* Unused pixels are copied from the render, as in the loss. PSNR is then taken over the used
 * pixels. */
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

/* The pixels that a score compares. */
struct scored {
    const struct sg_view *view;
    uint8_t *photo, *render; /* bytes; the photo's masked pixels are the render's */
    double share;            /* used pixels */
};

static int score(sg_ctx *ctx, const struct scored *s, double *psnr, double *ssim)
{
    const int w = s->view->camera.width, h = s->view->camera.height;
    const int code = sg_ssim_u8(ctx, s->render, s->photo, w, h, ssim);
    *psnr = s->share > 0
                ? fmin(sg_psnr_u8(s->render, s->photo, w, h) + 10 * log10(s->share), EQUAL_PSNR)
                : NAN;
    *ssim = s->share > 0 ? *ssim : NAN;
    return code;
}

/* Undoes, in each channel, the best fit render = a photo + b over the used pixels. A render without
 * such a relation stays as it is. */
static void match_colours(const struct sg_view *v, const uint8_t *photo, float *rgb)
{
    const size_t pixels = (size_t) v->camera.width * (size_t) v->camera.height;
    for (size_t ch = 0; ch < 3; ch++) {
        double n = 0, x = 0, y = 0, xx = 0, xy = 0;
        float *plane = rgb + ch * pixels;
        for (size_t i = 0; i < pixels; i++) {
            if (v->mask && !v->mask[i])
                continue;
            const double p = photo[3 * i + ch] / 255.0, r = fmin(fmax((double) plane[i], 0), 1);
            n++, x += p, y += r, xx += p * p, xy += p * r;
        }
        const double spread = n * xx - x * x, a = (n * xy - x * y) / spread, b = (y - a * x) / n;
        if (!(spread > 1e-8 * n * n) || !(fabs(a) > 1e-8))
            continue;
        for (size_t i = 0; i < pixels; i++)
            plane[i] = (float) ((fmin(fmax((double) plane[i], 0), 1) - b) / a);
    }
}

/* rgb: the render, which is lost. */
static int score_view(sg_ctx *ctx, const struct sg_view *v, float *rgb, uint8_t *render,
                      uint8_t *photo, int what, struct sg_view_score *out)
{
    const int w = v->camera.width, h = v->camera.height;
    const size_t pixels = (size_t) w * (size_t) h;
    struct scored s = {v, photo, render, 1};
    const uint8_t *bytes;
    int code = sg_photo_pixels(ctx, v, &bytes);
    if (code)
        return code;
    memcpy(photo, bytes, 3 * pixels);
    sg_view_release(v);
    sg_quantise(rgb, w, h, render);
    if (what & SG_EVAL_CORRECTED)
        match_colours(v, photo, rgb);
    if (v->mask)
        s.share = used_share(v->mask, render, pixels, photo);
    code = score(ctx, &s, &out->psnr, &out->ssim);
    if (code || !(what & SG_EVAL_CORRECTED))
        return code;
    sg_quantise(rgb, w, h, render);
    if (v->mask)
        used_share(v->mask, render, pixels, photo);
    return score(ctx, &s, &out->corrected_psnr, &out->corrected_ssim);
}

int sg_evaluate(sg_ctx *ctx, sg_renderer *r, const struct sg_view *views, size_t n, int what,
                struct sg_eval *out)
{
    const int time_fps = what & SG_EVAL_FPS;
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
        struct sg_view_score *view = &out->per_view[i];
        const size_t timed = time_fps ? WARM_UP + ROUNDS * n : 0;
        sg_renderer_set_index(r, i);
        if ((code = sg_progress(ctx, SG_STAGE_EVALUATE, i, n + timed)) ||
            (code = sg_render(r, c, rgb, NULL, NULL, NULL)))
            goto done;
        if ((code = score_view(ctx, &views[i], rgb, bytes, photo, what, view)))
            goto done;
        if (isnan(view->psnr))
            continue;
        measured++;
        out->psnr += view->psnr, out->ssim += view->ssim;
        out->corrected_psnr += view->corrected_psnr, out->corrected_ssim += view->corrected_ssim;
    }
    if (!(measured > 0)) {
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "evaluation: found no view with a used pixel, expected at least one");
        goto done;
    }
    out->psnr /= measured, out->ssim /= measured;
    out->corrected_psnr /= measured, out->corrected_ssim /= measured;
    if (time_fps)
        code = time_frames(ctx, r, views, n, rgb, out);
done:
    sg_renderer_set_index(r, SIZE_MAX);
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
