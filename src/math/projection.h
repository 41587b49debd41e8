/* SPDX-License-Identifier: Apache-2.0 */
/* One Gaussian to one 2D splat, and back: EWA projection (Zwicker et al. 2001) as in Kerbl et al.
 * 2023, section 4. Include a real_*.h or simd.h first. Every function assigns its outputs. */
#ifndef SG_MATH_PROJECTION_H
#define SG_MATH_PROJECTION_H

#include "constants.h"
#include "splatguard/camera.h"

/* A camera in the precision of the arithmetic, with what projection needs of it. */
struct view {
    scalar R[9], t[3], centre[3];
    scalar fx, fy, cx, cy; /* cx, cy as px = fx x/z + cx, pixel centres at integers */
    scalar lim[4];         /* tangent clamp: -x, +x, -y, +y */
    scalar half_w, half_h; /* d px / d ndc */
};

static inline struct view view_make(const struct sg_camera *c)
{
    struct view v;
    for (int i = 0; i < 9; i++)
        v.R[i] = (scalar) c->R[i];
    for (int i = 0; i < 3; i++) {
        v.t[i] = (scalar) c->t[i];
        v.centre[i] =
            (scalar) - (c->R[i] * c->t[0] + c->R[3 + i] * c->t[1] + c->R[6 + i] * c->t[2]);
    }
    v.fx = (scalar) c->fx, v.fy = (scalar) c->fy;
    v.cx = (scalar) (c->cx - 0.5), v.cy = (scalar) (c->cy - 0.5);
    /* 1.3 half fields of view from the image centre; the same margin beyond each edge when cx, cy
     * are off-centre. */
    const double mx = (SG_GUARD - 1) * c->width / (2 * c->fx),
                 my = (SG_GUARD - 1) * c->height / (2 * c->fy);
    v.lim[0] = (scalar) - (c->cx / c->fx + mx);
    v.lim[1] = (scalar) ((c->width - c->cx) / c->fx + mx);
    v.lim[2] = (scalar) - (c->cy / c->fy + my);
    v.lim[3] = (scalar) ((c->height - c->cy) / c->fy + my);
    v.half_w = (scalar) c->width / 2, v.half_h = (scalar) c->height / 2;
    return v;
}

struct splat {
    real x, y, z; /* pixel position, camera-space depth */
    real a, b, c; /* 2D covariance with blur */
    real A, B, C; /* its inverse, the conic */
    real det;
    real sigma;   /* standard deviation along the longer axis, as the reference rounds it:
                     sqrt(lambda) */
    mask visible; /* in front of the camera and invertible; NaN is not visible */
};

/* What the forward pass computes on the way and the backward pass needs again. */
struct projection {
    real q[4], qlen; /* normalised quaternion and the stored one's length */
    real R[9];       /* of the Gaussian */
    real s[3];       /* activated scales */
    real S[6];       /* 3D covariance 00 01 02 11 12 22 */
    real tx, ty, iz; /* camera space, 1/z; tx, ty already clamped */
    real ux, uy;     /* camera space, not clamped */
    mask in_x, in_y; /* not clamped */
    real T[6];       /* J R_view, 2 x 3 */
};

