/* SPDX-License-Identifier: Apache-2.0 */
#include "ascent.h"

#include <math.h>
#include <string.h>

#define ISO_FLOOR 1e-12f

/* The difference to the next column, 0 where there is none. */
static float right(const float *row, int width, int i)
{
    return i + 1 < width ? row[i + 1] - row[i] : 0;
}

/* Down the anisotropy loss, its mean absolute value scaled to the weight. */
static const float *spectral_descent(const struct ascent *a, const float *x, size_t values)
{
    double sum = 0;
    memset(a->extra, 0, values * sizeof(float));
    sg_anisotropy_loss(a->spectral, x, 1, a->extra);
    for (size_t i = 0; i < values; i++)
        sum += (double) fabsf(a->extra[i]);
    const float scale =
        sum > 0 ? (float) (-(double) a->spectral_weight * (double) values / sum) : 0;
    for (size_t i = 0; i < values; i++)
        a->extra[i] *= scale;
    return a->extra;
}

int sg_ascend(struct sg_engine *e, const struct ascent *a, const float *photo, int width,
              int height, float *x, float *scratch)
{
    const size_t values = 3 * (size_t) width * (size_t) height;
    struct sg_ascend step = {.epsilon = a->epsilon,
                             .step = a->step,
                             .form = a->form,
                             .width = width,
                             .height = height,
                             .photo = photo,
                             .bound = a->bound,
                             .from = x,
                             .to = scratch};
    for (int k = 0; k < a->steps; k++) {
        int code =
            sg_progress(sg_engine_ctx(e), SG_STAGE_ASCEND, (uint64_t) k, (uint64_t) a->steps);
        if (a->spectral && !code)
            step.extra = spectral_descent(a, step.from, values);
        if (!code)
            code = sg_engine_ascend(e, &step);
        if (code)
            return code;
        float *next = k % 2 ? scratch : x;
        step.from = step.to;
        step.to = next;
    }
    if (a->steps % 2)
        memcpy(x, scratch, values * sizeof(float));
    return SG_OK;
}

struct variation {
    const float *planes;
    int width, height;
    enum sg_tv_form form;
    double *rows;
};

static void variation_row(void *arg, size_t r, int thread)
{
    (void) thread;
    const struct variation *j = arg;
    const int w = j->width;
    const float *row = j->planes + r * (size_t) w,
                *below = (r + 1) % (size_t) j->height ? row + w : row;
    double sum = 0;
    for (int i = 0; i < w; i++) {
        const double v = (double) (below[i] - row[i]), h = (double) right(row, w, i);
        sum += j->form == SG_TV_VERTICAL2 ? 2 * fabs(v)
               : j->form == SG_TV_ANISO   ? fabs(v) + fabs(h)
                                          : sqrt(v * v + h * h + (double) ISO_FLOOR);
    }
    j->rows[r] = sum;
}

double sg_tv_planes(sg_ctx *ctx, const float *planes, int width, int height, enum sg_tv_form form,
                    double *rows)
{
    sg_parallel_for(ctx, 3 * (size_t) height, variation_row,
                    &(struct variation){planes, width, height, form, rows});
    double sum = 0;
    for (int r = 0; r < 3 * height; r++)
        sum += rows[r];
    return sum;
}

double sg_total_variation(const uint8_t *rgb, int width, int height, enum sg_tv_form form)
{
    const size_t stride = 3 * (size_t) width;
    double sum = 0;
    for (int y = 0; y < height; y++)
        for (size_t i = 0; i < stride; i++) {
            const uint8_t *p = rgb + (size_t) y * stride + i;
            const double v = y + 1 < height ? p[stride] - p[0] : 0,
                         h = i + 3 < stride ? p[3] - p[0] : 0;
            sum += form == SG_TV_VERTICAL2 ? 2 * fabs(v)
                   : form == SG_TV_ANISO   ? fabs(v) + fabs(h)
                                           : sqrt(v * v + h * h);
        }
    return sum / (double) (stride * (size_t) height);
}
