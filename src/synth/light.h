/* SPDX-License-Identifier: Apache-2.0 */
/* Light on a surface point. */
#ifndef SG_SYNTH_LIGHT_H
#define SG_SYNTH_LIGHT_H

#include "scene.h"

/* The light that other solids let through. It is slow to compute, the same from every direction,
 * and smooth enough to be shared within a pixel. */
struct synth_exposure {
    double key; /* part of the lamp in sight, 0..1 */
    double sky; /* part of the sky in sight, cosine-weighted, 0..1 */
};

struct synth_exposure sg_synth_expose(const struct synth_scene *scene, const struct synth_hit *hit);

/* Linear colour in [0, 1]^3, tone-mapped, that leaves the point against the direction of sight. */
struct vec sg_synth_shade(const struct synth_scene *scene, const struct synth_hit *hit,
                          struct vec sight, struct synth_exposure exposure);

#endif