/* xyz: 3, scale: 3 logs, rot: 4. */
static inline void project(const struct view *v, const real *xyz, const real *scale,
                           const real *rot, struct splat *o, struct projection *p)
{
    const real x = xyz[0], y = xyz[1], z = xyz[2];
    const scalar *W = v->R;
    p->ux = W[0] * x + W[1] * y + W[2] * z + v->t[0];
    p->uy = W[3] * x + W[4] * y + W[5] * z + v->t[1];
    o->z = W[6] * x + W[7] * y + W[8] * z + v->t[2];
    const mask front = r_lt(r_set((scalar) SG_Z_MIN), o->z);
    const real tz = r_sel(front, o->z, r_set(1)); /* keeps culled lanes finite */
    p->iz = (scalar) 1 / tz;

    const real len2 = rot[0] * rot[0] + rot[1] * rot[1] + rot[2] * rot[2] + rot[3] * rot[3];
    p->qlen = r_max(r_sqrt(len2), r_set((scalar) 1e-12));
    const real il = (scalar) 1 / p->qlen;
    for (int i = 0; i < 4; i++)
        p->q[i] = rot[i] * il;
    const real r = p->q[0], qx = p->q[1], qy = p->q[2], qz = p->q[3];
    const scalar one = 1, two = 2;
    p->R[0] = one - two * (qy * qy + qz * qz), p->R[1] = two * (qx * qy - r * qz),
    p->R[2] = two * (qx * qz + r * qy);
    p->R[3] = two * (qx * qy + r * qz), p->R[4] = one - two * (qx * qx + qz * qz),
    p->R[5] = two * (qy * qz - r * qx);
    p->R[6] = two * (qx * qz - r * qy), p->R[7] = two * (qy * qz + r * qx),
    p->R[8] = one - two * (qx * qx + qy * qy);
    real s2[3];
    for (int i = 0; i < 3; i++) {
        p->s[i] = r_exp(scale[i]);
        s2[i] = p->s[i] * p->s[i];
    }
    for (int i = 0, k = 0; i < 3; i++)
        for (int j = i; j < 3; j++, k++)
            p->S[k] = p->R[3 * i] * p->R[3 * j] * s2[0] +
                      p->R[3 * i + 1] * p->R[3 * j + 1] * s2[1] +
                      p->R[3 * i + 2] * p->R[3 * j + 2] * s2[2];

    const real rx = p->ux * p->iz, ry = p->uy * p->iz;
    p->in_x = r_and(r_le(r_set(v->lim[0]), rx), r_le(rx, r_set(v->lim[1])));
    p->in_y = r_and(r_le(r_set(v->lim[2]), ry), r_le(ry, r_set(v->lim[3])));
    p->tx = r_min(r_max(rx, r_set(v->lim[0])), r_set(v->lim[1])) * tz;
    p->ty = r_min(r_max(ry, r_set(v->lim[2])), r_set(v->lim[3])) * tz;
    const real j00 = v->fx * p->iz, j11 = v->fy * p->iz;
    const real j02 = -j00 * p->tx * p->iz, j12 = -j11 * p->ty * p->iz;
    for (int j = 0; j < 3; j++) {
        p->T[j] = j00 * W[j] + j02 * W[6 + j];
        p->T[3 + j] = j11 * W[3 + j] + j12 * W[6 + j];
    }
    const real *S = p->S, *T0 = p->T, *T1 = p->T + 3;
    const real u0 = S[0] * T0[0] + S[1] * T0[1] + S[2] * T0[2];
    const real u1 = S[1] * T0[0] + S[3] * T0[1] + S[4] * T0[2];
    const real u2 = S[2] * T0[0] + S[4] * T0[1] + S[5] * T0[2];
    const real w0 = S[0] * T1[0] + S[1] * T1[1] + S[2] * T1[2];
    const real w1 = S[1] * T1[0] + S[3] * T1[1] + S[4] * T1[2];
    const real w2 = S[2] * T1[0] + S[4] * T1[1] + S[5] * T1[2];
    o->a = T0[0] * u0 + T0[1] * u1 + T0[2] * u2 + (scalar) SG_BLUR;
    o->b = T1[0] * u0 + T1[1] * u1 + T1[2] * u2;
    o->c = T1[0] * w0 + T1[1] * w1 + T1[2] * w2 + (scalar) SG_BLUR;
    o->det = o->a * o->c - o->b * o->b;
    /* The reference culls det == 0; in exact arithmetic det > 0.09, so negative means that float
     * overflowed or cancelled and the conic would be garbage. Beyond 1e16 (a splat of 1e8 pixels)
     * the gradient would overflow. */
    const real big = r_set((scalar) 1e30);
    const mask sound = r_and(r_lt(r_set(0), o->det), r_lt(r_max(o->a, o->c), r_set((scalar) 1e16)));
    const real det = r_sel(sound, o->det, r_set(1));
    const real idet = one / det;
    o->A = o->c * idet, o->B = -o->b * idet, o->C = o->a * idet;
    const real mid = (scalar) 0.5 * (o->a + o->c);
    o->sigma = r_sqrt(mid + r_sqrt(r_max(r_set((scalar) 0.1), mid * mid - det)));
    const real iz_ndc = one / (tz + (scalar) 1e-7);
    o->x = v->fx * p->ux * iz_ndc + v->cx;
    o->y = v->fy * p->uy * iz_ndc + v->cy;
    const mask finite =
        r_and(r_and(r_lt(-big, o->x), r_lt(o->x, big)), r_and(r_lt(-big, o->y), r_lt(o->y, big)));
    o->visible = r_and(r_and(front, sound), finite);
}

/* Gradient of the loss with respect to a splat. */
struct splat_grad {
    real x, y;     /* pixel position */
    real A, Bh, C; /* conic; Bh is half of the true derivative with respect to B */
};

