/* SPDX-License-Identifier: Apache-2.0 */
/* L1 and SSIM with their gradient, a row at a time: down the columns first, then along the row. Every row is its own
 * piece of work, so sums do not depend on how rows are dealt out. */
#include "kernels.h"

#include "math/photometric.h"

#define PAD SG_LANES /* zeros on both sides of a row buffer */

/* Row y of the channel's target as floats; where masked out, the render itself. */
void KERNEL(loss_target)(const struct cpu_loss_args *a, int channel, int y)
{
    const size_t at = (size_t) y * (size_t) a->width, plane = (size_t) a->width * (size_t) a->height;
    const float *x = a->rgb + (size_t) channel * plane + at;
    const uint8_t *m = a->params->mask ? a->params->mask + at : NULL;
    float *out = a->target + (size_t) channel * plane + at;
    if (a->params->planes) {
        const float *planes = a->params->planes + (size_t) channel * plane + at;
        for (int i = 0; i < a->width; i++)
            out[i] = m && !m[i] ? x[i] : planes[i];
        return;
    }
    const uint8_t *t = a->params->target + 3 * at + channel;
    for (int i = 0; i < a->width; i++)
        out[i] = m && !m[i] ? x[i] : (float) t[3 * i] * (1.0f / 255.0f);
}

/* Lanes of a row from i on, zeros past its end. */
SIMD real row_load(const float *row, int i, int width)
{
    if (i + LANES <= width)
        return r_load(row + i);
    float lanes[LANES] = {0};
    memcpy(lanes, row + i, (size_t) (width - i) * sizeof(float));
    return r_load(lanes);
}

SIMD void row_store(float *row, int i, int width, real v)
{
    if (i + LANES <= width)
        r_store(row + i, v);
    else {
        float lanes[LANES];
        r_store(lanes, v);
        memcpy(row + i, lanes, (size_t) (width - i) * sizeof(float));
    }
}

/* The window along a row. It is symmetric: one multiplication for two taps. */
SIMD real along(const float *row, int i)
{
    real s = r_load(row + i) * sg_ssim_window[SG_SSIM_RADIUS];
    for (int k = 1; k <= SG_SSIM_RADIUS; k++)
        s += (r_load(row + i - k) + r_load(row + i + k)) * sg_ssim_window[SG_SSIM_RADIUS - k];
    return s;
}

/* Zeros around `count` row buffers of `stride` floats; returns the first pixel of the first. */
SIMD float *clear_pads(float *scratch, int count, int stride, int width)
{
    for (int m = 0; m < count; m++) {
        memset(scratch + m * stride, 0, PAD * sizeof(float));
        memset(scratch + m * stride + PAD + width, 0, (size_t) (stride - PAD - width) * sizeof(float));
    }
    return scratch + PAD;
}

