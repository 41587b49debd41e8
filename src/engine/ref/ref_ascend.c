/* SPDX-License-Identifier: Apache-2.0 */
/* The scalar step up the total variation. */
#include "ref_ascend.h"

#include <math.h>

#include "engine/ops.h"

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

void sg_tv_gradient_row(const float *plane, int width, int height, int y, enum sg_tv_form form,
                        float *out)
{
    const float *row = plane + (size_t) y * (size_t) width;
    const float *above = y > 0 ? row - width : row,
                *below = y + 1 < height ? row + width : row; /* none: no difference */
    if (form == SG_TV_ISO) {
        for (int i = 0; i < width; i++) {
            const float own =
                -((below[i] - row[i]) + right(row, width, i)) * iso_weight(row, below, width, i);
            const float up = (row[i] - above[i]) * iso_weight(above, row, width, i);
            out[i] = own + up +
                     (i > 0 ? (row[i] - row[i - 1]) * iso_weight(row, below, width, i - 1) : 0);
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

static void ascend_row(const struct sg_ascend *a, size_t r)
{
    const size_t channel = r / (size_t) a->height, plane = (size_t) a->width * (size_t) a->height;
    const size_t at = r * (size_t) a->width;
    const float *x = a->from + at, *v = a->photo + at;
    float *to = a->to + at;
    sg_tv_gradient_row(a->from + channel * plane, a->width, a->height,
                       (int) (r % (size_t) a->height), a->form, to);
    for (int i = 0; i < a->width; i++) {
        float y = x[i] + a->step * sign(to[i] + (a->extra ? a->extra[at + (size_t) i] : 0));
        const float epsilon = a->bound ? a->bound[at + (size_t) i - channel * plane] : a->epsilon;
        y = fminf(fmaxf(y, v[i] - epsilon), v[i] + epsilon);
        to[i] = fminf(fmaxf(y, 0), 1);
    }
}

static void ascend_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct sg_ascend *a = arg;
    const size_t first = piece * ROWS, all = 3 * (size_t) a->height;
    for (size_t r = first; r < first + ROWS && r < all; r++)
        ascend_row(a, r);
}

void sg_ref_ascend(sg_ctx *ctx, const struct sg_ascend *a)
{
    sg_parallel_for(ctx, (3 * (size_t) a->height + ROWS - 1) / ROWS, ascend_piece, (void *) a);
}
