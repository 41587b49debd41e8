/* SPDX-License-Identifier: Apache-2.0 */
/* Smoothing by soft thresholds of wavelets. Undecimated Haar wavelets: a value and its neighbour
 * at a distance of 1, 2, 4 become half their sum and half their difference, along both axes. The
 * threshold of a band is BayesShrink's (Chang et al. 2000), variance of the noise over standard
 * deviation of the signal. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/compare.h"
#include "image/smooth.h"

#define LEVELS 3
#define MARGIN 8 /* the sum of all distances, at least */

/* One channel with mirrored margins, in which transforms wrap around. */
struct plane {
    int width, height; /* with margins */
    float *low, *next;
};

static size_t place(const struct plane *p, int x, int y)
{
    x = x < 0 ? x + p->width : x >= p->width ? x - p->width : x;
    y = y < 0 ? y + p->height : y >= p->height ? y - p->height : y;
    return (size_t) y * (size_t) p->width + (size_t) x;
}

/* The four bands at (x, y) of the values at distance d; [0] is the mean. */
static void bands_at(const struct plane *p, int x, int y, int d, float out[4])
{
    const float a = p->low[place(p, x, y)], b = p->low[place(p, x + d, y)],
                c = p->low[place(p, x, y + d)], e = p->low[place(p, x + d, y + d)];
    out[0] = (a + b + c + e) / 4, out[1] = (a - b + c - e) / 4;
    out[2] = (a + b - c - e) / 4, out[3] = (a - b - c + e) / 4;
}

/* Standard deviation of the noise: the median of the finest diagonal band, in which the photo
 * itself has little energy. Zeros do not count, so that a background of one colour does not hide
 * the noise elsewhere. */
static double noise_of(const struct plane *p)
{
    size_t n = 0;
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++) {
            float band[4];
            bands_at(p, x, y, 1, band);
            p->next[n] = fabsf(band[3]);
            n += p->next[n] > 0;
        }
    qsort(p->next, n, sizeof(*p->next), sg_float_ascending);
    return n ? 2 * (double) p->next[n / 2] / 0.6745 : 0;
}

static float shrink(float v, float threshold)
{
    return fabsf(v) <= threshold ? 0 : v > 0 ? v - threshold : v + threshold;
}

/* One level: `next` becomes the means, `detail` the reconstruction from the shrunk differences: the
 * mean over the four ways in which a value takes part. */
static void split(const struct plane *p, int d, double noise, float *detail)
{
    const size_t n = (size_t) p->width * (size_t) p->height;
    double power[4] = {0};
    float threshold[4] = {0};
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++) {
            float band[4];
            bands_at(p, x, y, d, band);
            for (int k = 1; k < 4; k++)
                power[k] += (double) band[k] * (double) band[k];
            p->next[place(p, x, y)] = band[0];
        }
    for (int k = 1; k < 4 && noise > 0; k++) {
        const double signal = power[k] / (double) n - noise * noise;
        threshold[k] = signal > 0 ? (float) (noise * noise / sqrt(signal)) : INFINITY;
    }
    memset(detail, 0, n * sizeof(*detail));
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++) {
            float band[4];
            bands_at(p, x, y, d, band);
            for (int k = 1; k < 4; k++)
                band[k] = shrink(band[k], threshold[k]) / 4;
            detail[place(p, x, y)] += band[1] + band[2] + band[3];
            detail[place(p, x + d, y)] += -band[1] + band[2] - band[3];
            detail[place(p, x, y + d)] += band[1] - band[2] - band[3];
            detail[place(p, x + d, y + d)] += -band[1] - band[2] + band[3];
        }
    memcpy(p->low, p->next, n * sizeof(*p->low));
}

/* The way back: the means of the four that a value takes part in, and its details. */
static void join(const struct plane *p, int d, const float *detail)
{
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++)
            p->next[place(p, x, y)] =
                (p->low[place(p, x, y)] + p->low[place(p, x - d, y)] + p->low[place(p, x, y - d)] +
                 p->low[place(p, x - d, y - d)]) /
                    4 +
                detail[place(p, x, y)];
    memcpy(p->low, p->next, (size_t) p->width * (size_t) p->height * sizeof(*p->low));
}

/* The mean of a channel's used pixels. */
static float mean_of(const uint8_t *rgb, const uint8_t *mask, size_t pixels, int channel)
{
    double sum = 0, n = 0;
    for (size_t i = 0; i < pixels; i++)
        if (mask[i])
            sum += rgb[3 * i + (size_t) channel], n++;
    return n > 0 ? (float) (sum / n) : 0;
}

int sg_smooth_wavelet(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width, int height,
                      uint8_t *out)
{
    struct plane p = {.width = width + 2 * MARGIN, .height = height + 2 * MARGIN};
    const size_t n = (size_t) p.width * (size_t) p.height;
    float *memory = sg_alloc_raw(ctx, SG_MEM_FRAME, n, (2 + LEVELS) * sizeof(*memory));
    if (!memory)
        return SG_ERR_BUDGET;
    p.low = memory, p.next = memory + n;
    float *detail = memory + 2 * n;
    for (int ch = 0; ch < 3; ch++) {
        const float mean = mask ? mean_of(rgb, mask, (size_t) width * (size_t) height, ch) : 0;
        for (int y = 0; y < p.height; y++)
            for (int x = 0; x < p.width; x++) {
                const size_t at = (size_t) sg_mirror(y - MARGIN, height) * (size_t) width +
                                  (size_t) sg_mirror(x - MARGIN, width);
                p.low[place(&p, x, y)] = mask && !mask[at] ? mean : rgb[3 * at + (size_t) ch];
            }
        const double noise = noise_of(&p);
        for (int l = 0; l < LEVELS; l++)
            split(&p, 1 << l, noise / (2 << l), detail + (size_t) l * n);
        for (int l = LEVELS - 1; l >= 0; l--)
            join(&p, 1 << l, detail + (size_t) l * n);
        for (int y = 0; y < height; y++)
            for (int x = 0; x < width; x++) {
                const size_t at = (size_t) y * (size_t) width + (size_t) x;
                const float v = p.low[place(&p, x + MARGIN, y + MARGIN)];
                out[3 * at + (size_t) ch] = mask && !mask[at]
                                                ? rgb[3 * at + (size_t) ch]
                                                : (uint8_t) rintf(fminf(fmaxf(v, 0), 255));
            }
    }
    sg_free(memory);
    return SG_OK;
}