void KERNEL(loss_forward)(const struct cpu_loss_args *a, int channel, int y, float *scratch)
{
    const int w = a->width, stride = CPU_LOSS_STRIDE(w);
    const size_t plane = (size_t) w * (size_t) a->height, at = (size_t) y * (size_t) w;
    const float *x = a->rgb + (size_t) channel * plane, *t = a->target + (size_t) channel * plane;
    const int j0 = y < SG_SSIM_RADIUS ? -y : -SG_SSIM_RADIUS;
    const int j1 = a->height - 1 - y < SG_SSIM_RADIUS ? a->height - 1 - y : SG_SSIM_RADIUS;
    float *rows = clear_pads(scratch, 4, stride, w);
    real l1 = r_set(0), l2 = r_set(0), ssim = r_set(0);
    for (int i = 0; i < w; i += LANES) {
        real m1 = r_set(0), m2 = m1, squares = m1, xy = m1;
        for (int j = j0; j <= j1; j++) {
            const ptrdiff_t row = (ptrdiff_t) at + (ptrdiff_t) j * w;
            const real vx = row_load(x + row, i, w), vt = row_load(t + row, i, w);
            const float k = sg_ssim_window[j + SG_SSIM_RADIUS];
            const real kx = vx * k, kt = vt * k;
            m1 += kx, m2 += kt;
            squares += kx * vx, xy += kx * vt;
            squares += kt * vt;
        }
        row_store(rows, i, w, m1);
        row_store(rows + stride, i, w, m2);
        row_store(rows + 2 * stride, i, w, squares);
        row_store(rows + 3 * stride, i, w, xy);
        const real d = row_load(x + at, i, w) - row_load(t + at, i, w);
        l1 += r_max(d, -d);
        l2 += d * d;
    }
    for (int i = 0; i < w; i += LANES) {
        real d_m, d_xx, d_xy;
        const real s = ssim_point(along(rows, i), along(rows + stride, i), along(rows + 2 * stride, i),
                                  along(rows + 3 * stride, i), &d_m, &d_xx, &d_xy);
        ssim += r_keep(r_lt(r_lane() + (float) i, r_set((float) w)), s);
        float *maps = a->maps + 3 * (size_t) channel * plane + at;
        row_store(maps, i, w, d_m);
        row_store(maps + plane, i, w, d_xx);
        row_store(maps + 2 * plane, i, w, d_xy);
    }
    double *sums = a->sums + 3 * ((size_t) channel * (size_t) a->height + (size_t) y);
    sums[0] = (double) r_sum(l1), sums[1] = (double) r_sum(l2), sums[2] = (double) r_sum(ssim);
}

void KERNEL(loss_backward)(const struct cpu_loss_args *a, int channel, int y, float *scratch)
{
    const int w = a->width, stride = CPU_LOSS_STRIDE(w);
    const size_t plane = (size_t) w * (size_t) a->height, at = (size_t) y * (size_t) w;
    const float *maps = a->maps + 3 * (size_t) channel * plane;
    const float *x = a->rgb + (size_t) channel * plane + at, *t = a->target + (size_t) channel * plane + at;
    float *out = a->gradient + (size_t) channel * plane + at;
    const int j0 = y < SG_SSIM_RADIUS ? -y : -SG_SSIM_RADIUS;
    const int j1 = a->height - 1 - y < SG_SSIM_RADIUS ? a->height - 1 - y : SG_SSIM_RADIUS;
    float *rows = clear_pads(scratch, 3, stride, w);
    for (int i = 0; i < w; i += LANES) {
        real s[3] = {r_set(0), r_set(0), r_set(0)};
        for (int j = j0; j <= j1; j++) {
            const ptrdiff_t row = (ptrdiff_t) at + (ptrdiff_t) j * w;
            for (int m = 0; m < 3; m++)
                s[m] += row_load(maps + (size_t) m * plane + row, i, w) * sg_ssim_window[j + SG_SSIM_RADIUS];
        }
        for (int m = 0; m < 3; m++)
            row_store(rows + m * stride, i, w, s[m]);
    }
    const float unit = 1 / (3 * (float) plane), lambda = a->params->lambda_dssim;
    const float l1 = (1 - lambda) * unit, dssim = -lambda * unit;
    const uint8_t *used = a->params->mask ? a->params->mask + at : NULL;
    for (int i = 0; i < w; i += LANES) {
        const real vx = row_load(x, i, w), vt = row_load(t, i, w), zero = r_set(0);
        const real ds = along(rows, i) + 2 * vx * along(rows + stride, i) + vt * along(rows + 2 * stride, i);
        const real sign = r_keep(r_lt(vt, vx), r_set(1)) - r_keep(r_lt(vx, vt), r_set(1));
        real g = l1 * sign + dssim * ds;
        if (used) { /* no pull where the target is the render itself */
            real keep = zero;
            for (int k = 0; k < LANES && i + k < w; k++)
                keep[k] = used[i + k] ? 1.0f : 0.0f;
            g *= keep;
        }
        row_store(out, i, w, g);
    }
}
