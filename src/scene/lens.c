/* SPDX-License-Identifier: Apache-2.0 */
/* What a lens does to a direction (x, y, 1): COLMAP's camera models, which contain OpenCV's. */
#include <math.h>

#include "scene/reader.h"

#define DEGREE_MAX 8 /* of the polynomial whose roots are the folds */

bool sg_lens_is_distorted(const struct sg_lens *l)
{
    return l->kind == SG_LENS_FISHEYE || (l->kind == SG_LENS_FOV && l->omega != 0) || l->k1 != 0 ||
           l->k2 != 0 || l->k3 != 0 || l->k4 != 0 || l->k5 != 0 || l->k6 != 0 || l->p1 != 0 ||
           l->p2 != 0;
}

/* Of a field-of-view lens (Devernay and Faugeras 2001): the distorted radius over the radius. */
static double fov_factor(double omega, double r)
{
    const double twice = 2 * tan(omega / 2);
    if (omega == 0)
        return 1;
    return r > 1e-9 ? atan(r * twice) / (r * omega) : twice / omega;
}

void sg_lens_distort(const struct sg_lens *l, double x, double y, double *xd, double *yd)
{
    double r2 = x * x + y * y, d, below = 1;
    if (l->kind == SG_LENS_FISHEYE) { /* from here on radii are angles */
        const double r = sqrt(r2), scale = r > 1e-9 ? atan(r) / r : 1;
        x *= scale, y *= scale;
        r2 = x * x + y * y;
    }
    if (l->kind == SG_LENS_FOV)
        d = fov_factor(l->omega, sqrt(r2));
    else if (l->kind == SG_LENS_RATIONAL) {
        d = 1 + (l->k1 + (l->k2 + l->k3 * r2) * r2) * r2;
        below = 1 + (l->k4 + (l->k5 + l->k6 * r2) * r2) * r2;
    } else
        d = 1 + (l->k1 + (l->k2 + (l->k3 + l->k4 * r2) * r2) * r2) * r2;
    d /= below;
    *xd = x * d + 2 * l->p1 * x * y + l->p2 * (r2 + 2 * x * x) + l->s1 * r2;
    *yd = y * d + l->p1 * (r2 + 2 * y * y) + 2 * l->p2 * x * y + l->s2 * r2;
}

static double value_at(const double *p, int degree, double s)
{
    double v = p[degree];
    for (int i = degree - 1; i >= 0; i--)
        v = v * s + p[i];
    return v;
}

/* Where a polynomial changes its sign in (0, end], rising; between the roots of its derivative
 * there is one at most. */
static int sign_changes(const double *p, int degree, double end, double *roots)
{
    if (degree == 0)
        return 0;
    double slope[DEGREE_MAX], edges[DEGREE_MAX + 1];
    for (int i = 1; i <= degree; i++)
        slope[i - 1] = i * p[i];
    int n = 0, pieces = sign_changes(slope, degree - 1, end, edges);
    edges[pieces++] = end;
    for (int i = 0; i < pieces; i++) {
        double low = i ? edges[i - 1] : 0, high = edges[i];
        const bool negative = value_at(p, degree, low) < 0;
        if ((value_at(p, degree, high) < 0) == negative)
            continue;
        for (int k = 0; k < 200; k++) {
            const double middle = low + (high - low) / 2;
            if ((value_at(p, degree, middle) < 0) == negative)
                low = middle;
            else
                high = middle;
        }
        roots[n++] = high;
    }
    return n;
}

double sg_lens_fold(const struct sg_lens *l, double r2_max)
{
    const bool rational = l->kind == SG_LENS_RATIONAL, fisheye = l->kind == SG_LENS_FISHEYE;
    if (l->kind == SG_LENS_FOV)
        return INFINITY; /* it never stops growing */
    const double above[5] = {1, l->k1, l->k2, l->k3, rational ? 0 : l->k4};
    const double below[4] = {1, rational ? l->k4 : 0, rational ? l->k5 : 0, rational ? l->k6 : 0};
    /* r above(r^2) / below(r^2) grows while (above + 2 s above') below - 2 s above below' is
     * positive, at s = r^2. */
    double growth[DEGREE_MAX] = {0}, roots[DEGREE_MAX], first = INFINITY;
    for (int i = 0; i < 5; i++)
        for (int j = 0; j < 4; j++)
            growth[i + j] += (1 + 2 * i - 2 * j) * above[i] * below[j];
    const double end = fisheye ? M_PI * M_PI / 4 : r2_max;
    if (sign_changes(growth, DEGREE_MAX - 1, end, roots))
        first = roots[0];
    if (sign_changes(below, 3, end, roots) && roots[0] < first) /* a pole */
        first = roots[0];
    return fisheye && first < INFINITY ? pow(tan(sqrt(first)), 2) : first;
}

bool sg_lens_keeps_sides(const struct sg_lens *l, double x, double y)
{
    const double h = 1e-5;
    double right[2], left[2], down[2], up[2];
    sg_lens_distort(l, x + h, y, &right[0], &right[1]);
    sg_lens_distort(l, x - h, y, &left[0], &left[1]);
    sg_lens_distort(l, x, y + h, &down[0], &down[1]);
    sg_lens_distort(l, x, y - h, &up[0], &up[1]);
    return (right[0] - left[0]) * (down[1] - up[1]) - (right[1] - left[1]) * (down[0] - up[0]) > 0;
}
