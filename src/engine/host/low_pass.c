/* SPDX-License-Identifier: Apache-2.0 */
/* The window is symmetric, and outside of the image differences are 0. So the low-pass filter is
 * its own transpose, and the gradient is the difference filtered twice. */
#include "low_pass.h"

#include <string.h>

#include "math/real_f32.h"
#include "math/photometric.h"

struct job {
    const float *image;
    const struct sg_target_pixels *target;
    const struct sg_photometric *params;
    float *difference, *passed, *gradient;
    double *rows;
    int width, height;
    float scale; /* of the gradient */
};

/* A value's difference from the photo, or 0 where it does not count. */
static float difference(const struct job *j, size_t r, size_t i, bool *counts)
{
    const size_t width = (size_t) j->width, channel = r / (size_t) j->height,
                 pixel = r % (size_t) j->height * width + i;
    const struct sg_target_pixels *t = j->target;
    const float photo =
        t->planes ? t->planes[r * width + i] : (float) t->rgb[3 * pixel + channel] / 255.0f;
    const float d = j->image[r * width + i] - photo;
    *counts = !(t->mask && !t->mask[pixel]) && low_pass_counts(d, photo, j->params->tolerance);
    return *counts ? d : 0;
}

/* out += weight x in, for as many values. */
static void add_row(const float *in, float weight, int count, float *out)
{
    for (int i = 0; i < count; i++)
        out[i] += weight * in[i];
}

static void along(const float *in, int width, float *out)
{
    memset(out, 0, (size_t) width * sizeof(*out));
    for (int k = -SG_SSIM_RADIUS; k <= SG_SSIM_RADIUS; k++) {
        const int from = k > 0 ? k : 0, to = k < 0 ? -k : 0;
        if (from + to < width)
            add_row(in + from, sg_ssim_window[k + SG_SSIM_RADIUS], width - from - to, out + to);
    }
}

/* Down the columns, row r of the planes. */
static void down(const struct job *j, const float *planes, size_t r, float *out)
{
    const int y = (int) (r % (size_t) j->height);
    memset(out, 0, (size_t) j->width * sizeof(*out));
    for (int k = -SG_SSIM_RADIUS; k <= SG_SSIM_RADIUS; k++)
        if (y + k >= 0 && y + k < j->height)
            add_row(planes + ((ptrdiff_t) r + k) * j->width, sg_ssim_window[k + SG_SSIM_RADIUS],
                    j->width, out);
}

static void first_along(void *arg, size_t r, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t at = r * (size_t) j->width;
    for (size_t i = 0; i < (size_t) j->width; i++) {
        bool counts;
        j->difference[at + i] = difference(j, r, i, &counts);
    }
    along(j->difference + at, j->width, j->passed + at);
}

static void first_down(void *arg, size_t r, int thread)
{
    (void) thread;
    const struct job *j = arg;
    float *row = j->difference + r * (size_t) j->width;
    double sum = 0;
    down(j, j->passed, r, row);
    for (int i = 0; i < j->width; i++)
        sum += (double) row[i] * (double) row[i];
    j->rows[r] = sum;
}

static void again_along(void *arg, size_t r, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t at = r * (size_t) j->width;
    along(j->difference + at, j->width, j->passed + at);
}

static void again_down(void *arg, size_t r, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t at = r * (size_t) j->width;
    down(j, j->passed, r, j->difference + at);
    for (size_t i = 0; i < (size_t) j->width; i++) {
        bool counts;
        difference(j, r, i, &counts);
        j->gradient[at + i] += counts ? j->scale * j->difference[at + i] : 0;
    }
}

int sg_host_low_pass(sg_ctx *ctx, struct sg_host_low_pass *s, const float *image,
                     const struct sg_target_pixels *target, const struct sg_photometric *p,
                     int width, int height, float *gradient, double *out)
{
    const size_t rows = 3 * (size_t) height, values = rows * (size_t) width;
    if (sg_grow(ctx, SG_MEM_FRAME, &s->difference, &s->cap_difference, values, 0, sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &s->passed, &s->cap_passed, values, 0, sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &s->rows, &s->cap_rows, rows, 0, sizeof(double)))
        return SG_ERR_BUDGET;
    struct job j = {.image = image,
                    .target = target,
                    .params = p,
                    .difference = s->difference,
                    .passed = s->passed,
                    .gradient = gradient,
                    .rows = s->rows,
                    .width = width,
                    .height = height,
                    .scale = 2 * p->low_pass / (float) values};
    static void (*const passes[])(void *, size_t, int) = {first_along, first_down, again_along,
                                                          again_down};
    for (size_t k = 0; k < sizeof(passes) / sizeof(passes[0]); k++)
        sg_parallel_for(ctx, rows, passes[k], &j);
    double sum = 0;
    for (size_t r = 0; r < rows; r++)
        sum += s->rows[r];
    *out = sum / (double) values;
    return SG_OK;
}

void sg_host_low_pass_clear(struct sg_host_low_pass *s)
{
    sg_free(s->difference);
    sg_free(s->passed);
    sg_free(s->rows);
    *s = (struct sg_host_low_pass){0};
}
