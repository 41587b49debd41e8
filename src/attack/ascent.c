/* SPDX-License-Identifier: Apache-2.0 */
#include "ascent.h"

#include <math.h>
#include <string.h>

#include "engine/cpu/dispatch.h"

#define ROWS 16 /* a piece of work */
#define ISO_FLOOR 1e-12f

static float sign(float v)
{
    return (float) ((v > 0) - (v < 0));
}

/* The difference to the next column, 0 where there is none. */
static float right(const float *row, int width, int i)
{
    return i + 1 < width ? row[i + 1] - row[i] : 0;
}

/* 1 / the root of pixel i's term. */
static float iso_weight(const float *row, const float *below, int width, int i)
{
    const float v = below[i] - row[i], h = right(row, width, i);
    return 1 / sqrtf(v * v + h * h + ISO_FLOOR);
}

void sg_tv_gradient_row(const float *plane, int width, int height, int y, enum sg_tv_form form, float *out)
{
    const float *row = plane + (size_t) y * (size_t) width;
    const float *above = y > 0 ? row - width : row,
                *below = y + 1 < height ? row + width : row; /* none: no difference */
    if (form == SG_TV_ISO) {
        for (int i = 0; i < width; i++) {
            const float own = -((below[i] - row[i]) + right(row, width, i)) * iso_weight(row, below, width, i);
            const float up = (row[i] - above[i]) * iso_weight(above, row, width, i);
            out[i] = own + up + (i > 0 ? (row[i] - row[i - 1]) * iso_weight(row, below, width, i - 1) : 0);
        }
        return;
    }
    const float weight = form == SG_TV_VERTICAL2 ? 2 : 1;
    for (int i = 0; i < width; i++)
        out[i] = weight * (sign(row[i] - above[i]) + sign(row[i] - below[i]));
    if (form == SG_TV_ANISO)
        for (int i = 0; i < width; i++)
            out[i] += (i > 0 ? sign(row[i] - row[i - 1]) : 0) - sign(right(row, width, i));
}

struct job {
    const struct cpu_kernels *kernels;
    struct cpu_ascend_args args;
};

static void scalar_row(const struct cpu_ascend_args *a, size_t r)
{
    const size_t channel = r / (size_t) a->height, plane = (size_t) a->width * (size_t) a->height;
    const size_t at = r * (size_t) a->width;
    const float *x = a->from + at, *v = a->photo + at;
    float *to = a->to + at;
    sg_tv_gradient_row(a->from + channel * plane, a->width, a->height, (int) (r % (size_t) a->height),
                       (enum sg_tv_form) a->form, to);
    for (int i = 0; i < a->width; i++) {
        float y = x[i] + a->step * sign(to[i] + (a->extra ? a->extra[at + (size_t) i] : 0));
        y = fminf(fmaxf(y, v[i] - a->epsilon), v[i] + a->epsilon);
        to[i] = fminf(fmaxf(y, 0), 1);
    }
}

static void step_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t first = piece * ROWS, all = 3 * (size_t) j->args.height;
    for (size_t r = first; r < first + ROWS && r < all; r++)
        (j->kernels ? j->kernels->ascend : scalar_row)(&j->args, r);
}

/* Down the anisotropy loss, its mean absolute value scaled to the weight. */
static const float *spectral_descent(const struct ascent *a, const float *x, size_t values)
{
    double sum = 0;
    memset(a->extra, 0, values * sizeof(float));
    sg_anisotropy_loss(a->spectral, x, 1, a->extra);
    for (size_t i = 0; i < values; i++)
        sum += (double) fabsf(a->extra[i]);
    const float scale = sum > 0 ? (float) (-(double) a->spectral_weight * (double) values / sum) : 0;
    for (size_t i = 0; i < values; i++)
        a->extra[i] *= scale;
    return a->extra;
}

void sg_ascend(sg_ctx *ctx, const struct ascent *a, const float *photo, int width, int height, float *x, float *scratch)
{
    const size_t values = 3 * (size_t) width * (size_t) height, pieces = (3 * (size_t) height + ROWS - 1) / ROWS;
    struct job j = {.kernels = a->kernels,
                    .args = {.epsilon = a->epsilon,
                             .step = a->step,
                             .form = a->form,
                             .width = width,
                             .height = height,
                             .photo = photo,
                             .from = x,
                             .to = scratch}};
    for (int k = 0; k < a->steps; k++) {
        if (a->spectral)
            j.args.extra = spectral_descent(a, j.args.from, values);
        sg_parallel_for(ctx, pieces, step_piece, &j);
        float *next = k % 2 ? scratch : x;
        j.args.from = j.args.to;
        j.args.to = next;
    }
    if (a->steps % 2)
        memcpy(x, scratch, values * sizeof(float));
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
    const float *row = j->planes + r * (size_t) w, *below = (r + 1) % (size_t) j->height ? row + w : row;
    double sum = 0;
    for (int i = 0; i < w; i++) {
        const double v = (double) (below[i] - row[i]), h = (double) right(row, w, i);
        sum += j->form == SG_TV_VERTICAL2 ? 2 * fabs(v)
               : j->form == SG_TV_ANISO   ? fabs(v) + fabs(h)
                                          : sqrt(v * v + h * h + (double) ISO_FLOOR);
    }
    j->rows[r] = sum;
}

double sg_tv_planes(sg_ctx *ctx, const float *planes, int width, int height, enum sg_tv_form form, double *rows)
{
    sg_parallel_for(ctx, 3 * (size_t) height, variation_row, &(struct variation){planes, width, height, form, rows});
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
            const double v = y + 1 < height ? p[stride] - p[0] : 0, h = i + 3 < stride ? p[3] - p[0] : 0;
            sum += form == SG_TV_VERTICAL2 ? 2 * fabs(v)
                   : form == SG_TV_ANISO   ? fabs(v) + fabs(h)
                                           : sqrt(v * v + h * h);
        }
    return sum / (double) (stride * (size_t) height);
}
