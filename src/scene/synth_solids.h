/* SPDX-License-Identifier: Apache-2.0 */
/* The solids the scene is made of, each in the frame of its object. */
#ifndef SG_SCENE_SYNTH_SOLIDS_H
#define SG_SCENE_SYNTH_SOLIDS_H

#include "scene/synth_vec.h"

enum solid_kind { SOLID_SPHERE, SOLID_CAPSULE, SOLID_BOX, SOLID_CYLINDER, SOLID_TORUS };

struct solid {
    enum solid_kind kind;
    int material;
    struct vec a, b;   /* centre, or the capsule's ends; box: b = half sides, cylinder: b.z = half height */
    double r, rim;     /* radius; rim = rounding of the edges, or the torus' minor radius */
    struct vec middle; /* of the bounding sphere */
    double bound;      /* its radius */
};

struct solid solid_sphere(struct vec centre, double radius, int material);
struct solid solid_capsule(struct vec a, struct vec b, double radius, int material);
struct solid solid_box(struct vec centre, struct vec half, double rounding, int material);
/* Around the z axis. */
struct solid solid_cylinder(struct vec centre, double radius, double half_height, double rounding, int material);
struct solid solid_torus(struct vec centre, double major, double minor, int material);

/* Smallest distance in (0, reach) at which the ray enters the solid, or reach. direction has length 1. */
double solid_hit(const struct solid *s, struct vec origin, struct vec direction, double reach);
struct vec solid_normal(const struct solid *s, struct vec p);

#endif
