/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/spectrum.h"

#include <math.h>

#include "fft.h"

struct sums {
    double total, ring[SG_SPECTRUM_RINGS], ring_count[SG_SPECTRUM_RINGS];
};

/* Adds one channel. Half of the coefficients stand for their conjugates too. */
static void add_channel(const float complex *f, int width, int height, const struct sg_spectrum_params *p,
                        struct sums *sums, struct sg_spectrum *out)
{
    const int columns = (int) SG_FFT_COLUMNS(width);
    for (int u = 0; u < height; u++)
        for (int v = 0; v < columns; v++) {
            const double r = sg_spectrum_radius(u, v, width, height), twins = v == 0 || 2 * v == width ? 1 : 2;
            const double re = (double) crealf(f[(size_t) u * (size_t) columns + (size_t) v]);
            const double im = (double) cimagf(f[(size_t) u * (size_t) columns + (size_t) v]);
            const double energy = re * re + im * im;
            const int ring = (int) (r * SG_SPECTRUM_RINGS), bin = sg_spectrum_bin(u, v, width, height, p, -1);
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
static void centre(const float complex *f, int width, int height, float *amplitude)
{
    const int columns = (int) SG_FFT_COLUMNS(width);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int u = (y - height / 2 + height) % height, v = (x - width / 2 + width) % width;
            if (v >= columns)
                u = (height - u) % height, v = width - v;
            amplitude[(size_t) y * (size_t) width + (size_t) x] = log1pf(cabsf(f[u * columns + v]));
        }
}

static void finish(struct sums *sums, double pixels, struct sg_spectrum *out)
{
    double band = 0, entropy = 0;
    for (int b = 0; b < out->bins; b++)
        band += out->angular[b];
    const bool empty = !(band > 1e-12 * 9 * pixels * pixels); /* rounding of a flat image */
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

int sg_spectrum_of(sg_ctx *ctx, const uint8_t *rgb, int width, int height, const struct sg_spectrum_params *params,
                   struct sg_spectrum *out, float *amplitude)
{
    const struct sg_spectrum_params p = params ? *params : sg_spectrum_params_default();
    const size_t pixels = (size_t) width * (size_t) height;
    if (!(p.low >= 0 && p.high >= p.low && p.high <= 1) || p.bins < 2 || p.bins > SG_SPECTRUM_BINS_MAX || p.bins % 2)
        return sg_fail(
            ctx, SG_ERR_USAGE,
            "spectrum: found a band of %g to %g in %d directions, expected 0 to 1 and an even number up to %d", p.low,
            p.high, p.bins, SG_SPECTRUM_BINS_MAX);
    float *image = sg_alloc_raw(ctx, SG_MEM_FRAME, pixels, sizeof(float));
    float complex *f = sg_alloc_raw(ctx, SG_MEM_FRAME, (size_t) height * SG_FFT_COLUMNS(width), sizeof(*f));
    fftwf_plan plan = NULL;
    int code = image && f ? sg_fft_plan(ctx, width, height, image, f, &plan) : SG_ERR_BUDGET;
    struct sums sums = {0};
    *out = (struct sg_spectrum){.bins = p.bins};
    for (int channel = 0; channel < 3 && !code; channel++) {
        for (size_t i = 0; i < pixels; i++)
            image[i] = (float) rgb[3 * i + (size_t) channel] * (1.0f / 255);
        fftwf_execute(plan);
        add_channel(f, width, height, &p, &sums, out);
    }
    if (!code)
        finish(&sums, (double) pixels, out);
    if (!code && amplitude) {
        for (size_t i = 0; i < pixels; i++)
            image[i] = (float) (rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) * (1.0f / 765);
        fftwf_execute(plan);
        centre(f, width, height, amplitude);
    }
    sg_fft_forget(plan);
    sg_free(image);
    sg_free(f);
    return code;
}

int sg_spectrum_measure(sg_ctx *ctx, const uint8_t *rgb, int width, int height, const struct sg_spectrum_params *params,
                        struct sg_spectrum *out, float *amplitude)
{
    sg_clear_error(ctx);
    return sg_spectrum_of(ctx, rgb, width, height, params, out, amplitude);
}
