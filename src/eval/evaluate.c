/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "core/compare.h"
#include "core/context.h"
#include "math/exposure.h"
#include "scene/photo.h"
#include "scene/used.h"
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

/* The smallest rectangle that holds the used pixels of a view. */
struct used {
    int x, y, width, height;
    double share; /* of it that is used */
};

static struct used find_used(const struct sg_view *v)
{
    const int w = v->camera.width, h = v->camera.height;
    if (!v->mask)
        return (struct used){0, 0, w, h, 1};
    int x0 = w, x1 = 0, y0 = h, y1 = 0;
    size_t count = 0;
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            if (!v->mask[(size_t) y * (size_t) w + (size_t) x])
                continue;
            count++;
            x0 = x < x0 ? x : x0, x1 = x + 1 > x1 ? x + 1 : x1;
            y0 = y < y0 ? y : y0, y1 = y + 1;
        }
    if (!count)
        return (struct used){0};
    return (struct used){x0, y0, x1 - x0, y1 - y0,
                         (double) count / ((double) (x1 - x0) * (y1 - y0))};
}

/* Compares in the rectangle of the used pixels. Others in it are the render's in both, as in the
 * loss; PSNR is then taken over the used ones. target: room for the photo's part of the rectangle.
 * The render is cut to it in place. */
static int score(sg_ctx *ctx, const struct sg_view *v, const struct used *u, const uint8_t *photo,
                 uint8_t *render, uint8_t *target, double *psnr, double *ssim)
{
    *psnr = *ssim = NAN;
    if (!(u->share > 0))
        return SG_OK;
    const size_t width = (size_t) u->width;
    for (size_t y = 0; y < (size_t) u->height; y++) {
        const size_t from = ((size_t) u->y + y) * (size_t) v->camera.width + (size_t) u->x;
        const uint8_t *mask = v->mask ? v->mask + from : NULL;
        uint8_t *row = render + 3 * y * width, *to = target + 3 * y * width;
        memmove(row, render + 3 * from, 3 * width);
        memcpy(to, photo + 3 * from, 3 * width);
        for (size_t x = 0; mask && x < width; x++)
            if (!mask[x])
                memcpy(to + 3 * x, row + 3 * x, 3);
    }
    *psnr =
        fmin(sg_psnr_u8(render, target, u->width, u->height) + 10 * log10(u->share), EQUAL_PSNR);
    return sg_ssim_u8(ctx, render, target, u->width, u->height, ssim);
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

/* What the map of a photo makes of a render. */
static void expose(const float *exposure, const struct sg_camera *c, float *rgb)
{
    const size_t pixels = (size_t) c->width * (size_t) c->height;
    for (size_t i = 0; i < pixels; i++) {
        const float colour[3] = {rgb[i], rgb[pixels + i], rgb[2 * pixels + i]};
        float shown[3];
        sg_expose(exposure, colour, shown);
        for (size_t ch = 0; ch < 3; ch++)
            rgb[ch * pixels + i] = shown[ch];
    }
}

/* Of the view at an index. rgb: the render, which is lost. render, target: room for its bytes. */
static int score_view(sg_ctx *ctx, const struct sg_view *v, size_t index,
                      const struct sg_eval_params *params, float *rgb, uint8_t *render,
                      uint8_t *target, struct sg_view_score *out)
{
    const int w = v->camera.width, h = v->camera.height;
    const struct used used = find_used(v);
    const uint8_t *photo;
    int code = sg_photo_pixels(ctx, v, &photo);
    if (code)
        return code;
    sg_quantise(rgb, w, h, render);
    code = score(ctx, v, &used, photo, render, target, &out->psnr, &out->ssim);
    if (!code && sg_eval_corrected_by(params)) {
        if (params->exposures)
            expose(params->exposures + params->photos[index] * SG_EXPOSURE, &v->camera, rgb);
        else
            match_colours(v, photo, rgb);
        sg_quantise(rgb, w, h, render);
        code =
            score(ctx, v, &used, photo, render, target, &out->corrected_psnr, &out->corrected_ssim);
    }
    sg_view_release(v);
    return code;
}

static int check(sg_ctx *ctx, const struct sg_view *views, size_t n,
                 const struct sg_eval_params *params)
{
    if (!n)
        return sg_fail(ctx, SG_ERR_INPUT, "evaluation: found no views, expected at least one");
    if (params->exposures && (params->match_colours || !params->photos))
        return sg_fail(ctx, SG_ERR_USAGE, "evaluation: found exposures %s, expected them %s",
                       params->match_colours ? "and match_colours" : "without photos",
                       params->match_colours ? "alone" : "with photos");
    for (size_t i = 0; i < n && params->exposures; i++)
        if (params->photos[i] == SIZE_MAX)
            return sg_fail(
                ctx, SG_ERR_USAGE,
                "evaluation: view %s: found no training photo of it, expected one, whose "
                "exposure is known",
                views[i].name);
    return SG_OK;
}

/* Means over the views with a used pixel. */
static int average(sg_ctx *ctx, struct sg_eval *e)
{
    double measured = 0;
    for (size_t i = 0; i < e->views; i++) {
        const struct sg_view_score *view = &e->per_view[i];
        if (isnan(view->psnr))
            continue;
        measured++;
        e->psnr += view->psnr, e->ssim += view->ssim;
        e->corrected_psnr += view->corrected_psnr, e->corrected_ssim += view->corrected_ssim;
    }
    if (!(measured > 0))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "evaluation: found no view with a used pixel, expected at least one");
    e->psnr /= measured, e->ssim /= measured;
    e->corrected_psnr /= measured, e->corrected_ssim /= measured;
    return SG_OK;
}

