/* SPDX-License-Identifier: Apache-2.0 */
/* Smoothing filters against noise in photos. Gaussian and bilateral have the results of OpenCV's.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image/smooth.h"

#define RADIUS_MAX 4
#define DISTANCES (3 * 255 + 1)

/* A pixel of the neighbourhood. */
struct tap {
    int dx, dy;
    float weight;
};

struct filter {
    struct tap taps[(2 * RADIUS_MAX + 1) * (2 * RADIUS_MAX + 1)];
    int n;
    float range[DISTANCES]; /* weight by the sum of absolute differences of the three channels */
};

/* 5 x 5, sigma 1.5. */
static void make_gaussian(struct filter *f)
{
    const double variance = 1.5 * 1.5;
    for (int dy = -2; dy <= 2; dy++)
        for (int dx = -2; dx <= 2; dx++)
            f->taps[f->n++] =
                (struct tap){dx, dy, (float) exp(-(dx * dx + dy * dy) / (2 * variance))};
    for (int d = 0; d < DISTANCES; d++)
        f->range[d] = 1;
}

/* A disc of diameter 9; both sigmas are 75. */
static void make_bilateral(struct filter *f)
{
    const double variance = 75.0 * 75.0;
    for (int dy = -4; dy <= 4; dy++)
        for (int dx = -4; dx <= 4; dx++)
            if (dx * dx + dy * dy <= 16)
                f->taps[f->n++] =
                    (struct tap){dx, dy, (float) exp(-(dx * dx + dy * dy) / (2 * variance))};
    for (int d = 0; d < DISTANCES; d++)
        f->range[d] = (float) exp(-d * (double) d / (2 * variance));
}

/* An image of one is repeated. */
int sg_mirror(int i, int n)
{
    const int period = n > 1 ? 2 * n - 2 : 1;
    i %= period;
    i = i < 0 ? i + period : i;
    return i < n ? i : period - i;
}

static void smooth_pixel(const struct filter *f, const uint8_t *rgb, const uint8_t *mask,
                         const int *columns, const int *rows, int width, const uint8_t *center,
                         uint8_t *out)
{
    float sum[3] = {0}, weights = 0;
    for (int k = 0; k < f->n; k++) {
        const struct tap *t = &f->taps[k];
        const size_t at = (size_t) rows[t->dy] * (size_t) width + (size_t) columns[t->dx];
        if (mask && !mask[at])
            continue;
        const uint8_t *q = rgb + 3 * at;
        const int d = abs(q[0] - center[0]) + abs(q[1] - center[1]) + abs(q[2] - center[2]);
        const float w = t->weight * f->range[d];
        sum[0] += w * q[0], sum[1] += w * q[1], sum[2] += w * q[2];
        weights += w;
    }
    for (int c = 0; c < 3; c++)
        out[c] = (uint8_t) rintf(sum[c] / weights);
}

int sg_smooth(sg_ctx *ctx, enum sg_smooth kind, const uint8_t *rgb, const uint8_t *mask, int width,
              int height, uint8_t *out)
{
    struct filter f = {.n = 0};
    if (kind == SG_SMOOTH_WAVELET)
        return sg_smooth_wavelet(ctx, rgb, mask, width, height, out);
    if (kind == SG_SMOOTH_GAUSSIAN)
        make_gaussian(&f);
    else
        make_bilateral(&f);
    /* Mirrored indices of columns -RADIUS_MAX to width - 1 + RADIUS_MAX, and of rows. */
    const size_t longest = (size_t) (width > height ? width : height) + 2 * RADIUS_MAX;
    int *columns = sg_alloc_raw(ctx, SG_MEM_FRAME, longest, sizeof(*columns));
    int *rows = sg_alloc_raw(ctx, SG_MEM_FRAME, longest, sizeof(*rows));
    const int code = columns && rows ? SG_OK : SG_ERR_BUDGET;
    for (int i = 0; i < width + 2 * RADIUS_MAX && !code; i++)
        columns[i] = sg_mirror(i - RADIUS_MAX, width);
    for (int i = 0; i < height + 2 * RADIUS_MAX && !code; i++)
        rows[i] = sg_mirror(i - RADIUS_MAX, height);
    for (int y = 0; y < height && !code; y++)
        for (int x = 0; x < width; x++) {
            const size_t at = (size_t) y * (size_t) width + (size_t) x;
            if (mask && !mask[at])
                memcpy(out + 3 * at, rgb + 3 * at, 3);
            else
                smooth_pixel(&f, rgb, mask, columns + x + RADIUS_MAX, rows + y + RADIUS_MAX, width,
                             rgb + 3 * at, out + 3 * at);
        }
    sg_free(columns);
    sg_free(rows);
    return code;
}
