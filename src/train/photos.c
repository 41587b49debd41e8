/* SPDX-License-Identifier: Apache-2.0 */
/* The photos that a training compares its renders with: in the engine for the whole run or for one
 * step, as they are or smoothed. */
#include <limits.h>
#include <math.h>

#include "image/smooth.h"
#include "scene/photo.h"
#include "trainer.h"

float sg_trainer_tolerance(const sg_trainer *t, size_t view)
{
    return t->smooths ? 0 : t->tolerances ? t->tolerances[view] : t->params.tolerance;
}

bool sg_trainer_smooths(const sg_trainer *t, size_t view)
{
    return t->smooths && t->tolerances[view] > 0;
}

void sg_trainer_let_go(sg_trainer *t, size_t view)
{
    if (t->smoothed[view])
        sg_free(t->smoothed[view]);
    else
        sg_view_release(&t->scene->train[view]);
    t->smoothed[view] = NULL;
    t->photos[view] = 0;
}

/* The bilateral filter's sigma of colours against noise of this level: its usual 75 for 16 levels,
 * and less than in proportion below, where the filter takes more detail than noise. */
static double sigma_of(double level)
{
    const double x = level / 16;
    return SG_SMOOTH_SIGMA * x * sqrt(fmin(x, 1));
}

/* Smoothed pixels take the place of the photo's, which is released. */
static int smooth(sg_trainer *t, size_t view, const uint8_t **rgb)
{
    const struct sg_view *v = &t->scene->train[view];
    const int w = v->camera.width, h = v->camera.height;
    uint8_t *out = sg_alloc_raw(t->ctx, SG_MEM_IMAGES, (size_t) w * (size_t) h, 3);
    const int code = out ? sg_smooth_bilateral(t->ctx, sigma_of(t->noise), *rgb, v->mask, w, h, out)
                         : SG_ERR_BUDGET;
    if (code) {
        sg_free(out);
        return code;
    }
    sg_view_release(v);
    *rgb = t->smoothed[view] = out;
    return SG_OK;
}

/* Under a limit on memory smoothed pixels are in place of those of the scene, not beside them. */
static void forget(const sg_trainer *t, size_t view)
{
    if (sg_mem_limit(t->ctx))
        sg_photo_forget(&t->scene->train[view]);
}

int sg_trainer_hold_photo(sg_trainer *t, size_t view, bool stays)
{
    const struct sg_view *v = &t->scene->train[view];
    const uint8_t *rgb;
    int code = sg_photo_pixels(t->ctx, v, &rgb);
    if (code)
        return code;
    if (sg_trainer_smooths(t, view))
        code = smooth(t, view, &rgb);
    if (t->smoothed[view] && stays)
        forget(t, view);
    if (!code)
        code = (stays ? sg_engine_photo_add : sg_engine_photo_pass)(
            t->engine, v->camera.width, v->camera.height, rgb, v->mask, &t->photos[view]);
    if (code)
        sg_trainer_let_go(t, view);
    return code;
}

int sg_trainer_smooth(sg_trainer *t)
{
    int code = SG_OK;
    t->smooths = true;
    t->beyond = 1;
    t->settles_from = INT_MAX;
    for (size_t i = 0; i < t->scene->n_train && !code; i++)
        if (t->photos[i] && t->tolerances[i] > 0) {
            code = sg_engine_photo_drop(t->engine, t->photos[i]);
            t->photos[i] = 0;
            if (!code)
                code = sg_trainer_hold_photo(t, i, true);
            sg_view_release(&t->scene->train[i]); /* as it was held before */
            forget(t, i);
        }
    return code;
}
