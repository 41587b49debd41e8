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
#define RAISE 1.5 /* for lossy compression */

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

/* What draws the views of a look. */
struct eye {
    sg_trainer *t;
    int sh_degree;
    float *image;           /* room for the largest render */
    const float *exposures; /* of all training views, or NULL */
};

/* Draws a view as its photo is compared with it. The caller releases the photo. */
static int open_view(const struct eye *e, size_t view, const uint8_t **photo)
{
    sg_trainer *t = e->t;
    const struct sg_view *v = &t->scene->train[view];
    const float level = t->params.white_background;
    struct sg_render_params render = sg_trainer_render(t);
    float *image = e->image;
    for (int ch = 0; ch < 3; ch++)
        render.background[ch] = level;
    render.appearance = (int) view;
    int code = sg_engine_draw(t->engine, &v->camera, e->sh_degree, &render, false);
    if (!code)
        code = sg_engine_read_image(t->engine, image, NULL, NULL);
    const size_t n = (size_t) v->camera.width * (size_t) v->camera.height;
    for (size_t i = 0; i < n && e->exposures && !code; i++) {
        const float colour[3] = {image[i], image[n + i], image[2 * n + i]};
        float shown[3];
        sg_expose(e->exposures + view * SG_EXPOSURE, colour, shown);
        image[i] = shown[0], image[n + i] = shown[1], image[2 * n + i] = shown[2];
    }
    return code ? code : sg_photo_pixels(t->ctx, v, photo);
}

static int bound_of(const struct eye *e, size_t view, const uint8_t *photo, double *out)
{
    const struct sg_view *v = &e->t->scene->train[view];
    return sg_residual_bound(e->t->ctx, photo, v->mask, e->image, v->camera.width, v->camera.height,
                             out);
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

/* What a look has measured. bounds: see sg_residual_bound. */
struct findings {
    struct values levels, kurtosis, bounds;
    struct difference sum;
    size_t photos, lossless;
};

/* The median of the tolerances before all looks, of the photos that had one. */
static int find_given(const sg_trainer *t, double *out)
{
    const size_t n = t->scene->n_train;
    double *given = sg_alloc_raw(t->ctx, SG_MEM_MISC, n, sizeof(*given));
    size_t count = 0;
    if (!given)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n && t->params.tolerances; i++)
        if (t->params.tolerances[i] > 0)
            given[count++] = (double) t->params.tolerances[i];
    qsort(given, count, sizeof(*given), sg_double_ascending);
    *out = count ? given[count / 2] : 0;
    sg_free(given);
    return SG_OK;
}

static bool shows_bound(const struct findings *f)
{
    return f->bounds.count > 0 && 4 * f->bounds.count >= f->photos;
}

/* The tolerance after a look. The first level that is measured stays: later ones fall as the model
 * learns noise, and a tolerance that is a little too small lets the poison in. It is raised by
 * RAISE, at most to what was given, since lossy compression adds to the noise, and most where there
 * is more than in the quietest parts; by less where photos are known to be without.
 *
 * A bound that shows in photos is exact. But a poison could be weaker there, so it counts down to
 * half of what was given, which is the audit's estimate less its error. */
static double level_of(const sg_trainer *t, struct findings *f, double given)
{
    const double measured = quantile(&f->levels, 3),
                 lossy = f->photos ? 1 - (double) f->lossless / (double) f->photos : 1,
                 raised = (1 + (RAISE - 1) * lossy) * measured;
    double level = t->noise > 0 ? t->noise : fmax(measured, fmin(raised, given));
    if (shows_bound(f))
        level = fmax(quantile(&f->bounds, 3), 0.5 * given);
    return fmin(level, SG_TOLERANCE_MAX);
}

static int look_at(const struct eye *e, size_t view, struct findings *f)
{
    const sg_trainer *t = e->t;
    const struct sg_view *v = &t->scene->train[view];
    const uint8_t *photo;
    struct sg_residual r;
    double bound;
    int code = open_view(e, view, &photo);
    if (code)
        return code;
    add_difference(v, photo, e->image, (double) sg_trainer_tolerance(t, view), &f->sum);
    code = sg_residual_measure(t->ctx, photo, v->mask, e->image, v->camera.width, v->camera.height,
                               &r);
    if (!code)
        code = bound_of(e, view, photo, &bound);
    sg_view_release(v);
    if (code)
        return code;
    f->photos++, f->lossless += v->lossless;
    if (r.blocks)
        put(&f->levels, r.level), put(&f->kurtosis, r.kurtosis);
    if (bound > 0)
        put(&f->bounds, bound);
    return SG_OK;
}

