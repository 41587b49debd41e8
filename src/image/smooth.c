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

/* A disc of diameter 9. */
static void make_bilateral(struct filter *f, double sigma)
{
    const double space = 2 * 75.0 * 75.0, range = 2 * sigma * sigma;
    for (int dy = -4; dy <= 4; dy++)
        for (int dx = -4; dx <= 4; dx++)
            if (dx * dx + dy * dy <= 16)
                f->taps[f->n++] = (struct tap){dx, dy, (float) exp(-(dx * dx + dy * dy) / space)};
    for (int d = 0; d < DISTANCES; d++)
        f->range[d] = d ? (float) exp(-d * (double) d / range) : 1; /* range can be 0 */
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

struct job {
    struct filter filter;
    const uint8_t *rgb, *mask;
    int width;
    int *columns, *rows; /* mirrored indices, from -RADIUS_MAX on */
    uint8_t *out;
};

static void smooth_row(void *arg, size_t y, int thread)
{
    const struct job *j = arg;
    (void) thread;
    for (size_t x = 0; x < (size_t) j->width; x++) {
        const size_t at = y * (size_t) j->width + x;
        if (j->mask && !j->mask[at])
            memcpy(j->out + 3 * at, j->rgb + 3 * at, 3);
        else
            smooth_pixel(&j->filter, j->rgb, j->mask, j->columns + x + RADIUS_MAX,
                         j->rows + y + RADIUS_MAX, j->width, j->rgb + 3 * at, j->out + 3 * at);
    }
}

/* j: has its filter. */
static int smooth(sg_ctx *ctx, struct job *j, int height, bool parallel)
{
    const int width = j->width;
    const size_t longest = (size_t) (width > height ? width : height) + 2 * RADIUS_MAX;
    j->columns = sg_alloc_raw(ctx, SG_MEM_FRAME, longest, sizeof(*j->columns));
    j->rows = sg_alloc_raw(ctx, SG_MEM_FRAME, longest, sizeof(*j->rows));
    const int code = j->columns && j->rows ? SG_OK : SG_ERR_BUDGET;
    for (int i = 0; i < width + 2 * RADIUS_MAX && !code; i++)
        j->columns[i] = sg_mirror(i - RADIUS_MAX, width);
    for (int i = 0; i < height + 2 * RADIUS_MAX && !code; i++)
        j->rows[i] = sg_mirror(i - RADIUS_MAX, height);
    if (!code && parallel)
        sg_parallel_for(ctx, (size_t) height, smooth_row, j);
    for (int y = 0; y < height && !code && !parallel; y++)
        smooth_row(j, (size_t) y, 0);
    sg_free(j->columns);
    sg_free(j->rows);
    return code;
}

int sg_smooth(sg_ctx *ctx, enum sg_smooth kind, const uint8_t *rgb, const uint8_t *mask, int width,
              int height, uint8_t *out)
{
    struct job j = {.rgb = rgb, .mask = mask, .width = width, .out = out};
    if (kind == SG_SMOOTH_WAVELET)
        return sg_smooth_wavelet(ctx, rgb, mask, width, height, out);
    if (kind == SG_SMOOTH_GAUSSIAN)
        make_gaussian(&j.filter);
    else
        make_bilateral(&j.filter, SG_SMOOTH_SIGMA);
    return smooth(ctx, &j, height, false);
}

int sg_smooth_bilateral(sg_ctx *ctx, double sigma, const uint8_t *rgb, const uint8_t *mask,
                        int width, int height, uint8_t *out)
{
    struct job j = {.rgb = rgb, .mask = mask, .width = width, .out = out};
    make_bilateral(&j.filter, sigma);
    return smooth(ctx, &j, height, true);
}
