/* SPDX-License-Identifier: Apache-2.0 */
/* Whether an engine computes on this machine what the CPU engine does. Drivers of GPUs have faults,
 * and one that nobody has named is only used where it draws and learns a small model as the CPU. */
#include "registry.h"

#include <math.h>

#include "core/rng.h"
#include "ops.h"

#define GAUSSIANS 60
#define DEGREE 1
#define WIDTH 50 /* with tiles that are not whole */
#define HEIGHT 37
#define PIXELS ((size_t) WIDTH * HEIGHT)
/* Exponentials of drivers differ in the last digits; a fault makes more. */
#define IMAGE_ERROR 1e-3
#define GRADIENT_ERROR 1e-2 /* of the largest */

/* What an engine has made of the model. */
struct trial {
    float rgb[3 * PIXELS];
    struct sg_model *gradients;
};

static float random_in(size_t gaussian, int parameter, float low, float high)
{
    return low + (high - low) * sg_rng_uniform(1, SG_RNG_SYNTH, gaussian, (uint64_t) parameter);
}

/* Before a camera that looks along z. */
static int make_model(sg_ctx *ctx, struct sg_model **out)
{
    const int code = sg_model_create(ctx, GAUSSIANS, DEGREE, out);
    for (size_t i = 0; i < GAUSSIANS && !code; i++)
        for (int p = 0; p < sg_param_count(DEGREE); p++)
            *sg_model_at(*out, i, p) = p < SG_P_OPACITY    ? random_in(i, p, -1, 1)
                                       : p == SG_P_OPACITY ? random_in(i, p, -3, 4)
                                       : p < SG_P_ROT      ? random_in(i, p, -3.5f, -1.2f)
                                                           : random_in(i, p, -1, 1);
    return code;
}

static int run(struct sg_engine *e, const struct sg_model *m, const uint8_t *photo,
               struct trial *out)
{
    const struct sg_camera camera = {.width = WIDTH,
                                     .height = HEIGHT,
                                     .fx = WIDTH,
                                     .fy = WIDTH,
                                     .cx = 0.5 * WIDTH,
                                     .cy = 0.5 * HEIGHT,
                                     .R = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                     .t = {0, 0, 2.5}};
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    const struct sg_loss loss = {
        .kind = SG_LOSS_PHOTOMETRIC, .weight = 1, .photometric = {.lambda_dssim = 0.2f}};
    struct sg_target target = {0};
    struct sg_step step;
    int code = sg_engine_upload(e, m, NULL);
    if (code || (code = sg_engine_photo_add(e, WIDTH, HEIGHT, photo, NULL, &target.photo)))
        return code;
    if (!(code = sg_engine_draw(e, &camera, DEGREE, &params, false)) &&
        !(code = sg_engine_read_image(e, out->rgb, NULL, NULL)) &&
        !(code = sg_engine_losses(e, &target, &loss, 1)) &&
        !(code = sg_engine_raster_backward(e)) && !(code = sg_engine_project_backward(e, false)) &&
        !(code = sg_engine_read_gradients(e, out->gradients)))
        code = sg_engine_read_step(e, &step);
    sg_engine_photo_drop(e, target.photo);
    return code;
}

/* NaN is far from everything. */
static bool is_near(double a, double b, double most)
{
    return fabs(a - b) <= most;
}

static int compare(sg_ctx *ctx, const char *name, const struct trial *found,
                   const struct trial *expected)
{
    double largest = 0;
    for (size_t i = 0; i < 3 * PIXELS; i++)
        if (!is_near(found->rgb[i], expected->rgb[i], IMAGE_ERROR))
            return sg_fail(ctx, SG_ERR_INTERNAL,
                           "%s: found %g as value %zu of a test image, expected %g", name,
                           found->rgb[i], i, expected->rgb[i]);
    for (size_t i = 0; i < GAUSSIANS; i++)
        for (int p = 0; p < sg_param_count(DEGREE); p++)
            largest = fmax(largest, fabs((double) *sg_model_at(expected->gradients, i, p)));
    for (size_t i = 0; i < GAUSSIANS; i++)
        for (int p = 0; p < sg_param_count(DEGREE); p++) {
            const double a = *sg_model_at(found->gradients, i, p),
                         b = *sg_model_at(expected->gradients, i, p);
            if (!is_near(a, b, GRADIENT_ERROR * largest))
                return sg_fail(ctx, SG_ERR_INTERNAL,
                               "%s: found %g as gradient of parameter %d of Gaussian %zu of a test "
                               "model, expected %g",
                               name, a, p, i, b);
        }
    return SG_OK;
}

int sg_engine_try(struct sg_engine *candidate)
{
    sg_ctx *ctx = candidate->ctx;
    struct sg_engine *cpu = NULL;
    struct sg_model *m = NULL;
    struct trial *t = sg_alloc(ctx, SG_MEM_MISC, 2, sizeof(*t));
    uint8_t *photo = sg_alloc_raw(ctx, SG_MEM_MISC, 3 * PIXELS, 1);
    int code = t && photo ? make_model(ctx, &m) : SG_ERR_BUDGET;
    for (size_t i = 0; i < 3 * PIXELS && !code; i++)
        photo[i] = (uint8_t) (i * 7 % 251);
    for (int k = 0; k < 2 && !code; k++)
        code = sg_model_create(ctx, GAUSSIANS, DEGREE, &t[k].gradients);
    if (!code && !(code = sg_engine_create(ctx, "cpu", NULL, &cpu)) &&
        !(code = run(candidate, m, photo, &t[0])) && !(code = run(cpu, m, photo, &t[1])))
        code = compare(ctx, sg_engine_variant(candidate), &t[0], &t[1]);
    sg_engine_destroy(&cpu);
    for (int k = 0; k < 2 && t; k++)
        sg_model_destroy(&t[k].gradients);
    sg_model_destroy(&m);
    sg_free(photo);
    sg_free(t);
    return code;
}
