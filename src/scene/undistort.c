/* SPDX-License-Identifier: Apache-2.0 */
/* Lens distortion is taken out once, at loading, so that the rest of the library knows pinholes only. */
#include <math.h>
#include <string.h>

#include "scene/reader.h"

/* Square of the radius up to which x (1 + k1 r^2 + k2 r^4) grows: beyond, the polynomial folds back and would show
 * parts of the photo twice. */
static double fold_radius(double k1, double k2)
{
    /* smallest positive root of 1 + 3 k1 s + 5 k2 s^2 */
    double a = 5 * k2, b = 3 * k1, disc = b * b - 4 * a;
    if (a == 0)
        return b < 0 ? -1 / b : INFINITY;
    if (disc < 0)
        return INFINITY;
    double q = -0.5 * (b + copysign(sqrt(disc), b)), s0 = q / a, s1 = q != 0 ? 1 / q : INFINITY;
    double low = s0 < s1 ? s0 : s1, high = s0 < s1 ? s1 : s0;
    return low > 0 ? low : high > 0 ? high : INFINITY;
}

/* Keys' cubic (a = -0.5) at distances 1+f, f, 1-f, 2-f: sharper than linear, which matters for a target image. */
static void cubic_weights(float f, float w[4])
{
    w[0] = ((-0.5f * f + 1) * f - 0.5f) * f;
    w[1] = (1.5f * f - 2.5f) * f * f + 1;
    w[2] = ((-1.5f * f + 2) * f + 0.5f) * f;
    w[3] = (0.5f * f - 0.5f) * f * f;
}

static int clamp(int i, int n)
{
    return i < 0 ? 0 : i >= n ? n - 1 : i;
}

static void sample(const uint8_t *src, int width, int height, double sx, double sy, uint8_t rgb[3])
{
    int x0 = (int) floor(sx), y0 = (int) floor(sy);
    float wx[4], wy[4], sum[3] = {0.5f, 0.5f, 0.5f};
    cubic_weights((float) (sx - x0), wx);
    cubic_weights((float) (sy - y0), wy);
    for (int j = 0; j < 4; j++) {
        const uint8_t *row = src + (size_t) clamp(y0 - 1 + j, height) * (size_t) width * 3;
        for (int i = 0; i < 4; i++) {
            const uint8_t *p = row + (size_t) clamp(x0 - 1 + i, width) * 3;
            for (int c = 0; c < 3; c++)
                sum[c] += wy[j] * wx[i] * p[c];
        }
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t) (sum[c] < 0 ? 0 : sum[c] > 255 ? 255 : sum[c]);
}

int sg_undistort(sg_ctx *ctx, const struct sg_lens *lens, int width, int height, const uint8_t *src, uint8_t *dst,
                 uint8_t *valid, uint8_t *mask, size_t *lost)
{
    size_t pixels = (size_t) width * (size_t) height;
    uint8_t *old_mask = NULL;
    if (mask) {
        old_mask = sg_alloc_raw(ctx, SG_MEM_IMAGES, pixels, 1);
        if (!old_mask)
            return SG_ERR_BUDGET;
        memcpy(old_mask, mask, pixels);
    }
    double fold = fold_radius(lens->k1, lens->k2);
    *lost = 0;
    for (int v = 0; v < height; v++)
        for (int u = 0; u < width; u++) {
            size_t at = (size_t) v * (size_t) width + (size_t) u;
            double x = (u + 0.5 - lens->cx) / lens->fx, y = (v + 0.5 - lens->cy) / lens->fy;
            double r2 = x * x + y * y, d = 1 + (lens->k1 + lens->k2 * r2) * r2;
            double xd = x * d + 2 * lens->p1 * x * y + lens->p2 * (r2 + 2 * x * x);
            double yd = y * d + lens->p1 * (r2 + 2 * y * y) + 2 * lens->p2 * x * y;
            double sx = xd * lens->fx + lens->cx - 0.5, sy = yd * lens->fy + lens->cy - 0.5; /* in sample indices */
            /* a photo ends half a pixel beyond its outer samples; NaN is outside */
            bool inside = r2 < fold && sx >= -0.5 && sx <= width - 0.5 && sy >= -0.5 && sy <= height - 0.5;
            valid[at] = inside ? 255 : 0;
            if (inside) {
                sample(src, width, height, sx, sy, dst + 3 * at);
            } else {
                memset(dst + 3 * at, 0, 3);
                ++*lost;
            }
            if (mask) {
                size_t sv = inside ? (size_t) clamp((int) lround(sy), height) : 0;
                size_t su = inside ? (size_t) clamp((int) lround(sx), width) : 0;
                mask[at] = inside ? old_mask[sv * (size_t) width + su] : 0;
            }
        }
    sg_free(old_mask);
    return SG_OK;
}
