/* SPDX-License-Identifier: Apache-2.0 */
/* Charts of a run's page: SVG, without a script. */
#include "report_chart.h"

#include <math.h>

#include "page.h"

#define WIDE 400 /* as a phone, so that letters stay as large as those of the text */
#define HIGH 240
#define LEFT 64
#define RIGHT 24 /* half of a number below the end of an axis */
#define BOTTOM 30
#define TOP 24

static void put_count(FILE *f, double v)
{
    if (fabs(v) >= 1e6)
        fprintf(f, "%.4g M", v / 1e6);
    else if (fabs(v) >= 1e4)
        fprintf(f, "%.4g k", v / 1e3);
    else
        fprintf(f, "%.4g", v);
}

/* A round step, of which at most four fit. */
static double step_of(double range)
{
    const double step = pow(10, floor(log10(range / 4)));
    for (int k = 0;; k++) {
        static const double units[] = {1, 2, 5, 10};
        if (k == 3 || range / (units[k] * step) <= 4)
            return units[k] * step;
    }
}

struct axes {
    double x[2], y[2];
};

/* The k-th number on an axis. Not by adding steps, which could be too small to change a number. */
static double tick(const double range[2], double step, int k)
{
    return (ceil(range[0] / step) + k) * step;
}

/* Numbers of a log can be any. An axis needs some that differ, by more than their rounding. */
static bool has_extent(const double range[2])
{
    const double extent = range[1] - range[0];
    return extent >= 1e-300 && extent <= 1e300 &&
           extent >= 1e-9 * fmax(fabs(range[0]), fabs(range[1]));
}

static double at_x(const struct axes *a, double v)
{
    return LEFT + (v - a->x[0]) / (a->x[1] - a->x[0]) * (WIDE - LEFT - RIGHT);
}

static double at_y(const struct axes *a, double v)
{
    return HIGH - BOTTOM - (v - a->y[0]) / (a->y[1] - a->y[0]) * (HIGH - BOTTOM - TOP);
}

static void put_axes(FILE *f, const struct axes *a, const char *title)
{
    const double step = step_of(a->y[1] - a->y[0]), along = step_of(a->x[1] - a->x[0]);
    fprintf(f,
            "<figure><svg role=img aria-label=\"%s\" viewBox=\"0 0 %d %d\" width=%d height=%d>\n",
            title, WIDE, HIGH, WIDE, HIGH);
    double v;
    for (int k = 0; (v = tick(a->y, step, k)) <= a->y[1] + 1e-9 * step; k++) {
        fprintf(f, "<path class=axis d=\"M%d %.1fH%d\"/><text x=%d y=%.1f text-anchor=end>", LEFT,
                at_y(a, v), WIDE - RIGHT, LEFT - 6, at_y(a, v) + 5);
        put_count(f, v);
        fprintf(f, "</text>\n");
    }
    for (int k = 0; (v = tick(a->x, along, k)) <= a->x[1] + 1e-9 * along; k++) {
        fprintf(f, "<text x=%.1f y=%d text-anchor=middle>", at_x(a, v), HIGH - 8);
        put_count(f, v);
        fprintf(f, "</text>\n");
    }
}

static void include(double *range, double v)
{
    range[0] = fmin(range[0], v), range[1] = fmax(range[1], v);
}

void put_curve(FILE *f, const struct curves *c, enum column k, double limit, bool tests,
               const char *title)
{
    struct axes a = {.x = {0, 1}, .y = {INFINITY, -INFINITY}};
    bool begun = false;
    for (size_t i = 0; i < c->n; i++)
        if (isfinite(c->rows[i][k])) {
            include(a.x, c->rows[i][C_ITERATION]);
            include(a.y, c->rows[i][k]);
        }
    if (!(a.y[1] >= a.y[0]))
        return;
    for (size_t i = 0; tests && i < c->n_tests; i++)
        include(a.y, c->tests[i][1]);
    if (k != C_PSNR)
        a.y[0] = 0;
    if (limit > 0)
        include(a.y, limit);
    if (!(a.y[1] > a.y[0]))
        a.y[1] = a.y[0] + 1;
    if (!has_extent(a.x) || !has_extent(a.y))
        return;
    put_axes(f, &a, title);
    if (limit > 0)
        fprintf(f, "<path class=limit d=\"M%d %.1fH%d\"/>\n", LEFT, at_y(&a, limit), WIDE - RIGHT);
    fprintf(f, "<path class=curve d=\"");
    for (size_t i = 0; i < c->n; i++)
        if (isfinite(c->rows[i][k])) {
            fprintf(f, "%s%.1f %.1f", begun ? "L" : "M", at_x(&a, c->rows[i][C_ITERATION]),
                    at_y(&a, c->rows[i][k]));
            begun = true;
        }
    fprintf(f, "\"/>\n");
    for (size_t i = 0; tests && i < c->n_tests; i++)
        fprintf(f,
                "<circle class=mark data-value=%.6g cx=%.1f cy=%.1f r=5><title>%.2f dB at "
                "%.0f</title></circle>\n",
                c->tests[i][1], at_x(&a, c->tests[i][0]), at_y(&a, c->tests[i][1]), c->tests[i][1],
                c->tests[i][0]);
    fprintf(f, "</svg><figcaption>%s</figcaption></figure>\n", title);
}

void put_bars(FILE *f, const struct bar *bars, size_t n, double scale, int digits, const char *unit,
              const char *title)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += isfinite(bars[i].value) ? bars[i].value : 0;
    if (!(sum > 0))
        return;
    fprintf(f, "<h2>%s</h2>\n<div class=wide><table class=bars>\n", title);
    for (size_t i = 0; i < n; i++)
        if (isfinite(bars[i].value) && bars[i].value > 0) {
            const double share = bars[i].value / sum;
            fprintf(f, "<tr><th scope=row>%s<td>%.*f %s<td>%.0f %%", bars[i].name, digits,
                    bars[i].value * scale, unit, 100 * share);
            put_bar(f, share);
        }
    fprintf(f, "</table></div>\n");
}
