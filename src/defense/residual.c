/* SPDX-License-Identifier: Apache-2.0 */
#include "residual.h"
#include "core/compare.h"

#include <math.h>
#include <stdlib.h>

#define BLOCK 8
#define VALUES (3 * BLOCK * BLOCK) /* of a block */
#define RADIUS 6                   /* of the low-pass */
#define SIGMA 2.0
/* Grey levels from black or white: a poison of this amplitude is not clipped. */
#define RENDER_MARGIN 24
#define PHOTO_MARGIN 3
#define LEAST_BLOCKS 50  /* of which a tenth is measured */
#define EXTREME 6        /* grey levels from black or white: the render is that */
#define AROUND 3         /* pixels around one on black or white that are so too */
#define LEAST_GROUND 400 /* pixels, and at least a fiftieth of the photo */
#define LEAST_BOUND 3    /* grey levels */

struct block {
    double energy;
    size_t at; /* its index among all blocks */
};

static int by_energy(const void *a, const void *b)
{
    const struct block *x = a, *y = b;
    if (x->energy != y->energy)
        return x->energy < y->energy ? -1 : 1;
    return x->at < y->at ? -1 : 1;
}

static void low_pass_row(const float *in, size_t stride, int n, const float taps[RADIUS + 1],
                         float *out)
{
    for (int i = 0; i < n; i++) {
        float sum = taps[0] * in[(size_t) i * stride];
        for (int k = 1; k <= RADIUS; k++) {
            const int before = i - k < 0 ? 0 : i - k, after = i + k > n - 1 ? n - 1 : i + k;
            sum += taps[k] * (in[(size_t) before * stride] + in[(size_t) after * stride]);
        }
        out[i] = sum;
    }
}

/* Subtracts the plane's low-pass, a Gaussian whose border values are repeated. */
static void high_pass(float *plane, int width, int height, float *low, float *line)
{
    float taps[RADIUS + 1], sum = 0;
    const size_t w = (size_t) width;
    for (int k = 0; k <= RADIUS; k++) {
        taps[k] = expf((float) (-k * k / (2 * SIGMA * SIGMA)));
        sum += k ? 2 * taps[k] : taps[k];
    }
    for (int k = 0; k <= RADIUS; k++)
        taps[k] /= sum;
    for (int y = 0; y < height; y++)
        low_pass_row(plane + (size_t) y * w, 1, width, taps, low + (size_t) y * w);
    for (int x = 0; x < width; x++) {
        low_pass_row(low + x, w, height, taps, line);
        for (int y = 0; y < height; y++)
            plane[(size_t) y * w + (size_t) x] -= line[y];
    }
}

/* Photo minus render in grey levels, and where it counts. */
static void subtract(const uint8_t *photo, const uint8_t *mask, const float *render, size_t pixels,
                     float *difference, uint8_t *used)
{
    for (size_t i = 0; i < pixels; i++) {
        used[i] = !mask || mask[i];
        for (size_t c = 0; c < 3; c++) {
            const float r = 255 * render[c * pixels + i], p = photo[3 * i + c];
            difference[c * pixels + i] = p - r;
            used[i] &= r >= RENDER_MARGIN && r <= 255 - RENDER_MARGIN && p >= PHOTO_MARGIN &&
                       p <= 255 - PHOTO_MARGIN;
        }
    }
}

/* The values of a block, one after the other; whether all of its pixels count. */
static bool read_block(const float *planes, const uint8_t *used, int width, size_t pixels,
                       size_t at, float values[VALUES])
{
    const size_t columns = (size_t) width / BLOCK;
    const size_t first = at / columns * BLOCK * (size_t) width + at % columns * BLOCK;
    bool whole = true;
    size_t n = 0;
    for (size_t y = 0; y < BLOCK; y++)
        for (size_t x = 0; x < BLOCK; x++) {
            const size_t i = first + y * (size_t) width + x;
            whole &= used[i];
            for (size_t c = 0; c < 3; c++)
                values[n++] = planes[c * pixels + i];
        }
    return whole;
}

static void measure(const float *planes, int width, size_t pixels, const struct block *quiet,
                    size_t n, const uint8_t *used, float *values, struct sg_residual *out)
{
    double second = 0, fourth = 0;
    for (size_t b = 0; b < n; b++) {
        float *v = values + b * VALUES;
        read_block(planes, used, width, pixels, quiet[b].at, v);
        for (size_t i = 0; i < VALUES; i++) {
            const double square = (double) v[i] * (double) v[i];
            second += square, fourth += square * square;
            v[i] = fabsf(v[i]);
        }
    }
    const double total = (double) (n * VALUES);
    qsort(values, n * VALUES, sizeof(*values), sg_float_ascending);
    out->blocks = n;
    out->level = (double) values[n * VALUES / 10 * 9];
    out->kurtosis = second > 0 ? fourth * total / (second * second) : 0;
}

/* The extreme that all channels of a render are at. */
enum ground { NEITHER, BLACK, WHITE };

