/* SPDX-License-Identifier: Apache-2.0 */
#ifndef BENCH_MEASURE_H
#define BENCH_MEASURE_H

#include <stdio.h>
#include <stdlib.h>

#include "splatguard/context.h"

static inline int ascending(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

/* Sorts v. */
static inline double median(double *v, int n)
{
    qsort(v, (size_t) n, sizeof(*v), ascending);
    return v[n / 2];
}

static inline void bench_fail(const sg_ctx *ctx, const char *what)
{
    fprintf(stderr, "bench: %s: %s\n", what, ctx ? sg_last_error(ctx) : "");
    exit(4);
}

#endif
