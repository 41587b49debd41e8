/* SPDX-License-Identifier: Apache-2.0 */
/* Verdicts on photos and sets, from the measurements of audit_features.c. */
#include "splatguard/audit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "audit_photo.h"
#include "core/context.h"
#include "scene/photo.h"
#include "scene/used.h"

static double logistic(double x)
{
    return 1 / (1 + exp(-x));
}

/* Of a photo, and of a set. */
static double score_of(double ragged, double evidence)
{
    return ragged > SG_AUDIT_RAGGED ? 1 : logistic(evidence);
}

#define SUSPICIOUS 0.6 /* score */
#define POISONED 0.9

static enum sg_audit_verdict verdict_of(double score)
{
    return score >= POISONED     ? SG_AUDIT_POISONED
           : score >= SUSPICIOUS ? SG_AUDIT_SUSPICIOUS
                                 : SG_AUDIT_CLEAN;
}

/* A value of a photo, and its weight. */
struct vote {
    double value, weight;
};

static int by_value(const void *a, const void *b)
{
    const double x = ((const struct vote *) a)->value, y = ((const struct vote *) b)->value;
    return (x > y) - (x < y);
}

/* The quantile of the votes: the value below which this share of them is. */
static double quantile(struct vote *votes, size_t n, double part)
{
    double total = 0, sum = 0;
    qsort(votes, n, sizeof(*votes), by_value);
    for (size_t i = 0; i < n; i++)
        total += votes[i].weight;
    size_t i = 0;
    while (i + 1 < n && (sum += votes[i].weight) <= part * total)
        i++;
    return n ? votes[i].value : 0;
}

/* The mean of the middle three fifths of the votes, which is robust against outliers. */
static double trimmed_mean(struct vote *votes, size_t n)
{
    double total = 0, before = 0, sum = 0;
    qsort(votes, n, sizeof(*votes), by_value);
    for (size_t i = 0; i < n; i++)
        total += votes[i].weight;
    for (size_t i = 0; i < n; i++) {
        const double after = before + votes[i].weight;
        sum += fmax(fmin(after, 0.8 * total) - fmax(before, 0.2 * total), 0) * votes[i].value;
        before = after;
    }
    return sum / (0.6 * total);
}

/* Of a double in each image. Returns how many vote. */
static size_t collect(const struct sg_audit *a, size_t offset, struct vote *votes)
{
    size_t n = 0;
    for (size_t i = 0; i < a->count; i++) {
        votes[n].weight = sg_audit_vote(&a->images[i].features);
        memcpy(&votes[n].value, (const char *) &a->images[i] + offset, sizeof(double));
        n += votes[n].weight > 0;
    }
    return n;
}

static double median_of(const struct sg_audit *a, size_t offset, struct vote *votes)
{
    return quantile(votes, collect(a, offset, votes), 0.5);
}

/* The median of a double in each image that is not clean. */
static double median_of_poisoned(const struct sg_audit *a, size_t offset, struct vote *votes)
{
    size_t n = 0;
    for (size_t i = 0; i < a->count; i++) {
        votes[n].weight = a->images[i].tau > 0 ? sg_audit_vote(&a->images[i].features) : 0;
        memcpy(&votes[n].value, (const char *) &a->images[i] + offset, sizeof(double));
        n += votes[n].weight > 0;
    }
    return quantile(votes, n, 0.5);
}

/* A few poisoned photos among clean ones are an attack too. */
static double score_of_few(const struct sg_audit *a)
{
    size_t certain = 0;
    double all = 0, surely = 0, poisoned = 0;
    for (size_t i = 0; i < a->count; i++) {
        const struct sg_audit_image *image = &a->images[i];
        const double vote = sg_audit_vote(&image->features);
        all += vote;
        poisoned += image->verdict == SG_AUDIT_POISONED ? vote : 0;
        if (vote > 0 && image->score >= SG_AUDIT_CERTAIN)
            surely += vote, certain++;
    }
    if (certain >= 3 && 20 * surely >= all)
        return POISONED;
    return (certain && 100 * surely >= all) || (poisoned > 0 && 10 * poisoned >= all) ? SUSPICIOUS
                                                                                      : 0;
}

