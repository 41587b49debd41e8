/* SPDX-License-Identifier: Apache-2.0 */
/* One round lamp with soft shadows, ambient occlusion under a sky, Blinn's highlights (1977) and
 * traced reflections with Schlick's Fresnel term (1994). All points use the same directions: no
 * noise, and views agree on shadows. */
#include "light.h"

#include <stdbool.h>

#include "materials.h"

#define PI 3.14159265358979323846
#define GOLDEN_ANGLE 2.39996322972865332
#define OFFSET 1e-3 /* distance from the surface at which rays start */
#define LAMP_RAYS 24
#define SKY_RAYS 32
#define RAYS_MAX 32
#define QUICK_SLACK 1e-5f /* above the rounding of the quick tests */
#define BOUNCES 2

static const struct vec lamp = {2.5, -3.1, 4.6};
static const double lamp_radius = 0.55;
static const struct vec lamp_colour = {3.05, 2.85, 2.50};
static const struct vec sky_colour = {0.66, 0.76, 0.92}, ground_colour = {0.26, 0.22, 0.18};
static const struct vec fill_direction = {-0.72, 0.48, 0.50}, fill_colour = {0.42, 0.46, 0.55};
static const double occlusion_reach = 0.7;

/* Rays that leave one point within a cone: `slope` is the tangent of its half angle. */
struct bundle {
    struct vec origin, axis;
    double slope, length;
    int from; /* solid they leave */
    bool any; /* any hit ends the ray: reach becomes 0 */
    int n;
    struct vec direction[RAYS_MAX];
    double reach[RAYS_MAX]; /* shrinks to the first hit */
};

/* Directions for the quick test that most rays fail: single precision and by component, for the
 * compiler's vectors. */
struct fan {
    float x[RAYS_MAX], y[RAYS_MAX], z[RAYS_MAX];
    int near[RAYS_MAX]; /* result: may the ray hit? */
    int ray[RAYS_MAX];  /* number in the bundle */
    int n;
};

static bool touches(const struct bundle *b, struct vec origin, struct vec axis, struct vec centre,
                    double radius)
{
    const struct vec q = sub(centre, origin);
    const double s = dot(q, axis), q2 = dot(q, q);
    if (s < -radius || q2 > (b->length + radius) * (b->length + radius))
        return false;
    return sqrt(larger(q2 - s * s, 0)) <= b->slope * s + radius * sqrt(1 + b->slope * b->slope);
}

static void near_sphere(struct fan *f, struct vec q, double radius)
{
    const float x = (float) q.x, y = (float) q.y, z = (float) q.z, back = (float) -radius;
    const float limit = (float) (dot(q, q) - radius * radius) - QUICK_SLACK;
    for (int i = 0; i < f->n; i++) {
        const float s = f->x[i] * x + f->y[i] * y + f->z[i] * z;
        f->near[i] = (s * s >= limit) & (s >= back);
    }
}

/* Against the endless cylinder around a capsule: its ends lie in it. q: from the ray's origin to
 * the capsule's a. */
static void near_capsule(struct fan *f, struct vec q, struct vec axis, double radius)
{
    const float x = (float) axis.x, y = (float) axis.y, z = (float) axis.z;
    const float qx = (float) q.x, qy = (float) q.y, qz = (float) q.z;
    const float aa = (float) dot(axis, axis), aq = (float) dot(axis, q);
    const float c =
        (float) (dot(axis, axis) * (dot(q, q) - radius * radius) - dot(axis, q) * dot(axis, q));
    for (int i = 0; i < f->n; i++) {
        const float ad = f->x[i] * x + f->y[i] * y + f->z[i] * z,
                    dq = f->x[i] * qx + f->y[i] * qy + f->z[i] * qz;
        const float a = aa - ad * ad, b = aa * dq - aq * ad;
        f->near[i] = b * b - a * c >= -QUICK_SLACK;
    }
}

static void turn_fan(const struct synth_object *o, const struct bundle *b, struct vec origin,
                     const struct fan *world, struct fan *local)
{
    local->n = 0;
    for (int i = 0; i < world->n; i++) {
        if (!world->near[i] || b->reach[i] <= 0)
            continue;
        const struct vec d = to_local_direction(o, b->direction[i]);
        if (!meets_box(o, origin, d, b->reach[i]))
            continue;
        local->x[local->n] = (float) d.x;
        local->y[local->n] = (float) d.y;
        local->z[local->n] = (float) d.z;
        local->ray[local->n++] = i;
    }
}

