/* SPDX-License-Identifier: Apache-2.0 */
/* The synthetic scene: analytic solids with procedural materials, and a ray tracer for it. z is up. */
#ifndef SG_SYNTH_SCENE_H
#define SG_SYNTH_SCENE_H

#include <stdbool.h>
#include <stdint.h>

struct vec {
    double x, y, z;
};

static inline struct vec vec_add(struct vec a, struct vec b)
{
    return (struct vec){a.x + b.x, a.y + b.y, a.z + b.z};
}
static inline struct vec vec_sub(struct vec a, struct vec b)
{
    return (struct vec){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline struct vec vec_scale(struct vec a, double s)
{
    return (struct vec){a.x * s, a.y * s, a.z * s};
}
static inline struct vec vec_mul(struct vec a, struct vec b)
{
    return (struct vec){a.x * b.x, a.y * b.y, a.z * b.z};
}
static inline double vec_dot(struct vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline struct vec vec_cross(struct vec a, struct vec b)
{
    return (struct vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
struct vec vec_unit(struct vec a);

enum solid_kind { SOLID_SPHERE, SOLID_BOX, SOLID_CAPSULE, SOLID_DISC };
enum material {
    MATERIAL_MATTE,
    MATERIAL_GLOSSY,
    MATERIAL_WOOD,
    MATERIAL_MARBLE,
    MATERIAL_CHECKER,
    MATERIAL_METAL,
    MATERIAL_PLAQUE,
    MATERIAL_GRADIENT
};

/* A sphere (a, r), a box (centre a, half sides b, turned by `turn` about z), a capsule (a to b, radius r) or an upright
 * cylinder (centre a, radius r, half height b.z). */
struct solid {
    enum solid_kind kind;
    enum material material;
    struct vec a, b;
    double r, turn;
    struct vec colour;
    struct vec centre; /* of the bounding sphere */
    double bound;      /* its radius, squared */
};

#define SYNTH_MAX_SOLIDS 96

struct synth_scene {
    struct solid solids[SYNTH_MAX_SOLIDS];
    int count;
};

struct hit {
    double t;
    const struct solid *solid;
    struct vec point, normal;
    struct vec local; /* in the solid's own frame, for textures */
};

void synth_scene_build(struct synth_scene *s, uint64_t seed);

/* Nearest hit beyond t = 0; false if there is none. direction has unit length. */
bool synth_trace(const struct synth_scene *s, struct vec origin, struct vec direction, struct hit *hit);

/* Linear colour, 0..1 and a little above in highlights. jitter: two numbers in [0, 1) that place the light sample. */
struct vec synth_shade(const struct synth_scene *s, struct vec direction, const struct hit *hit,
                       const double jitter[2]);

/* Surface colour of a material at a point of its solid. */
struct vec synth_albedo(const struct hit *hit);

/* Whether the engraved text covers (u, v): u in [0, 1) along it, v in [0, 1) upwards. */
bool synth_text(double u, double v);

#endif
