/* SPDX-License-Identifier: Apache-2.0 */
/* Separable resampling with 8-bit rounding after each pass. The order (columns within rows first)
 * and the fixed-point weights are those of Pillow, whose bytes the reference trains on. */
#include <math.h>
#include <string.h>

#include "image.h"

/* bits after the point: 8 bits of sample, 2 of overshoot, 22 of weight fill an int32 */
#define PRECISION 22

/* One output sample is the weighted sum of count inputs from first. */
struct taps {
    int *first, *count;
    int32_t *weight; /* size x support */
    int support;
};

static double bicubic(double x)
{
    const double a = -0.5;
    x = fabs(x);
    if (x < 1)
        return ((a + 2) * x - (a + 3)) * x * x + 1;
    return x < 2 ? (((x - 5) * x + 8) * x - 4) * a : 0;
}

static void clear_taps(struct taps *t)
{
    sg_free(t->first);
    sg_free(t->count);
    sg_free(t->weight);
}

static int make_taps(sg_ctx *ctx, int in, int out, struct taps *t)
{
    double scale = (double) in / out, filter = scale < 1 ? 1 : scale, radius = 2 * filter;
    t->support = (int) ceil(radius) * 2 + 1;
    double *weight = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) t->support, sizeof(*weight));
    t->first = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) out, sizeof(*t->first));
    t->count = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) out, sizeof(*t->count));
    t->weight =
        sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) out * (size_t) t->support, sizeof(*t->weight));
    if (!weight || !t->first || !t->count || !t->weight) {
        sg_free(weight);
        return SG_ERR_BUDGET;
    }
    for (int o = 0; o < out; o++) {
        double center = (o + 0.5) * scale, sum = 0;
        int first = (int) (center - radius + 0.5), last = (int) (center + radius + 0.5);
        first = first < 0 ? 0 : first;
        last = last > in ? in : last;
        for (int i = first; i < last; i++) {
            weight[i - first] = bicubic((i - center + 0.5) / filter);
            sum += weight[i - first];
        }
        for (int i = 0; i < last - first; i++) {
            double w = weight[i] / sum * (1 << PRECISION);
            t->weight[(size_t) o * (size_t) t->support + (size_t) i] =
                (int32_t) (w < 0 ? w - 0.5 : w + 0.5);
        }
        t->first[o] = first;
        t->count[o] = last - first;
    }
    sg_free(weight);
    return SG_OK;
}

static inline uint8_t to_byte(int32_t sum)
{
    int v = sum >> PRECISION;
    return (uint8_t) (v < 0 ? 0 : v > 255 ? 255 : v);
}

static void pass_x(const struct taps *t, const uint8_t *src, int width, int height, int channels,
                   uint8_t *dst, int dst_width)
{
    for (int y = 0; y < height; y++, src += (size_t) width * (size_t) channels)
        for (int o = 0; o < dst_width; o++) {
            const int32_t *w = t->weight + (size_t) o * (size_t) t->support;
            const uint8_t *s = src + (size_t) t->first[o] * (size_t) channels;
            for (int c = 0; c < channels; c++) {
                int32_t sum = 1 << (PRECISION - 1);
                for (int i = 0; i < t->count[o]; i++)
                    sum += w[i] * s[i * channels + c];
                *dst++ = to_byte(sum);
            }
        }
}

static void pass_y(const struct taps *t, const uint8_t *src, size_t stride, uint8_t *dst,
                   int dst_height, int32_t *sums)
{
    for (int o = 0; o < dst_height; o++, dst += stride) {
        const int32_t *w = t->weight + (size_t) o * (size_t) t->support;
        const uint8_t *s = src + (size_t) t->first[o] * stride;
        for (size_t x = 0; x < stride; x++)
            sums[x] = 1 << (PRECISION - 1);
        for (int i = 0; i < t->count[o]; i++, s += stride)
            for (size_t x = 0; x < stride; x++)
                sums[x] += w[i] * s[x];
        for (size_t x = 0; x < stride; x++)
            dst[x] = to_byte(sums[x]);
    }
}

int sg_resample(sg_ctx *ctx, const uint8_t *src, int width, int height, int channels, uint8_t *dst,
                int dst_width, int dst_height)
{
    int code = SG_ERR_BUDGET;
    struct taps tx = {0}, ty = {0};
    uint8_t *between = NULL;
    int32_t *sums = NULL;
    const uint8_t *rows = src;
    size_t stride = (size_t) dst_width * (size_t) channels;
    if (dst_width != width) {
        between = sg_alloc_raw(ctx, SG_MEM_IMAGES, stride, (size_t) height);
        if (!between || make_taps(ctx, width, dst_width, &tx))
            goto done;
        pass_x(&tx, src, width, height, channels, between, dst_width);
        rows = between;
    }
    if (dst_height != height) {
        sums = sg_alloc_raw(ctx, SG_MEM_MISC, stride, sizeof(*sums));
        if (!sums || make_taps(ctx, height, dst_height, &ty))
            goto done;
        pass_y(&ty, rows, stride, dst, dst_height, sums);
    } else {
        memcpy(dst, rows, stride * (size_t) height);
    }
    code = SG_OK;
done:
    clear_taps(&tx);
    clear_taps(&ty);
    sg_free(between);
    sg_free(sums);
    return code;
}