/* The verdict follows most of the photos, or their median, which clean photos added by an attacker
 * move less, or a few certain ones. Values of the median photo that no clean set had become
 * reasons. */
static int conclude(sg_ctx *ctx, struct sg_audit *a)
{
#define MEDIAN(field) median_of(a, offsetof(struct sg_audit_image, field), votes)
#define REASON(condition, ...)                                                                     \
    if (condition)                                                                                 \
    a->reasons[a->count_reasons++] = sg_strf(ctx, __VA_ARGS__)
    struct vote *votes = sg_alloc(ctx, SG_MEM_MISC, a->count, sizeof(*votes));
    if (!votes)
        return SG_ERR_BUDGET;
    size_t judged = 0;
    for (size_t i = 0; i < a->count; i++) {
        votes[judged] =
            (struct vote){a->images[i].features.evidence, sg_audit_vote(&a->images[i].features)};
        judged += votes[judged].weight > 0;
    }
    const double middle = judged ? trimmed_mean(votes, judged) : -INFINITY;
    const double median = judged ? quantile(votes, judged, 0.5) : -INFINITY;
    const double quiet = MEDIAN(features.osc_quiet);
    const double ragged = MEDIAN(features.ragged);
    a->score = score_of(ragged, fmax(middle, median - 1));
    a->score = fmax(a->score, score_of_few(a));
    a->verdict = verdict_of(a->score);
    /* Photos of one set have the same kind of error: so the set has that of one photo. */
    if (a->verdict != SG_AUDIT_CLEAN) {
        a->tau = median_of_poisoned(a, offsetof(struct sg_audit_image, tau), votes);
        a->tau_error = median_of_poisoned(a, offsetof(struct sg_audit_image, tau_error), votes);
    }
    const size_t poisoned = a->verdicts[SG_AUDIT_POISONED];
    const double share = MEDIAN(features.osc_share), noisy = MEDIAN(features.noisy);
    const double colour = MEDIAN(features.osc_chroma);
    const double down = MEDIAN(features.osc_down), across = MEDIAN(features.osc_across);
    if (a->verdict == SG_AUDIT_CLEAN)
        goto done;
    REASON(poisoned && 2 * poisoned < judged, "%zu of the %zu photos look poisoned", poisoned,
           judged);
    REASON(ragged > SG_AUDIT_RAGGED,
           "%.0f %% of the pixels that masks leave in lie at their border: such masks outline "
           "nothing, and can hide anything",
           100 * ragged);
    /* 19 of 20 of the clean photos that docs/audit.md names lie below these. */
    REASON(quiet > 3.9,
           "quiet parts of the photos oscillate by %.1f grey levels a pixel; those of most clean "
           "ones by less than 3.9",
           quiet);
    REASON(share > 0.5,
           "pixels that stick out from both neighbours carry %.0f %% of all variation; in most "
           "clean photos less than 50 %%",
           100 * share);
    REASON(colour > 0.65,
           "colours oscillate by %.2f grey levels a pixel; those of most clean photos by less than "
           "0.65",
           colour);
    REASON(
        down > 2 * across + 1 || across > 2 * down + 1,
        "rows oscillate by %.1f grey levels, columns by %.1f; in most clean photos they are alike",
        down, across);
    REASON(noisy > 0.7,
           "in %.0f %% of a photo's area nearly half of all variation sticks out from both "
           "neighbours; in most clean photos in less than 70 %%",
           100 * noisy);
    REASON(!a->count_reasons,
           "taken together, the statistics of texture are like those of poisoned photos; pixels "
           "that stick out carry %.0f %% of all variation, rows oscillate by %.1f grey levels, "
           "columns by %.1f",
           100 * share, down, across);
#undef REASON
#undef MEDIAN
done:
    sg_free(votes);
    for (size_t i = 0; i < a->count_reasons; i++)
        if (!a->reasons[i])
            return SG_ERR_BUDGET;
    return SG_OK;
}

