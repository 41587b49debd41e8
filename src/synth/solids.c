/* SPDX-License-Identifier: Apache-2.0 */
/* Spheres and capsules are solved in closed form; solids with rounded edges by sphere tracing (Hart
 * 1996) of their exact distance inside their bounding box, which takes one step wherever the ray
 * meets a flat face. */
#include "solids.h"

#define MARCH_STEPS 96
#define MARCH_CLOSE 1e-5
#define GRADIENT_STEP 1e-4

struct solid sg_solid_sphere(struct vec centre, double radius, int material)
{
    return (struct solid){SOLID_SPHERE, material, centre, centre, radius, 0, centre, radius};
}

struct solid sg_solid_capsule(struct vec a, struct vec b, double radius, int material)
{
    return (struct solid){SOLID_CAPSULE,
                          material,
                          a,
                          b,
                          radius,
                          0,
                          scale(add(a, b), 0.5),
                          0.5 * length(sub(b, a)) + radius};
}

struct solid sg_solid_box(struct vec centre, struct vec half, double rounding, int material)
{
    return (struct solid){SOLID_BOX, material, centre, half, 0, rounding, centre, length(half)};
}

struct solid sg_solid_cylinder(struct vec centre, double radius, double half_height,
                               double rounding, int material)
{
    const struct vec half = vec(radius, radius, half_height);
    return (struct solid){SOLID_CYLINDER, material, centre, half,
                          radius,         rounding, centre, hypot(radius, half_height)};
}

struct solid sg_solid_torus(struct vec centre, double major, double minor, int material)
{
    const struct vec half = vec(major + minor, major + minor, minor);
    return (struct solid){SOLID_TORUS, material, centre, half, major, minor, centre, major + minor};
}

void sg_solid_box_around(const struct solid *s, struct vec *low, struct vec *high)
{
    const bool round = s->kind == SOLID_SPHERE || s->kind == SOLID_CAPSULE;
    const struct vec half = round ? vec(s->r, s->r, s->r) : s->b, end = round ? s->b : s->a;
    *low = sub(vec(smaller(s->a.x, end.x), smaller(s->a.y, end.y), smaller(s->a.z, end.z)), half);
    *high = add(vec(larger(s->a.x, end.x), larger(s->a.y, end.y), larger(s->a.z, end.z)), half);
}

static double distance(const struct solid *s, struct vec p)
{
    const struct vec q = sub(p, s->a);
    if (s->kind == SOLID_BOX) {
        const double x = fabs(q.x) - s->b.x + s->rim, y = fabs(q.y) - s->b.y + s->rim,
                     z = fabs(q.z) - s->b.z + s->rim;
        const double inside = smaller(larger(x, larger(y, z)), 0);
        return length(vec(larger(x, 0), larger(y, 0), larger(z, 0))) + inside - s->rim;
    }
    const double ring = sqrt(q.x * q.x + q.y * q.y) - s->r;
    if (s->kind == SOLID_TORUS)
        return sqrt(ring * ring + q.z * q.z) - s->rim;
    const double x = ring + s->rim, z = fabs(q.z) - s->b.z + s->rim, u = larger(x, 0),
                 v = larger(z, 0);
    return sqrt(u * u + v * v) + smaller(larger(x, z), 0) - s->rim;
}

static double march(const struct solid *s, struct vec o, struct vec d, double reach)
{
    const struct vec q = sub(o, s->a), inverse = vec(1 / d.x, 1 / d.y, 1 / d.z);
    const double x0 = (-s->b.x - q.x) * inverse.x, x1 = (s->b.x - q.x) * inverse.x;
    const double y0 = (-s->b.y - q.y) * inverse.y, y1 = (s->b.y - q.y) * inverse.y;
    const double z0 = (-s->b.z - q.z) * inverse.z, z1 = (s->b.z - q.z) * inverse.z;
    double t = larger(larger(smaller(x0, x1), smaller(y0, y1)), larger(smaller(z0, z1), 0));
    const double end =
        smaller(smaller(larger(x0, x1), larger(y0, y1)), smaller(larger(z0, z1), reach));
    for (int i = 0; i < MARCH_STEPS && t < end; i++) {
        const double step = distance(s, along(o, d, t));
        if (step < MARCH_CLOSE)
            return t > 0 ? t : reach;
        t += step;
    }
    return reach;
}

static double hit_sphere(struct vec centre, double radius, struct vec o, struct vec d, double reach)
{
    const struct vec q = sub(o, centre);
    const double b = dot(q, d);
    const struct vec nearest = along(q, d, -b); /* better conditioned than b^2 - |q|^2 + r^2 */
    const double h = radius * radius - dot(nearest, nearest);
    if (h < 0)
        return reach;
    const double t = -b - sqrt(h);
    return t > 0 && t < reach ? t : reach;
}

static double hit_capsule(const struct solid *s, struct vec o, struct vec d, double reach)
{
    const struct vec axis = sub(s->b, s->a), q = sub(o, s->a);
    const double aa = dot(axis, axis), ad = dot(axis, d), aq = dot(axis, q), dq = dot(d, q);
    const double a = aa - ad * ad, b = aa * dq - aq * ad,
                 c = aa * dot(q, q) - aq * aq - s->r * s->r * aa;
    const double h = b * b - a * c;
    if (h < 0)
        return reach;
    if (a > 1e-12) {
        const double t = (-b - sqrt(h)) / a, y = aq + t * ad;
        if (y > 0 && y < aa)
            return t > 0 && t < reach ? t : reach;
    }
    const double near_a = hit_sphere(s->a, s->r, o, d, reach);
    return hit_sphere(s->b, s->r, o, d, near_a);
}

double sg_solid_hit(const struct solid *s, struct vec o, struct vec d, double reach)
{
    if (s->kind == SOLID_SPHERE)
        return hit_sphere(s->a, s->r, o, d, reach);
    if (!meets_sphere(s->middle, s->bound, o, d, reach))
        return reach;
    return s->kind == SOLID_CAPSULE ? hit_capsule(s, o, d, reach) : march(s, o, d, reach);
}

struct vec sg_solid_normal(const struct solid *s, struct vec p)
{
    if (s->kind == SOLID_SPHERE)
        return normalise(sub(p, s->a));
    if (s->kind == SOLID_CAPSULE) {
        const struct vec axis = sub(s->b, s->a);
        const double t = clamp01(dot(sub(p, s->a), axis) / dot(axis, axis));
        return normalise(sub(p, along(s->a, axis, t)));
    }
    const double h = GRADIENT_STEP;
    return normalise(
        vec(distance(s, vec(p.x + h, p.y, p.z)) - distance(s, vec(p.x - h, p.y, p.z)),
            distance(s, vec(p.x, p.y + h, p.z)) - distance(s, vec(p.x, p.y - h, p.z)),
            distance(s, vec(p.x, p.y, p.z + h)) - distance(s, vec(p.x, p.y, p.z - h))));
}