static enum ground ground_at(const float *render, size_t pixels, size_t i)
{
    bool black = true, white = true; /* NaN is neither */
    for (size_t c = 0; c < 3; c++) {
        const float value = 255 * render[c * pixels + i];
        black &= value < EXTREME;
        white &= value > 255 - EXTREME;
    }
    return black ? BLACK : white ? WHITE : NEITHER;
}

/* Clears what is nearer than AROUND to another value of the line. */
static void narrow(uint8_t *ground, size_t stride, int n)
{
    for (int from = 0, to; from < n; from = to) {
        const uint8_t here = ground[(size_t) from * stride];
        for (to = from + 1; to < n && ground[(size_t) to * stride] == here;)
            to++;
        for (int i = from; i < to; i++)
            if ((from > 0 && i < from + AROUND) || (to < n && i >= to - AROUND))
                ground[(size_t) i * stride] = NEITHER;
    }
}

/* The value that more than this share of all values reaches. */
static int reached_by(const uint32_t counts[256], double share, double total)
{
    int value = 255;
    for (double above = counts[255]; value > 0 && above <= share * total; above += counts[value])
        value--;
    return value;
}

/* A poison that pushes to its bound has many values there and none beyond; sensor noise and detail
 * have ever fewer. ground: room for a byte a pixel. */
static double bound_of(const uint8_t *photo, const uint8_t *mask, const float *render, int width,
                       int height, uint8_t *ground)
{
    const size_t w = (size_t) width, pixels = w * (size_t) height;
    uint32_t counts[256] = {0};
    size_t n = 0;
    for (size_t i = 0; i < pixels; i++)
        ground[i] = (uint8_t) ground_at(render, pixels, i);
    for (int y = 0; y < height; y++)
        narrow(ground + (size_t) y * w, 1, width);
    for (int x = 0; x < width; x++)
        narrow(ground + x, w, height);
    for (size_t i = 0; i < pixels; i++) {
        if (ground[i] == NEITHER || (mask && !mask[i]))
            continue;
        n++;
        for (size_t c = 0; c < 3; c++)
            counts[ground[i] == BLACK ? photo[3 * i + c] : 255 - photo[3 * i + c]]++;
    }
    if (n < LEAST_GROUND || n < pixels / 50)
        return 0;
    /* What a poison takes away ends there; a black that is a little grey does not. */
    if (counts[0] < 0.05 * 3 * (double) n)
        return 0;
    const int bound = reached_by(counts, 0.001, 3 * (double) n);
    const int often = reached_by(counts, 0.01, 3 * (double) n);
    return bound >= LEAST_BOUND && 8 * often >= 7 * bound ? bound : 0;
}

static size_t count_blocks(int width, int height)
{
    return (size_t) (width / BLOCK) * (size_t) (height / BLOCK);
}

int sg_residual_bound(sg_ctx *ctx, const uint8_t *photo, const uint8_t *mask, const float *render,
                      int width, int height, double *out)
{
    *out = 0;
    if (count_blocks(width, height) < LEAST_BLOCKS)
        return SG_OK;
    uint8_t *ground = sg_alloc_raw(ctx, SG_MEM_FRAME, (size_t) width, (size_t) height);
    if (!ground)
        return SG_ERR_BUDGET;
    *out = bound_of(photo, mask, render, width, height, ground);
    sg_free(ground);
    return SG_OK;
}

int sg_residual_measure(sg_ctx *ctx, const uint8_t *photo, const uint8_t *mask, const float *render,
                        int width, int height, struct sg_residual *out)
{
    *out = (struct sg_residual){0};
    const size_t pixels = (size_t) width * (size_t) height;
    const size_t all = count_blocks(width, height);
    if (all < LEAST_BLOCKS)
        return SG_OK;
    float *planes = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 3 * sizeof(*planes));
    float *low = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, sizeof(*low));
    float *line = sg_alloc_raw(ctx, SG_MEM_FRAME, (size_t) height, sizeof(*line));
    uint8_t *used = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, 1);
    struct block *blocks = sg_alloc_raw(ctx, SG_MEM_FRAME, all, sizeof(*blocks));
    float *values = sg_alloc_raw(ctx, SG_MEM_FRAME, all / 10 + 1, VALUES * sizeof(*values));
    const int code = planes && low && line && used && blocks && values ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        size_t n = 0;
        float block[VALUES];
        subtract(photo, mask, render, pixels, planes, used);
        for (size_t c = 0; c < 3; c++)
            high_pass(planes + c * pixels, width, height, low, line);
        for (size_t at = 0; at < all; at++) {
            if (!read_block(planes, used, width, pixels, at, block))
                continue;
            double energy = 0;
            for (size_t i = 0; i < VALUES; i++)
                energy += (double) block[i] * (double) block[i];
            if (isfinite(energy)) /* a broken Gaussian can draw anything */
                blocks[n++] = (struct block){energy, at};
        }
        qsort(blocks, n, sizeof(*blocks), by_energy);
        if (n >= LEAST_BLOCKS)
            measure(planes, width, pixels, blocks, n / 10, used, values, out);
    }
    sg_free(planes);
    sg_free(low);
    sg_free(line);
    sg_free(used);
    sg_free(blocks);
    sg_free(values);
    return code;
}
