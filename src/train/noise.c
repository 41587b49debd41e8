/* SPDX-License-Identifier: Apache-2.0 */
/* Tolerances are looked at again during training. The audit estimates the amplitude of a poison
 * from the photos alone. A model that has learned the scene, but not the noise, allows a better
 * estimate, the better the more it has learned. It also shows how much of what photos and renders
 * differ in the tolerances hide: growth follows what they do not hide. */
#include <math.h>
#include <stdlib.h>

#include "begin.h"
#include "core/compare.h"
#include "defense/residual.h"
#include "scene/photo.h"
#include "schedule.h"
#include "trainer.h"

#define PHOTOS 32 /* most photos that are measured */

/* Sums of absolute differences of photos and renders, in grey levels. */
struct difference {
    double all, beyond; /* beyond: the parts that exceed the tolerance */
};

static void add_difference(const struct sg_view *v, const uint8_t *rgb, const float *image,
                           double tolerance, struct difference *sum)
{
    const size_t n = (size_t) v->camera.width * (size_t) v->camera.height;
    for (size_t i = 0; i < n; i++) {
        if (v->mask && !v->mask[i])
            continue;
        for (size_t c = 0; c < 3; c++) {
            const double d = fabs(255 * (double) image[c * n + i] - (double) rgb[3 * i + c]);
            sum->all += d, sum->beyond += fmax(d - tolerance, 0);
        }
    }
}

/* exposures: of all training views, or NULL. */
static int measure_view(sg_trainer *t, size_t view, const float *exposures, int sh_degree,
                        float *image, struct difference *sum, struct sg_residual *out)
{
    const struct sg_view *v = &t->scene->train[view];
    const float level = t->params.white_background;
    struct sg_render_params render = sg_trainer_render(t);
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = level;
    render.appearance = (int) view;
    int code = sg_engine_draw(t->engine, &v->camera, sh_degree, &render, false);
    if (!code)
        code = sg_engine_read_image(t->engine, image, NULL, NULL);
    const size_t n = (size_t) v->camera.width * (size_t) v->camera.height;
    for (size_t i = 0; i < n && exposures && !code; i++) {
        const float colour[3] = {image[i], image[n + i], image[2 * n + i]};
        float shown[3];
        sg_expose(exposures + view * SG_EXPOSURE, colour, shown);
        image[i] = shown[0], image[n + i] = shown[1], image[2 * n + i] = shown[2];
    }
    const uint8_t *rgb;
    if (code || (code = sg_photo_pixels(t->ctx, v, &rgb)))
        return code;
    add_difference(v, rgb, image, (double) sg_trainer_tolerance(t, view), sum);
    code = sg_residual_measure(t->ctx, rgb, v->mask, image, v->camera.width, v->camera.height, out);
    sg_view_release(v);
    return code;
}

/* The tolerance after a look that has measured `level`; given: the one before all looks. Detail
 * that the model lacks raises the level, noise that it has learned lowers it. So a later look
 * corrects an early one at most down to three quarters of what was given, which is what the audit
 * has found without the error of its estimate. One in few of the photos corrects nothing. */
static double corrected(const sg_trainer *t, const struct sg_noise *look, double level,
                        double given)
{
    if (t->noise > 0)
        level = 4 * look->photos < look->compared ? t->noise
                                                  : fmax(level, fmin(t->noise, 0.75 * given));
    return fmin(level, SG_TOLERANCE_MAX);
}

int sg_trainer_measure_noise(sg_trainer *t, int it, struct sg_noise *out)
{
    size_t tolerated = 0, pixels = 0;
    double levels[PHOTOS], kurtosis[PHOTOS], given[PHOTOS];
    struct difference sum = {0};
    *out = (struct sg_noise){0};
    for (size_t i = 0; i < t->scene->n_train; i++) {
        const struct sg_camera *c = &t->scene->train[i].camera;
        const size_t n = (size_t) c->width * (size_t) c->height;
        tolerated += sg_trainer_tolerance(t, i) > 0;
        pixels = n > pixels ? n : pixels;
    }
    if (!tolerated)
        return SG_OK;
    const size_t wanted = tolerated < PHOTOS ? tolerated : PHOTOS;
    float *image = sg_alloc_raw(t->ctx, SG_MEM_FRAME, pixels, 3 * sizeof(*image));
    const float *exposures = NULL;
    int code = image ? sg_trainer_exposures(t, &exposures) : SG_ERR_BUDGET;
    for (size_t i = 0, rank = 0, taken = 0; taken < wanted && !code; i++) {
        if (!(sg_trainer_tolerance(t, i) > 0) || rank++ != sg_evenly(tolerated, taken, wanted))
            continue;
        struct sg_residual r;
        taken++;
        code = measure_view(t, i, exposures, sg_active_degree(&t->params, t->start_degree, it),
                            image, &sum, &r);
        out->compared += !code;
        if (!code && r.blocks) {
            given[out->photos] = t->params.tolerances ? (double) t->params.tolerances[i] : 0;
            levels[out->photos] = r.level;
            kurtosis[out->photos++] = r.kurtosis;
        }
    }
    sg_free(image);
    if (code == SG_ERR_BUDGET) {
        *out = (struct sg_noise){0};
        sg_log(t->ctx, SG_LOG_WARN,
               "no memory to measure the noise in the photos: the tolerances stay");
        sg_clear_error(t->ctx);
        return SG_OK;
    }
    if (!code && sum.all > 0 && isfinite(sum.all)) /* a broken Gaussian can draw anything */
        t->beyond = out->beyond =
            1 - (1 - sum.beyond / sum.all) * (double) tolerated / (double) t->scene->n_train;
    if (!code && out->photos) {
        qsort(levels, out->photos, sizeof(*levels), sg_double_ascending);
        qsort(kurtosis, out->photos, sizeof(*kurtosis), sg_double_ascending);
        qsort(given, out->photos, sizeof(*given), sg_double_ascending);
        out->level = corrected(t, out, levels[out->photos * 3 / 4], given[out->photos / 2]);
        out->kurtosis = kurtosis[out->photos / 2];
        t->noise = out->level;
    }
    return code;
}