static void cast_at_object(const struct synth_scene *scene, const struct synth_object *o,
                           struct bundle *b, const struct fan *world)
{
    const struct vec origin = to_local(o, b->origin), axis = to_local_direction(o, b->axis);
    struct fan f;
    turn_fan(o, b, origin, world, &f);
    for (int k = o->first; k < o->first + o->count && f.n; k++) {
        const struct solid *s = &scene->solids[k];
        if ((k == b->from && solid_is_convex(s)) || !touches(b, origin, axis, s->middle, s->bound))
            continue;
        if (s->kind == SOLID_CAPSULE)
            near_capsule(&f, sub(s->a, origin), sub(s->b, s->a), s->r);
        else
            near_sphere(&f, sub(s->middle, origin), s->bound);
        for (int i = 0; i < f.n; i++) {
            double *reach = &b->reach[f.ray[i]];
            if (!f.near[i] || *reach <= 0)
                continue;
            const double t =
                sg_solid_hit(s, origin, to_local_direction(o, b->direction[f.ray[i]]), *reach);
            if (t < *reach)
                *reach = b->any ? 0 : t;
        }
    }
}

static void cast(const struct synth_scene *scene, struct bundle *b)
{
    struct fan world = {.n = b->n};
    for (int r = 0; r < b->n; r++) {
        world.x[r] = (float) b->direction[r].x;
        world.y[r] = (float) b->direction[r].y;
        world.z[r] = (float) b->direction[r].z;
    }
    for (int i = 0; i < scene->n_objects; i++) {
        const struct synth_object *o = &scene->objects[i];
        if (!touches(b, b->origin, b->axis, o->middle, o->bound))
            continue;
        near_sphere(&world, sub(o->middle, b->origin), o->bound);
        cast_at_object(scene, o, b, &world);
    }
}

/* Vogel's spiral (1979): even on a disc for any count. */
static void spiral(int i, int n, double *x, double *y)
{
    const double r = sqrt((i + 0.5) / n), angle = GOLDEN_ANGLE * i;
    *x = r * cos(angle);
    *y = r * sin(angle);
}

static double lamp_in_sight(const struct synth_scene *scene, const struct synth_hit *hit, int rays)
{
    const struct vec p = hit->p, n = hit->n, to_lamp = sub(lamp, p);
    const double distance = length(to_lamp);
    if (dot(to_lamp, n) < -lamp_radius)
        return 0;
    struct bundle b = {.origin = along(p, n, OFFSET),
                       .axis = scale(to_lamp, 1 / distance),
                       .from = hit->solid,
                       .any = true,
                       .n = rays};
    b.slope = lamp_radius / distance * 1.01;
    b.length = distance + lamp_radius;
    struct vec u, v;
    frame(b.axis, &u, &v);
    for (int i = 0; i < rays; i++) {
        double x, y;
        spiral(i, rays, &x, &y);
        const struct vec q =
            add(to_lamp, add(scale(u, x * lamp_radius), scale(v, y * lamp_radius)));
        b.reach[i] = length(q);
        b.direction[i] = scale(q, 1 / b.reach[i]);
    }
    cast(scene, &b);
    int seen = 0;
    for (int i = 0; i < rays; i++)
        seen += b.reach[i] > 0;
    return (double) seen / rays;
}

/* Occluders count less with distance, and not at all at the end of the reach, because they are lit
 * themselves. */
static double sky_in_sight(const struct synth_scene *scene, const struct synth_hit *hit, int rays)
{
    const struct vec n = hit->n;
    struct bundle b = {.origin = along(hit->p, n, OFFSET),
                       .axis = n,
                       .from = hit->solid,
                       .slope = 1e6,
                       .length = occlusion_reach,
                       .n = rays};
    struct vec u, v;
    frame(n, &u, &v);
    for (int i = 0; i < rays; i++) {
        double x, y;
        spiral(i, rays, &x, &y);
        b.direction[i] = add(add(scale(u, x), scale(v, y)), scale(n, sqrt(1 - x * x - y * y)));
        b.reach[i] = occlusion_reach;
    }
    cast(scene, &b);
    double sum = 0;
    for (int i = 0; i < rays; i++) {
        const double t = b.reach[i] / occlusion_reach;
        sum += t * (2 - t);
    }
    return sum / rays;
}

