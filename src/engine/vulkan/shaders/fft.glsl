/* SPDX-License-Identifier: Apache-2.0 */
/* The Fourier transform of a line of complex numbers by one workgroup, in shared memory, or in
 * device memory where the line is longer. The tables are the host's (spectral/fft.h); stages go from
 * short transforms to long ones, and each reads one half of the room and writes the other. Backward
 * transforms are forward ones whose real and imaginary parts are exchanged. */
#include "math/fft_points.h"

layout(local_size_x = VK_LINE_GROUP) in;
layout(constant_id = 1) const uint FAR = 0; /* 1: in device memory */

layout(buffer_reference, std430, buffer_reference_align = 8) coherent buffer Points {
    vec2 v[];
};

shared vec2 near_points[2 * VK_LINE];
Points far_points; /* this workgroup's room */
uint from_half, to_half;

/* Room for two halves of `points` in the buffer `room`, of which each workgroup has its own. */
void line_room(Points room, uint points)
{
    far_points = room;
    from_half = FAR != 0 ? group_index() * 2 * points : 0;
    to_half = from_half + (FAR != 0 ? points : VK_LINE);
}

vec2 line_get(uint k)
{
    return FAR != 0 ? far_points.v[from_half + k] : near_points[from_half + k];
}

void line_put(uint k, vec2 value)
{
    if (FAR != 0)
        far_points.v[to_half + k] = value;
    else
        near_points[to_half + k] = value;
}

/* What was put can be got. */
void line_turn()
{
    if (FAR != 0)
        memoryBarrierBuffer();
    barrier(); /* all have put, and all have got what they need of the other half */
    const uint half_way = from_half;
    from_half = to_half;
    to_half = half_way;
}

vec2 table_at(uint at)
{
    return vec2(a.tables.v[at], a.tables.v[at + 1]);
}

vec2 complex_product(vec2 x, vec2 y)
{
    return vec2(x.x * y.x - x.y * y.y, x.x * y.y + x.y * y.x);
}

/* Place of point k of part j in the line, of a stage that joins `radix` parts of `rest` points. */
struct line_stage {
    uint radix, rest, apart, twiddles, roots;
};

fft_value stage_get(line_stage s, uint k, uint q, uint j)
{
    const vec2 x = line_get((k * s.radix + j) * s.apart + q);
    const fft_value v = fft_value_of(x.x, x.y);
    if (j == 0)
        return v;
    const vec2 w = table_at(s.twiddles + 2 * (k * (s.radix - 1) + j - 1));
    return fft_multiply(v, w.x, w.y);
}

void stage_put(line_stage s, uint k, uint q, uint p, fft_value v)
{
    line_put((k + s.rest * p) * s.apart + q, vec2(v.re, v.im));
}

#define STAGE(radix, transform)                                                                    \
    {                                                                                              \
        fft_value x[radix];                                                                        \
        for (uint j = 0; j < radix; j++)                                                           \
            x[j] = stage_get(s, k, q, j);                                                          \
        transform(x);                                                                              \
        for (uint j = 0; j < radix; j++)                                                           \
            stage_put(s, k, q, j, x[j]);                                                           \
    }

/* By definition, for larger primes. */
void stage_prime(line_stage s, uint k, uint q)
{
    for (uint p = 0; p < s.radix; p++) {
        fft_value sum = stage_get(s, k, q, 0);
        uint at = 0; /* j p modulo the radix */
        for (uint j = 1; j < s.radix; j++) {
            at = at + p < s.radix ? at + p : at + p - s.radix;
            const vec2 root = table_at(s.roots + 2 * at);
            sum = fft_add(sum, fft_multiply(stage_get(s, k, q, j), root.x, root.y));
        }
        stage_put(s, k, q, p, sum);
    }
}

/* The line has been put. Its transform can be got. */
void line_stages()
{
    const uint n = a.plan.v[VK_FFT_POINTS], stages = a.plan.v[VK_FFT_STAGES];
    line_turn();
    for (uint i = stages; i > 0; i--) {
        const uint at = VK_FFT_HEADER + 4 * (i - 1);
        line_stage s = line_stage(a.plan.v[at], a.plan.v[at + 1], 0, a.plan.v[at + 2],
                                  a.plan.v[at + 3]);
        s.apart = n / (s.radix * s.rest);
        for (uint b = gl_LocalInvocationID.x; b < n / s.radix; b += VK_LINE_GROUP) {
            const uint k = b / s.apart, q = b % s.apart;
            switch (s.radix) {
            case 1:
                stage_put(s, k, q, 0, stage_get(s, k, q, 0));
                break;
            case 2:
                STAGE(2, fft_two)
                break;
            case 3:
                STAGE(3, fft_three)
                break;
            case 4:
                STAGE(4, fft_four)
                break;
            case 5:
                STAGE(5, fft_five)
                break;
            case 8:
                STAGE(8, fft_eight)
                break;
            default:
                stage_prime(s, k, q);
            }
        }
        line_turn();
    }
}

/* The line of a.points points has been put. Its transform can be got. A length with a large prime
 * factor is a convolution with a chirp (Bluestein). */
void line_transform()
{
    const uint n = a.points, longer = a.plan.v[VK_FFT_POINTS], chirp = a.plan.v[VK_FFT_CHIRP],
               filter_at = a.plan.v[VK_FFT_FILTER];
    if (chirp == 0) {
        line_stages();
        return;
    }
    line_turn();
    for (uint k = gl_LocalInvocationID.x; k < longer; k += VK_LINE_GROUP)
        line_put(k, k < n ? complex_product(line_get(k), table_at(chirp + 2 * k)) : vec2(0.0));
    line_stages();
    for (uint k = gl_LocalInvocationID.x; k < longer; k += VK_LINE_GROUP)
        line_put(k, complex_product(line_get(k), table_at(filter_at + 2 * k)).yx);
    line_stages();
    for (uint k = gl_LocalInvocationID.x; k < n; k += VK_LINE_GROUP)
        line_put(k, complex_product(line_get(k).yx, table_at(chirp + 2 * k)));
    line_turn();
}
