/* SPDX-License-Identifier: Apache-2.0 */
/* Tolerances are measured again during training. The audit estimates the amplitude of a poison from
 * the photos alone. A model that has learned the scene, but not yet the noise, allows a better
 * estimate. */
#include <stdlib.h>

#include "begin.h"
#include "core/compare.h"
#include "defense/residual.h"
#include "scene/photo.h"
#include "schedule.h"
#include "trainer.h"

#define PHOTOS 32 /* most photos that are measured */

/* exposures: of all training views, or NULL. */
static int measure_view(sg_trainer *t, size_t view, const float *exposures, int sh_degree,
                        float *image, struct sg_residual *out)
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
    code = sg_residual_measure(t->ctx, rgb, v->mask, image, v->camera.width, v->camera.height, out);
    sg_view_release(v);
    return code;
}

int sg_trainer_measure_noise(sg_trainer *t, int it, struct sg_noise *out)
{
    size_t tolerated = 0, pixels = 0;
    double levels[PHOTOS], kurtosis[PHOTOS];
    *out = (struct sg_noise){0};
    for (size_t i = 0; i < t->scene->n_train; i++) {
        const struct sg_camera *c = &t->scene->train[i].camera;
        const size_t n = (size_t) c->width * (size_t) c->height;
        tolerated += t->params.tolerances[i] > 0;
        pixels = n > pixels ? n : pixels;
    }
    const size_t wanted = tolerated < PHOTOS ? tolerated : PHOTOS;
    float *image = sg_alloc_raw(t->ctx, SG_MEM_FRAME, pixels, 3 * sizeof(*image));
    const float *exposures = NULL;
    int code = image ? sg_trainer_exposures(t, &exposures) : SG_ERR_BUDGET;
    for (size_t i = 0, rank = 0, taken = 0; taken < wanted && !code; i++) {
        if (!(t->params.tolerances[i] > 0) || rank++ != sg_evenly(tolerated, taken, wanted))
            continue;
        struct sg_residual r;
        taken++;
        code = measure_view(t, i, exposures, sg_active_degree(&t->params, t->start_degree, it),
                            image, &r);
        if (!code && r.blocks) {
            levels[out->photos] = r.level;
            kurtosis[out->photos++] = r.kurtosis;
        }
    }
    sg_free(image);
    if (code == SG_ERR_BUDGET) {
        *out = (struct sg_noise){0};
        sg_log(t->ctx, SG_LOG_WARN,
               "no memory to measure the noise in the photos: the tolerances "
               "of the audit stay");
        sg_clear_error(t->ctx);
        return SG_OK;
    }
    if (!code && out->photos) {
        qsort(levels, out->photos, sizeof(*levels), sg_double_ascending);
        qsort(kurtosis, out->photos, sizeof(*kurtosis), sg_double_ascending);
        out->level = levels[out->photos * 3 / 4] < SG_TOLERANCE_MAX ? levels[out->photos * 3 / 4]
                                                                    : SG_TOLERANCE_MAX;
        out->kurtosis = kurtosis[out->photos / 2];
        t->noise = out->level;
    }
    return code;
}
