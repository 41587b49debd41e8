/* SPDX-License-Identifier: Apache-2.0 */
/* Counter-based random numbers: a value depends only on (seed, stream, index), so that any thread
 * or device can draw any of them, and resuming needs no state. */
#ifndef SG_CORE_RNG_H
#define SG_CORE_RNG_H

#include <math.h>
#include <stdint.h>

/* The use of the numbers. It is mixed into the stream, so that two uses never share numbers. */
enum sg_rng_use {
    SG_RNG_VIEWS = 1,
    SG_RNG_INIT = 2,
    SG_RNG_SPLIT = 3,
    SG_RNG_BACKGROUND = 4,
    SG_RNG_SYNTH = 5,
    SG_RNG_NOISE = 6,
    SG_RNG_POISONED = 7,
    SG_RNG_COUNTED = 8,
    SG_RNG_DRIFT = 9,
    SG_RNG_RELOCATE = 10,
    SG_RNG_GROW = 11,
    SG_RNG_EXPLORE = 12,
    SG_RNG_REPLACE = 13,
    SG_RNG_NETWORKS = 14,
    SG_RNG_ANCHORS = 15
};

static inline uint64_t sg_rng_mix(uint64_t x) /* the finaliser of splitmix64 (Steele et al. 2014) */
{
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
}

/* Of all numbers of a stream. */
static inline uint64_t sg_rng_key(uint64_t seed, enum sg_rng_use use, uint64_t stream)
{
    return sg_rng_mix(sg_rng_mix(seed ^ (uint64_t) use << 56) + stream);
}

static inline uint64_t sg_rng_u64(uint64_t seed, enum sg_rng_use use, uint64_t stream,
                                  uint64_t index)
{
    return sg_rng_mix(sg_rng_key(seed, use, stream) + index);
}

/* In [0, 1). */
static inline float sg_rng_uniform(uint64_t seed, enum sg_rng_use use, uint64_t stream,
                                   uint64_t index)
{
    return (float) (sg_rng_u64(seed, use, stream, index) >> 40) * 0x1p-24f;
}

/* Standard normal by Box and Muller. */
static inline float sg_rng_normal(uint64_t seed, enum sg_rng_use use, uint64_t stream,
                                  uint64_t index)
{
    uint64_t bits = sg_rng_u64(seed, use, stream, index);
    double u = ((double) (bits >> 32) + 1) * 0x1p-32, v = (double) (bits & 0xffffffffu) * 0x1p-32;
    return (float) (sqrt(-2 * log(u)) * cos(6.283185307179586 * v));
}

#endif
