/* SPDX-License-Identifier: Apache-2.0 */
#include "ascent.h"

#include <math.h>

#define ROWS 16 /* a piece of work */
#define ISO_FLOOR 1e-12f

static float sign(float v)
{
    return (float) ((v > 0) - (v < 0));
}

/* Differences to the next row and column, 0 where there is none. */
static float down(const float *row, const float *below, int i)
{
    return below ? below[i] - row[i] : 0;
}

static float right(const float *row, int width, int i)
{
    return i + 1 < width ? row[i + 1] - row[i] : 0;
}

static void iso_norms_row(const float *plane, int width, int height, int y, float *norms)
{
    const float *row = plane + (size_t) y * (size_t) width, *below = y + 1 < height ? row + width : NULL;
    for (int i = 0; i < width; i++) {
        const float v = down(row, below, i), h = right(row, width, i);
        norms[i] = 1 / sqrtf(v * v + h * h + ISO_FLOOR);
    }
}

void sg_tv_gradient_row(const float *plane, const float *norms, int width, int height, int y, enum sg_tv_form form,
                        float *out)
{
    const float *row = plane + (size_t) y * (size_t) width;
    const float *above = y > 0 ? row - width : row,
                *below = y + 1 < height ? row + width : row; /* none: no difference */
    if (form == SG_TV_ISO) {
        const float *n = norms + (size_t) y * (size_t) width, *n_above = y > 0 ? n - width : n;
        for (int i = 0; i < width; i++) {
            const float own = -((below[i] - row[i]) + right(row, width, i)) * n[i];
            const float up = (row[i] - above[i]) * n_above[i];
            out[i] = own + up + (i > 0 ? (row[i] - row[i - 1]) * n[i - 1] : 0);
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
    const struct ascent *a;
    const float *photo, *from;
    float *to, *norms;
    int width, height;
};

static void norms_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t first = piece * ROWS, all = 3 * (size_t) j->height, plane = (size_t) j->width * (size_t) j->height;
    for (size_t r = first; r < first + ROWS && r < all; r++) {
        const size_t channel = r / (size_t) j->height;
        iso_norms_row(j->from + channel * plane, j->width, j->height, (int) (r % (size_t) j->height),
                      j->norms + r * (size_t) j->width);
    }
}

static void step_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const struct ascent *a = j->a;
    const size_t first = piece * ROWS, all = 3 * (size_t) j->height, plane = (size_t) j->width * (size_t) j->height;
    for (size_t r = first; r < first + ROWS && r < all; r++) {
        const size_t channel = r / (size_t) j->height, at = r * (size_t) j->width;
        const float *x = j->from + at, *v = j->photo + at;
        float *to = j->to + at;
        sg_tv_gradient_row(j->from + channel * plane, j->norms ? j->norms + channel * plane : NULL, j->width, j->height,
                           (int) (r % (size_t) j->height), a->form, to);
        for (int i = 0; i < j->width; i++) {
            float y = x[i] + a->step * sign(to[i]);
            y = fminf(fmaxf(y, v[i] - a->epsilon), v[i] + a->epsilon);
            to[i] = fminf(fmaxf(y, 0), 1);
        }
    }
}

void sg_ascend(sg_ctx *ctx, const struct ascent *a, const float *photo, int width, int height, float *x, float *scratch)
{
    const size_t values = 3 * (size_t) width * (size_t) height, pieces = (3 * (size_t) height + ROWS - 1) / ROWS;
    float *from = x, *to = scratch;
    for (int k = 0; k < a->steps; k++) {
        struct job j = {a, photo, from, to, a->form == SG_TV_ISO ? scratch + values : NULL, width, height};
        if (j.norms)
            sg_parallel_for(ctx, pieces, norms_piece, &j);
        sg_parallel_for(ctx, pieces, step_piece, &j);
        float *swap = from;
        from = to, to = swap;
    }
    for (size_t i = 0; from != x && i < values; i++)
        x[i] = from[i];
}

double sg_tv_planes(const float *planes, int width, int height, enum sg_tv_form form)
{
    double sum = 0;
    for (int r = 0; r < 3 * height; r++) {
        const float *row = planes + (size_t) r * (size_t) width, *below = (r + 1) % height ? row + width : NULL;
        for (int i = 0; i < width; i++) {
            const double v = (double) down(row, below, i), h = (double) right(row, width, i);
            sum += form == SG_TV_VERTICAL2 ? 2 * fabs(v)
                   : form == SG_TV_ANISO   ? fabs(v) + fabs(h)
                                           : sqrt(v * v + h * h + (double) ISO_FLOOR);
        }
    }
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
