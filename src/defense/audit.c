/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/audit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/internal.h"

#define BLOCK 16
#define FAINT 2 /* grey levels: smaller steps are rounding, sensor noise and compression */

/* Sums over one direction. */
struct variation {
    double total, extremes, oscillation;
};

/* The pixel `here` between two neighbours: what it oscillates. */
static int oscillation(int before, int here, int after)
{
    const int a = here - before, b = here - after;
    if ((a < 0) != (b < 0) || abs(a) < FAINT || abs(b) < FAINT)
        return 0;
    return abs(a) < abs(b) ? abs(a) : abs(b);
}

static void add(struct variation *v, int before, int here, int after, float *block)
{
    const int o = oscillation(before, here, after);
    v->total += abs(after - here);
    if (!o)
        return;
    v->oscillation += o;
    v->extremes += abs(here - before) + abs(here - after);
    *block += (float) o;
}

static int ascending(const void *a, const void *b)
{
    const float x = *(const float *) a, y = *(const float *) b;
    return (x > y) - (x < y);
}

static double slope(const struct sg_spectrum *s)
{
    double high = 0, middle = 0;
    int n_high = 0, n_middle = 0;
    for (int i = 0; i < SG_SPECTRUM_RINGS; i++) {
        const double r = (i + 0.5) / SG_SPECTRUM_RINGS;
        if (r > 0.7 && r < 0.95)
            high += s->radial[i], n_high++;
        if (r > 0.35 && r < 0.55)
            middle += s->radial[i], n_middle++;
    }
    return log((high / n_high + 1e-9) / (middle / n_middle + 1e-9));
}

int sg_audit_measure(sg_ctx *ctx, const uint8_t *rgb, int width, int height, struct sg_audit_features *out, float *map)
{
    const size_t w = (size_t) width, h = (size_t) height, across = (w + BLOCK - 1) / BLOCK,
                 blocks = across * ((h + BLOCK - 1) / BLOCK);
    struct sg_spectrum spectrum;
    *out = (struct sg_audit_features){0};
    int code = sg_spectrum_measure(ctx, rgb, width, height, NULL, &spectrum, NULL);
    if (code)
        return code;
    uint8_t *luma = sg_alloc_raw(ctx, SG_MEM_FRAME, w * h, 1);
    float *own = sg_alloc(ctx, SG_MEM_FRAME, blocks, sizeof(*own));
    if (!luma || !own) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    for (size_t i = 0; i < w * h; i++)
        luma[i] = (uint8_t) ((77 * rgb[3 * i] + 150 * rgb[3 * i + 1] + 29 * rgb[3 * i + 2] + 128) >> 8);
    struct variation down = {0}, right = {0};
    for (size_t y = 1; y + 1 < h; y++)
        for (size_t x = 1; x + 1 < w; x++) {
            const uint8_t *p = luma + y * w + x;
            float *block = &own[y / BLOCK * across + x / BLOCK];
            add(&down, p[-(ptrdiff_t) w], p[0], p[w], block);
            add(&right, p[-1], p[0], p[1], block);
        }
    const double inner = width > 2 && height > 2 ? (double) (w - 2) * (double) (h - 2) : 1;
    out->tv_down = down.total / inner, out->tv_across = right.total / inner;
    out->osc_down = down.oscillation / inner, out->osc_across = right.oscillation / inner;
    const double total = 2 * (down.total + right.total);
    out->osc_share = total > 0 ? (down.extremes + right.extremes) / total : 0;
    out->slope = slope(&spectrum);
    out->anisotropy = spectrum.anisotropy;
    double mean = 0;
    for (size_t i = 0; i < blocks; i++) {
        own[i] /= 2 * BLOCK * BLOCK;
        mean += (double) own[i] / (double) blocks;
    }
    if (map)
        memcpy(map, own, blocks * sizeof(*map));
    qsort(own, blocks, sizeof(*own), ascending);
    out->osc_quiet = (double) own[blocks / 4];
    out->evenness = mean > 0 ? (double) own[blocks / 2] / mean : 0;
done:
    sg_free(ctx, luma);
    sg_free(ctx, own);
    return code;
}

static double logistic(double x)
{
    return 1 / (1 + exp(-x));
}

static double score_of(const struct sg_audit_features *f)
{
    return logistic(f->osc_share);
}

static enum sg_audit_verdict verdict_of(double score)
{
    return score >= 0.8 ? SG_AUDIT_POISONED : score >= 0.5 ? SG_AUDIT_SUSPICIOUS : SG_AUDIT_CLEAN;
}

const char *sg_audit_verdict_name(enum sg_audit_verdict verdict)
{
    static const char *const names[] = {"clean", "suspicious", "poisoned"};
    return names[verdict];
}

struct audit_job {
    sg_ctx *ctx;
    const struct sg_scene *scene;
    struct sg_audit *audit;
    int *codes;
};

static void audit_view(void *arg, size_t i, int thread)
{
    (void) thread;
    const struct audit_job *j = arg;
    const struct sg_view *v = &j->scene->train[i];
    struct sg_audit_image *image = &j->audit->images[i];
    image->name = v->name;
    j->codes[i] = sg_audit_measure(j->ctx, v->rgb, v->camera.width, v->camera.height, &image->features, NULL);
    image->score = score_of(&image->features);
    image->verdict = verdict_of(image->score);
}

int sg_audit_scene(sg_ctx *ctx, const struct sg_scene *scene, struct sg_audit **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    struct sg_audit *a = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*a));
    int *codes = sg_alloc(ctx, SG_MEM_MISC, scene->n_train, sizeof(*codes));
    if (a)
        a->images = sg_alloc(ctx, SG_MEM_MISC, scene->n_train, sizeof(*a->images));
    int code = a && codes && a->images ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        a->count = scene->n_train;
        sg_parallel_for(ctx, a->count, audit_view, &(struct audit_job){ctx, scene, a, codes});
        for (size_t i = 0; i < a->count; i++) {
            code = code ? code : codes[i];
            a->verdicts[a->images[i].verdict]++;
            a->score += a->images[i].score / (double) a->count;
        }
        a->verdict = verdict_of(a->score);
    }
    sg_free(ctx, codes);
    if (code)
        sg_audit_destroy(ctx, &a);
    else
        *out = a;
    return code;
}

void sg_audit_destroy(sg_ctx *ctx, struct sg_audit **audit)
{
    if (!audit || !*audit)
        return;
    sg_free(ctx, (*audit)->images);
    sg_free(ctx, *audit);
    *audit = NULL;
}
