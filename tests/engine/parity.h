/* SPDX-License-Identifier: Apache-2.0 */
/* How far an engine may be from the oracle, and how far it is. With SG_PARITY=FILE a program adds
 * what it has measured to that file when it ends: rows of quantity, engine, largest difference and
 * bound, from which bench/parity.sh makes a table. */
#ifndef TESTS_ENGINE_PARITY_H
#define TESTS_ENGINE_PARITY_H

#include "models.h"

static struct {
    char quantity[64], engine[32];
    double largest, bound;
} parity[256];
static size_t parity_rows;

static inline void write_parity(void)
{
    FILE *f = fopen(getenv("SG_PARITY"), "a");
    for (size_t i = 0; f && i < parity_rows; i++)
        fprintf(f, "%s\t%s\t%.3g\t%g\n", parity[i].quantity, parity[i].engine, parity[i].largest,
                parity[i].bound);
    if (f)
        fclose(f);
}

/* A difference that must not be larger than its bound. */
static inline void assert_within(const char *engine, const char *quantity, double difference,
                                 double bound)
{
    if (!(difference <= bound))
        fail_msg("%s: %s: off by %.3g, expected at most %g", engine, quantity, difference, bound);
    if (!getenv("SG_PARITY"))
        return;
    if (!parity_rows)
        atexit(write_parity);
    size_t i = 0;
    while (i < parity_rows &&
           (strcmp(parity[i].engine, engine) || strcmp(parity[i].quantity, quantity)))
        i++;
    assert_true(i < sizeof(parity) / sizeof(parity[0]));
    if (i == parity_rows) {
        snprintf(parity[i].quantity, sizeof(parity[i].quantity), "%s", quantity);
        snprintf(parity[i].engine, sizeof(parity[i].engine), "%s", engine);
        parity_rows++;
    }
    parity[i].largest = fmax(parity[i].largest, difference);
    parity[i].bound = bound;
}

/* The largest difference between two lists of numbers; infinity where one is not a number. skip, or
 * NULL: places that are left out, again and again every `plane` numbers. */
static inline double difference_of(const float *a, const float *b, size_t n, const uint8_t *skip,
                                   size_t plane)
{
    double most = 0;
    for (size_t i = 0; i < n; i++) {
        const double d = fabs((double) a[i] - (double) b[i]);
        if (!(skip && skip[i % plane]) && !(d <= most))
            most = isnan(d) ? (double) INFINITY : d;
    }
    return most;
}

static inline double largest_of(const float *a, size_t n)
{
    double most = 0;
    for (size_t i = 0; i < n; i++)
        most = fmax(most, fabs((double) a[i]));
    return most;
}

/* Of each plane of the parameters, the largest difference as a share of the largest value. */
static inline void assert_gradients(const char *engine, const char *quantity,
                                    const struct sg_model *found, const struct sg_model *expected,
                                    double bound)
{
    const size_t n = expected->count;
    double most = 0;
    assert_int_equal(found->count, n);
    float *a = calloc(n, sizeof(float)), *b = calloc(n, sizeof(float));
    assert_true(a && b);
    for (int p = 0; p < sg_param_count(expected->sh_degree); p++) {
        for (size_t i = 0; i < n; i++)
            a[i] = *sg_model_at(found, i, p), b[i] = *sg_model_at(expected, i, p);
        const double share = difference_of(a, b, n, NULL, 1) / (largest_of(b, n) + 1e-9);
        if (!(share <= bound))
            fprintf(stderr, "plane %d:\n", p);
        most = fmax(most, share);
    }
    assert_within(engine, quantity, most, bound);
    free(a);
    free(b);
}

#endif
