/* SPDX-License-Identifier: Apache-2.0 */
/* What the tests of single operations share: the engines and variants of this machine, a view that
 * is compared with a photo, and comparisons with the oracle. */
#ifndef TESTS_ENGINE_OPERATIONS_H
#define TESTS_ENGINE_OPERATIONS_H

#include "models.h"

#define W 52
#define H 41
#define PIXELS ((size_t) W * H)
#define GAUSSIANS 150
#define DEGREE 2

static struct engine_case cases[ENGINE_CASES];
static int case_count;

static inline int find_cases(void **state)
{
    (void) state;
    case_count = engine_cases(cases);
    return 0;
}

static inline struct sg_engine *begin(sg_ctx *ctx, int k, const struct sg_model *m,
                                      const struct sg_columns *o)
{
    return make_engine(ctx, cases[k].engine, cases[k].variant, m, o);
}

/* Draws and compares with a target, whose photo is dropped after that. */
static inline struct sg_step step_against(struct sg_engine *e, const struct sg_model *m,
                                          const struct sg_camera *camera,
                                          const struct sg_target *target,
                                          const struct sg_loss *losses, size_t n)
{
    const struct sg_render_params params = {SG_RENDER_DEFAULTS, .background = {0.3f, 0.2f, 0.6f}};
    struct sg_step step;
    assert_int_equal(sg_engine_draw(e, camera, m->sh_degree, &params, false), SG_OK);
    assert_int_equal(sg_engine_losses(e, target, losses, n), SG_OK);
    assert_int_equal(sg_engine_read_step(e, &step), SG_OK);
    sg_engine_photo_drop(e, target->photo);
    return step;
}

/* Draws and compares with a random photo of values below `brightest`, by the first n of three
 * losses. exposure: see struct sg_target. */
static inline struct sg_step losses_against(struct sg_engine *e, const struct sg_model *m,
                                            const uint8_t *mask, size_t exposure, float brightest,
                                            size_t n)
{
    static uint8_t photo[3 * PIXELS];
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_loss losses[] = {
        {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}},
        {SG_LOSS_ANISOTROPY, 0.02, {.anisotropy = {SG_ANISOTROPY_DEFAULTS}}},
        {SG_LOSS_TOTAL_VARIATION, 3, {.total_variation = SG_TV_PENALTY_HUBER}},
    };
    struct sg_target target = {.exposure = exposure};
    for (size_t i = 0; i < 3 * PIXELS; i++)
        photo[i] = (uint8_t) draw(14, i, 0, brightest);
    assert_int_equal(sg_engine_photo_add(e, W, H, photo, mask, &target.photo), SG_OK);
    return step_against(e, m, &camera, &target, losses, n);
}

/* Gradients of all parameters after losses_against. */
static inline struct sg_model *gradients_of(sg_ctx *ctx, struct sg_engine *e,
                                            const struct sg_model *m)
{
    struct sg_model *g;
    assert_int_equal(sg_engine_raster_backward(e), SG_OK);
    assert_int_equal(sg_model_create(ctx, m->count, m->sh_degree, &g), SG_OK);
    assert_int_equal(sg_engine_read_gradients(e, g), SG_OK);
    return g;
}

static inline size_t values_of(const struct sg_model *m)
{
    return m->capacity * (size_t) sg_param_count(m->sh_degree);
}

/* Of all values at most a share may differ by more than `relative` of the largest of their
 * plane. */
static inline void assert_near(int k, const char *what, const struct sg_model *found,
                               const struct sg_model *expected, float relative, double share)
{
    const int planes = sg_param_count(expected->sh_degree);
    assert_int_equal(found->count, expected->count);
    for (int p = 0; p < planes; p++) {
        float largest = 0;
        size_t off = 0;
        for (size_t i = 0; i < expected->count; i++)
            largest = fmaxf(largest, fabsf(*sg_model_at(expected, i, p)));
        for (size_t i = 0; i < expected->count; i++)
            off += !(fabsf(*sg_model_at(found, i, p) - *sg_model_at(expected, i, p)) <=
                     relative * largest + 1e-9f);
        if ((double) off > share * (double) expected->count + 1e-9)
            fail_msg("%s: %s: plane %d: %zu of %zu values are off", case_name(cases[k]), what, p,
                     off, expected->count);
    }
}

#endif
