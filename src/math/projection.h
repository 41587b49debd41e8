/* SPDX-License-Identifier: Apache-2.0 */
/* One Gaussian to one 2D splat, and back: EWA projection (Zwicker et al. 2001) as in Kerbl et al.
 * 2023, section 4. Include a real_*.h or simd.h first. Every function assigns its outputs. */
#ifndef SG_MATH_PROJECTION_H
#define SG_MATH_PROJECTION_H

#include "constants.h"
#ifndef SG_GLSL
#include "splatguard/camera.h"
#endif

/* Whether opacities make up for the blur; a constant where that is known to the compiler. */
#ifndef SG_COMPENSATED
#define SG_COMPENSATED(v) ((v).compensated > NUM(0))
#endif

/* A camera in the precision of the arithmetic, with what projection needs of it. */
struct pinhole {
    scalar R[9], t[3], centre[3];
    scalar fx, fy, cx, cy; /* cx, cy as px = fx x/z + cx, pixel centres at integers */
    scalar lim[4];         /* tangent clamp: -x, +x, -y, +y */
    scalar half_w, half_h; /* d px / d ndc */
    scalar blur;           /* added to the diagonal of the 2D covariance */
    scalar compensated;    /* 1: opacities make up for the blur; 0 */
};

#ifndef SG_GLSL /* which has no doubles */
static inline struct pinhole view_make(const struct sg_camera *c)
{
    struct pinhole v;
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
    v.blur = (scalar) SG_BLUR, v.compensated = 0;
    return v;
}

/* With the 2D filter of Mip-Splatting (Yu et al. 2024, section 5.2). kernel: its variance; 0: no
 * such filter. */
static inline struct pinhole view_make_mip(const struct sg_camera *c, float kernel)
{
    struct pinhole v = view_make(c);
    if (kernel > 0)
        v.blur = (scalar) kernel, v.compensated = 1;
    return v;
}
#endif

struct splat {
    real x, y, z; /* pixel position, camera-space depth */
    real a, b, c; /* 2D covariance with blur */
    real A, B, C; /* its inverse, the conic */
    real det;
    real gain;    /* of the opacity: 1, or what makes up for the blur */
    real sigma;   /* standard deviation along the longer axis, as the reference rounds it:
                     sqrt(lambda) */
    mask visible; /* in front of the camera and invertible; NaN is not visible */
};

/* What the forward pass computes on the way and the backward pass needs again. */
struct projection {
    real q[4], qlen;   /* normalised quaternion and the stored one's length */
    real R[9];         /* of the Gaussian */
    real s[3];         /* activated scales */
    real S[6];         /* 3D covariance 00 01 02 11 12 22 */
    real tx, ty, iz;   /* camera space, 1/z; tx, ty already clamped */
    real ux, uy;       /* camera space, not clamped */
    mask in_x, in_y;   /* not clamped */
    real T0[3], T1[3]; /* rows of J R_view */
    real a0, c0;       /* diagonal of the 2D covariance without blur */
};

/* From the determinants of the 2D covariance without and with blur. */
SG_FN real mip_gain(real plain, real blurred)
{
    const real least = r_set(NUM(SG_MIP_LEAST));
    const real det0 = r_max(least, plain), det1 = r_max(least, blurred);
    const real gain = r_sqrt(det0 / (det1 + least) + least);
    return r_sel(r_and(r_lt(least, det0), r_lt(least, det1)), gain, r_set(NUM(0)));
}

/* What the parameters v, o, p and g of the two functions hold. */
#define V REF(v)
#define O REF(o)
#define P REF(p)
#define G REF(g)

