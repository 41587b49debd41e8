/* SPDX-License-Identifier: Apache-2.0 */
#include "ref_losses.h"

#include <complex.h>
#include <math.h>
#include <string.h>

#include "math/spectrum.h"
#include "spectral/anisotropy.h"

#define PI 3.14159265358979323846

/* Transforms of `count` lines of n values, by definition. Values are `step` apart, lines `next`.
 * sign: -1 forward, 1 back. work: 2 n values. */
static void dft(double complex *f, int n, int count, size_t step, size_t next, int sign,
                double complex *work)
{
    double complex *out = work, *root = work + n;
    for (int k = 0; k < n; k++)
        root[k] = cexp(sign * I * 2 * PI * k / n);
    for (int c = 0; c < count; c++, f += next) {
        for (int k = 0; k < n; k++) {
            out[k] = 0;
            for (int i = 0; i < n; i++)
                out[k] += f[(size_t) i * step] * root[(size_t) k * (size_t) i % (size_t) n];
        }
        for (int k = 0; k < n; k++)
            f[(size_t) k * step] = out[k];
    }
}

/* Direction of coefficient (u, v): of the whole spectrum, so that its conjugate has the opposite
 * one. */
static uint8_t direction(int u, int v, int w, int h, const struct sg_spectrum_params *band)
{
    const double fu = (double) (2 * u < h ? u : u - h) / h,
                 fv = (double) (2 * v < w ? v : v - w) / w;
    const double r = 2 * hypot(fu, fv);
    if (!(r > 0 && r >= band->low && r <= band->high && 2 * u != h && 2 * v != w))
        return SG_OUTSIDE;
    return (uint8_t) ((int) floor((atan2(fu, fv) + PI) * band->bins / (2 * PI) + 1e-9) %
                      band->bins);
}

static const double luma[3] = {SG_LUMA};

/* How much of a channel is in a transformed plane. */
static double share(const struct sg_anisotropy_params *p, int channel, int plane)
{
    return p->channels == SG_CHANNELS_LUMA ? luma[channel] : channel == plane;
}

/* 1 - H / ln B, and the gradient of it, from the whole complex spectrum of the image continued to a
 * quick size. */
int sg_ref_loss_anisotropy(sg_ctx *ctx, const struct sg_loss *loss, const float *x, int w, int h,
                           double *gradient, double *out)
{
    const struct sg_anisotropy_params *p = &loss->anisotropy;
    const int W = sg_anisotropy_width(w, p->exact_size), H = sg_anisotropy_height(h, p->exact_size);
    const int bins = p->band.bins, planes = p->channels == SG_CHANNELS_LUMA ? 1 : 3;
    const size_t n = (size_t) W * (size_t) H, pixels = (size_t) w * (size_t) h;
    double complex *f = sg_alloc(ctx, SG_MEM_FRAME, n * (size_t) planes, sizeof(*f));
    double complex *work = sg_alloc(ctx, SG_MEM_FRAME, 2 * (size_t) (W > H ? W : H), sizeof(*work));
    uint8_t *bin = sg_alloc(ctx, SG_MEM_FRAME, n, 1);
    double energy[SG_SPECTRUM_BINS_MAX] = {0}, total = 0, entropy = 0;
    if (!f || !work || !bin)
        goto done;
    for (int u = 0; u < H; u++)
        for (int v = 0; v < W; v++)
            bin[u * W + v] = direction(u, v, W, H, &p->band);
    for (int plane = 0; plane < planes; plane++) {
        double complex *own = f + (size_t) plane * n;
        for (size_t i = 0; i < n; i++) {
            const int y = (int) (i / (size_t) W), column = (int) (i % (size_t) W);
            const int from = (y < h ? y : h - 1) * w + (column < w ? column : w - 1);
            for (int ch = 0; ch < 3; ch++)
                own[i] += share(p, ch, plane) * (double) x[(size_t) ch * pixels + (size_t) from];
        }
        dft(own, W, H, 1, (size_t) W, -1, work);
        dft(own, H, W, (size_t) W, 1, -1, work);
        for (size_t i = 0; i < n; i++)
            if (bin[i] != SG_OUTSIDE)
                energy[bin[i]] +=
                    p->energy == SG_ENERGY_POWER ? creal(own[i] * conj(own[i])) : cabs(own[i]);
    }
    for (int b = 0; b < bins; b++)
        total += energy[b];
    const double values = (double) planes * (double) n;
    const bool flat = !(total > (p->energy == SG_ENERGY_POWER ? SG_FLAT_POWER * values * values
                                                              : SG_FLAT_AMPLITUDE * values));
    for (int b = 0; b < bins && !flat; b++)
        entropy -= energy[b] > 0 ? energy[b] / total * log(energy[b] / total) : 0;
    *out = flat ? 0 : 1 - entropy / log(bins);
    if (gradient)
        memset(gradient, 0, 3 * pixels * sizeof(*gradient));
    for (int plane = 0; plane < planes && gradient && !flat; plane++) {
        double complex *own = f + (size_t) plane * n;
        for (size_t i = 0; i < n; i++) {
            const double factor =
                bin[i] == SG_OUTSIDE || !(energy[bin[i]] > 0)
                    ? 0
                    : (log(fmax(energy[bin[i]] / total, 1e-12)) + entropy) / (total * log(bins));
            own[i] *= factor * (p->energy == SG_ENERGY_POWER ? 2
                                : cabs(own[i]) > 0           ? 1 / cabs(own[i])
                                                             : 0);
        }
        dft(own, W, H, 1, (size_t) W, 1, work);
        dft(own, H, W, (size_t) W, 1, 1, work);
        for (size_t i = 0; i < n; i++) {
            const int y = (int) (i / (size_t) W), column = (int) (i % (size_t) W);
            const int to = (y < h ? y : h - 1) * w + (column < w ? column : w - 1);
            for (int ch = 0; ch < 3; ch++)
                gradient[(size_t) ch * pixels + (size_t) to] += creal(own[i]) * share(p, ch, plane);
        }
    }
done:;
    const bool failed = !f || !work || !bin;
    sg_free(f);
    sg_free(work);
    sg_free(bin);
    return failed ? SG_ERR_BUDGET : SG_OK;
}

