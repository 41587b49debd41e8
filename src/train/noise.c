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
#include "scene/used.h"
#include "schedule.h"
#include "trainer.h"

#define PHOTOS 32 /* most photos that are measured */
#define RAISE 1.5

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

/* What all views of a look share. */
struct looking {
    sg_trainer *t;
    int sh_degree;
    float *image;           /* room for the largest render */
    const float *exposures; /* of all training views, or NULL */
};

static int measure_view(const struct looking *l, size_t view, struct difference *sum,
                        struct sg_residual *out)
{
    sg_trainer *t = l->t;
    const struct sg_view *v = &t->scene->train[view];
    const float level = t->params.white_background;
    struct sg_render_params render = sg_trainer_render(t);
    float *image = l->image;
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = level;
    render.appearance = (int) view;
    int code = sg_engine_draw(t->engine, &v->camera, l->sh_degree, &render, false);
    if (!code)
        code = sg_engine_read_image(t->engine, image, NULL, NULL);
    const size_t n = (size_t) v->camera.width * (size_t) v->camera.height;
    for (size_t i = 0; i < n && l->exposures && !code; i++) {
        const float colour[3] = {image[i], image[n + i], image[2 * n + i]};
        float shown[3];
        sg_expose(l->exposures + view * SG_EXPOSURE, colour, shown);
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

/* Values of the photos of a look, and how many photos have one. */
struct values {
    double of[PHOTOS];
    size_t count;
};

static void put(struct values *v, double value)
{
    v->of[v->count++] = value;
}

static double quantile(struct values *v, size_t quarters)
{
    qsort(v->of, v->count, sizeof(*v->of), sg_double_ascending);
    return v->count ? v->of[v->count * quarters / 4] : 0;
}

/* What a look has measured. given: the tolerances before all looks; bounds: see sg_residual. */
struct look {
    struct values levels, kurtosis, bounds, given;
    struct difference sum;
};

static bool shows_bound(const struct look *look)
{
    return look->bounds.count > 0 && 4 * look->bounds.count >= look->given.count;
}

/* The tolerance after a look. The first level that is measured stays: later ones fall as the model
 * learns noise, and a tolerance that is a little too small lets the poison in. It is raised by
 * RAISE, at most to what was given, since elsewhere noise exceeds that of the quietest parts.
 *
 * A bound that shows in photos is exact. But a poison could be weaker there, so it counts down to
 * half of what was given, which is the audit's estimate less its error. */
static double corrected(const sg_trainer *t, struct look *look)
{
    const double given = quantile(&look->given, 2), measured = quantile(&look->levels, 3);
    double level = t->noise > 0 ? t->noise : fmax(measured, fmin(RAISE * measured, given));
    if (shows_bound(look))
        level = fmax(quantile(&look->bounds, 3), 0.5 * given);
    return fmin(level, SG_TOLERANCE_MAX);
}

/* Photos with a tolerance, at most PHOTOS of them. */
static int look_at_tolerated(const struct looking *l, size_t tolerated, struct look *look)
{
    sg_trainer *t = l->t;
    const size_t wanted = tolerated < PHOTOS ? tolerated : PHOTOS;
    int code = SG_OK;
    for (size_t i = 0, rank = 0, taken = 0; taken < wanted && !code; i++) {
        if (!(sg_trainer_tolerance(t, i) > 0) || rank++ != sg_evenly(tolerated, taken, wanted))
            continue;
        struct sg_residual r;
        taken++;
        if ((code = measure_view(l, i, &look->sum, &r)))
            break;
        put(&look->given, t->params.tolerances ? (double) t->params.tolerances[i] : 0);
        if (r.blocks)
            put(&look->levels, r.level), put(&look->kurtosis, r.kurtosis);
        if (r.bound > 0)
            put(&look->bounds, r.bound);
    }
    return code;
}

/* Photos of one attack show its bound in one way. So where those that the audit doubts show it, the
 * others are looked at too, and get a tolerance if they do as well. */
static int look_at_others(const struct looking *l, float tolerance, size_t *added)
{
    sg_trainer *t = l->t;
    int code = SG_OK;
    for (size_t i = 0; i < t->scene->n_train && !code; i++) {
        struct difference unused = {0};
        struct sg_residual r;
        if (t->tolerances[i] > 0 || !sg_views_used(&t->scene->train[i], 1))
            continue;
        code = measure_view(l, i, &unused, &r);
        if (!code && r.bound > 0)
            t->tolerances[i] = tolerance, ++*added;
    }
    return code;
}

static int measure(const struct looking *l, size_t tolerated, struct sg_noise *out)
{
    sg_trainer *t = l->t;
    struct look look = {.levels = {.count = 0}};
    int code = look_at_tolerated(l, tolerated, &look);
    if (code)
        return code;
    out->compared = look.given.count;
    out->photos = look.levels.count, out->bounded = look.bounds.count;
    out->kurtosis = quantile(&look.kurtosis, 2);
    out->level = corrected(t, &look);
    for (size_t i = 0; t->tolerances && out->level > 0 && i < t->scene->n_train; i++)
        if (t->tolerances[i] > 0)
            t->tolerances[i] = (float) out->level;
    if (out->level > 0)
        t->noise = out->level;
    if (t->tolerances && shows_bound(&look))
        code = look_at_others(l, (float) out->level, &out->added);
    const double share = (double) (tolerated + out->added) / (double) t->scene->n_train;
    if (look.sum.all > 0 && isfinite(look.sum.all)) /* a broken Gaussian can draw anything */
        t->beyond = out->beyond = 1 - (1 - look.sum.beyond / look.sum.all) * share;
    return code;
}

int sg_trainer_measure_noise(sg_trainer *t, int it, struct sg_noise *out)
{
    size_t tolerated = 0, pixels = 0;
    *out = (struct sg_noise){0};
    for (size_t i = 0; i < t->scene->n_train; i++) {
        const struct sg_camera *c = &t->scene->train[i].camera;
        const size_t n = (size_t) c->width * (size_t) c->height;
        tolerated += sg_trainer_tolerance(t, i) > 0;
        pixels = n > pixels ? n : pixels;
    }
    if (!tolerated)
        return SG_OK;
    struct looking l = {.t = t, .sh_degree = sg_active_degree(&t->params, t->start_degree, it)};
    l.image = sg_alloc_raw(t->ctx, SG_MEM_FRAME, pixels, 3 * sizeof(*l.image));
    int code = l.image ? sg_trainer_exposures(t, &l.exposures) : SG_ERR_BUDGET;
    if (!code)
        code = measure(&l, tolerated, out);
    sg_free(l.image);
    if (code == SG_ERR_BUDGET) {
        *out = (struct sg_noise){0};
        sg_log(t->ctx, SG_LOG_WARN,
               "no memory to measure the noise in all photos: not all tolerances follow it");
        sg_clear_error(t->ctx);
        return SG_OK;
    }
    return code;
}
