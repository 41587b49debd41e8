/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/path.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/cameras.h"
#include "scene/reader.h"

#define ONE_WAY 0.7    /* length of the mean direction of view, from which cameras look one way */
#define NO_WAY 0.1     /* of a mean of directions, below which there is none */
#define NARROWEST 0.25 /* an ellipse around something, of its length */
#define SHARE 0.9      /* of the cameras are within the ellipse, along each axis */
#define FOCUS_WEIGHT 1e-3 /* of the place in front of the cameras, where their axes do not meet */
#define ARC_PIECES 1024

/* ---- vectors ---- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                         a[0] * b[1] - a[1] * b[0]};
    memcpy(out, c, sizeof(c));
}

/* Adds s b. */
static void add(double a[3], double s, const double b[3])
{
    for (int k = 0; k < 3; k++)
        a[k] += s * b[k];
}

/* Returns the length before. */
static double normalise(double a[3])
{
    const double length = sqrt(dot(a, a));
    for (int k = 0; k < 3 && length > 0; k++)
        a[k] /= length;
    return length;
}

/* A unit vector across a unit vector. */
static void any_across(const double normal[3], double out[3])
{
    int least = 0;
    for (int k = 1; k < 3; k++)
        least = fabs(normal[k]) < fabs(normal[least]) ? k : least;
    double axis[3] = {0};
    axis[least] = 1;
    cross(normal, axis, out);
    normalise(out);
}

/* ---- the ellipse ---- */

struct ellipse {
    double middle[3], axis[2][3]; /* with the lengths of the half axes */
    double focus[3], up[3];
    double facing;              /* -1: frames look away from the focus */
    double arc[ARC_PIECES + 1]; /* length from angle 0 to the end of each piece */
};

/* The point that is nearest to all axes of view, by least squares. It is pulled a little to
 * `ahead`, which decides where the axes are parallel. Cramer's rule; the matrix is positive
 * definite. */
static void find_focus(const struct sg_camera *cameras, size_t n, const double ahead[3],
                       double focus[3])
{
    double m[9] = {0}, b[3] = {0};
    for (size_t i = 0; i < n; i++) {
        double c[3];
        const double *d = cameras[i].R + 6;
        sg_camera_centre(&cameras[i], c);
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++) {
                const double v = (r == k) - d[r] * d[k];
                m[3 * r + k] += v / (double) n;
                b[r] += v * c[k] / (double) n;
            }
    }
    for (int k = 0; k < 3; k++)
        m[4 * k] += FOCUS_WEIGHT, b[k] += FOCUS_WEIGHT * ahead[k];
    double rows[3][3];
    cross(m + 3, m + 6, rows[0]); /* columns of the inverse times the determinant */
    cross(m + 6, m, rows[1]);
    cross(m, m + 3, rows[2]);
    const double det = dot(m, rows[0]);
    for (int k = 0; k < 3; k++)
        focus[k] = (rows[0][k] * b[0] + rows[1][k] * b[1] + rows[2][k] * b[2]) / det;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

/* The half axis along `axis` that leaves SHARE of the cameras within. scratch: n. */
static double half_axis(const struct sg_camera *cameras, size_t n, const double origin[3],
                        const double axis[3], double *scratch)
{
    for (size_t i = 0; i < n; i++) {
        double c[3];
        sg_camera_centre(&cameras[i], c);
        add(c, -1, origin);
        scratch[i] = fabs(dot(c, axis));
    }
    qsort(scratch, n, sizeof(*scratch), ascending);
    return scratch[(size_t) (SHARE * (double) (n - 1))];
}

/* Sets the axes of the ellipse across `normal`: the principal ones of the cameras' offsets from its
 * middle. Returns the length of the longer half axis. */
static double find_axes(const struct sg_camera *cameras, size_t n, const double normal[3],
                        double narrowest, double *scratch, struct ellipse *e)
{
    double x[3], y[3], xx = 0, xy = 0, yy = 0, length[2];
    any_across(normal, x);
    cross(normal, x, y);
    for (size_t i = 0; i < n; i++) {
        double c[3];
        sg_camera_centre(&cameras[i], c);
        add(c, -1, e->middle);
        xx += dot(c, x) * dot(c, x), xy += dot(c, x) * dot(c, y), yy += dot(c, y) * dot(c, y);
    }
    const double angle = atan2(2 * xy, xx - yy) / 2;
    memset(e->axis, 0, sizeof(e->axis));
    add(e->axis[0], cos(angle), x);
    add(e->axis[0], sin(angle), y);
    cross(normal, e->axis[0], e->axis[1]);
    for (int k = 0; k < 2; k++)
        length[k] = half_axis(cameras, n, e->middle, e->axis[k], scratch);
    const double longer = fmax(length[0], length[1]);
    for (int k = 0; k < 2; k++)
        for (int c = 0; c < 3; c++)
            e->axis[k][c] *= fmax(length[k], narrowest * longer);
    return longer;
}

