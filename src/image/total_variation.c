/* SPDX-License-Identifier: Apache-2.0 */
/* Total variation: the penalty on renders. ref_losses.c has it by definition. */
#include "total_variation.h"

#include "math/real_f32.h"
#include "math/total_variation.h"

_Static_assert(SG_TV_NORM_L2 == (int) SG_TV_PENALTY_L2 && SG_TV_NORM_L1 == (int) SG_TV_PENALTY_L1 &&
                   SG_TV_NORM_HUBER == (int) SG_TV_PENALTY_HUBER,
               "kernels name the penalties so");

struct tv_job {
    const float *planes;
    float *gradient;
    int width, height;
    float vertical, horizontal; /* weight of a difference's gradient */
    enum sg_tv_penalty norm;
    double *rows; /* per row: vertical and horizontal sums */
};

#define LANES 16 /* pixels side by side, so that compilers may vectorise them */

static inline float norm_of(float d, enum sg_tv_penalty norm)
{
    return tv_norm(d, (int) norm, SG_TV_EDGE);
}

/* Sum over x of the norm of b - a. */
static inline double row_sum(const float *a, const float *b, int n, enum sg_tv_penalty norm)
{
    float part[LANES] = {0};
    double sum = 0;
    int x = 0;
    for (; x + LANES <= n; x += LANES)
        for (int k = 0; k < LANES; k++)
            part[k] += norm_of(b[x + k] - a[x + k], norm);
    for (; x < n; x++)
        part[0] += norm_of(b[x] - a[x], norm);
    for (int k = 0; k < LANES; k++)
        sum += (double) part[k];
    return sum;
}

/* Adds the gradient of n pixels, given with those around them. */
static inline void add_pull(const struct tv_job *j, const float *here, const float *above,
                            const float *below, const float *left, const float *right, int n,
                            enum sg_tv_penalty norm, float *restrict to)
{
    const float vertical = j->vertical, horizontal = j->horizontal;
    for (int x = 0; x < n; x++)
        to[x] += tv_gradient(here[x] - above[x], below[x] - here[x], here[x] - left[x],
                             right[x] - here[x], (int) norm, SG_TV_EDGE, vertical, horizontal);
}

/* Beyond the border the image repeats its last row or column, so differences and gradients are 0
 * there. */
static inline void row_of(const struct tv_job *j, size_t r, enum sg_tv_penalty norm)
{
    const int w = j->width, y = (int) (r % (size_t) j->height), last = w - 1;
    const float *row = j->planes + r * (size_t) w;
    const float *above = y > 0 ? row - w : row, *below = y + 1 < j->height ? row + w : row;
    j->rows[2 * r] = row_sum(row, below, w, norm);
    j->rows[2 * r + 1] = row_sum(row, row + 1, last, norm);
    if (!j->gradient)
        return;
    float *to = j->gradient + r * (size_t) w;
    add_pull(j, row, above, below, row, row + (w > 1), 1, norm, to);
    add_pull(j, row + 1, above + 1, below + 1, row, row + 2, w - 2, norm, to + 1);
    if (w > 1)
        add_pull(j, row + last, above + last, below + last, row + last - 1, row + last, 1, norm,
                 to + last);
}

/* Instantiates the loops once per norm. */
static void tv_row(void *arg, size_t r, int thread)
{
    (void) thread;
    const struct tv_job *j = arg;
    switch (j->norm) {
    case SG_TV_PENALTY_L2:
        row_of(j, r, SG_TV_PENALTY_L2);
        return;
    case SG_TV_PENALTY_L1:
        row_of(j, r, SG_TV_PENALTY_L1);
        return;
    default:
        row_of(j, r, SG_TV_PENALTY_HUBER);
    }
}

double sg_tv_loss(sg_ctx *ctx, const float *planes, int width, int height, enum sg_tv_penalty norm,
                  double weight, float *gradient, double *rows)
{
    const double vertical = 3.0 * (height - 1) * width, horizontal = 3.0 * height * (width - 1);
    struct tv_job j = {.planes = planes,
                       .gradient = gradient,
                       .width = width,
                       .height = height,
                       .vertical = vertical > 0 ? (float) (weight / vertical) : 0,
                       .horizontal = horizontal > 0 ? (float) (weight / horizontal) : 0,
                       .norm = norm,
                       .rows = rows};
    const size_t n = 3 * (size_t) height;
    double sums[2] = {0};
    sg_parallel_for(ctx, n, tv_row, &j);
    for (size_t r = 0; r < n; r++)
        sums[0] += rows[2 * r], sums[1] += rows[2 * r + 1];
    return (vertical > 0 ? sums[0] / vertical : 0) + (horizontal > 0 ? sums[1] / horizontal : 0);
}
