/* SPDX-License-Identifier: Apache-2.0 */
/* The scalar step up the total variation. */
#include <math.h>

#include "engine/ops.h"
#include "image/total_variation.h"

#define ROWS 16 /* a piece of work */

static float sign(float v)
{
    return (float) ((v > 0) - (v < 0));
}

static void ascend_row(const struct sg_ascend *a, size_t r)
{
    const size_t channel = r / (size_t) a->height, plane = (size_t) a->width * (size_t) a->height;
    const size_t at = r * (size_t) a->width;
    const float *x = a->from + at, *v = a->photo + at;
    float *to = a->to + at;
    const float weight = a->form == SG_ATTACK_TV_VERTICAL2 ? 0.5f : 1; /* 1 per neighbour */
    sg_tv_gradient_row(a->from + channel * plane, a->width, a->height,
                       (int) (r % (size_t) a->height), a->form, to);
    for (int i = 0; i < a->width; i++) {
        float y =
            x[i] + a->step * sign(weight * to[i] + (a->extra ? a->extra[at + (size_t) i] : 0));
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
