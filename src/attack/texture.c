/* SPDX-License-Identifier: Apache-2.0 */
/* A bound that follows the texture of a photo, by sums over a window that slides down and
 * across. */
#include "ascent.h"

#include <math.h>
#include <stdlib.h>

#define REACH 3 /* pixels from the middle of the window to its sides */

struct window {
    const uint8_t *rgb;
    int width, height;
    int *columns; /* differences of each column, over the rows of the window */
};

static int least(int a, int b)
{
    return a < b ? a : b;
}

static int most(int a, int b)
{
    return a > b ? a : b;
}

/* Adds the differences of a row's values to the next column and row, `times` times. */
static void add_row(const struct window *w, int y, int times)
{
    const size_t stride = 3 * (size_t) w->width;
    const uint8_t *row = w->rgb + (size_t) y * stride;
    for (int x = 0; x < w->width; x++) {
        const uint8_t *p = row + 3 * x;
        int sum = 0;
        for (int ch = 0; ch < 3; ch++)
            sum += (x + 1 < w->width ? abs(p[ch + 3] - p[ch]) : 0) +
                   (y + 1 < w->height ? abs(p[stride + (size_t) ch] - p[ch]) : 0);
        w->columns[x] += times * sum;
    }
}

/* The number of differences that add_row adds for a window of rows x columns. The photo's last row
 * and column have no next one. */
static int count(int rows, int columns, bool last_row, bool last_column)
{
    return 3 * (rows * (columns - last_column) + columns * (rows - last_row));
}

int sg_texture_bound(sg_ctx *ctx, const uint8_t *rgb, int width, int height, float epsilon,
                     float texture, float *bound)
{
    const double levels = 255 * (double) epsilon + 1e-3; /* 16 of them are not 15.99 */
    const struct window w = {rgb, width, height,
                             sg_alloc(ctx, SG_MEM_FRAME, (size_t) width, sizeof(int))};
    if (!w.columns)
        return SG_ERR_BUDGET;
    for (int y = 0; y < least(REACH, height); y++)
        add_row(&w, y, 1);
    for (int y = 0; y < height; y++) {
        if (y + REACH < height)
            add_row(&w, y + REACH, 1);
        if (y - REACH > 0)
            add_row(&w, y - REACH - 1, -1);
        const int bottom = least(y + REACH, height - 1), rows = bottom - most(y - REACH, 0) + 1;
        int sum = 0;
        for (int x = 0; x < least(REACH, width); x++)
            sum += w.columns[x];
        for (int x = 0; x < width; x++) {
            sum += x + REACH < width ? w.columns[x + REACH] : 0;
            sum -= x - REACH > 0 ? w.columns[x - REACH - 1] : 0;
            const int end = least(x + REACH, width - 1), columns = end - most(x - REACH, 0) + 1;
            const int n = count(rows, columns, bottom == height - 1, end == width - 1);
            const double share = n ? sum / (n * (double) texture) : 0;
            *bound++ = share < 1 ? fminf((float) (floor(levels * share) / 255), epsilon) : epsilon;
        }
    }
    sg_free(w.columns);
    return SG_OK;
}
