/* SPDX-License-Identifier: Apache-2.0 */
/* As many Gaussians in one tile as a hostile file may have, on every engine and variant. */
#include "operations.h"

#define N 100000
#define FAR 500        /* of them are behind all others, in the corner that is open */
#define WALL (9 * 224) /* in front */

static const struct sg_camera camera = {.width = W,
                                        .height = H,
                                        .fx = 20,
                                        .fy = 20,
                                        .cx = 8,
                                        .cy = 8,
                                        .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};

/* A Gaussian of less than a pixel, in the middle of one. */
static void place(struct sg_model *m, size_t i, int x, int y, float depth, float opacity)
{
    *sg_model_at(m, i, SG_P_XYZ) = ((float) x - 8) * depth / 20;
    *sg_model_at(m, i, SG_P_XYZ + 1) = ((float) y - 8) * depth / 20;
    *sg_model_at(m, i, SG_P_XYZ + 2) = depth;
    *sg_model_at(m, i, SG_P_OPACITY) = opacity;
    for (int axis = 0; axis < 3; axis++)
        *sg_model_at(m, i, SG_P_SCALE + axis) = -5;
}

/* All in one place, each opaque: the first few hide the others. */
static void pile(struct sg_model *m)
{
    for (size_t i = 0; i < N; i++) {
        place(m, i, 8, 8, 2, 3);
        for (int axis = 0; axis < 3; axis++)
            *sg_model_at(m, i, SG_P_SCALE + axis) = 1;
    }
}

/* Hidden behind a wall, but for a corner of the tile: what is there lies behind all the others, and
 * is faint. So the tile's list is walked to its end. The corner is a block of pixels with a list of
 * its own: Mesa's driver for the CPU ends all loops after 65535 passes. */
static void hide(struct sg_model *m)
{
    size_t wall = 0, far = 0;
    for (size_t i = 0; i < N; i++) {
        int at = (int) draw(61, i, 0, 223.99f);
        const bool in_wall = i % 17 == 0 && wall < WALL;
        if (in_wall)
            at = (int) (wall++ / 9);
        /* 12 rows of 16, and 4 of 8 */
        const int y = at < 192 ? at / 16 : 12 + (at - 192) / 8,
                  x = at < 192 ? at % 16 : (at - 192) % 8;
        if (!in_wall && i % 3 == 1 && far < FAR)
            place(m, i, 12, 14, 3.1f + 0.0001f * (float) far++, -4.5f);
        else
            place(m, i, x, y, in_wall ? 1 : draw(62, i, 2, 3), 3);
    }
    assert_true(wall == WALL && far == FAR);
}

/* Of all values at most a share may differ by more than `relative` of the largest of their plane:
 * at the wall's open corner a Gaussian of the end may be drawn or not. */
static void assert_near(int k, const char *what, const struct sg_model *found,
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

static void check(struct sg_model *m, float farthest)
{
    static float rgb[2][3 * PIXELS];
    static uint8_t photo[3 * PIXELS];
    const struct sg_loss loss = {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
    struct sg_model *right = NULL;
    sg_ctx *ctx = make_context(2);
    for (size_t i = 0; i < 3 * PIXELS; i++)
        photo[i] = (uint8_t) draw(14, i, 0, 255.9f);
    for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
        struct sg_engine *e = begin(ctx, k, m, NULL);
        struct sg_target target = {0};
        assert_int_equal(sg_engine_photo_add(e, W, H, photo, NULL, &target.photo), SG_OK);
        const struct sg_step step = step_against(e, m, &camera, &target, &loss, 1);
        assert_true(step.stats.max_tile == N && step.stats.visible == N);
        assert_int_equal(sg_engine_read_image(e, rgb[right != NULL], NULL, NULL), SG_OK);
        struct sg_model *g = gradients_of(ctx, e, m);
        sg_engine_destroy(&e);
        if (!right) {
            right = g;
            size_t drawn = 0;
            for (size_t i = 0; i < N; i++) {
                const float gradient = *sg_model_at(g, i, SG_P_OPACITY);
                drawn += gradient != 0;
                assert_true(*sg_model_at(m, i, SG_P_XYZ + 2) < farthest || gradient != 0);
            }
            assert_in_range(drawn, 3, N / 5);
            continue;
        }
        size_t off = 0;
        for (size_t i = 0; i < 3 * PIXELS; i++)
            off += !(fabsf(rgb[1][i] - rgb[0][i]) <= 1e-4f);
        if (off > 6)
            fail_msg("%s: %zu values are off", case_name(cases[k]), off);
        assert_near(k, "gradient", g, right, 2e-3f, 20.0 / N);
        sg_model_destroy(&g);
    }
    sg_model_destroy(&right);
    sg_ctx_destroy(&ctx);
}

static void test_pile(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, N, 0, 6);
    pile(m);
    check(m, INFINITY);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

static void test_wall(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, N, 0, 6);
    hide(m);
    check(m, 3.1f);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pile),
        cmocka_unit_test(test_wall),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
