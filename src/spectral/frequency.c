/* SPDX-License-Identifier: Apache-2.0 */
#include "frequency.h"

#include <math.h>
#include <stdbool.h>

#define TAU 6.283185307179586

/* Signed frequency of a row, in cycles a pixel. */
static double vertical(int u, int height)
{
    return (double) (u <= (height - 1) / 2 ? u : u - height) / height;
}

double sg_spectrum_radius(int u, int v, int width, int height)
{
    return hypot(vertical(u, height), (double) v / width) / 0.5;
}

int sg_spectrum_bin(int u, int v, int width, int height, const struct sg_spectrum_params *p,
                    int outside)
{
    const double fu = vertical(u, height), fv = (double) v / width,
                 r = sg_spectrum_radius(u, v, width, height);
    if (!(r > 0 && r >= p->low && r <= p->high) || 2 * v == width || 2 * u == height)
        return outside;
    /* Exact multiples of a bin, as the axes are, belong to the upper one on every machine; the
     * pairs with v = 0 are opposite whatever atan2 says. */
    const bool lower = v == 0 && fu < 0;
    const int b =
        (int) floor((atan2(lower ? -fu : fu, fv) + TAU / 2) * p->bins / TAU + 1e-9) % p->bins;
    return lower ? (b + p->bins / 2) % p->bins : b;
}

int sg_spectrum_columns(int width, int height, const struct sg_spectrum_params *p)
{
    int columns = 1;
    for (int v = 1; v <= width / 2; v++)
        for (int u = 0; u < height && columns <= v; u++)
            if (sg_spectrum_bin(u, v, width, height, p, -1) >= 0)
                columns = v + 1;
    return columns;
}
