/* SPDX-License-Identifier: Apache-2.0 */
/* View-dependent colour from real spherical harmonics of degree 0..3, and its gradient.
 * Include a real_*.h or simd.h first. */
#ifndef SG_MATH_SH_H
#define SG_MATH_SH_H

#include "constants.h"

#define SG_SH_C1 0.4886025119029199f

/* basis[(degree + 1)^2] for the unit direction (x, y, z). */
static inline void sh_basis(int degree, real x, real y, real z, real *basis)
{
    basis[0] = r_set((scalar) SG_SH_C0);
    if (degree < 1)
        return;
    const scalar c1 = (scalar) SG_SH_C1;
    basis[1] = -c1 * y, basis[2] = c1 * z, basis[3] = -c1 * x;
    if (degree < 2)
        return;
    const real xx = x * x, yy = y * y, zz = z * z;
    basis[4] = (scalar) 1.0925484305920792f * x * y;
    basis[5] = (scalar) -1.0925484305920792f * y * z;
    basis[6] = (scalar) 0.31539156525252005f * ((scalar) 2 * zz - xx - yy);
    basis[7] = (scalar) -1.0925484305920792f * x * z;
    basis[8] = (scalar) 0.5462742152960396f * (xx - yy);
    if (degree < 3)
        return;
    basis[9] = (scalar) -0.5900435899266435f * y * ((scalar) 3 * xx - yy);
    basis[10] = (scalar) 2.890611442640554f * x * y * z;
    basis[11] = (scalar) -0.4570457994644658f * y * ((scalar) 4 * zz - xx - yy);
    basis[12] =
        (scalar) 0.3731763325901154f * z * ((scalar) 2 * zz - (scalar) 3 * xx - (scalar) 3 * yy);
    basis[13] = (scalar) -0.4570457994644658f * x * ((scalar) 4 * zz - xx - yy);
    basis[14] = (scalar) 1.445305721320277f * z * (xx - yy);
    basis[15] = (scalar) -0.5900435899266435f * x * (xx - (scalar) 3 * yy);
}

/* Gradient of sum_k w_k basis_k with respect to (x, y, z) taken as independent; w has (degree +
 * 1)^2 entries. */
static inline void sh_direction_gradient(int degree, real x, real y, real z, const real *w, real *d)
{
    d[0] = d[1] = d[2] = r_set(0);
    if (degree < 1)
        return;
    const scalar c1 = (scalar) SG_SH_C1;
    d[0] -= c1 * w[3], d[1] -= c1 * w[1], d[2] += c1 * w[2];
    if (degree < 2)
        return;
    const scalar a = (scalar) 1.0925484305920792f, b = (scalar) 0.31539156525252005f,
                 c = (scalar) 0.5462742152960396f;
    const scalar two = 2, three = 3, four = 4, six = 6, eight = 8;
    d[0] += a * y * w[4] - two * b * x * w[6] - a * z * w[7] + two * c * x * w[8];
    d[1] += a * x * w[4] - a * z * w[5] - two * b * y * w[6] - two * c * y * w[8];
    d[2] += -a * y * w[5] + four * b * z * w[6] - a * x * w[7];
    if (degree < 3)
        return;
    const real xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
    const scalar e = (scalar) -0.5900435899266435f, f = (scalar) 2.890611442640554f,
                 g = (scalar) -0.4570457994644658f, h = (scalar) 0.3731763325901154f,
                 i = (scalar) 1.445305721320277f;
    d[0] += e * six * xy * w[9] + f * yz * w[10] - g * two * xy * w[11] - h * six * xz * w[12] +
            g * (four * zz - three * xx - yy) * w[13] + i * two * xz * w[14] +
            e * three * (xx - yy) * w[15];
    d[1] += e * three * (xx - yy) * w[9] + f * xz * w[10] +
            g * (four * zz - xx - three * yy) * w[11] - h * six * yz * w[12] -
            g * two * xy * w[13] - i * two * yz * w[14] - e * six * xy * w[15];
    d[2] += f * xy * w[10] + g * eight * yz * w[11] + h * three * (two * zz - xx - yy) * w[12] +
            g * eight * xz * w[13] + i * (xx - yy) * w[14];
}

#endif