static void ellipse_point(const struct ellipse *e, double angle, double out[3])
{
    memcpy(out, e->middle, sizeof(e->middle));
    add(out, cos(angle), e->axis[0]);
    add(out, sin(angle), e->axis[1]);
}

static void measure_arc(struct ellipse *e)
{
    double last[3], here[3];
    ellipse_point(e, 0, last);
    for (int i = 0; i < ARC_PIECES; i++) {
        ellipse_point(e, 2 * M_PI * (i + 1) / ARC_PIECES, here);
        add(last, -1, here);
        e->arc[i + 1] = e->arc[i] + sqrt(dot(last, last));
        memcpy(last, here, sizeof(here));
    }
}

/* The angle after a share of the whole length. */
static double angle_at(const struct ellipse *e, double share)
{
    const double length = share * e->arc[ARC_PIECES];
    int i = 0;
    while (i < ARC_PIECES - 1 && e->arc[i + 1] < length)
        i++;
    const double piece = e->arc[i + 1] - e->arc[i];
    return 2 * M_PI * (i + (piece > 0 ? (length - e->arc[i]) / piece : 0)) / ARC_PIECES;
}

static int make_ellipse(sg_ctx *ctx, const struct sg_camera *cameras, size_t n, double *scratch,
                        struct ellipse *e)
{
    double mean[3] = {0}, forward[3] = {0}, ahead[3], normal[3], spread = 0;
    *e = (struct ellipse){.facing = 1};
    for (size_t i = 0; i < n; i++) {
        double c[3];
        sg_camera_centre(&cameras[i], c);
        add(mean, 1 / (double) n, c);
        add(forward, 1 / (double) n, cameras[i].R + 6);
        add(e->up, -1 / (double) n, cameras[i].R + 3);
    }
    for (size_t i = 0; i < n; i++) {
        double c[3];
        sg_camera_centre(&cameras[i], c);
        add(c, -1, mean);
        spread = fmax(spread, sqrt(dot(c, c)));
    }
    memcpy(ahead, mean, sizeof(ahead));
    add(ahead, spread, forward);
    find_focus(cameras, n, ahead, e->focus);
    const bool one_way = normalise(forward) > ONE_WAY;
    const bool upright = normalise(e->up) > NO_WAY;
    memcpy(e->middle, mean, sizeof(mean));
    if (one_way)
        memcpy(normal, forward, sizeof(normal));
    else {
        if (!upright) /* on all sides: any plane is as good */
            memcpy(e->up, (double[3]){0, 0, 1}, sizeof(e->up));
        memcpy(normal, e->up, sizeof(normal));
        memcpy(e->middle, e->focus, sizeof(e->focus));
        add(e->middle, dot(mean, normal) - dot(e->focus, normal), normal);
    }
    double towards = 0;
    for (size_t i = 0; i < n; i++) {
        double c[3];
        sg_camera_centre(&cameras[i], c);
        add(c, -1, e->focus);
        towards -= dot(c, cameras[i].R + 6);
    }
    e->facing = towards < 0 ? -1 : 1;
    const double longer = find_axes(cameras, n, normal, one_way ? 0 : NARROWEST, scratch, e);
    if (!(longer > 1e-9 * (1 + sqrt(dot(mean, mean)))))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "path: found cameras that are all at one place, expected some distance");
    if (one_way && !upright) { /* seen from above, with any side up */
        memcpy(e->up, e->axis[0], sizeof(e->up));
        normalise(e->up);
    }
    measure_arc(e);
    return SG_OK;
}

/* At `centre`, in direction `forward`. */
static void look(const double centre[3], const double forward[3], const double up[3],
                 struct sg_camera *out)
{
    double *right = out->R, *down = out->R + 3, *z = out->R + 6;
    memcpy(z, forward, 3 * sizeof(*z));
    normalise(z);
    cross(z, up, right);
    if (!(normalise(right) > 1e-9))
        any_across(z, right);
    cross(z, right, down);
    for (int k = 0; k < 3; k++)
        out->t[k] = -dot(out->R + 3 * k, centre);
}

static void fly_ellipse(const struct ellipse *e, size_t frames, struct sg_camera *out)
{
    for (size_t i = 0; i < frames; i++) {
        double centre[3], forward[3];
        ellipse_point(e, angle_at(e, (double) i / (double) frames), centre);
        for (int k = 0; k < 3; k++)
            forward[k] = e->facing * (e->focus[k] - centre[k]);
        look(centre, forward, e->up, &out[i]);
    }
}

