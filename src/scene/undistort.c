/* SPDX-License-Identifier: Apache-2.0 */
/* Lens distortion is taken out once, at loading, so that the rest of the library knows pinholes
 * only. */
#include <math.h>
#include <string.h>

#include "scene/reader.h"

/* Keys' cubic (a = -0.5) at distances 1+f, f, 1-f, 2-f: sharper than linear, which matters for a
 * target image. */
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

int sg_undistort(sg_ctx *ctx, const struct sg_lens *lens, int width, int height, const uint8_t *src,
                 uint8_t *dst, uint8_t *valid, uint8_t *mask, size_t *lost)
{
    size_t pixels = (size_t) width * (size_t) height;
    uint8_t *old_mask = NULL;
    if (mask) {
        old_mask = sg_alloc_raw(ctx, SG_MEM_IMAGES, pixels, 1);
        if (!old_mask)
            return SG_ERR_BUDGET;
        memcpy(old_mask, mask, pixels);
    }
    const bool decentred = lens->p1 != 0 || lens->p2 != 0 || lens->s1 != 0 || lens->s2 != 0;
    const double far_x = fmax(fabs(lens->cx), fabs(width - lens->cx)) / lens->fx;
    const double far_y = fmax(fabs(lens->cy), fabs(height - lens->cy)) / lens->fy;
    const double fold = sg_lens_fold(lens, far_x * far_x + far_y * far_y);
    *lost = 0;
    for (int v = 0; v < height; v++)
        for (int u = 0; u < width; u++) {
            size_t at = (size_t) v * (size_t) width + (size_t) u;
            double x = (u + 0.5 - lens->cx) / lens->fx, y = (v + 0.5 - lens->cy) / lens->fy, xd, yd;
            double r2 = x * x + y * y;
            sg_lens_distort(lens, x, y, &xd, &yd);
            double sx = xd * lens->fx + lens->cx - 0.5,
                   sy = yd * lens->fy + lens->cy - 0.5; /* in sample indices */
            /* a photo ends half a pixel beyond its outer samples; NaN is outside */
            bool inside =
                r2 < fold && sx >= -0.5 && sx <= width - 0.5 && sy >= -0.5 && sy <= height - 0.5;
            inside = inside && (!decentred || sg_lens_keeps_sides(lens, x, y));
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
