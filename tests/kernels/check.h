/* SPDX-License-Identifier: Apache-2.0 */
/* Kernels one at a time: each is compared with its oracle and timed next to it. checkkernels.c
 * lists them; a file check_*.c has the checks of one kind. */
#ifndef TESTS_KERNELS_CHECK_H
#define TESTS_KERNELS_CHECK_H

#include "models.h"

#include "core/clock.h"
#include "engine/cpu/dispatch.h"

struct kernel_check {
    const char *name;
    const char *unit; /* of the time that bench returns */
    bool portable;    /* plain C, the same on every instruction set: checked once */
    /* Compares a variant's kernel with the oracle. A difference ends it, by fail_msg. */
    void (*check)(const struct cpu_kernels *kernels);
    /* Nanoseconds per unit of the variant's kernel; NULL: of the oracle. */
    double (*bench)(const struct cpu_kernels *kernels);
};

/* The fastest of several runs, which other work on the machine disturbs least:
 *
 *     struct timing t = {0};
 *     while (timing_again(&t))
 *         kernel(...);
 *     return timing_result(&t, units of one run);
 */
struct timing {
    double begin, last, fastest;
    int runs;
};

static inline bool timing_again(struct timing *t)
{
    const double now = sg_seconds();
    if (!t->runs)
        t->begin = now;
    else if (t->runs == 1 || now - t->last < t->fastest)
        t->fastest = now - t->last;
    const bool again = t->runs < 5 || (t->runs < 1000 && now - t->begin < 0.1);
    t->runs++;
    t->last = sg_seconds();
    return again;
}

static inline double timing_result(const struct timing *t, double units)
{
    return 1e9 * t->fastest / units;
}

static inline void *must(size_t n, size_t size)
{
    void *p = aligned_alloc(64, (n * size + 64) / 64 * 64);
    assert_non_null(p);
    return p;
}

/* n floats, drawn from [low, high). */
static inline float *random_floats(size_t n, uint64_t seed, float low, float high)
{
    float *p = must(n, sizeof(float));
    for (size_t i = 0; i < n; i++)
        p[i] = draw(seed, i, low, high);
    return p;
}

#endif