struct synth_exposure sg_synth_expose(const struct synth_scene *scene, const struct synth_hit *hit)
{
    return (struct synth_exposure){lamp_in_sight(scene, hit, LAMP_RAYS),
                                   sky_in_sight(scene, hit, SKY_RAYS)};
}

/* What a mirror sees where no solid is; `sharp` adds the lamps of the studio. */
static struct vec surroundings(struct vec d, bool sharp)
{
    const double horizon = smooth_step(-0.25, 0.12, d.z);
    struct vec c =
        mix(vec(0.085, 0.075, 0.070),
            mix(vec(0.52, 0.50, 0.47), vec(0.10, 0.18, 0.34), clamp01(d.z * 1.1)), horizon);
    if (!sharp)
        return scale(c, 0.9);
    const double to_lamp = dot(d, normalise(lamp));
    c = along(c, lamp_colour, 1.8 * smooth_step(0.975, 0.985, to_lamp));
    /* a window with a cross, on the other side */
    struct vec u, v;
    const struct vec w = normalise(vec(-0.8, -0.30, 0.52));
    frame(w, &u, &v);
    const double facing = dot(d, w), x = fabs(dot(d, u) / facing), y = fabs(dot(d, v) / facing);
    if (facing > 0)
        c = along(c, vec(1.5, 1.65, 1.9),
                  (1 - smooth_step(0.28, 0.30, larger(x, y))) *
                      smooth_step(0.012, 0.022, smaller(x, y)));
    return c;
}

static struct vec radiance(const struct synth_scene *scene, const struct synth_hit *hit,
                           struct vec sight, struct synth_exposure exposure, int bounces)
{
    const struct solid *solid = &scene->solids[hit->solid];
    const struct surface s =
        sg_synth_surface((enum material) solid->material, hit->local, hit->local_n);
    const struct vec n = hit->n, to_lamp = normalise(sub(lamp, hit->p));
    const double cosine = larger(dot(n, to_lamp), 0) * exposure.key,
                 view = larger(-dot(n, sight), 0);

    /* light that bounces between near surfaces brightens what occludes (Jimenez et al. 2016) */
    const struct vec sky = mix(ground_colour, sky_colour, 0.5 + 0.5 * n.z),
                     closed = scale(s.albedo, 1 - exposure.sky);
    const struct vec open = vec(exposure.sky / (1 - closed.x), exposure.sky / (1 - closed.y),
                                exposure.sky / (1 - closed.z));
    struct vec light = mul(add(sky, scale(fill_colour, larger(dot(n, fill_direction), 0))), open);
    light = along(light, lamp_colour, cosine);
    struct vec sum = mul(scale(light, 0.62), s.albedo);
    if (!(s.specular.x > 0))
        return sum;

    const double f = pow(1 - view, 5);
    const struct vec fresnel =
        add(scale(s.specular, 1 - f), scale(vec(1, 1, 1), f * smaller(4 * s.specular.x, 1)));
    const struct vec half = normalise(sub(to_lamp, sight));
    const double highlight =
        (s.shininess + 8) / (8 * PI) * pow(larger(dot(n, half), 0), s.shininess) * cosine;
    sum = add(sum, mul(scale(lamp_colour, smaller(highlight, 12) * 0.4 * (1 - s.mirror)), fresnel));
    const struct vec mirrored = along(sight, n, 2 * view);
    struct vec seen = scale(surroundings(mirrored, false), exposure.sky);
    if (s.mirror > 0 && bounces > 0) {
        const struct synth_hit next = sg_synth_trace(scene, along(hit->p, n, OFFSET), mirrored);
        struct vec sharp = surroundings(mirrored, true);
        if (next.solid >= 0) {
            const struct synth_exposure there = {lamp_in_sight(scene, &next, 4),
                                                 sky_in_sight(scene, &next, 8)};
            sharp = radiance(scene, &next, mirrored, there, bounces - 1);
        }
        seen = mix(seen, sharp, s.mirror);
    }
    return add(sum, mul(seen, fresnel));
}

/* Narkowicz' fit (2015) of the ACES film curve. */
static double film(double x)
{
    x *= 0.60;
    return clamp01(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14));
}

struct vec sg_synth_shade(const struct synth_scene *scene, const struct synth_hit *hit,
                          struct vec sight, struct synth_exposure exposure)
{
    const struct vec c = radiance(scene, hit, sight, exposure, BOUNCES);
    return vec(film(c.x), film(c.y), film(c.z));
}
