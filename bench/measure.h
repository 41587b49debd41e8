/* SPDX-License-Identifier: Apache-2.0 */
#ifndef BENCH_MEASURE_H
#define BENCH_MEASURE_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "core/compare.h"
#include "splatguard/context.h"

/* Sorts v. */
static inline double median(double *v, int n)
{
    qsort(v, (size_t) n, sizeof(*v), sg_double_ascending);
    return v[n / 2];
}

static inline void bench_fail(const sg_ctx *ctx, const char *what)
{
    fprintf(stderr, "bench: %s: %s\n", what, ctx ? sg_last_error(ctx) : "");
    exit(4);
}

/* NULL where no file is asked for. */
static inline FILE *csv_open(const char *path)
{
    FILE *csv = path ? fopen(path, "w") : NULL;
    if (path && !csv) {
        perror(path);
        exit(1);
    }
    return csv;
}

/* A full disk shows at the end. csv: may be NULL. */
static inline void csv_close(FILE *csv, const char *path)
{
    const bool failed = csv && ferror(csv);
    if (csv && (fclose(csv) || failed)) {
        perror(path);
        exit(1);
    }
}

#endif
