/* SPDX-License-Identifier: Apache-2.0 */
/* Whitted ray tracing (1980): one soft light, a sky for ambient light, Fresnel reflections of two bounces. */
#include <math.h>

#include "synth_scene.h"

#define EPSILON 1e-6

static struct vec turn(struct vec v, double angle)
{
    const double c = cos(angle), s = sin(angle);
    return (struct vec){c * v.x - s * v.y, s * v.x + c * v.y, v.z};
}

static bool sphere(struct vec centre, double r, struct vec o, struct vec d, double *t, struct vec *n)
{
    const struct vec oc = vec_sub(o, centre);
    const double b = vec_dot(oc, d), c = vec_dot(oc, oc) - r * r, disc = b * b - c;
    if (disc < 0)
        return false;
    const double root = sqrt(disc);
    *t = -b - root > EPSILON ? -b - root : -b + root;
    if (*t <= EPSILON)
        return false;
    *n = vec_scale(vec_sub(vec_add(o, vec_scale(d, *t)), centre), 1 / r);
    return true;
}

static bool box(const struct solid *s, struct vec o, struct vec d, double *t, struct vec *n)
{
    const struct vec lo = turn(vec_sub(o, s->a), -s->turn), ld = turn(d, -s->turn);
    const double p[3] = {lo.x, lo.y, lo.z}, q[3] = {ld.x, ld.y, ld.z}, h[3] = {s->b.x, s->b.y, s->b.z};
    double enter = -INFINITY, leave = INFINITY;
    int axis = 0;
    for (int i = 0; i < 3; i++) {
        if (fabs(q[i]) < 1e-12) {
            if (fabs(p[i]) > h[i])
                return false;
            continue;
        }
        const double a = (-h[i] - p[i]) / q[i], b = (h[i] - p[i]) / q[i];
        const double first = a < b ? a : b, last = a < b ? b : a;
        if (first > enter)
            enter = first, axis = i;
        leave = last < leave ? last : leave;
    }
    if (enter > leave || enter <= EPSILON)
        return false;
    *t = enter;
    const double sign = q[axis] > 0 ? -1 : 1;
    *n = turn((struct vec){axis == 0 ? sign : 0, axis == 1 ? sign : 0, axis == 2 ? sign : 0}, s->turn);
    return true;
}

static bool capsule(const struct solid *s, struct vec o, struct vec d, double *t, struct vec *n)
{
    const struct vec ba = vec_sub(s->b, s->a), oa = vec_sub(o, s->a);
    const double baba = vec_dot(ba, ba), bad = vec_dot(ba, d), baoa = vec_dot(ba, oa), doa = vec_dot(d, oa);
    const double a = baba - bad * bad, b = baba * doa - baoa * bad;
    const double c = baba * (vec_dot(oa, oa) - s->r * s->r) - baoa * baoa, disc = b * b - a * c;
    if (disc < 0)
        return false;
    const double at = (-b - sqrt(disc)) / a, y = baoa + at * bad;
    if (y > 0 && y < baba) {
        if (at <= EPSILON)
            return false;
        *t = at;
        const struct vec p = vec_sub(vec_add(oa, vec_scale(d, at)), vec_scale(ba, y / baba));
        *n = vec_scale(p, 1 / s->r);
        return true;
    }
    return sphere(y <= 0 ? s->a : s->b, s->r, o, d, t, n);
}

static bool disc(const struct solid *s, struct vec o, struct vec d, double *t, struct vec *n)
{
    const struct vec p = vec_sub(o, s->a);
    bool found = false;
    if (fabs(d.z) > 1e-12) {
        const double at = ((d.z > 0 ? -s->b.z : s->b.z) - p.z) / d.z;
        const double x = p.x + at * d.x, y = p.y + at * d.y;
        if (at > EPSILON && x * x + y * y <= s->r * s->r) {
            *t = at, *n = (struct vec){0, 0, d.z > 0 ? -1 : 1};
            found = true;
        }
    }
    const double a = d.x * d.x + d.y * d.y, b = p.x * d.x + p.y * d.y, c = p.x * p.x + p.y * p.y - s->r * s->r;
    const double root = b * b - a * c;
    if (a > 1e-12 && root >= 0) {
        const double at = (-b - sqrt(root)) / a, z = p.z + at * d.z;
        if (at > EPSILON && fabs(z) <= s->b.z && (!found || at < *t)) {
            *t = at, *n = vec_scale((struct vec){p.x + at * d.x, p.y + at * d.y, 0}, 1 / s->r);
            found = true;
        }
    }
    return found;
}

static bool solid_hit(const struct solid *s, struct vec o, struct vec d, double *t, struct vec *n)
{
    const struct vec oc = vec_sub(o, s->centre); /* bounding sphere first */
    const double b = vec_dot(oc, d);
    if (b * b < vec_dot(oc, oc) - s->bound)
        return false;
    switch (s->kind) {
    case SOLID_SPHERE:
        return sphere(s->a, s->r, o, d, t, n);
    case SOLID_BOX:
        return box(s, o, d, t, n);
    case SOLID_CAPSULE:
        return capsule(s, o, d, t, n);
    default:
        return disc(s, o, d, t, n);
    }
}

bool synth_trace(const struct synth_scene *s, struct vec origin, struct vec direction, struct hit *hit)
{
    hit->t = INFINITY;
    for (int i = 0; i < s->count; i++) {
        double t;
        struct vec n;
        if (solid_hit(&s->solids[i], origin, direction, &t, &n) && t < hit->t)
            hit->t = t, hit->normal = n, hit->solid = &s->solids[i];
    }
    if (hit->t == INFINITY)
        return false;
    hit->point = vec_add(origin, vec_scale(direction, hit->t));
    hit->local = turn(vec_sub(hit->point, hit->solid->a), -hit->solid->turn);
    return true;
}