static double norm_of(double d, enum sg_tv_penalty norm)
{
    const double edge = (double) SG_TV_EDGE, size = fabs(d);
    if (norm == SG_TV_PENALTY_L1)
        return size;
    return norm == SG_TV_PENALTY_L2 || size < edge ? d * d : edge * (2 * size - edge);
}

static double slope_of(double d, enum sg_tv_penalty norm)
{
    const double edge = (double) SG_TV_EDGE;
    if (norm == SG_TV_PENALTY_L1)
        return (d > 0) - (d < 0);
    return norm == SG_TV_PENALTY_L2 || fabs(d) < edge ? 2 * d : d > 0 ? 2 * edge : -2 * edge;
}

/* Mean over the vertical differences plus mean over the horizontal ones. */
int sg_ref_loss_total_variation(sg_ctx *ctx, const struct sg_loss *loss, const float *x, int w,
                                int h, double *gradient, double *out)
{
    (void) ctx;
    const enum sg_tv_penalty norm = loss->total_variation;
    const double count[2] = {3.0 * w * (h - 1), 3.0 * (w - 1) * h};
    *out = 0;
    if (gradient)
        memset(gradient, 0, 3 * (size_t) w * (size_t) h * sizeof(*gradient));
    for (int i = 0; i < 3 * w * h; i++)
        for (int across = 0; across < 2; across++) {
            if (across ? i % w + 1 == w : i / w % h + 1 == h)
                continue;
            const int next = i + (across ? 1 : w);
            const double d = (double) (x[next] - x[i]);
            *out += norm_of(d, norm) / count[across];
            if (gradient) {
                gradient[next] += slope_of(d, norm) / count[across];
                gradient[i] -= slope_of(d, norm) / count[across];
            }
        }
    return SG_OK;
}

int sg_ref_image_loss(sg_ctx *ctx, const struct sg_loss *loss, const float *planes, int width,
                      int height, double *gradient, double *out)
{
    static int (*const kinds[SG_LOSSES])(sg_ctx *, const struct sg_loss *, const float *, int, int,
                                         double *, double *) = {
#define L(kind, name, type) [SG_LOSS_##kind] = sg_ref_loss_##name,
        SG_IMAGE_LOSSES(L)
#undef L
    };
    return kinds[loss->kind](ctx, loss, planes, width, height, gradient, out);
}
