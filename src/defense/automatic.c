/* SPDX-License-Identifier: Apache-2.0 */
/* Preset auto: how strong the defense is, from what the photos look like. docs/defense-results.md shows where the
 * numbers come from. */
#include <math.h>

#include "audit_photo.h"
#include "splatguard/defense.h"

/* Grey levels a pixel: oscillation from which on a poison gets the whole filter; that of quiet parts, and that at half
 * and a quarter of the size, from which on it gets more lambda, up to four times as much. A scene's own texture has a
 * share in the first, none in the second, and stays below the third. */
static const double strong = 2.3, loud = 1.8, coarse = 7;

double sg_defense_frequency(double extent)
{
    /* 8 where scenes are as large as synthetic ones are; an extent of 0 is taken for 1, as in training. */
    return fmin(fmax(8 * 5.2 / (extent > 0 ? extent : 1), 1e-9), 1e9);
}

void sg_defense_automatic(const struct sg_audit *audit, double extent, float *shares, struct sg_defense_params *p)
{
    double strength = 0, certain_strength = 0;
    size_t judged = 0, certain = 0;
    for (size_t i = 0; i < audit->count; i++) {
        const struct sg_audit_features *f = &audit->images[i].features;
        const double suspicion = fmin(fmax((audit->images[i].score - 0.3) / 0.6, 0), 1);
        const double loudness = fmax(f->osc_quiet / loud, fmax(f->half_osc, f->quarter_osc) / coarse);
        const double amplitude = (f->osc_down + f->osc_across) / 2 / strong;
        /* Growth follows the energy of the noise: a weak one is not worth the filter's price. */
        const double part = suspicion * fmin(amplitude * amplitude, 1);
        strength += part;
        judged += !sg_audit_blank(f);
        if (audit->images[i].score >= SG_AUDIT_CERTAIN)
            certain_strength += part, certain++;
        shares[i] = (float) (suspicion * fmin(fmax(loudness, 1), 4));
    }
    strength /= fmax((double) judged, 1);
    if (certain) /* from a twentieth on they are judged among themselves */
        strength =
            fmax(strength, certain_strength / (double) certain * fmin(20.0 * (double) certain / (double) judged, 1));
    p->lambda = 6;
    p->shares = shares;
    p->rho = -(0.1 + 0.35 * strength);
    p->frequency = sg_defense_frequency(extent);
}