static bool shadowed(const struct synth_scene *s, struct vec origin, struct vec direction, double limit)
{
    for (int i = 0; i < s->count; i++) {
        double t;
        struct vec n;
        if (solid_hit(&s->solids[i], origin, direction, &t, &n) && t < limit)
            return true;
    }
    return false;
}

static struct vec mix(struct vec a, struct vec b, double t)
{
    return vec_add(vec_scale(a, 1 - t), vec_scale(b, t));
}

static double smooth(double low, double high, double x)
{
    const double t = x <= low ? 0 : x >= high ? 1 : (x - low) / (high - low);
    return t * t * (3 - 2 * t);
}

/* Sums of sines: band limited, so that it stays the same surface from every distance. */
static double ripple(struct vec p)
{
    return sin(7.1 * p.x + 1.7 * sin(5.3 * p.y + 0.6)) + 0.6 * sin(11.3 * p.y + 2.1 * sin(6.7 * p.z + 1.1)) +
           0.4 * sin(17.9 * p.z + 1.3 * sin(13.1 * p.x));
}

struct vec synth_albedo(const struct hit *h)
{
    const struct vec p = h->local, base = h->solid->colour;
    switch (h->solid->material) {
    case MATERIAL_WOOD: {
        const double rings = sqrt(p.x * p.x + 1.6 * p.y * p.y) * 34 + 1.2 * ripple(p);
        return mix(vec_scale(base, 0.55), base, 0.5 + 0.5 * sin(rings));
    }
    case MATERIAL_MARBLE: {
        const double vein = pow(0.5 + 0.5 * sin(9 * p.x + 6 * p.z + 2.2 * ripple(vec_scale(p, 1.7))), 6);
        return mix(base, (struct vec){0.30, 0.33, 0.40}, 0.75 * vein);
    }
    case MATERIAL_CHECKER: {
        const int odd = ((int) floor(p.x / 0.15) + (int) floor(p.y / 0.15)) & 1;
        return odd ? base : (struct vec){0.13, 0.19, 0.24};
    }
    case MATERIAL_GRADIENT:
        return mix((struct vec){0.80, 0.25, 0.45}, base, smooth(-0.19, 0.19, p.z + 0.4 * p.x));
    case MATERIAL_PLAQUE: {
        const double u = (p.x + h->solid->b.x) / (2 * h->solid->b.x), v = (p.z + h->solid->b.z) / (2 * h->solid->b.z);
        /* Readable from the front and from behind. */
        const bool front = p.y<-0.99 * h->solid->b.y, back = p.y> 0.99 * h->solid->b.y;
        if ((front && synth_text(u, v)) || (back && synth_text(1 - u, v)))
            return (struct vec){0.10, 0.12, 0.30};
        return base;
    }
    default:
        return base;
    }
}

static struct vec sky(struct vec d)
{
    return mix((struct vec){0.55, 0.52, 0.50}, (struct vec){0.55, 0.72, 0.95}, smooth(-0.2, 0.9, d.z));
}

static struct vec shade(const struct synth_scene *s, struct vec direction, const struct hit *h, const double jitter[2],
                        int bounces)
{
    static const struct vec light = {2.6, -1.8, 4.2};
    const struct vec n = h->normal, albedo = synth_albedo(h), start = vec_add(h->point, vec_scale(n, 1e-5));
    const bool glossy = h->solid->material == MATERIAL_GLOSSY, metal = h->solid->material == MATERIAL_METAL;
    /* A square light of side 0.7 around its centre. */
    const struct vec at = vec_add(light, (struct vec){0.7 * (jitter[0] - 0.5), 0.7 * (jitter[1] - 0.5), 0});
    const struct vec to_light = vec_sub(at, start);
    const double distance = sqrt(vec_dot(to_light, to_light));
    const struct vec l = vec_scale(to_light, 1 / distance);
    const double facing = vec_dot(n, l);
    const bool lit = facing > 0 && !shadowed(s, start, l, distance);

    const double open = 0.62 + 0.38 * n.z;                                  /* share of the sky that is seen */
    const double grounded = 0.55 + 0.45 * smooth(-0.50, -0.10, h->point.z); /* darker towards the base */
    struct vec colour = vec_mul(albedo, vec_scale((struct vec){0.40, 0.43, 0.48}, open * grounded));
    if (lit)
        colour = vec_add(colour, vec_mul(albedo, vec_scale((struct vec){0.80, 0.76, 0.68}, facing)));
    if (!glossy && !metal)
        return colour;

    const double cosine = -vec_dot(direction, n) > 0 ? -vec_dot(direction, n) : 0;
    const double fresnel = metal ? 0.35 : 0.05 + 0.95 * pow(1 - cosine, 5);
    const struct vec mirror = vec_sub(direction, vec_scale(n, 2 * vec_dot(direction, n)));
    struct hit next;
    struct vec reflected = sky(mirror);
    if (bounces > 0 && synth_trace(s, start, mirror, &next))
        reflected = shade(s, mirror, &next, jitter, bounces - 1);
    if (metal)
        reflected = vec_mul(reflected, albedo);
    colour = mix(colour, reflected, fresnel);
    if (lit) { /* Blinn and Phong's highlight */
        const double d = vec_dot(n, vec_unit(vec_sub(l, direction)));
        const double peak = metal ? 0.5 * pow(d > 0 ? d : 0, 40) : 0.9 * pow(d > 0 ? d : 0, 120);
        colour = vec_add(colour, (struct vec){peak, peak, 0.95 * peak});
    }
    return colour;
}

struct vec synth_shade(const struct synth_scene *s, struct vec direction, const struct hit *hit, const double jitter[2])
{
    return shade(s, direction, hit, jitter, 2);
}
