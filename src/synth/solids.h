/* SPDX-License-Identifier: Apache-2.0 */
/* The solids the scene is made of, each in the frame of its object. */
#ifndef SG_SYNTH_SOLIDS_H
#define SG_SYNTH_SOLIDS_H

#include <stdbool.h>

#include "vec.h"

enum solid_kind { SOLID_SPHERE, SOLID_CAPSULE, SOLID_BOX, SOLID_CYLINDER, SOLID_TORUS };

struct solid {
    enum solid_kind kind;
    int material;
    struct vec a,
        b; /* centre, or the capsule's ends; box: b = half sides, cylinder: b.z = half height */
    double r, rim;     /* radius; rim = rounding of the edges, or the torus' minor radius */
    struct vec middle; /* of the bounding sphere */
    double bound;      /* its radius */
};

struct solid sg_solid_sphere(struct vec centre, double radius, int material);
struct solid sg_solid_capsule(struct vec a, struct vec b, double radius, int material);
struct solid sg_solid_box(struct vec centre, struct vec half, double rounding, int material);
/* Around the z axis. */
struct solid sg_solid_cylinder(struct vec centre, double radius, double half_height,
                               double rounding, int material);
struct solid sg_solid_torus(struct vec centre, double major, double minor, int material);

void sg_solid_box_around(const struct solid *s, struct vec *low, struct vec *high);

/* Smallest distance in (0, reach) at which the ray enters the solid, or reach. direction has
 * length 1. */
double sg_solid_hit(const struct solid *s, struct vec origin, struct vec direction, double reach);

/* Does the ray meet the bounding sphere before reach? */
static inline bool meets_sphere(struct vec middle, double radius, struct vec origin,
                                struct vec direction, double reach)
{
    const struct vec q = sub(middle, origin);
    const double s = dot(q, direction);
    const struct vec nearest = along(q, direction, -s);
    return dot(nearest, nearest) <= radius * radius && s >= -radius && s - radius <= reach;
}

/* A ray that leaves a convex solid never meets it again. */
static inline bool solid_is_convex(const struct solid *s)
{
    return s->kind != SOLID_TORUS;
}

struct vec sg_solid_normal(const struct solid *s, struct vec p);

#endif
