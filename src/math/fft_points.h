/* SPDX-License-Identifier: Apache-2.0 */
/* Fourier transforms of a few points, in place and not normalised, of which those of any length are
 * made. Include a real_*.h or simd.h first. */
#ifndef SG_MATH_FFT_POINTS_H
#define SG_MATH_FFT_POINTS_H

struct fft_value {
    real re, im;
};

SG_FN STRUCT(fft_value) fft_value_of(real re, real im)
{
    STRUCT(fft_value) v;
    v.re = re;
    v.im = im;
    return v;
}

SG_FN STRUCT(fft_value) fft_add(STRUCT(fft_value) a, STRUCT(fft_value) b)
{
    return fft_value_of(a.re + b.re, a.im + b.im);
}

SG_FN STRUCT(fft_value) fft_subtract(STRUCT(fft_value) a, STRUCT(fft_value) b)
{
    return fft_value_of(a.re - b.re, a.im - b.im);
}

/* a times re + i im */
SG_FN STRUCT(fft_value) fft_multiply(STRUCT(fft_value) a, scalar re, scalar im)
{
    return fft_value_of(a.re * re - a.im * im, a.re * im + a.im * re);
}

SG_FN void fft_two(INOUT_ARRAY(STRUCT(fft_value), x, 2))
{
    const STRUCT(fft_value) a = x[0];
    x[0] = fft_add(a, x[1]);
    x[1] = fft_subtract(a, x[1]);
}

SG_FN void fft_four(INOUT_ARRAY(STRUCT(fft_value), x, 4))
{
    const STRUCT(fft_value) a = fft_add(x[0], x[2]), b = fft_subtract(x[0], x[2]),
                            c = fft_add(x[1], x[3]), d = fft_subtract(x[1], x[3]);
    x[0] = fft_add(a, c);
    x[2] = fft_subtract(a, c);
    x[1] = fft_value_of(b.re + d.im, b.im - d.re);
    x[3] = fft_value_of(b.re - d.im, b.im + d.re);
}

SG_FN void fft_eight(INOUT_ARRAY(STRUCT(fft_value), x, 8))
{
    const scalar root = NUM(0.707106781f);
    STRUCT(fft_value) even[4], odd[4];
    even[0] = x[0];
    even[1] = x[2];
    even[2] = x[4];
    even[3] = x[6];
    odd[0] = x[1];
    odd[1] = x[3];
    odd[2] = x[5];
    odd[3] = x[7];
    fft_four(even);
    fft_four(odd);
    odd[1] = fft_value_of((odd[1].re + odd[1].im) * root, (odd[1].im - odd[1].re) * root);
    odd[2] = fft_value_of(odd[2].im, -odd[2].re);
    odd[3] = fft_value_of((odd[3].im - odd[3].re) * root, (odd[3].re + odd[3].im) * -root);
    for (int k = 0; k < 4; k++) {
        x[k] = fft_add(even[k], odd[k]);
        x[k + 4] = fft_subtract(even[k], odd[k]);
    }
}

SG_FN void fft_three(INOUT_ARRAY(STRUCT(fft_value), x, 3))
{
    const scalar sine = NUM(0.866025404f);
    const STRUCT(fft_value) a = fft_add(x[1], x[2]), b = fft_subtract(x[1], x[2]);
    const STRUCT(fft_value) m =
        fft_value_of(x[0].re - NUM(0.5f) * a.re, x[0].im - NUM(0.5f) * a.im),
                            s = fft_value_of(sine * b.im, sine * b.re);
    x[0] = fft_add(x[0], a);
    x[1] = fft_value_of(m.re + s.re, m.im - s.im);
    x[2] = fft_value_of(m.re - s.re, m.im + s.im);
}

SG_FN void fft_five(INOUT_ARRAY(STRUCT(fft_value), x, 5))
{
    /* sqrt(5) / 4, sines of 72 and 36 degrees */
    const scalar root5 = NUM(0.559016994f), sine1 = NUM(0.951056516f), sine2 = NUM(0.587785252f);
    const STRUCT(fft_value) a = fft_add(x[1], x[4]), b = fft_subtract(x[1], x[4]),
                            c = fft_add(x[2], x[3]), d = fft_subtract(x[2], x[3]);
    const STRUCT(fft_value) sum = fft_add(a, c), m = fft_value_of(x[0].re - NUM(0.25f) * sum.re,
                                                                  x[0].im - NUM(0.25f) * sum.im);
    const STRUCT(fft_value) t = fft_value_of(root5 * (a.re - c.re), root5 * (a.im - c.im)),
                            p = fft_add(m, t), q = fft_subtract(m, t);
    const STRUCT(fft_value)
        s1 = fft_value_of(sine1 * b.im + sine2 * d.im, sine1 * b.re + sine2 * d.re),
        s2 = fft_value_of(sine2 * b.im - sine1 * d.im, sine2 * b.re - sine1 * d.re);
    x[0] = fft_add(x[0], sum);
    x[1] = fft_value_of(p.re + s1.re, p.im - s1.im);
    x[4] = fft_value_of(p.re - s1.re, p.im + s1.im);
    x[2] = fft_value_of(q.re + s2.re, q.im - s2.im);
    x[3] = fft_value_of(q.re - s2.re, q.im + s2.im);
}

#endif