/* ---- from camera to camera ---- */

/* w x y z of a rotation (Shepperd 1978): the largest is found first. */
static void quaternion_of(const double R[9], double q[4])
{
    const double trace = R[0] + R[4] + R[8],
                 square[4] = {trace, 2 * R[0] - trace, 2 * R[4] - trace, 2 * R[8] - trace};
    int largest = 0;
    for (int k = 1; k < 4; k++)
        largest = square[k] > square[largest] ? k : largest;
    const double products[4][4] = {
        {1 + trace, R[7] - R[5], R[2] - R[6], R[3] - R[1]},
        {R[7] - R[5], 1 + square[1], R[1] + R[3], R[2] + R[6]},
        {R[2] - R[6], R[1] + R[3], 1 + square[2], R[5] + R[7]},
        {R[3] - R[1], R[2] + R[6], R[5] + R[7], 1 + square[3]},
    };
    const double length = 2 * sqrt(products[largest][largest]);
    for (int k = 0; k < 4; k++)
        q[k] = products[largest][k] / length;
}

/* The spline through p[1] and p[2], at 0..1 between them. */
static double catmull_rom(const double p[4], double x)
{
    return p[1] + x / 2 *
                      (p[2] - p[0] +
                       x * (2 * p[0] - 5 * p[1] + 4 * p[2] - p[3] +
                            x * (3 * (p[1] - p[2]) + p[3] - p[0])));
}

/* keys: n rows of a quaternion and a centre. */
static void make_keys(const struct sg_camera *cameras, size_t n, double (*keys)[7])
{
    for (size_t i = 0; i < n; i++) {
        double product = 0;
        quaternion_of(cameras[i].R, keys[i]);
        sg_camera_centre(&cameras[i], keys[i] + 4);
        for (int k = 0; k < 4 && i; k++)
            product += keys[i][k] * keys[i - 1][k];
        for (int k = 0; k < 4 && product < 0; k++) /* q and -q are one rotation: the shorter way */
            keys[i][k] = -keys[i][k];
    }
}

static int interpolate(sg_ctx *ctx, const double (*keys)[7], size_t n, size_t frames,
                       struct sg_camera *out)
{
    int code = SG_OK;
    for (size_t i = 0; i < frames && !code; i++) {
        const double at = frames > 1 ? (double) i * (double) (n - 1) / (double) (frames - 1) : 0;
        size_t key = (size_t) at;
        key = n > 1 && key > n - 2 ? n - 2 : key;
        const size_t from = key ? key - 1 : 0, to = key + 1 < n ? key + 1 : key,
                     end = to + 1 < n ? to + 1 : to;
        double value[7];
        for (int k = 0; k < 7; k++)
            value[k] =
                catmull_rom((double[4]){keys[from][k], keys[key][k], keys[to][k], keys[end][k]},
                            at - (double) key);
        const double zero[3] = {0};
        code = sg_pose_from_quaternion(ctx, value, zero, "path", out[i].R, out[i].t);
        for (int k = 0; k < 3; k++)
            out[i].t[k] = -dot(out[i].R + 3 * k, value + 4);
    }
    return code;
}

/* ---- both ---- */

int sg_camera_path(sg_ctx *ctx, enum sg_path_kind kind, const struct sg_camera *cameras, size_t n,
                   size_t frames, struct sg_camera *out)
{
    sg_clear_error(ctx);
    if (!n || !frames || (kind != SG_PATH_ELLIPSE && kind != SG_PATH_INTERPOLATE))
        return sg_fail(ctx, SG_ERR_USAGE,
                       "path: found kind %d, %zu cameras and %zu frames, expected a kind and at "
                       "least one of each",
                       (int) kind, n, frames);
    int code = SG_OK;
    for (size_t i = 0; i < n && !code; i++) {
        char where[40];
        snprintf(where, sizeof(where), "path: camera %zu", i);
        code = sg_camera_check(ctx, &cameras[i], SG_ERR_USAGE, where);
    }
    if (code)
        return code;
    for (size_t i = 0; i < frames; i++)
        out[i] = cameras[0];
    double(*keys)[7] = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*keys));
    struct ellipse *e = sg_alloc_raw(ctx, SG_MEM_MISC, 1, sizeof(*e));
    if (!keys || !e)
        code = SG_ERR_BUDGET;
    else if (kind == SG_PATH_INTERPOLATE) {
        make_keys(cameras, n, keys);
        code = interpolate(ctx, (const double(*)[7]) keys, n, frames, out);
    } else if (!(code = make_ellipse(ctx, cameras, n, keys[0], e)))
        fly_ellipse(e, frames, out);
    sg_free(keys);
    sg_free(e);
    return code;
}