/* xyz: 3, scale: 3 logs, rot: 4. */
SG_FN void project(IN(pinhole, v), IN_ARRAY(real, xyz, 3), IN_ARRAY(real, scale, 3),
                   IN_ARRAY(real, rot, 4), OUT(splat, o), OUT(projection, p))
{
    const real x = xyz[0], y = xyz[1], z = xyz[2];
    P.ux = V.R[0] * x + V.R[1] * y + V.R[2] * z + V.t[0];
    P.uy = V.R[3] * x + V.R[4] * y + V.R[5] * z + V.t[1];
    O.z = V.R[6] * x + V.R[7] * y + V.R[8] * z + V.t[2];
    const mask front = r_lt(r_set(NUM(SG_Z_MIN)), O.z);
    const real tz = r_sel(front, O.z, r_set(1)); /* keeps culled lanes finite */
    P.iz = NUM(1) / tz;

    const real len2 = rot[0] * rot[0] + rot[1] * rot[1] + rot[2] * rot[2] + rot[3] * rot[3];
    P.qlen = r_max(r_sqrt(len2), r_set(NUM(1e-12)));
    const real il = NUM(1) / P.qlen;
    for (int i = 0; i < 4; i++)
        P.q[i] = rot[i] * il;
    const real r = P.q[0], qx = P.q[1], qy = P.q[2], qz = P.q[3];
    const scalar one = NUM(1), two = NUM(2);
    P.R[0] = one - two * (qy * qy + qz * qz), P.R[1] = two * (qx * qy - r * qz),
    P.R[2] = two * (qx * qz + r * qy);
    P.R[3] = two * (qx * qy + r * qz), P.R[4] = one - two * (qx * qx + qz * qz),
    P.R[5] = two * (qy * qz - r * qx);
    P.R[6] = two * (qx * qz - r * qy), P.R[7] = two * (qy * qz + r * qx),
    P.R[8] = one - two * (qx * qx + qy * qy);
    real s2[3];
    for (int i = 0; i < 3; i++) {
        P.s[i] = r_exp(scale[i]);
        s2[i] = P.s[i] * P.s[i];
    }
    for (int i = 0, k = 0; i < 3; i++)
        for (int j = i; j < 3; j++, k++)
            P.S[k] = P.R[3 * i] * P.R[3 * j] * s2[0] + P.R[3 * i + 1] * P.R[3 * j + 1] * s2[1] +
                     P.R[3 * i + 2] * P.R[3 * j + 2] * s2[2];

    const real rx = P.ux * P.iz, ry = P.uy * P.iz;
    P.in_x = r_and(r_le(r_set(V.lim[0]), rx), r_le(rx, r_set(V.lim[1])));
    P.in_y = r_and(r_le(r_set(V.lim[2]), ry), r_le(ry, r_set(V.lim[3])));
    P.tx = r_min(r_max(rx, r_set(V.lim[0])), r_set(V.lim[1])) * tz;
    P.ty = r_min(r_max(ry, r_set(V.lim[2])), r_set(V.lim[3])) * tz;
    const real j00 = V.fx * P.iz, j11 = V.fy * P.iz;
    const real j02 = -j00 * P.tx * P.iz, j12 = -j11 * P.ty * P.iz;
    for (int j = 0; j < 3; j++) {
        P.T0[j] = j00 * V.R[j] + j02 * V.R[6 + j];
        P.T1[j] = j11 * V.R[3 + j] + j12 * V.R[6 + j];
    }
    const real u0 = P.S[0] * P.T0[0] + P.S[1] * P.T0[1] + P.S[2] * P.T0[2];
    const real u1 = P.S[1] * P.T0[0] + P.S[3] * P.T0[1] + P.S[4] * P.T0[2];
    const real u2 = P.S[2] * P.T0[0] + P.S[4] * P.T0[1] + P.S[5] * P.T0[2];
    const real w0 = P.S[0] * P.T1[0] + P.S[1] * P.T1[1] + P.S[2] * P.T1[2];
    const real w1 = P.S[1] * P.T1[0] + P.S[3] * P.T1[1] + P.S[4] * P.T1[2];
    const real w2 = P.S[2] * P.T1[0] + P.S[4] * P.T1[1] + P.S[5] * P.T1[2];
    P.a0 = P.T0[0] * u0 + P.T0[1] * u1 + P.T0[2] * u2;
    O.a = P.a0 + V.blur;
    O.b = P.T1[0] * u0 + P.T1[1] * u1 + P.T1[2] * u2;
    P.c0 = P.T1[0] * w0 + P.T1[1] * w1 + P.T1[2] * w2;
    O.c = P.c0 + V.blur;
    O.det = O.a * O.c - O.b * O.b;
    O.gain = r_set(1);
    if (SG_COMPENSATED(V))
        O.gain = mip_gain(P.a0 * P.c0 - O.b * O.b, O.det);
    /* The reference culls det == 0; in exact arithmetic det >= blur^2, so negative means that float
     * overflowed or cancelled and the conic would be garbage. Beyond 1e16 (a splat of 1e8 pixels)
     * the gradient would overflow. */
    const real big = r_set(NUM(1e30));
    const mask sound = r_and(r_lt(r_set(0), O.det), r_lt(r_max(O.a, O.c), r_set(NUM(1e16))));
    const real det = r_sel(sound, O.det, r_set(1));
    const real idet = one / det;
    O.A = O.c * idet, O.B = -O.b * idet, O.C = O.a * idet;
    const real mid = NUM(0.5) * (O.a + O.c);
    O.sigma = r_sqrt(mid + r_sqrt(r_max(r_set(NUM(0.1)), mid * mid - det)));
    const real iz_ndc = one / (tz + NUM(1e-7));
    O.x = V.fx * P.ux * iz_ndc + V.cx;
    O.y = V.fy * P.uy * iz_ndc + V.cy;
    const mask finite =
        r_and(r_and(r_lt(-big, O.x), r_lt(O.x, big)), r_and(r_lt(-big, O.y), r_lt(O.y, big)));
    O.visible = r_and(r_and(front, sound), finite);
}