int sg_evaluate(sg_ctx *ctx, sg_renderer *r, const struct sg_view *views, size_t n,
                const struct sg_eval_params *params, struct sg_eval *out)
{
    const struct sg_eval_params none = {0};
    params = params ? params : &none;
    sg_clear_error(ctx);
    *out = (struct sg_eval){0};
    int code = check(ctx, views, n, params);
    if (code)
        return code;
    const size_t pixels = sg_views_largest(views, n);
    out->views = n;
    code = SG_ERR_BUDGET;
    float *rgb = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(float));
    uint8_t *bytes = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3);
    uint8_t *target = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3);
    out->per_view = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*out->per_view));
    if (!rgb || !bytes || !target || !out->per_view)
        goto done;
    for (size_t i = 0; i < n; i++) {
        const struct sg_camera *c = &views[i].camera;
        const size_t timed = params->fps ? WARM_UP + ROUNDS * n : 0;
        sg_renderer_set_index(r, i);
        if (params->photos && params->appearances)
            sg_renderer_set_photo(r, params->photos[i]);
        if ((code = sg_progress(ctx, SG_STAGE_EVALUATE, i, n + timed)) ||
            (code = sg_render(r, c, rgb, NULL, NULL, NULL)) ||
            (code = score_view(ctx, &views[i], i, params, rgb, bytes, target, &out->per_view[i])))
            goto done;
    }
    code = average(ctx, out);
    if (!code && params->fps)
        code = time_frames(ctx, r, views, n, rgb, out);
done:
    sg_renderer_set_index(r, SIZE_MAX);
    if (params->photos && params->appearances)
        sg_renderer_set_photo(r, SIZE_MAX);
    sg_free(rgb);
    sg_free(bytes);
    sg_free(target);
    if (code)
        sg_eval_clear(out);
    return code;
}

const char *sg_eval_corrected_by(const struct sg_eval_params *params)
{
    return params->exposures ? "exposure" : params->match_colours ? "matching" : NULL;
}

void sg_eval_clear(struct sg_eval *eval)
{
    sg_free(eval->per_view);
    *eval = (struct sg_eval){0};
}
