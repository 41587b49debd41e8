/* SPDX-License-Identifier: Apache-2.0 */
#include "exposure.h"

#include <math.h>
#include <string.h>

#include "math/constants.h"

struct job {
    const float *exposure, *rgb;
    float *image, *gradient;
    double *rows;
    size_t width, pixels;
};

static void expose_row(void *arg, size_t row, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t n = j->pixels;
    for (size_t i = row * j->width; i < (row + 1) * j->width; i++) {
        float out[3];
        sg_expose(j->exposure, (const float[]){j->rgb[i], j->rgb[n + i], j->rgb[2 * n + i]}, out);
        for (size_t c = 0; c < 3; c++)
            j->image[c * n + i] = out[c];
    }
}

/* Rows are summed on their own and then in their order: the same for any number of threads. */
static void backward_row(void *arg, size_t row, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t n = j->pixels;
    double sums[SG_EXPOSURE] = {0};
    for (size_t i = row * j->width; i < (row + 1) * j->width; i++) {
        const float g[3] = {j->gradient[i], j->gradient[n + i], j->gradient[2 * n + i]};
        float colour[3];
        sg_expose_backward(j->exposure, g, colour);
        for (size_t k = 0; k < 3; k++) {
            for (size_t c = 0; c < 3; c++)
                sums[4 * k + c] += (double) (j->rgb[k * n + i] * g[c]);
            sums[4 * k + 3] += (double) g[k];
            j->gradient[k * n + i] = colour[k];
        }
    }
    memcpy(j->rows + row * SG_EXPOSURE, sums, sizeof(sums));
}

int sg_host_expose(sg_ctx *ctx, struct sg_host_exposure *x, const float *exposure, const float *rgb,
                   int width, int height)
{
    const size_t pixels = (size_t) width * (size_t) height;
    if (sg_grow(ctx, SG_MEM_FRAME, &x->image, &x->cap_image, pixels, 0, 3 * sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &x->rows, &x->cap_rows, (size_t) height, 0,
                SG_EXPOSURE * sizeof(double)))
        return SG_ERR_BUDGET;
    struct job job = {.exposure = exposure,
                      .rgb = rgb,
                      .image = x->image,
                      .width = (size_t) width,
                      .pixels = pixels};
    sg_parallel_for(ctx, (size_t) height, expose_row, &job);
    return SG_OK;
}

void sg_host_expose_backward(sg_ctx *ctx, struct sg_host_exposure *x, const float *exposure,
                             const float *rgb, int width, int height, float *gradient,
                             double out[SG_EXPOSURE])
{
    struct job job = {.exposure = exposure,
                      .rgb = rgb,
                      .gradient = gradient,
                      .rows = x->rows,
                      .width = (size_t) width,
                      .pixels = (size_t) width * (size_t) height};
    sg_parallel_for(ctx, (size_t) height, backward_row, &job);
    memset(out, 0, SG_EXPOSURE * sizeof(*out));
    for (int row = 0; row < height; row++)
        for (int k = 0; k < SG_EXPOSURE; k++)
            out[k] += x->rows[row * SG_EXPOSURE + k];
}

void sg_host_learn_exposures(float *exposures, size_t n, size_t number,
                             const double gradient[SG_EXPOSURE],
                             const struct sg_exposure_update *update)
{
    const double b1 = (double) SG_ADAM_BETA1, b2 = (double) SG_ADAM_BETA2;
    const size_t values = n * SG_EXPOSURE;
    float *m = exposures + values, *v = m + values;
    for (size_t i = 0; i < values; i++) {
        const double g = i / SG_EXPOSURE == number ? gradient[i % SG_EXPOSURE] : 0;
        m[i] = (float) (b1 * (double) m[i] + (1 - b1) * g);
        v[i] = (float) (b2 * (double) v[i] + (1 - b2) * g * g);
        exposures[i] -= (float) (update->rate * (double) m[i] /
                                 (sqrt((double) v[i]) * update->root + SG_EXPOSURE_EPS));
    }
}

void sg_host_exposure_clear(struct sg_host_exposure *x)
{
    sg_free(x->image);
    sg_free(x->rows);
    *x = (struct sg_host_exposure){0};
}
