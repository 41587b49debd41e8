/* SPDX-License-Identifier: Apache-2.0 */
/* The attacks that Poison-splat is compared with: perturbations that do not agree between views. */
#include <math.h>
#include <string.h>

#include "ascent.h"
#include "engine/engine.h"
#include "core/rng.h"
#include "scene/photo.h"
#include "splatguard/eval.h"

static float within(float low, float v, float high)
{
    return fminf(fmaxf(v, low), high);
}

/* A cosine over a photo, in radians. */
struct wave {
    double right, down, phase; /* change a pixel, value at the first pixel */
    float amplitude;
};

/* Direction, sign, and the pixel at which the drift reaches its amplitude are drawn. */
static struct wave draw_wave(const struct sg_attack_params *p, uint64_t index, int width,
                             int height)
{
    float draws[4];
    for (uint64_t k = 0; k < 4; k++)
        draws[k] = sg_rng_uniform(p->seed, SG_RNG_DRIFT, index, k);
    const double turn = 2 * acos(-1), angle = turn * (double) draws[0];
    const double wavelength = p->wavelength > 0 ? (double) p->wavelength
                              : width > height  ? width
                                                : height;
    struct wave wave = {.right = turn / wavelength * cos(angle),
                        .down = turn / wavelength * sin(angle),
                        .amplitude = draws[1] < 0.5f ? -p->epsilon : p->epsilon};
    wave.phase = -wave.right * floor((double) draws[2] * width) -
                 wave.down * floor((double) draws[3] * height);
    return wave;
}

static float wave_at(const struct wave *w, size_t x, size_t y)
{
    return w->amplitude * (float) cos(w->phase + w->right * (double) x + w->down * (double) y);
}

/* From the photo to x, on an engine of its own. */
static int ascend_alone(sg_ctx *ctx, const struct sg_attack_params *p, const struct ascent *a,
                        const float *photo, int w, int h, float *x, float *scratch)
{
    struct sg_engine *engine;
    int code = sg_engine_create(ctx, p->engine, p->cpu, &engine);
    memcpy(x, photo, 3 * (size_t) w * (size_t) h * sizeof(*x));
    if (!code)
        code = sg_ascend(engine, a, photo, w, h, x, scratch);
    sg_engine_destroy(&engine);
    return sg_engine_give_way(ctx, p->engine, p->cpu, code)
               ? ascend_alone(ctx, p, a, photo, w, h, x, scratch)
               : code;
}

/* photo_rgb: of the view. */
static int naive(sg_ctx *ctx, const struct sg_view *view, const uint8_t *photo_rgb, uint64_t index,
                 const struct sg_attack_params *params, enum sg_naive_attack method, uint8_t *rgb)
{
    const struct sg_attack_params p = *params;
    const int w = view->camera.width, h = view->camera.height;
    const size_t n = (size_t) w * (size_t) h;
    int code = SG_OK;
    struct ascent a = {.epsilon = p.epsilon,
                       .step = p.step,
                       .steps = p.inner,
                       .form = p.tv,
                       .spectral_weight = p.spectral_weight};
    float *photo = sg_alloc_raw(ctx, SG_MEM_FRAME, (p.texture > 0 ? 13 : 12) * n, sizeof(float));
    if (!photo)
        return SG_ERR_BUDGET;
    float *x = photo + 3 * n, *scratch = photo + 6 * n;
    float *bound = p.texture > 0 && method != SG_NAIVE_DRIFT ? photo + 12 * n : NULL;
    if (bound && (code = sg_texture_bound(ctx, photo_rgb, w, h, p.epsilon, p.texture, bound)))
        goto done;
    const struct wave wave = draw_wave(&p, index, w, h);
    for (size_t ch = 0; ch < 3; ch++)
        for (size_t i = 0; i < n; i++) {
            const float v = (float) photo_rgb[3 * i + ch] / 255.0f,
                        e = bound ? bound[i] : p.epsilon;
            const float change =
                method == SG_NAIVE_NOISE   ? sg_rng_normal(p.seed, SG_RNG_NOISE, index, ch * n + i)
                : method == SG_NAIVE_DRIFT ? wave_at(&wave, i % (size_t) w, i / (size_t) w)
                                           : 0;
            photo[ch * n + i] = v;
            x[ch * n + i] = within(0, v + within(-e, change, e), 1);
        }
    a.bound = bound, a.extra = photo + 9 * n;
    if (method == SG_NAIVE_TV) { /* the others need no engine */
        if (p.spectral_weight > 0)
            code = sg_anisotropy_create(ctx, w, h, NULL, NULL, &a.spectral);
        if (!code)
            code = ascend_alone(ctx, &p, &a, photo, w, h, x, scratch);
    }
    if (!code)
        sg_quantise(x, w, h, rgb);
done:
    sg_anisotropy_destroy(&a.spectral);
    sg_free(photo);
    return code;
}

int sg_attack_naive(sg_ctx *ctx, const struct sg_view *view, uint64_t index,
                    const struct sg_attack_params *params, enum sg_naive_attack method,
                    uint8_t *rgb)
{
    const struct sg_attack_params p = params ? *params : sg_attack_params_default();
    const uint8_t *photo;
    int code = sg_attack_check(ctx, &p);
    if (code)
        return code;
    if ((unsigned) method > SG_NAIVE_DRIFT)
        return sg_fail(ctx, SG_ERR_USAGE, "method: found %d, expected one of enum sg_naive_attack",
                       (int) method);
    if (!(p.epsilon >= 0 && p.epsilon <= 1))
        return sg_fail(ctx, SG_ERR_USAGE,
                       "epsilon: found %g, expected 0 to 255 grey levels for this method",
                       255 * (double) p.epsilon);
    if ((code = sg_photo_pixels(ctx, view, &photo)))
        return code;
    code = naive(ctx, view, photo, index, &p, method, rgb);
    sg_view_release(view);
    return code;
}
