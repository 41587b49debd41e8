/* SPDX-License-Identifier: Apache-2.0 */
/* The scene: a still life on a round table, about 2.5 wide and centred on the origin, z up. */
#ifndef SG_SYNTH_SCENE_H
#define SG_SYNTH_SCENE_H

#include <stdbool.h>
#include <stdint.h>

#include "solids.h"

#define SYNTH_SOLIDS_MAX 256
#define SYNTH_OBJECTS_MAX 24

/* A rigid group of solids. */
struct synth_object {
    struct vec x, y, z, origin; /* its axes and origin in the world */
    int first, count;           /* its solids */
    struct vec middle;          /* of the bounding sphere, in the world */
    double bound;
    struct vec low, high; /* bounding box, in its own frame */
};

/* Read-only once built: any thread may trace rays in it. */
struct synth_scene {
    struct solid solids[SYNTH_SOLIDS_MAX];
    struct synth_object objects[SYNTH_OBJECTS_MAX];
    int n_solids, n_objects;
    double bound; /* the scene lies within this distance of the origin */
};

/* The seed moves and turns the objects a little. */
void sg_synth_scene_build(struct synth_scene *scene, uint64_t seed);

static inline struct vec to_local_direction(const struct synth_object *o, struct vec d)
{
    return vec(dot(d, o->x), dot(d, o->y), dot(d, o->z));
}

static inline struct vec to_local(const struct synth_object *o, struct vec p)
{
    return to_local_direction(o, sub(p, o->origin));
}

static inline struct vec to_world_direction(const struct synth_object *o, struct vec d)
{
    return along(along(scale(o->x, d.x), o->y, d.y), o->z, d.z);
}

/* Does a ray in the frame of the object meet its bounding box? */
static inline bool meets_box(const struct synth_object *o, struct vec origin, struct vec direction,
                             double reach)
{
    const struct vec inverse = vec(1 / direction.x, 1 / direction.y, 1 / direction.z);
    const struct vec a = mul(sub(o->low, origin), inverse), b = mul(sub(o->high, origin), inverse);
    const double from =
        larger(larger(smaller(a.x, b.x), smaller(a.y, b.y)), larger(smaller(a.z, b.z), 0));
    const double to =
        smaller(smaller(larger(a.x, b.x), larger(a.y, b.y)), smaller(larger(a.z, b.z), reach));
    return from <= to;
}

struct synth_hit {
    int object, solid; /* solid -1: nothing was hit */
    double t;
    struct vec p, n; /* in the world */
    struct vec local, local_n;
};

struct synth_hit sg_synth_trace(const struct synth_scene *scene, struct vec origin,
                                struct vec direction);

#endif
