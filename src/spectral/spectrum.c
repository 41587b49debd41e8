/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/spectrum.h"

#include <math.h>
#include <string.h>

#include "fft.h"
#include "frequency.h"

#include "math/spectrum.h"
#include "splatguard/camera.h"

/* An image and its half spectrum, in panels. */
struct transform {
    int width, height;
    struct sg_fft *across, *down;
    float *image, *f, *room;
};

static int transform_create(sg_ctx *ctx, int width, int height, struct transform *t)
{
    *t = (struct transform){.width = width, .height = height};
    if (sg_fft_create(ctx, width, &t->across) || sg_fft_create(ctx, height, &t->down))
        return SG_ERR_BUDGET;
    const size_t rows = sg_fft_rows_scratch(t->across), points = (size_t) height * SG_FFT_POINT;
    const size_t column = points + sg_fft_scratch(t->down);
    t->image = sg_alloc_raw(ctx, SG_MEM_FRAME, (size_t) width * (size_t) height, sizeof(float));
    t->f = sg_alloc_raw(ctx, SG_MEM_FRAME, SG_FFT_PANELS(SG_FFT_COLUMNS(width)) * points,
                        sizeof(float));
    t->room = sg_alloc_raw(ctx, SG_MEM_FRAME, rows > column ? rows : column, sizeof(float));
    return t->image && t->f && t->room ? SG_OK : SG_ERR_BUDGET;
}

static void transform_clear(struct transform *t)
{
    sg_fft_destroy(&t->across);
    sg_fft_destroy(&t->down);
    sg_free(t->image);
    sg_free(t->f);
    sg_free(t->room);
}

static void transform(const struct transform *t)
{
    const struct sg_fft_kernels *fft = sg_fft_fastest();
    const int columns = (int) SG_FFT_COLUMNS(t->width);
    const size_t panel = (size_t) t->height * SG_FFT_POINT;
    for (int y = 0; y < t->height; y += SG_FFT_ROWS) {
        const struct sg_fft_rows r = {.count =
                                          t->height - y < SG_FFT_ROWS ? t->height - y : SG_FFT_ROWS,
                                      .width = t->width,
                                      .columns = columns,
                                      .panels = t->f + (size_t) y * SG_FFT_POINT,
                                      .panel = panel};
        const float *rows[SG_FFT_ROWS];
        for (int i = 0; i < r.count; i++)
            rows[i] = t->image + (size_t) (y + i) * (size_t) t->width;
        fft->rows(t->across, &r, rows, t->room);
    }
    for (size_t p = 0; p < SG_FFT_PANELS(columns); p++) {
        fft->columns(t->down, t->f + p * panel, t->room, false, t->room + panel);
        memcpy(t->f + p * panel, t->room, panel * sizeof(float));
    }
}

/* Real part; the imaginary one is SG_FFT_LANES further. */
static const float *coefficient(const struct transform *t, int u, int v)
{
    return t->f + (size_t) (v / SG_FFT_LANES) * (size_t) t->height * SG_FFT_POINT +
           (size_t) u * SG_FFT_POINT + (size_t) (v % SG_FFT_LANES);
}

struct sums {
    double total, ring[SG_SPECTRUM_RINGS], ring_count[SG_SPECTRUM_RINGS];
};

/* Adds one channel. Half of the coefficients stand for their conjugates too. */
static void add_channel(const struct transform *t, const struct sg_spectrum_params *p,
                        struct sums *sums, struct sg_spectrum *out)
{
    const int width = t->width, height = t->height;
    for (int u = 0; u < height; u++)
        for (int v = 0; v < (int) SG_FFT_COLUMNS(width); v++) {
            const double r = sg_spectrum_radius(u, v, width, height),
                         twins = v == 0 || 2 * v == width ? 1 : 2;
            const float *f = coefficient(t, u, v);
            const double re = (double) f[0], im = (double) f[SG_FFT_LANES],
                         energy = re * re + im * im;
            const int ring = (int) (r * SG_SPECTRUM_RINGS),
                      bin = sg_spectrum_bin(u, v, width, height, p, -1);
            if (r <= 0)
                continue;
            sums->total += twins * energy;
            if (ring < SG_SPECTRUM_RINGS)
                sums->ring[ring] += twins * energy, sums->ring_count[ring] += twins;
            if (bin < 0)
                continue;
            out->angular[bin] += energy;
            if (v > 0) /* its conjugate, which is not stored */
                out->angular[(bin + p->bins / 2) % p->bins] += energy;
        }
}

