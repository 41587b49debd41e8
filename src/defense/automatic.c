/* SPDX-License-Identifier: Apache-2.0 */
/* Preset auto: how strong the defense is, from what the photos look like. docs/design/defense.md
 * shows where the numbers come from. */
#include <math.h>
#include <stdlib.h>

#include "audit_photo.h"
#include "core/compare.h"
#include "splatguard/defense.h"

/* Grey levels a pixel: the oscillation at which a poison gets the full filter; the oscillation of
 * quiet parts, and that at half and a quarter of the size, above which lambda grows, up to four
 * times. The texture of a scene contributes to the first, not to the second, and stays below the
 * third. */
static const double strong = 2.3, loud = 1.8, coarse = 7;
/* The oscillation at half and a quarter of the size of photos that are changed by more than
 * SG_TOLERANCE_MAX, which the audit's amplitudes do not tell: they end there. A bounded poison has
 * a third and a fifth of its bound there at most, and the texture's. */
static const double half_beyond = 18, quarter_beyond = 10;

static double oscillation_of(const struct sg_audit_image *image)
{
    return (image->features.osc_down + image->features.osc_across) / 2;
}

static double suspicion_of(const struct sg_audit_image *image)
{
    return fmin(fmax((image->score - 0.3) / 0.6, 0), 1);
}

/* Photos of one attack share its bound, so the set's estimate supports the photo's own. The error
 * is added, since a tolerance that is too small lets the poison in, while one that is too large
 * costs some detail. */
static float tolerance_of(const struct sg_audit *audit, const struct sg_audit_image *image)
{
    const double most = fmax(image->tau, audit->tau + audit->tau_error);
    return image->tau > 0 ? (float) fmin(most, SG_TOLERANCE_MAX) : 0;
}

void sg_defense_tolerances(const struct sg_audit *audit, float *tolerances)
{
    for (size_t i = 0; i < audit->count; i++)
        tolerances[i] = tolerance_of(audit, &audit->images[i]);
}

/* Whether most photos that are not clean are changed by more than a tolerance can cover. room: for
 * a value of each photo. */
static bool is_beyond(const struct sg_audit *audit, float *room)
{
    size_t n = 0;
    for (size_t i = 0; i < audit->count; i++) {
        const struct sg_audit_features *f = &audit->images[i].features;
        if (audit->images[i].tau > 0)
            room[n++] = (float) fmax(f->half_osc / half_beyond, f->quarter_osc / quarter_beyond);
    }
    qsort(room, n, sizeof(*room), sg_float_descending);
    return n > 0 && room[n / 2] > 1;
}

double sg_defense_frequency(double extent)
{
    /* 8 where scenes are as large as synthetic ones are; an extent of 0 is taken for 1, as in
     * training. */
    return fmin(fmax(8 * 5.2 / (extent > 0 ? extent : 1), 1e-9), 1e9);
}

/* Certain photos form a set of their own, which counts in full where it has one for every twenty
 * votes of all. Its strength is the best mean of the strongest n, so that weaker photos cannot
 * dilute it. parts: the strength of each times its vote, so that one with little content is weak
 * here too. */
static double strength_of_few(float *parts, size_t n, double votes)
{
    double sum = 0, most = 0;
    qsort(parts, n, sizeof(*parts), sg_float_descending);
    for (size_t i = 0; i < n; i++) {
        sum += (double) parts[i];
        most = fmax(most, sum / (double) (i + 1) * fmin(20 * (double) (i + 1) / votes, 1));
    }
    return most;
}

void sg_defense_automatic(const struct sg_audit *audit, double extent, double tolerance,
                          float *view_weights, float *tolerances, struct sg_defense_params *p)
{
    double strength = 0, votes = 0, tolerated = 0;
    size_t certain = 0;
    const bool hopeless = is_beyond(audit, view_weights);
    for (size_t i = 0; i < audit->count; i++) {
        const struct sg_audit_image *image = &audit->images[i];
        const double vote = sg_audit_vote(&image->features);
        const double amplitude = oscillation_of(image) / strong;
        const bool covered = image->tau <= tolerance + image->tau_error;
        /* Growth follows the energy of the noise. Weak noise costs less than the filter does, and
         * tolerated noise causes no growth. */
        tolerances[i] =
            (hopeless && image->tau > 0 && tolerance <= SG_TOLERANCE_MAX) || tolerance == 0 ? 0
            : tolerance < 0 ? tolerance_of(audit, image)
            : covered       ? (float) tolerance
                            : 0;
        const double part =
            tolerances[i] > 0 ? 0 : suspicion_of(image) * fmin(amplitude * amplitude, 1);
        strength += vote * part;
        votes += vote;
        tolerated += tolerances[i] > 0 ? vote : 0;
        if (image->score >= SG_AUDIT_CERTAIN) /* for now their strength */
            view_weights[certain++] = (float) (vote * part);
    }
    strength =
        votes > 0 ? fmax(strength / votes, strength_of_few(view_weights, certain, votes)) : 0;
    p->lambda = 6;
    for (size_t i = 0; i < audit->count; i++) {
        const struct sg_audit_features *f = &audit->images[i].features;
        const double loudness =
            fmax(f->osc_quiet / loud, fmax(f->half_osc, f->quarter_osc) / coarse);
        /* A tolerated photo has a regulariser of its own. */
        const double weight = tolerances[i] > 0 ? 0 : fmin(fmax(loudness, 1), 4);
        view_weights[i] = (float) (suspicion_of(&audit->images[i]) * weight);
    }
    p->view_weights = view_weights;
    const double others = votes > 0 ? 1 - tolerated / votes : 1;
    p->rho = 0 - 0.1 * others - 0.35 * strength; /* tolerated noise causes no growth */
    /* Against a weak poison the filter saves little and costs quality. */
    p->rho_least = 0.05 * strength * strength;
    p->frequency = sg_defense_frequency(extent);
}
