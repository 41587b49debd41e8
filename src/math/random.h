/* SPDX-License-Identifier: Apache-2.0 */
/* The random numbers of core/rng.h where there are neither 64-bit integers nor doubles: the same
 * bits, and normals that are the same but for rounding. They are computed without functions of the
 * language whose precision a device may choose. Include a real_*.h first. */
#ifndef SG_MATH_RANDOM_H
#define SG_MATH_RANDOM_H

/* 64 bits. */
struct words {
    WORD low, high;
};

SG_FN STRUCT(words) words_of(WORD low, WORD high)
{
    STRUCT(words) w;
    w.low = low, w.high = high;
    return w;
}

SG_FN STRUCT(words) words_add(STRUCT(words) a, STRUCT(words) b)
{
    const WORD low = a.low + b.low;
    return words_of(low, a.high + b.high + (low < a.low ? 1u : 0u));
}

/* a ^ a >> n, n from 1 to 31 */
SG_FN STRUCT(words) words_fold(STRUCT(words) a, int n)
{
    return words_of(a.low ^ (a.low >> n | a.high << (32 - n)), a.high ^ a.high >> n);
}

SG_FN STRUCT(words) words_multiply(STRUCT(words) a, STRUCT(words) b)
{
    const WORD a0 = a.low & 0xffffu, a1 = a.low >> 16, b0 = b.low & 0xffffu, b1 = b.low >> 16;
    const WORD cross = a1 * b0 + (a0 * b0 >> 16);
    const WORD carry = (cross & 0xffffu) + a0 * b1;
    return words_of(a.low * b.low,
                    a1 * b1 + (cross >> 16) + (carry >> 16) + a.low * b.high + a.high * b.low);
}

/* sg_rng_mix */
SG_FN STRUCT(words) random_mix(STRUCT(words) x)
{
    x = words_fold(words_add(x, words_of(0x7f4a7c15u, 0x9e3779b9u)), 30);
    x = words_fold(words_multiply(x, words_of(0x1ce4e5b9u, 0xbf58476du)), 27);
    return words_fold(words_multiply(x, words_of(0x133111ebu, 0x94d049bbu)), 31);
}

/* ln((1 + s) / (1 - s)), s from 0 to 1/3 */
SG_FN float random_log_ratio(float s)
{
    const float q = s * s;
    return 2.0f * s *
           (1.0f + q * (1.0f / 3 +
                        q * (1.0f / 5 +
                             q * (1.0f / 7 +
                                  q * (1.0f / 9 + q * (1.0f / 11 + q * (1.0f / 13 + q / 15)))))));
}

/* -ln((x + 1) / 2^32), x a word */
SG_FN float random_minus_log(WORD x)
{
    if (x >= 0x80000000u) { /* of 1 - t */
        const float t = TO_FLOAT(0xffffffffu - x) * 2.3283064365386963e-10f;
        return random_log_ratio(t / (2.0f - t));
    }
    WORD m = x + 1u;
    int halvings = 0; /* m / 2^32 = (1 to 2) / 2^halvings */
    for (; m < 0x80000000u; halvings++)
        m <<= 1;
    const float mantissa = TO_FLOAT(m) * 4.656612873077393e-10f;
    return TO_FLOAT(halvings + 1) * 0.693147180559945f -
           random_log_ratio((mantissa - 1.0f) / (mantissa + 1.0f));
}

/* cos(2 pi x / 2^32), x a word */
SG_FN float random_cosine(WORD x)
{
    const WORD quarter = x >> 30, rest = x & 0x3fffffffu;
    const bool upper = rest > 0x20000000u; /* nearer to the end of its quarter */
    const float angle = TO_FLOAT(upper ? 0x40000000u - rest : rest) * 1.4629180792671596e-09f;
    const float q = angle * angle;
    const bool sine = (quarter == 1u || quarter == 3u) != upper;
    const float size =
        sine ? angle * (1.0f - q / 6 * (1.0f - q / 20 * (1.0f - q / 42 * (1.0f - q / 72))))
             : 1.0f - q / 2 * (1.0f - q / 12 * (1.0f - q / 30 * (1.0f - q / 56 * (1.0f - q / 90))));
    return quarter == 1u || quarter == 2u ? -size : size;
}

/* Standard normal from the bits that sg_rng_normal draws. */
SG_FN float random_normal(STRUCT(words) bits)
{
    return r_sqrt(2.0f * random_minus_log(bits.high)) * random_cosine(bits.low);
}

#endif
