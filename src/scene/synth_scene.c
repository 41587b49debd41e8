/* SPDX-License-Identifier: Apache-2.0 */
#include "synth_scene.h"

#include <math.h>

#include "core/rng.h"

struct vec vec_unit(struct vec a)
{
    return vec_scale(a, 1 / sqrt(vec_dot(a, a)));
}

static struct solid *add(struct synth_scene *s, struct solid solid)
{
    struct vec half = {0};
    switch (solid.kind) {
    case SOLID_SPHERE:
        solid.centre = solid.a, solid.bound = solid.r;
        break;
    case SOLID_BOX:
        solid.centre = solid.a, solid.bound = sqrt(vec_dot(solid.b, solid.b));
        break;
    case SOLID_CAPSULE:
        solid.centre = vec_scale(vec_add(solid.a, solid.b), 0.5);
        half = vec_scale(vec_sub(solid.b, solid.a), 0.5);
        solid.bound = sqrt(vec_dot(half, half)) + solid.r;
        break;
    default:
        solid.centre = solid.a, solid.bound = sqrt(solid.r * solid.r + solid.b.z * solid.b.z);
    }
    solid.bound = solid.bound * solid.bound * 1.0001;
    s->solids[s->count] = solid;
    return &s->solids[s->count++];
}

static void rod(struct synth_scene *s, struct vec a, struct vec b, double r, struct vec colour, enum material m)
{
    add(s, (struct solid){.kind = SOLID_CAPSULE, .material = m, .a = a, .b = b, .r = r, .colour = colour});
}

/* A wire cube with diagonals, balanced on the marble block. */
static void lattice(struct synth_scene *s, struct vec at, double side, double angle)
{
    struct vec corner[8];
    const double c = cos(angle), k = sin(angle);
    for (int i = 0; i < 8; i++) {
        const double x = (i & 1 ? side : -side), y = (i & 2 ? side : -side), z = (i & 4 ? side : -side);
        corner[i] = vec_add(at, (struct vec){c * x - k * y, k * x + c * y, z});
    }
    const struct vec brass = {0.85, 0.62, 0.25}, steel = {0.55, 0.58, 0.62};
    for (int i = 0; i < 8; i++)
        for (int bit = 1; bit < 8; bit <<= 1)
            if (!(i & bit))
                rod(s, corner[i], corner[i | bit], 0.014, brass, MATERIAL_METAL);
    rod(s, corner[0], corner[7], 0.008, steel, MATERIAL_METAL);
    rod(s, corner[1], corner[6], 0.008, steel, MATERIAL_METAL);
    rod(s, corner[2], corner[5], 0.008, steel, MATERIAL_METAL);
    rod(s, corner[3], corner[4], 0.008, steel, MATERIAL_METAL);
}

/* A leaning ladder of thin rungs. */
static void ladder(struct synth_scene *s, struct vec foot, struct vec top, struct vec across)
{
    const struct vec red = {0.75, 0.16, 0.12};
    rod(s, vec_sub(foot, across), vec_sub(top, across), 0.013, red, MATERIAL_MATTE);
    rod(s, vec_add(foot, across), vec_add(top, across), 0.013, red, MATERIAL_MATTE);
    for (int i = 1; i < 9; i++) {
        const struct vec at = vec_add(foot, vec_scale(vec_sub(top, foot), i / 9.0));
        rod(s, vec_sub(at, across), vec_add(at, across), 0.008, red, MATERIAL_MATTE);
    }
}

void synth_scene_build(struct synth_scene *s, uint64_t seed)
{
    s->count = 0;
    /* Seed 0 is the scene of the pictures; others nudge the solids that stand free. */
    double nudge[8];
    for (int i = 0; i < 8; i++)
        nudge[i] = seed ? 0.12 * ((double) sg_rng_uniform(seed, SG_RNG_SYNTH, 1, (uint64_t) i) - 0.5) : 0;

    add(s, (struct solid){.kind = SOLID_DISC,
                          .material = MATERIAL_WOOD,
                          .a = {0, 0, -0.62},
                          .b = {0, 0, 0.06},
                          .r = 1.25,
                          .colour = {0.62, 0.40, 0.22}});
    add(s, (struct solid){.kind = SOLID_DISC,
                          .material = MATERIAL_CHECKER,
                          .a = {0, 0, -0.53},
                          .b = {0, 0, 0.03},
                          .r = 1.08,
                          .colour = {0.82, 0.80, 0.74}});
    add(s, (struct solid){.kind = SOLID_BOX,
                          .material = MATERIAL_MARBLE,
                          .a = {-0.30, 0.33, -0.22},
                          .b = {0.26, 0.26, 0.28},
                          .turn = 0.35 + nudge[0],
                          .colour = {0.90, 0.89, 0.86}});
    lattice(s, (struct vec){-0.30, 0.33, 0.29}, 0.20, 0.35 + nudge[0] + 0.4);
    add(s, (struct solid){.kind = SOLID_SPHERE,
                          .material = MATERIAL_GLOSSY,
                          .a = {-0.30, 0.33, 0.27},
                          .r = 0.10,
                          .colour = {0.90, 0.35, 0.08}});
    add(s, (struct solid){.kind = SOLID_SPHERE,
                          .material = MATERIAL_GLOSSY,
                          .a = {0.48 + nudge[1], 0.20 + nudge[2], -0.20},
                          .r = 0.30,
                          .colour = {0.05, 0.22, 0.42}});
    add(s, (struct solid){.kind = SOLID_SPHERE,
                          .material = MATERIAL_GRADIENT,
                          .a = {-0.62 + nudge[3], -0.30 + nudge[4], -0.31},
                          .r = 0.19,
                          .colour = {0.85, 0.75, 0.35}});
    add(s, (struct solid){.kind = SOLID_BOX,
                          .material = MATERIAL_PLAQUE,
                          .a = {0.10, -0.62, -0.32},
                          .b = {0.52, 0.035, 0.18},
                          .turn = 0.12,
                          .colour = {0.93, 0.91, 0.84}});
    add(s, (struct solid){.kind = SOLID_DISC,
                          .material = MATERIAL_WOOD,
                          .a = {0.30 + nudge[5], 0.72, -0.30},
                          .b = {0, 0, 0.20},
                          .r = 0.15,
                          .colour = {0.45, 0.26, 0.14}});
    add(s, (struct solid){.kind = SOLID_SPHERE,
                          .material = MATERIAL_MATTE,
                          .a = {0.30 + nudge[5], 0.72, 0.04},
                          .r = 0.14,
                          .colour = {0.20, 0.52, 0.24}});
    ladder(s, (struct vec){-0.78, 0.10, -0.50}, (struct vec){-0.52, 0.28, 0.42}, (struct vec){-0.06, 0.087, 0});
    for (int i = 0; i < 12; i++) { /* a picket of thin posts along the rim */
        const double angle = 2.2 + 0.13 * i;
        const struct vec foot = {0.98 * cos(angle + 3.6), 0.98 * sin(angle + 3.6), -0.50};
        rod(s, foot, vec_add(foot, (struct vec){0, 0, 0.26 + 0.05 * (i % 3)}), 0.010, (struct vec){0.92, 0.92, 0.90},
            MATERIAL_MATTE);
    }
}