/* Gradient of the loss with respect to a splat. */
struct splat_grad {
    real x, y;     /* pixel position */
    real A, Bh, C; /* conic; Bh is half of the true derivative with respect to B */
    real opacity;  /* drawn opacity, times that opacity; read where the view is compensated */
};

/* From moments of w = opacity G dL/dalpha about the centre. */
SG_FN STRUCT(splat_grad)
    splat_pull(IN(splat, o), real w, real wx, real wy, real wxx, real wxy, real wyy)
{
    STRUCT(splat_grad) g;
    g.x = REF(o).A * wx + REF(o).B * wy;
    g.y = REF(o).C * wy + REF(o).B * wx;
    g.A = NUM(-0.5) * wxx;
    g.Bh = NUM(-0.5) * wxy;
    g.C = NUM(-0.5) * wyy;
    g.opacity = w;
    return g;
}

/* The opacity that is drawn; gain: of struct splat. */
SG_FN real opacity_drawn(real logit, real gain)
{
    return gain / (NUM(1) + r_exp(-logit));
}

/* dL/dlogit: d opacity = sum w / o, d logit = o (1 - o) d opacity. */
SG_FN real logit_pull(real w, real logit)
{
    return w * (NUM(1) - NUM(1) / (NUM(1) + r_exp(-logit)));
}

