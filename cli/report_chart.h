/* SPDX-License-Identifier: Apache-2.0 */
/* Charts of a run's page. */
#ifndef CLI_REPORT_CHART_H
#define CLI_REPORT_CHART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

/* What a line of log.jsonl has for them. */
enum column { C_ITERATION, C_GAUSSIANS, C_LOSS, C_PSNR, C_INSTANCES, C_MEMORY, COLUMNS };

struct curves {
    double (*rows)[COLUMNS]; /* NAN: not known */
    size_t n;
    double (*tests)[2]; /* iteration, PSNR of the test views */
    size_t n_tests;
};

/* A column over the iterations, or nothing where the log has none of it or no numbers that can be
 * drawn. limit: a line across, or 0. tests: with a mark for each PSNR of the test views. title: for
 * HTML. */
void put_curve(FILE *f, const struct curves *c, enum column column, double limit, bool tests,
               const char *title);

struct bar {
    const char *name;
    double value;
};

/* A table of values and their shares of the sum; nothing where that is 0. */
void put_bars(FILE *f, const struct bar *bars, size_t n, double scale, int digits, const char *unit,
              const char *title);

#endif
