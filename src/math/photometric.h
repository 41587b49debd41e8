/* SPDX-License-Identifier: Apache-2.0 */
/* SSIM (Wang et al. 2004) at one position and its partial derivatives, from the windowed moments.
 * Include a real_*.h or simd.h first. */
#ifndef SG_MATH_PHOTOMETRIC_H
#define SG_MATH_PHOTOMETRIC_H

#define SG_SSIM_TAPS 11
#define SG_SSIM_RADIUS 5
#define SG_SSIM_C1 0.0001f
#define SG_SSIM_C2 0.0009f

/* Gaussian, sigma 1.5, normalised to sum 1. */
SG_TABLE float sg_ssim_window[SG_SSIM_TAPS] = {
    0.00102838008f, 0.00759875814f, 0.03600077213f, 0.10936068951f, 0.21300553771f, 0.26601172486f,
    0.21300553771f, 0.10936068951f, 0.03600077213f, 0.00759875814f, 0.00102838008f};

/* S; d_m is dS/d(m1) with the second moments' dependence folded in, d_xx = dS/d(squares), d_xy =
 * dS/d(xy). */
struct ssim {
    real s, d_m, d_xx, d_xy;
};

/* m1 = w*x, m2 = w*y, squares = w*(x^2 + y^2), xy = w*xy: the variances are only ever used as a
 * sum. */
SG_FN STRUCT(ssim) ssim_point(real m1, real m2, real squares, real xy)
{
    const scalar c1 = NUM(SG_SSIM_C1), c2 = NUM(SG_SSIM_C2), two = NUM(2);
    const real a1 = two * m1 * m2 + c1, a2 = two * (xy - m1 * m2) + c2;
    const real b1 = m1 * m1 + m2 * m2 + c1;
    /* In exact arithmetic a variance; of values far above 1 its rounding may be below -c2. */
    const real b2 = r_max(squares - m1 * m1 - m2 * m2, r_set(0)) + c2;
    const real inv = NUM(1) / (b1 * b2), s = a1 * a2 * inv;
    const real p_a1 = a2 * inv, p_a2 = a1 * inv, p_b1 = -s * b2 * inv, p_b2 = -s * b1 * inv;
    STRUCT(ssim) o;
    o.s = s;
    o.d_m = two * (m2 * (p_a1 - p_a2) + m1 * (p_b1 - p_b2));
    o.d_xx = p_b2;
    o.d_xy = two * p_a2;
    return o;
}

/* Whether a difference d from a photo's value counts in the low-pass term: not where the photo is
 * within the tolerance of black and the render darker, or of white and the render brighter. */
SG_FN mask low_pass_counts(real d, real photo, scalar tolerance)
{
    const real none = r_set(0), one = r_set(1);
    const mask below = r_and(r_lt(photo, r_set(tolerance)), r_lt(d, none)),
               above = r_and(r_lt(r_set(NUM(1) - tolerance), photo), r_lt(none, d));
    return r_lt(r_sel(below, one, none) + r_sel(above, one, none), one);
}

/* The nearest value to the render x within the tolerance of the photo's. */
SG_FN real photometric_target(real x, real photo, real tolerance)
{
    return r_min(r_max(x, photo - tolerance), photo + tolerance);
}

/* dL/dx from the windowed derivatives of SSIM. l1, dssim: weights of both terms. tolerant: there is
 * no gradient where the target is the render itself. */
SG_FN real photometric_gradient(real x, real target, real d_m, real d_xx, real d_xy, scalar l1,
                                scalar dssim, bool tolerant)
{
    const real ds = d_m + NUM(2) * x * d_xx + target * d_xy;
    const real one = r_set(NUM(1)), none = r_set(NUM(0));
    const real sign_ = r_sel(r_lt(target, x), one, none) - r_sel(r_lt(x, target), one, none);
    const real g = l1 * sign_ + dssim * ds;
    return tolerant ? g * (sign_ * sign_) : g;
}

#endif
