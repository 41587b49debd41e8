/* SPDX-License-Identifier: Apache-2.0 */
/* What the tests of single operations share: the engines and variants of this machine, a view that
 * is compared with a photo, and comparisons with the oracle. */
#ifndef TESTS_ENGINE_OPERATIONS_H
#define TESTS_ENGINE_OPERATIONS_H

#include "edges.h"
#include "engine_cases.h"
#include "parity.h"

#define W 52
#define H 41
#define PIXELS ((size_t) W * H)
#define GAUSSIANS 150
#define DEGREE 2

static inline struct sg_engine *begin(sg_ctx *ctx, int k, const struct sg_model *m,
                                      const struct sg_columns *o)
{
    return make_engine(ctx, cases[k].engine, cases[k].variant, m, o);
}

/* A model that no engine draws otherwise by rounding: see find_edges. */
static inline struct sg_model *make_sure_model(sg_ctx *ctx, uint64_t seed)
{
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, seed);
    const struct sg_camera camera = make_camera(W, H, 3);
    const struct sg_render_params params = {SG_RENDER_DEFAULTS};
    assert_int_equal(find_edges(m, &camera, &params, 1e-3, NULL), 0);
    return m;
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

#endif