/* Photos with a tolerance, at most PHOTOS of them. */
static int look_at_tolerated(const struct eye *e, size_t tolerated, struct findings *f)
{
    const size_t wanted = tolerated < PHOTOS ? tolerated : PHOTOS;
    int code = SG_OK;
    for (size_t i = 0, rank = 0, taken = 0; taken < wanted && !code; i++)
        if (sg_trainer_tolerance(e->t, i) > 0 && rank++ == sg_evenly(tolerated, taken, wanted)) {
            taken++;
            code = look_at(e, i, f);
        }
    return code;
}

/* Photos of one attack show its bound in one way. So where those that the audit doubts show it, the
 * others are looked at too, and get a tolerance if they show about the same. */
static int look_at_others(const struct eye *e, float tolerance, double shown, size_t *added)
{
    sg_trainer *t = e->t;
    int code = SG_OK;
    for (size_t i = 0; i < t->scene->n_train && !code; i++) {
        const uint8_t *photo;
        double bound = 0;
        if (t->tolerances[i] > 0 || (code = open_view(e, i, &photo)))
            continue;
        code = bound_of(e, i, photo, &bound);
        sg_view_release(&t->scene->train[i]);
        if (bound >= 0.5 * shown && bound <= 2 * shown)
            t->tolerances[i] = tolerance, ++*added;
    }
    return code;
}

static int measure(const struct eye *e, size_t tolerated, struct sg_noise *out)
{
    sg_trainer *t = e->t;
    struct findings f = {.levels = {.count = 0}};
    int code = look_at_tolerated(e, tolerated, &f);
    double given = 0;
    if (!code)
        code = find_given(t, &given);
    if (code)
        return code;
    out->compared = f.photos;
    out->photos = f.levels.count, out->bounded = f.bounds.count;
    out->kurtosis = quantile(&f.kurtosis, 2);
    out->level = level_of(t, &f, given);
    out->before = t->noise > 0 && t->tolerances ? t->noise : given;
    out->deciding = shows_bound(&f) ? f.bounds.count : f.levels.count;
    for (size_t i = 0; t->tolerances && out->level > 0 && i < t->scene->n_train; i++)
        if (t->tolerances[i] > 0)
            t->tolerances[i] = (float) out->level;
    const bool first = t->beyond >= 1 && !(t->noise > 0);
    out->smooths = t->tolerances && first && out->level > 0 && !shows_bound(&f) &&
                   f.sum.beyond > (double) t->params.tolerance_smooth * f.sum.all;
    if (out->smooths) /* a filter needs no margin */
        out->level = fmin(quantile(&f.levels, 3), SG_TOLERANCE_MAX);
    if (out->level > 0)
        t->noise = out->level;
    if (t->tolerances && shows_bound(&f))
        code = look_at_others(e, (float) out->level, quantile(&f.bounds, 3), &out->added);
    const double share = (double) (tolerated + out->added) / (double) t->scene->n_train;
    if (f.sum.all > 0 && isfinite(f.sum.all)) /* a broken Gaussian can draw anything */
        t->beyond = out->beyond = 1 - (1 - f.sum.beyond / f.sum.all) * share;
    return code;
}

int sg_trainer_measure_noise(sg_trainer *t, int it, struct sg_noise *out)
{
    size_t tolerated = 0;
    *out = (struct sg_noise){0};
    for (size_t i = 0; i < t->scene->n_train; i++)
        tolerated += sg_trainer_tolerance(t, i) > 0;
    if (!tolerated)
        return SG_OK;
    struct eye e = {.t = t, .sh_degree = sg_active_degree(&t->params, t->start_degree, it)};
    e.image =
        sg_alloc_raw(t->ctx, SG_MEM_FRAME, sg_views_largest(t->scene->train, t->scene->n_train),
                     3 * sizeof(*e.image));
    int code = e.image ? sg_trainer_exposures(t, &e.exposures) : SG_ERR_BUDGET;
    if (!code)
        code = measure(&e, tolerated, out);
    sg_free(e.image);
    if (code == SG_ERR_BUDGET) {
        *out = (struct sg_noise){0};
        sg_log(t->ctx, SG_LOG_WARN,
               "no memory to measure the noise in all photos: not all tolerances follow it");
        sg_clear_error(t->ctx);
        return SG_OK;
    }
    return code;
}
