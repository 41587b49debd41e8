/* SPDX-License-Identifier: Apache-2.0 */
/* Three-vectors of the ray tracer. */
#ifndef SG_SYNTH_VEC_H
#define SG_SYNTH_VEC_H

#include <math.h>

struct vec {
    double x, y, z;
};

static inline struct vec vec(double x, double y, double z)
{
    return (struct vec){x, y, z};
}

static inline struct vec add(struct vec a, struct vec b)
{
    return vec(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline struct vec sub(struct vec a, struct vec b)
{
    return vec(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct vec scale(struct vec a, double s)
{
    return vec(a.x * s, a.y * s, a.z * s);
}

static inline struct vec mul(struct vec a, struct vec b)
{
    return vec(a.x * b.x, a.y * b.y, a.z * b.z);
}

/* a + b s */
static inline struct vec along(struct vec a, struct vec b, double s)
{
    return vec(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s);
}

static inline double dot(struct vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vec cross(struct vec a, struct vec b)
{
    return vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline double length(struct vec a)
{
    return sqrt(dot(a, a));
}

static inline struct vec normalise(struct vec a)
{
    return scale(a, 1 / length(a));
}

static inline struct vec mix(struct vec a, struct vec b, double t)
{
    return along(scale(a, 1 - t), b, t);
}

/* fmin and fmax without their care for NaN, which costs a call. */
static inline double smaller(double a, double b)
{
    return a < b ? a : b;
}

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static inline double clamp01(double x)
{
    return x < 0 ? 0 : x > 1 ? 1 : x;
}

static inline double smooth_step(double low, double high, double x)
{
    const double t = clamp01((x - low) / (high - low));
    return t * t * (3 - 2 * t);
}

/* Two unit vectors that make a right-handed frame with the unit vector n (Duff et al. 2017). */
static inline void frame(struct vec n, struct vec *u, struct vec *v)
{
    const double sign = copysign(1, n.z), a = -1 / (sign + n.z), b = n.x * n.y * a;
    *u = vec(1 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *v = vec(b, sign + n.y * n.y * a, -n.y);
}

#endif
