/* SPDX-License-Identifier: Apache-2.0 */
/* View-dependent colour from real spherical harmonics of degree 0..3, and its gradient.
 * Include a real_*.h or simd.h first. */
#ifndef SG_MATH_SH_H
#define SG_MATH_SH_H

#include "constants.h"

#define SG_SH_C1 0.4886025119029199f

/* basis[(degree + 1)^2] for the unit direction (x, y, z). */
SG_FN void sh_basis(int degree, real x, real y, real z, OUT_ARRAY(real, basis, 16))
{
    basis[0] = r_set(NUM(SG_SH_C0));
    if (degree < 1)
        return;
    const scalar c1 = NUM(SG_SH_C1);
    basis[1] = -c1 * y, basis[2] = c1 * z, basis[3] = -c1 * x;
    if (degree < 2)
        return;
    const real xx = x * x, yy = y * y, zz = z * z;
    basis[4] = NUM(1.0925484305920792f) * x * y;
    basis[5] = NUM(-1.0925484305920792f) * y * z;
    basis[6] = NUM(0.31539156525252005f) * (NUM(2) * zz - xx - yy);
    basis[7] = NUM(-1.0925484305920792f) * x * z;
    basis[8] = NUM(0.5462742152960396f) * (xx - yy);
    if (degree < 3)
        return;
    basis[9] = NUM(-0.5900435899266435f) * y * (NUM(3) * xx - yy);
    basis[10] = NUM(2.890611442640554f) * x * y * z;
    basis[11] = NUM(-0.4570457994644658f) * y * (NUM(4) * zz - xx - yy);
    basis[12] = NUM(0.3731763325901154f) * z * (NUM(2) * zz - NUM(3) * xx - NUM(3) * yy);
    basis[13] = NUM(-0.4570457994644658f) * x * (NUM(4) * zz - xx - yy);
    basis[14] = NUM(1.445305721320277f) * z * (xx - yy);
    basis[15] = NUM(-0.5900435899266435f) * x * (xx - NUM(3) * yy);
}

/* Gradient of sum_k w_k basis_k with respect to (x, y, z) taken as independent; w has (degree +
 * 1)^2 entries. */
SG_FN void sh_direction_gradient(int degree, real x, real y, real z, IN_ARRAY(real, w, 16),
                                 OUT_ARRAY(real, d, 3))
{
    d[0] = d[1] = d[2] = r_set(0);
    if (degree < 1)
        return;
    const scalar c1 = NUM(SG_SH_C1);
    d[0] -= c1 * w[3], d[1] -= c1 * w[1], d[2] += c1 * w[2];
    if (degree < 2)
        return;
    const scalar a = NUM(1.0925484305920792f), b = NUM(0.31539156525252005f),
                 c = NUM(0.5462742152960396f);
    const scalar two = NUM(2), three = NUM(3), four = NUM(4), six = NUM(6), eight = NUM(8);
    d[0] += a * y * w[4] - two * b * x * w[6] - a * z * w[7] + two * c * x * w[8];
    d[1] += a * x * w[4] - a * z * w[5] - two * b * y * w[6] - two * c * y * w[8];
    d[2] += -a * y * w[5] + four * b * z * w[6] - a * x * w[7];
    if (degree < 3)
        return;
    const real xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
    const scalar e = NUM(-0.5900435899266435f), f = NUM(2.890611442640554f),
                 g = NUM(-0.4570457994644658f), h = NUM(0.3731763325901154f),
                 i = NUM(1.445305721320277f);
    d[0] += e * six * xy * w[9] + f * yz * w[10] - g * two * xy * w[11] - h * six * xz * w[12] +
            g * (four * zz - three * xx - yy) * w[13] + i * two * xz * w[14] +
            e * three * (xx - yy) * w[15];
    d[1] += e * three * (xx - yy) * w[9] + f * xz * w[10] +
            g * (four * zz - xx - three * yy) * w[11] - h * six * yz * w[12] -
            g * two * xy * w[13] - i * two * yz * w[14] - e * six * xy * w[15];
    d[2] += f * xy * w[10] + g * eight * yz * w[11] + h * three * (two * zz - xx - yy) * w[12] +
            g * eight * xz * w[13] + i * (xx - yy) * w[14];
}

/* The direction from a centre to a position. Returns 1 / the distance. */
SG_FN real sh_direction(IN_ARRAY(real, xyz, 3), IN_ARRAY(scalar, centre, 3),
                        OUT_ARRAY(real, dir, 3))
{
    for (int i = 0; i < 3; i++)
        dir[i] = xyz[i] - centre[i];
    const real inv = NUM(1) / r_sqrt(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2]);
    for (int i = 0; i < 3; i++)
        dir[i] *= inv;
    return inv;
}

/* Adds to dL/dposition what comes of dL/ddirection, d. */
SG_FN void sh_direction_pull(IN_ARRAY(real, d, 3), IN_ARRAY(real, dir, 3), real inv,
                             INOUT_ARRAY(real, xyz, 3))
{
    const real dot_ = d[0] * dir[0] + d[1] * dir[1] + d[2] * dir[2];
    for (int i = 0; i < 3; i++)
        xyz[i] += (d[i] - dir[i] * dot_) * inv;
}

/* Whether a colour is one; NaN is not. */
SG_FN mask colour_sound(real c)
{
    return r_and(r_lt(c, r_set(NUM(SG_COLOUR_MAX))), r_lt(r_set(NUM(-SG_COLOUR_MAX)), c));
}

/* As it is drawn. The backward pass knows the clamped by their 0. */
SG_FN real colour_drawn(real c)
{
    return r_sel(r_lt(c, r_set(NUM(-SG_COLOUR_ROUNDING))), r_set(NUM(0)),
                 r_max(c, r_set(NUM(1e-30f))));
}

/* A colour that is clamped passes no gradient. */
SG_FN real colour_pull(real drawn, real g)
{
    return r_sel(r_lt(r_set(NUM(0)), drawn), g, r_set(NUM(0)));
}

#endif
