/* SPDX-License-Identifier: Apache-2.0 */
#include "check.h"

#include "image/total_variation.h"

#define MOST (3 * 70 * 23)

/* A step on random images. Rounding may decide the sign of a gradient of nearly 0, but not where
 * whole numbers are added. */
static void check_step(const struct cpu_kernels *k, sg_ctx *ctx, struct sg_ascend *a, size_t n)
{
    static float found[MOST], expected[MOST];
    a->to = expected;
    sg_ref_ascend(ctx, a);
    a->to = found;
    for (size_t row = 0; row < 3 * (size_t) a->height; row++)
        k->ascend(a, row);
    size_t off = 0;
    for (size_t i = 0; i < n; i++)
        off += fabsf(found[i] - expected[i]) > 1e-6f;
    if (off > (a->form == SG_ATTACK_TV_ISO ? 1 + n / 500 : 0))
        fail_msg("%s: %d x %d, form %d: %zu of %zu values differ", k->name, a->width, a->height,
                 a->form, off, n);
}

static void check(const struct cpu_kernels *k)
{
    static const int sizes[][2] = {{1, 1}, {3, 9}, {15, 4}, {16, 1}, {17, 23}, {33, 8}, {70, 23}};
    sg_ctx *ctx = make_context(1);
    float *photo = random_floats(MOST, 71, 0, 1), *from = random_floats(MOST, 72, 0, 1),
          *bound = random_floats(MOST, 73, 0, 0.05f), *extra = random_floats(MOST, 74, -2, 2);
    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++)
        for (int option = 0; option < 12; option++) {
            struct sg_ascend a = {.epsilon = 0.06f,
                                  .step = 0.02f,
                                  .form = (enum sg_attack_tv)(option % 3),
                                  .width = sizes[s][0],
                                  .height = sizes[s][1],
                                  .photo = photo,
                                  .from = from,
                                  .bound = option / 3 % 2 ? bound : NULL,
                                  .extra = option / 6 ? extra : NULL};
            check_step(k, ctx, &a, 3 * (size_t) a.width * (size_t) a.height);
        }
    free(photo), free(from), free(bound), free(extra);
    sg_ctx_destroy(&ctx);
}

static double bench(const struct cpu_kernels *k)
{
    enum { W = 400, H = 16, VALUES = 3 * W * H };
    sg_ctx *ctx = make_context(1);
    float *photo = random_floats(VALUES, 71, 0, 1), *from = random_floats(VALUES, 72, 0, 1),
          *to = must(VALUES, sizeof(float));
    const struct sg_ascend a = {.epsilon = 0.06f,
                                .step = 0.02f,
                                .form = SG_ATTACK_TV_ISO,
                                .width = W,
                                .height = H,
                                .photo = photo,
                                .from = from,
                                .to = to};
    struct timing t = {0};
    while (timing_again(&t))
        if (!k)
            sg_ref_ascend(ctx, &a);
        else
            for (size_t row = 0; row < 3 * H; row++)
                k->ascend(&a, row);
    free(photo), free(from), free(to);
    sg_ctx_destroy(&ctx);
    return timing_result(&t, VALUES / 3);
}

const struct kernel_check check_ascend = {"ascend", "pixel", false, check, bench};