/* Backward of project(). out_*: dL/d stored parameters. den^2 + 1e-7 as the reference. */
static inline void project_backward(const struct view *v, const struct projection *p,
                                    const struct splat *o, const struct splat_grad *g,
                                    real *out_xyz, real *out_scale, real *out_rot)
{
    const scalar *W = v->R;
    const real a = o->a, b = o->b, c = o->c;
    const real k = (scalar) 1 / (o->det * o->det + (scalar) 1e-7);
    const real off = o->det - a * c; /* = -b^2, in the reference's arithmetic */
    const real da = k * (-c * c * g->A + (scalar) 2 * b * c * g->Bh + off * g->C);
    const real dc = k * (-a * a * g->C + (scalar) 2 * a * b * g->Bh + off * g->A);
    const real db =
        (scalar) 2 * k * (b * c * g->A - (o->det + (scalar) 2 * b * b) * g->Bh + a * b * g->C);

    const real *T0 = p->T, *T1 = p->T + 3;
    real D[9]; /* symmetric dL/dSigma with halved off-diagonals */
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++)
            D[3 * i + j] = D[3 * j + i] = T0[i] * T0[j] * da +
                                          (scalar) 0.5 * (T0[i] * T1[j] + T0[j] * T1[i]) * db +
                                          T1[i] * T1[j] * dc;

    const real *S = p->S;
    real dT0[3], dT1[3];
    for (int i = 0; i < 3; i++) {
        static const int at[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
        const real st0 = S[at[3 * i]] * T0[0] + S[at[3 * i + 1]] * T0[1] + S[at[3 * i + 2]] * T0[2];
        const real st1 = S[at[3 * i]] * T1[0] + S[at[3 * i + 1]] * T1[1] + S[at[3 * i + 2]] * T1[2];
        dT0[i] = (scalar) 2 * da * st0 + db * st1;
        dT1[i] = (scalar) 2 * dc * st1 + db * st0;
    }
    const real dj00 = dT0[0] * W[0] + dT0[1] * W[1] + dT0[2] * W[2];
    const real dj02 = dT0[0] * W[6] + dT0[1] * W[7] + dT0[2] * W[8];
    const real dj11 = dT1[0] * W[3] + dT1[1] * W[4] + dT1[2] * W[5];
    const real dj12 = dT1[0] * W[6] + dT1[1] * W[7] + dT1[2] * W[8];
    const real fx2 = v->fx * p->iz * p->iz, fy2 = v->fy * p->iz * p->iz;
    real dtx = r_sel(p->in_x, -fx2 * dj02, r_set(0));
    real dty = r_sel(p->in_y, -fy2 * dj12, r_set(0));
    /* The factor 2 stands also where the tangent was clamped (exact would be 1), as in the
     * reference. */
    real dtz =
        -fx2 * dj00 - fy2 * dj11 + (scalar) 2 * p->iz * (fx2 * p->tx * dj02 + fy2 * p->ty * dj12);

    const real tz = (scalar) 1 / p->iz, iw = (scalar) 1 / (tz + (scalar) 1e-7);
    dtx += g->x * v->fx * iw;
    dty += g->y * v->fy * iw;
    dtz -= (g->x * v->fx * p->ux + g->y * v->fy * p->uy) * iw * iw;
    for (int j = 0; j < 3; j++)
        out_xyz[j] = W[j] * dtx + W[3 + j] * dty + W[6 + j] * dtz;

    /* Sigma = M^T M with M = diag(s) R^T. */
    const real *R = p->R;
    real E[9]; /* dL/dR[j][k] at 3j + k */
    for (int kk = 0; kk < 3; kk++) {
        real ds = r_set(0);
        for (int j = 0; j < 3; j++) {
            const real dM = (scalar) 2 * p->s[kk] *
                            (R[kk] * D[j] + R[3 + kk] * D[3 + j] + R[6 + kk] * D[6 + j]);
            ds += R[3 * j + kk] * dM;
            E[3 * j + kk] = p->s[kk] * dM;
        }
        out_scale[kk] = ds * p->s[kk];
    }
    const real r = p->q[0], x = p->q[1], y = p->q[2], z = p->q[3];
    const real d[4] = {
        (scalar) 2 * (z * (E[3] - E[1]) + y * (E[2] - E[6]) + x * (E[7] - E[5])),
        (scalar) 2 * (y * (E[1] + E[3]) + z * (E[2] + E[6]) + r * (E[7] - E[5]) -
                      (scalar) 2 * x * (E[4] + E[8])),
        (scalar) 2 * (x * (E[1] + E[3]) + r * (E[2] - E[6]) + z * (E[5] + E[7]) -
                      (scalar) 2 * y * (E[0] + E[8])),
        (scalar) 2 * (r * (E[3] - E[1]) + x * (E[2] + E[6]) + y * (E[5] + E[7]) -
                      (scalar) 2 * z * (E[0] + E[4])),
    };
    const real dot = p->q[0] * d[0] + p->q[1] * d[1] + p->q[2] * d[2] + p->q[3] * d[3];
    for (int i = 0; i < 4; i++)
        out_rot[i] = (d[i] - p->q[i] * dot) / p->qlen;
}

#endif
