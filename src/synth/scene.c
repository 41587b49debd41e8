/* SPDX-License-Identifier: Apache-2.0 */
#include "scene.h"

#include "core/rng.h"
#include "materials.h"

#define TABLE (-0.32) /* height of the table top */
#define PI 3.14159265358979323846

struct builder {
    struct synth_scene *scene;
    uint64_t seed, draw;
};

/* In [-size, size). */
static double jitter(struct builder *b, double size)
{
    return size * (2 * (double) sg_rng_uniform(b->seed, SG_RNG_SYNTH, 0, b->draw++) - 1);
}

static void put(struct builder *b, struct solid solid)
{
    struct synth_scene *s = b->scene;
    s->solids[s->n_solids++] = solid;
    s->objects[s->n_objects - 1].count++;
}

/* Begins an object at (x, y, z above the table), rotated by `turn` around z and tilted back by
 * `lean`. */
static void place(struct builder *b, double x, double y, double z, double turn, double lean)
{
    struct synth_scene *s = b->scene;
    const double c = cos(turn), sn = sin(turn), cl = cos(lean), sl = sin(lean);
    s->objects[s->n_objects++] = (struct synth_object){
        .x = vec(c, sn, 0),
        .y = vec(-sn * cl, c * cl, -sl),
        .z = vec(-sn * sl, c * sl, cl),
        .origin = vec(x, y, TABLE + z),
        .first = s->n_solids,
    };
}

static void place_loosely(struct builder *b, double x, double y, double z, double turn)
{
    const double dx = jitter(b, 0.025), dy = jitter(b, 0.025), dturn = jitter(b, 0.15);
    place(b, x + dx, y + dy, z, turn + dturn, 0);
}

static void table(struct builder *b)
{
    place(b, 0, 0, 0, 0, 0);
    put(b, sg_solid_cylinder(vec(0, 0, -0.05), 1.22, 0.05, 0.025, MATERIAL_FLOOR));
    for (int i = 0; i < 3; i++) {
        const double angle = 2 * PI * i / 3;
        put(b, sg_solid_sphere(vec(0.95 * cos(angle), 0.95 * sin(angle), -0.13), 0.06,
                               MATERIAL_BRASS));
    }
}

static void pedestal(struct builder *b)
{
    place_loosely(b, 0.02, 0.12, 0, 0.35);
    put(b, sg_solid_box(vec(0, 0, 0.035), vec(0.25, 0.25, 0.035), 0.012, MATERIAL_MARBLE));
    put(b, sg_solid_cylinder(vec(0, 0, 0.27), 0.165, 0.22, 0.01, MATERIAL_MARBLE));
    put(b, sg_solid_torus(vec(0, 0, 0.085), 0.165, 0.028, MATERIAL_MARBLE));
    put(b, sg_solid_torus(vec(0, 0, 0.465), 0.165, 0.022, MATERIAL_BRASS));
    put(b, sg_solid_box(vec(0, 0, 0.515), vec(0.23, 0.23, 0.03), 0.012, MATERIAL_MARBLE));
}

/* The edges of an icosahedron standing on one corner, around a lacquered ball. */
static void lattice_ball(struct builder *b)
{
    const double radius = 0.33, wire = 0.0125, z = 1 / sqrt(5), ring = 2 / sqrt(5);
    struct vec corner[12] = {{0, 0, -radius}, {0, 0, radius}};
    for (int i = 0; i < 5; i++) {
        const double low = 2 * PI * i / 5, high = low + PI / 5;
        corner[2 + i] = scale(vec(ring * cos(low), ring * sin(low), -z), radius);
        corner[7 + i] = scale(vec(ring * cos(high), ring * sin(high), z), radius);
    }
    const struct synth_object pedestal_at = b->scene->objects[b->scene->n_objects - 1];
    const double turn = 0.2 + jitter(b, 0.6);
    place(b, pedestal_at.origin.x, pedestal_at.origin.y, 0.545 + radius + wire, turn, 0);
    put(b, sg_solid_sphere(vec(0, 0, 0), 0.165, MATERIAL_LACQUER));
    put(b, sg_solid_capsule(vec(0, 0, -radius), vec(0, 0, -0.16), 0.02, MATERIAL_BRASS));
    const double edge =
        radius * 1.0514622242382672; /* of an icosahedron around which a unit sphere is drawn */
    for (int i = 0; i < 12; i++) {
        put(b, sg_solid_sphere(corner[i], 2 * wire, MATERIAL_BRASS));
        for (int j = i + 1; j < 12; j++)
            if (length(sub(corner[j], corner[i])) < 1.01 * edge)
                put(b, sg_solid_capsule(corner[i], corner[j], wire, MATERIAL_BRASS));
    }
}