/* ln(1 + |F|) with the zero frequency in the middle. */
static void centre(const struct transform *t, float *amplitude)
{
    const int width = t->width, height = t->height;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int u = (y - height / 2 + height) % height, v = (x - width / 2 + width) % width;
            if (2 * v > width)
                u = (height - u) % height, v = width - v;
            const float *f = coefficient(t, u, v);
            amplitude[(size_t) y * (size_t) width + (size_t) x] =
                log1pf(hypotf(f[0], f[SG_FFT_LANES]));
        }
}

static void finish(struct sums *sums, double pixels, struct sg_spectrum *out)
{
    double band = 0, entropy = 0;
    for (int b = 0; b < out->bins; b++)
        band += out->angular[b];
    const bool empty = !(band > SG_FLAT_POWER * 9 * pixels * pixels); /* rounding of a flat image */
    out->band_share = empty ? 0 : band / sums->total;
    for (int b = 0; b < out->bins; b++) {
        out->angular[b] = empty ? 0 : out->angular[b] / band;
        entropy -= out->angular[b] > 0 ? out->angular[b] * log(out->angular[b]) : 0;
    }
    out->entropy = empty ? 1 : entropy / log(out->bins);
    out->anisotropy = 1 - out->entropy;
    for (int i = 0; i < SG_SPECTRUM_RINGS; i++)
        out->radial[i] = sums->ring_count[i] > 0 ? sums->ring[i] / sums->ring_count[i] / pixels : 0;
}

struct sg_spectrum_params sg_spectrum_params_default(void)
{
    return (struct sg_spectrum_params){SG_SPECTRUM_DEFAULTS};
}

int sg_spectrum_of(sg_ctx *ctx, const uint8_t *rgb, int width, int height,
                   const struct sg_spectrum_params *params, struct sg_spectrum *out,
                   float *amplitude)
{
    const struct sg_spectrum_params p = params ? *params : sg_spectrum_params_default();
    const size_t pixels = (size_t) width * (size_t) height;
    if (width < 1 || height < 1 || width > SG_SIDE_MAX || height > SG_SIDE_MAX)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "spectrum: found an image of %d x %d, expected sides from 1 to %d", width,
                       height, SG_SIDE_MAX);
    if (!(p.low >= 0 && p.high >= p.low && p.high <= 1) || p.bins < 2 ||
        p.bins > SG_SPECTRUM_BINS_MAX || p.bins % 2)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "spectrum: found a band of %g to %g in %d directions, expected 0 to 1, not "
                       "falling, and an even number from 2 to %d",
                       p.low, p.high, p.bins, SG_SPECTRUM_BINS_MAX);
    struct transform t;
    const int code = transform_create(ctx, width, height, &t);
    struct sums sums = {0};
    *out = (struct sg_spectrum){.bins = p.bins};
    for (int channel = 0; channel < 3 && !code; channel++) {
        for (size_t i = 0; i < pixels; i++)
            t.image[i] = (float) rgb[3 * i + (size_t) channel] * (1.0f / 255);
        transform(&t);
        add_channel(&t, &p, &sums, out);
    }
    if (!code)
        finish(&sums, (double) pixels, out);
    if (!code && amplitude) {
        for (size_t i = 0; i < pixels; i++)
            t.image[i] = (float) (rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) * (1.0f / 765);
        transform(&t);
        centre(&t, amplitude);
    }
    transform_clear(&t);
    return code;
}

int sg_spectrum_measure(sg_ctx *ctx, const uint8_t *rgb, int width, int height,
                        const struct sg_spectrum_params *params, struct sg_spectrum *out,
                        float *amplitude)
{
    sg_clear_error(ctx);
    return sg_spectrum_of(ctx, rgb, width, height, params, out, amplitude);
}
