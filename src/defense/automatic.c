/* SPDX-License-Identifier: Apache-2.0 */
/* Preset auto: how strong the defense is, from what the photos look like. docs/defense-results.md shows where the
 * numbers come from. */
#include <math.h>

#include "splatguard/audit.h"
#include "splatguard/defense.h"

/* Grey levels a pixel: oscillation from which on a poison gets the whole filter, and that of quiet parts from which on
 * it gets more lambda, up to four times as much. A scene's own texture is in the first but not in the second. */
static const double strong = 2.3, loud = 1.8;

double sg_defense_frequency(double extent)
{
    /* 8 where scenes are as large as synthetic ones are; an extent of 0 is taken for 1, as in training. */
    return fmin(fmax(8 * 5.2 / (extent > 0 ? extent : 1), 1e-9), 1e9);
}

void sg_defense_automatic(const struct sg_audit *audit, double extent, float *shares, struct sg_defense_params *p)
{
    double strength = 0;
    for (size_t i = 0; i < audit->count; i++) {
        const struct sg_audit_features *f = &audit->images[i].features;
        const double suspicion = fmin(fmax((audit->images[i].score - 0.3) / 0.6, 0), 1);
        const double amplitude = (f->osc_down + f->osc_across) / 2 / strong;
        /* Growth follows the energy of the noise: a weak one is not worth the filter's price. */
        strength += suspicion * fmin(amplitude * amplitude, 1);
        shares[i] = (float) (suspicion * fmin(fmax(f->osc_quiet / loud, 1), 4));
    }
    p->lambda = 6;
    p->shares = shares;
    p->rho = -(0.1 + 0.35 * strength / fmax((double) audit->count, 1));
    p->frequency = sg_defense_frequency(extent);
}