static void crate(struct builder *b)
{
    const double h = 0.21;
    place_loosely(b, -0.60, 0.28, 0, 0.45);
    put(b, sg_solid_box(vec(0, 0, h), vec(h, h, h), 0.008, MATERIAL_PLANKS));
    for (int i = 0; i < 4; i++) /* steel corner posts */
        put(b, sg_solid_box(vec(i & 1 ? h : -h, i & 2 ? h : -h, h), vec(0.018, 0.018, h + 0.006),
                            0.008, MATERIAL_STEEL));
    put(b, sg_solid_sphere(vec(0, 0.02, 2 * h + 0.17), 0.17, MATERIAL_MATTE));
    /* the ladder leans on the crate's front, which is -y */
    const struct vec foot = vec(-0.03, -0.44, 0.015), head = vec(-0.03, -0.205, 0.60);
    const struct vec side = vec(0.085, 0, 0);
    put(b, sg_solid_capsule(sub(foot, side), sub(head, side), 0.015, MATERIAL_TIMBER));
    put(b, sg_solid_capsule(add(foot, side), add(head, side), 0.015, MATERIAL_TIMBER));
    for (int i = 1; i < 8; i++) {
        const struct vec p = mix(foot, head, i / 8.0);
        put(b, sg_solid_capsule(sub(p, side), add(p, side), 0.010, MATERIAL_PAINT));
    }
}

/* A spoked wheel on a fork: its axle lies along the object's z; the lean of 90 degrees lays that
 * flat. */
static void wheel(struct builder *b)
{
    const double radius = 0.30, tyre = 0.035;
    const double x = 0.70 + jitter(b, 0.02), y = 0.20 + jitter(b, 0.02),
                 turn = 0.9 + jitter(b, 0.2);
    place(b, x, y, radius + tyre + 0.04, turn, PI / 2);
    put(b, sg_solid_torus(vec(0, 0, 0), radius, tyre, MATERIAL_RUBBER));
    put(b, sg_solid_torus(vec(0, 0, 0), radius - 0.035, 0.016, MATERIAL_CHROME));
    put(b, sg_solid_capsule(vec(0, 0, -0.085), vec(0, 0, 0.085), 0.018, MATERIAL_STEEL));
    put(b, sg_solid_cylinder(vec(0, 0, 0), 0.045, 0.05, 0.012, MATERIAL_LACQUER));
    for (int i = 0; i < 20; i++) { /* alternate flanges, crossed as on a bicycle */
        const double rim = 2 * PI * i / 20, hub = rim + (i & 2 ? 0.9 : -0.9),
                     z = i & 1 ? 0.04 : -0.04;
        put(b, sg_solid_capsule(vec(0.04 * cos(hub), 0.04 * sin(hub), z),
                                vec((radius - 0.04) * cos(rim), (radius - 0.04) * sin(rim), 0),
                                0.007, MATERIAL_STEEL));
    }
    for (int i = -1; i <= 1; i += 2) { /* the stand: down is +y here */
        put(b, sg_solid_capsule(vec(0, 0, 0.08 * i), vec(-0.13, radius + tyre + 0.02, 0.12 * i),
                                0.012, MATERIAL_BRASS));
        put(b, sg_solid_capsule(vec(0, 0, 0.08 * i), vec(0.13, radius + tyre + 0.02, 0.12 * i),
                                0.012, MATERIAL_BRASS));
    }
}

static void plaque(struct builder *b)
{
    const double lean = 0.38, turn = jitter(b, 0.06);
    place(b, 0, -0.80, PLAQUE_HIGH * cos(lean) + 0.012, turn, lean);
    put(b,
        sg_solid_box(vec(0, 0, 0), vec(PLAQUE_WIDE, 0.022, PLAQUE_HIGH), 0.008, MATERIAL_PLAQUE));
    for (int i = -1; i <= 1; i += 2) /* struts behind */
        put(b, sg_solid_capsule(vec(0.34 * i, 0.02, 0.06), vec(0.34 * i, 0.17, -0.075), 0.012,
                                MATERIAL_BRASS));
}

static void chart(struct builder *b)
{
    const double lean = 0.16, turn = PI + jitter(b, 0.1);
    place(b, 0.05, 0.80, 0.06 + CHART_HIGH, turn, lean);
    put(b, sg_solid_box(vec(0, 0, 0), vec(CHART_WIDE, 0.016, CHART_HIGH), 0.006, MATERIAL_CHART));
    for (int i = -1; i <= 1; i += 2) {
        put(b, sg_solid_capsule(vec(0.25 * i, 0, -CHART_HIGH),
                                vec(0.25 * i, -0.045, -CHART_HIGH - 0.06), 0.014, MATERIAL_TIMBER));
        put(b, sg_solid_capsule(vec(0.25 * i, 0.016, 0.12), vec(0.25 * i, 0.20, -CHART_HIGH - 0.08),
                                0.012, MATERIAL_TIMBER));
    }
}

