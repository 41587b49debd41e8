/* SPDX-License-Identifier: Apache-2.0 */
/* Total variation in the forms that an attack raises, of planes and of bytes. The gradient here is
 * the oracle's; kernels have that of math/total_variation.h. */
#include "total_variation.h"

#include "math/real_f64.h"
#include "math/total_variation.h"
#include "splatguard/attack.h"

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
        sum += j->form == SG_ATTACK_TV_VERTICAL2 ? 2 * tv_sign_term(v, h, false)
               : j->form == SG_ATTACK_TV_ANISO   ? tv_sign_term(v, h, true)
                                                 : tv_iso_term(v, h);
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