/* Backward of project(). out_*: dL/d stored parameters. den^2 + 1e-7 as the reference. */
SG_FN void project_backward(IN(pinhole, v), IN(projection, p), IN(splat, o), IN(splat_grad, g),
                            OUT_ARRAY(real, out_xyz, 3), OUT_ARRAY(real, out_scale, 3),
                            OUT_ARRAY(real, out_rot, 4))
{
    const real a = O.a, b = O.b, c = O.c;
    const real k = NUM(1) / (O.det * O.det + NUM(1e-7));
    const real off = O.det - a * c; /* = -b^2, in the reference's arithmetic */
    real da = k * (-c * c * G.A + NUM(2) * b * c * G.Bh + off * G.C);
    real dc = k * (-a * a * G.C + NUM(2) * a * b * G.Bh + off * G.A);
    real db = NUM(2) * k * (b * c * G.A - (O.det + NUM(2) * b * b) * G.Bh + a * b * G.C);
    if (SG_COMPENSATED(V)) { /* what is not drawn has G.opacity 0 */
        const real least = r_set(NUM(SG_MIP_LEAST)), gain = O.gain + least;
        const real det0 = r_max(least, P.a0 * P.c0 - b * b), det1 = r_max(least, O.det);
        const real e = NUM(0.5) * G.opacity / (gain * gain);
        const real e0 = e / (det1 + least), e1 = -e * det0 / (det1 * det1 + least);
        da += e0 * P.c0 + e1 * c;
        dc += e0 * P.a0 + e1 * a;
        db -= NUM(2) * b * (e0 + e1);
    }

    real D[9]; /* symmetric dL/dSigma with halved off-diagonals */
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++)
            D[3 * i + j] = D[3 * j + i] = P.T0[i] * P.T0[j] * da +
                                          NUM(0.5) * (P.T0[i] * P.T1[j] + P.T0[j] * P.T1[i]) * db +
                                          P.T1[i] * P.T1[j] * dc;

    real dT0[3], dT1[3];
    SG_TABLE int at[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
    for (int i = 0; i < 3; i++) {
        const real st0 =
            P.S[at[3 * i]] * P.T0[0] + P.S[at[3 * i + 1]] * P.T0[1] + P.S[at[3 * i + 2]] * P.T0[2];
        const real st1 =
            P.S[at[3 * i]] * P.T1[0] + P.S[at[3 * i + 1]] * P.T1[1] + P.S[at[3 * i + 2]] * P.T1[2];
        dT0[i] = NUM(2) * da * st0 + db * st1;
        dT1[i] = NUM(2) * dc * st1 + db * st0;
    }
    const real dj00 = dT0[0] * V.R[0] + dT0[1] * V.R[1] + dT0[2] * V.R[2];
    const real dj02 = dT0[0] * V.R[6] + dT0[1] * V.R[7] + dT0[2] * V.R[8];
    const real dj11 = dT1[0] * V.R[3] + dT1[1] * V.R[4] + dT1[2] * V.R[5];
    const real dj12 = dT1[0] * V.R[6] + dT1[1] * V.R[7] + dT1[2] * V.R[8];
    const real fx2 = V.fx * P.iz * P.iz, fy2 = V.fy * P.iz * P.iz;
    real dtx = r_sel(P.in_x, -fx2 * dj02, r_set(0));
    real dty = r_sel(P.in_y, -fy2 * dj12, r_set(0));
    /* The factor 2 is also used where the tangent was clamped (exact would be 1), as in the
     * reference. */
    real dtz = -fx2 * dj00 - fy2 * dj11 + NUM(2) * P.iz * (fx2 * P.tx * dj02 + fy2 * P.ty * dj12);

    const real tz = NUM(1) / P.iz, iw = NUM(1) / (tz + NUM(1e-7));
    dtx += G.x * V.fx * iw;
    dty += G.y * V.fy * iw;
    dtz -= (G.x * V.fx * P.ux + G.y * V.fy * P.uy) * iw * iw;
    for (int j = 0; j < 3; j++)
        out_xyz[j] = V.R[j] * dtx + V.R[3 + j] * dty + V.R[6 + j] * dtz;

    /* Sigma = M^T M with M = diag(s) R^T. */
    real E[9]; /* dL/dR[j][k] at 3j + k */
    for (int kk = 0; kk < 3; kk++) {
        real ds = r_set(0);
        for (int j = 0; j < 3; j++) {
            const real dM = NUM(2) * P.s[kk] *
                            (P.R[kk] * D[j] + P.R[3 + kk] * D[3 + j] + P.R[6 + kk] * D[6 + j]);
            ds += P.R[3 * j + kk] * dM;
            E[3 * j + kk] = P.s[kk] * dM;
        }
        out_scale[kk] = ds * P.s[kk];
    }
    const real r = P.q[0], x = P.q[1], y = P.q[2], z = P.q[3];
    const real d[4] = {
        NUM(2) * (z * (E[3] - E[1]) + y * (E[2] - E[6]) + x * (E[7] - E[5])),
        NUM(2) * (y * (E[1] + E[3]) + z * (E[2] + E[6]) + r * (E[7] - E[5]) -
                  NUM(2) * x * (E[4] + E[8])),
        NUM(2) * (x * (E[1] + E[3]) + r * (E[2] - E[6]) + z * (E[5] + E[7]) -
                  NUM(2) * y * (E[0] + E[8])),
        NUM(2) * (r * (E[3] - E[1]) + x * (E[2] + E[6]) + y * (E[5] + E[7]) -
                  NUM(2) * z * (E[0] + E[4])),
    };
    const real dot = P.q[0] * d[0] + P.q[1] * d[1] + P.q[2] * d[2] + P.q[3] * d[3];
    for (int i = 0; i < 4; i++)
        out_rot[i] = (d[i] - P.q[i] * dot) / P.qlen;
}

#undef V
#undef O
#undef P
#undef G

#endif