/* Sections between two posts are separate objects, so that their bounds are small. */
static void fence(struct builder *b)
{
    const double radius = 1.12, from = 2.15, step = 0.08;
    const int sections = 4, pickets = 5;
    for (int i = 0; i <= sections * pickets; i++) {
        const double angle = from + step * i, next = angle + step;
        const struct vec up = vec(0, 0, 1), p = vec(radius * cos(angle), radius * sin(angle), 0);
        const struct vec q = vec(radius * cos(next), radius * sin(next), 0);
        const bool post = i % pickets == 0;
        if (post && i < sections * pickets)
            place(b, 0, 0, 0, 0, 0);
        put(b, sg_solid_capsule(along(p, up, 0.01), along(p, up, post ? 0.235 : 0.205),
                                post ? 0.017 : 0.010, MATERIAL_PAINT));
        if (post)
            put(b, sg_solid_sphere(along(p, up, 0.262), 0.024, MATERIAL_BRASS));
        if (i < sections * pickets) {
            put(b,
                sg_solid_capsule(along(p, up, 0.065), along(q, up, 0.065), 0.007, MATERIAL_PAINT));
            put(b,
                sg_solid_capsule(along(p, up, 0.165), along(q, up, 0.165), 0.007, MATERIAL_PAINT));
        }
    }
}

static void small_things(struct builder *b)
{
    place_loosely(b, -0.42, -0.36, 0.185, 0);
    put(b, sg_solid_sphere(vec(0, 0, 0), 0.185, MATERIAL_CHROME));
    place_loosely(b, 0.44, -0.36, 0, 0.3);
    put(b, sg_solid_torus(vec(0, 0, 0.075), 0.165, 0.075, MATERIAL_CERAMIC));
    put(b, sg_solid_sphere(vec(0, 0, 0.135), 0.12, MATERIAL_TERRACOTTA));
    place_loosely(b, 0.88, -0.22, 0, 0.4);
    put(b, sg_solid_cylinder(vec(0, 0, 0.05), 0.075, 0.05, 0.02, MATERIAL_TERRACOTTA));
    put(b, sg_solid_sphere(vec(0, 0, 0.165), 0.065, MATERIAL_LACQUER));
    place_loosely(b, -0.80, -0.30, 0, 0.2);
    put(b, sg_solid_box(vec(0, 0, 0.08), vec(0.08, 0.08, 0.08), 0.02, MATERIAL_CERAMIC));
    put(b, sg_solid_box(vec(0.01, 0, 0.215), vec(0.055, 0.055, 0.055), 0.012, MATERIAL_PAINT));
    put(b, sg_solid_sphere(vec(0.01, 0, 0.315), 0.045, MATERIAL_BRASS));
}

static void bound_objects(struct synth_scene *s)
{
    for (int i = 0; i < s->n_objects; i++) {
        struct synth_object *o = &s->objects[i];
        o->low = vec(HUGE_VAL, HUGE_VAL, HUGE_VAL);
        o->high = scale(o->low, -1);
        for (int k = o->first; k < o->first + o->count; k++) {
            struct vec low, high;
            sg_solid_box_around(&s->solids[k], &low, &high);
            o->low =
                vec(smaller(o->low.x, low.x), smaller(o->low.y, low.y), smaller(o->low.z, low.z));
            o->high = vec(larger(o->high.x, high.x), larger(o->high.y, high.y),
                          larger(o->high.z, high.z));
        }
        const struct vec middle = scale(add(o->low, o->high), 0.5);
        for (int k = o->first; k < o->first + o->count; k++)
            o->bound =
                larger(o->bound, length(sub(s->solids[k].middle, middle)) + s->solids[k].bound);
        o->middle = add(o->origin, to_world_direction(o, middle));
        s->bound = larger(s->bound, length(o->middle) + o->bound);
    }
}

void sg_synth_scene_build(struct synth_scene *scene, uint64_t seed)
{
    struct builder b = {scene, seed, 0};
    *scene = (struct synth_scene){0};
    table(&b);
    pedestal(&b);
    lattice_ball(&b);
    crate(&b);
    wheel(&b);
    plaque(&b);
    chart(&b);
    fence(&b);
    small_things(&b);
    bound_objects(scene);
}

struct synth_hit sg_synth_trace(const struct synth_scene *scene, struct vec origin,
                                struct vec direction)
{
    struct synth_hit hit = {.solid = -1, .t = 1e9};
    const double b = dot(origin, direction), far2 = dot(origin, origin) - b * b;
    if (far2 > scene->bound * scene->bound)
        return hit;
    for (int i = 0; i < scene->n_objects; i++) {
        const struct synth_object *o = &scene->objects[i];
        if (!meets_sphere(o->middle, o->bound, origin, direction, hit.t))
            continue;
        const struct vec lo = to_local(o, origin), ld = to_local_direction(o, direction);
        if (!meets_box(o, lo, ld, hit.t))
            continue;
        for (int k = o->first; k < o->first + o->count; k++) {
            const double t = sg_solid_hit(&scene->solids[k], lo, ld, hit.t);
            if (t < hit.t) {
                hit.t = t;
                hit.object = i;
                hit.solid = k;
                hit.local = along(lo, ld, t);
            }
        }
    }
    if (hit.solid >= 0) {
        hit.local_n = sg_solid_normal(&scene->solids[hit.solid], hit.local);
        hit.n = to_world_direction(&scene->objects[hit.object], hit.local_n);
        hit.p = along(origin, direction, hit.t);
    }
    return hit;
}
