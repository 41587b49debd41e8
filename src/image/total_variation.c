/* SPDX-License-Identifier: Apache-2.0 */
/* Total variation: the penalty on renders, and the forms that an attack raises, of planes and of
 * bytes. Scalar code; math/ascend.h has the gradient of the forms for kernels, and ref_losses.c
 * the penalty by definition. */
#include "total_variation.h"

#include <math.h>

#include "math/constants.h"
#include "splatguard/attack.h"

/* ---- the penalty ---- */

struct tv_job {
    const float *planes;
    float *gradient;
    int width, height;
    float vertical, horizontal; /* weight of a difference's gradient */
    enum sg_tv_penalty norm;
    double *rows; /* per row: vertical and horizontal sums */
};

#define LANES 16 /* pixels side by side, so that compilers may vectorise them */

/* d clamped to the edge. Without branches, so that compilers can vectorise the loops. */
static inline float cut(float d)
{
    return 0.5f * (fabsf(d + SG_TV_EDGE) - fabsf(d - SG_TV_EDGE));
}

static inline float norm_of(float d, enum sg_tv_penalty norm)
{
    return norm == SG_TV_PENALTY_L2   ? d * d
           : norm == SG_TV_PENALTY_L1 ? fabsf(d)
                                      : cut(d) * (2 * d - cut(d));
}

static inline float slope_of(float d, enum sg_tv_penalty norm)
{
    return norm == SG_TV_PENALTY_L2   ? 2 * d
           : norm == SG_TV_PENALTY_L1 ? (float) ((d > 0) - (d < 0))
                                      : 2 * cut(d);
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
        to[x] +=
            vertical * (slope_of(here[x] - above[x], norm) - slope_of(below[x] - here[x], norm)) +
            horizontal * (slope_of(here[x] - left[x], norm) - slope_of(right[x] - here[x], norm));
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

/* ---- the forms that an attack raises ---- */

static float sign(float v)
{
    return (float) ((v > 0) - (v < 0));
}

/* The difference to the next column, 0 where there is none. */
static float across(const float *row, int width, int i)
{
    return i + 1 < width ? row[i + 1] - row[i] : 0;
}

/* 1 / the root of pixel i's term. */
static float iso_weight(const float *row, const float *below, int width, int i)
{
    const float v = below[i] - row[i], h = across(row, width, i);
    return 1 / sqrtf(v * v + h * h + SG_TV_ISO_FLOOR);
}

void sg_tv_gradient_row(const float *plane, int width, int height, int y, enum sg_attack_tv form,
                        float *out)
{
    const float *row = plane + (size_t) y * (size_t) width;
    const float *above = y > 0 ? row - width : row,
                *below = y + 1 < height ? row + width : row; /* none: no difference */
    if (form == SG_ATTACK_TV_ISO) {
        for (int i = 0; i < width; i++) {
            const float own =
                -((below[i] - row[i]) + across(row, width, i)) * iso_weight(row, below, width, i);
            const float up = (row[i] - above[i]) * iso_weight(above, row, width, i);
            out[i] = own + up +
                     (i > 0 ? (row[i] - row[i - 1]) * iso_weight(row, below, width, i - 1) : 0);
        }
        return;
    }
    const float weight = form == SG_ATTACK_TV_VERTICAL2 ? 2 : 1;
    for (int i = 0; i < width; i++)
        out[i] = weight * (sign(row[i] - above[i]) + sign(row[i] - below[i]));
    if (form == SG_ATTACK_TV_ANISO)
        for (int i = 0; i < width; i++)
            out[i] += (i > 0 ? sign(row[i] - row[i - 1]) : 0) - sign(across(row, width, i));
}

struct variation {
    const float *planes;
    int width, height;
    enum sg_attack_tv form;
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
        const double v = (double) (below[i] - row[i]), h = (double) across(row, w, i);
        sum += j->form == SG_ATTACK_TV_VERTICAL2 ? 2 * fabs(v)
               : j->form == SG_ATTACK_TV_ANISO   ? fabs(v) + fabs(h)
                                                 : sqrt(v * v + h * h + (double) SG_TV_ISO_FLOOR);
    }
    j->rows[r] = sum;
}

double sg_tv_planes(sg_ctx *ctx, const float *planes, int width, int height, enum sg_attack_tv form,
                    double *rows)
{
    sg_parallel_for(ctx, 3 * (size_t) height, variation_row,
                    &(struct variation){planes, width, height, form, rows});
    double sum = 0;
    for (int r = 0; r < 3 * height; r++)
        sum += rows[r];
    return sum;
}

double sg_total_variation(const uint8_t *rgb, int width, int height, enum sg_attack_tv form)
{
    const size_t stride = 3 * (size_t) width;
    double sum = 0;
    for (int y = 0; y < height; y++)
        for (size_t i = 0; i < stride; i++) {
            const uint8_t *p = rgb + (size_t) y * stride + i;
            const double v = y + 1 < height ? p[stride] - p[0] : 0,
                         h = i + 3 < stride ? p[3] - p[0] : 0;
            sum += form == SG_ATTACK_TV_VERTICAL2 ? 2 * fabs(v)
                   : form == SG_ATTACK_TV_ANISO   ? fabs(v) + fabs(h)
                                                  : sqrt(v * v + h * h);
        }
    return sum / (double) (stride * (size_t) height);
}
