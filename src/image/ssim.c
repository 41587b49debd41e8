/* SPDX-License-Identifier: Apache-2.0 */
/* SSIM in double precision, a row at a time: moments down the columns, then along the row. */
#include <stdlib.h>
#include <string.h>

#include "math/real_f64.h"

#include "core/context.h"
#include "math/photometric.h"
#include "splatguard/eval.h"

#define MOMENTS 4

struct job {
    const uint8_t *a, *b;
    int width, height;
    double *rows; /* per output row: its sum */
    double *scratch;
};

static void accumulate(const struct job *j, int y, double weight, double *sums)
{
    for (int x = 0; x < 3 * j->width; x++) {
        const size_t at = 3 * (size_t) y * (size_t) j->width + (size_t) x;
        const double a = j->a[at] / 255.0, b = j->b[at] / 255.0;
        double *s = sums + MOMENTS * x;
        s[0] += weight * a, s[1] += weight * b;
        s[2] += weight * (a * a + b * b), s[3] += weight * a * b;
    }
}

static void row(void *arg, size_t y, int thread)
{
    const struct job *j = arg;
    const size_t columns = 3 * (size_t) j->width;
    double *sums = j->scratch + (size_t) thread * columns * MOMENTS, total = 0;
    memset(sums, 0, columns * MOMENTS * sizeof(*sums));
    for (int k = -SG_SSIM_RADIUS; k <= SG_SSIM_RADIUS; k++)
        if ((int) y + k >= 0 && (int) y + k < j->height)
            accumulate(j, (int) y + k, (double) sg_ssim_window[k + SG_SSIM_RADIUS], sums);
    for (int x = 0; x < j->width; x++)
        for (int ch = 0; ch < 3; ch++) {
            double m[MOMENTS] = {0};
            for (int k = -SG_SSIM_RADIUS; k <= SG_SSIM_RADIUS; k++) {
                if (x + k < 0 || x + k >= j->width)
                    continue;
                for (int i = 0; i < MOMENTS; i++)
                    m[i] += (double) sg_ssim_window[k + SG_SSIM_RADIUS] *
                            sums[MOMENTS * (3 * (x + k) + ch) + i];
            }
            total += ssim_point(m[0], m[1], m[2], m[3]).s;
        }
    j->rows[y] = total;
}

int sg_ssim_u8(sg_ctx *ctx, const uint8_t *a, const uint8_t *b, int width, int height, double *out)
{
    sg_clear_error(ctx);
    struct job j = {.a = a, .b = b, .width = width, .height = height};
    j.rows = sg_alloc_raw(ctx, SG_MEM_FRAME, (size_t) height, sizeof(double));
    j.scratch = sg_alloc_raw(ctx, SG_MEM_FRAME, 3 * (size_t) width * (size_t) sg_ctx_threads(ctx),
                             MOMENTS * sizeof(double));
    const int code = j.rows && j.scratch ? SG_OK : SG_ERR_BUDGET;
    if (!code) {
        sg_parallel_for(ctx, (size_t) height, row, &j);
        double sum = 0;
        for (int y = 0; y < height; y++)
            sum += j.rows[y];
        *out = sum / (3.0 * (double) width * (double) height);
    }
    sg_free(j.rows);
    sg_free(j.scratch);
    return code;
}