const char *sg_audit_verdict_name(enum sg_audit_verdict verdict)
{
    static const char *const names[SG_AUDIT_VERDICTS] = {"clean", "suspicious", "poisoned",
                                                         "unseen"};
    return verdict >= 0 && verdict < SG_AUDIT_VERDICTS ? names[verdict] : "unknown";
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
    const uint8_t *rgb;
    if ((j->codes[i] = sg_photo_pixels(j->ctx, v, &rgb)))
        return;
    j->codes[i] = sg_audit_features_of(j->ctx, rgb, v->mask, v->camera.width, v->camera.height,
                                       &image->features, NULL);
    sg_view_release(v);
    const bool seen = sg_views_used(v, 1);
    image->score = seen ? score_of(image->features.ragged, image->features.evidence) : 0;
    image->verdict = seen ? verdict_of(image->score) : SG_AUDIT_UNSEEN;
    const bool poisoned =
        image->verdict == SG_AUDIT_SUSPICIOUS || image->verdict == SG_AUDIT_POISONED;
    image->tau = poisoned ? image->features.amplitude : 0;
    image->tau_error = poisoned ? image->features.amplitude_error : 0;
}

/* Smaller sides have too few tiles for the statistics, which were fitted to larger crops. */
#define SIDE_JUDGED 200

static void warn_small_photos(sg_ctx *ctx, const struct sg_scene *scene)
{
    size_t small = 0;
    for (size_t i = 0; i < scene->n_train; i++)
        small += scene->train[i].camera.width < SIDE_JUDGED ||
                 scene->train[i].camera.height < SIDE_JUDGED;
    if (2 * small > scene->n_train)
        sg_log(ctx, SG_LOG_WARN,
               "audit: photos with fewer than %d pixels on a side are too small to be judged well: "
               "clean ones can look poisoned",
               SIDE_JUDGED);
}

int sg_audit_scene(sg_ctx *ctx, const struct sg_scene *scene, struct sg_audit **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    if (!sg_views_used(scene->train, scene->n_train))
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: audit: found no training view with a used pixel: masks leave nothing to look at",
            scene->path);
    warn_small_photos(ctx, scene);
    struct sg_audit *a = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*a));
    int *codes = sg_alloc(ctx, SG_MEM_MISC, scene->n_train, sizeof(*codes));
    if (a)
        a->images = sg_alloc(ctx, SG_MEM_MISC, scene->n_train, sizeof(*a->images));
    int code = a && codes && a->images ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        a->count = scene->n_train;
        code = sg_parallel_stage(ctx, SG_STAGE_AUDIT, a->count, audit_view,
                                 &(struct audit_job){ctx, scene, a, codes});
        if (!code)
            sg_clear_error(ctx); /* of the photos that are measured again */
        for (size_t i = 0; i < a->count && !code; i++) {
            /* Memory was short with all threads at once, or the message of the error is needed. */
            if (codes[i]) {
                sg_clear_error(ctx);
                audit_view(&(struct audit_job){ctx, scene, a, codes}, i, 0);
            }
            code = codes[i];
            a->verdicts[a->images[i].verdict]++;
        }
        code = code ? code : conclude(ctx, a);
    }
    sg_free(codes);
    if (code)
        sg_audit_destroy(&a);
    *out = a;
    return code;
}

void sg_audit_destroy(struct sg_audit **audit)
{
    if (!audit || !*audit)
        return;
    sg_free((*audit)->images);
    for (size_t i = 0; i < (*audit)->count_reasons; i++)
        sg_free((*audit)->reasons[i]);
    sg_free(*audit);
    *audit = NULL;
}
